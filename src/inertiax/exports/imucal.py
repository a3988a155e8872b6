"""imucal's JSON: constant matrices of both triads, with the gyros' g-sensitivity.

imucal applies a = R_a⁻¹ K_a⁻¹ (a' − b_a) and ω = R_g⁻¹ K_g⁻¹ (ω' − K_ga a − b_g), with K diagonal, R with
rows of unit length, in m/s² and deg/s: equation (3) exactly, at one temperature.

**Reference:** Küderle et al., *imucal - A Python library to calibrate 6 DOF IMUs*, JOSS 7(73), 2022.
"""

import json
import math

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration
from ..storage.wrong_value import WrongValue
from .export import Export, OneTemperature
from .imported import calibration as imported, numbers, triad
from .parameters import chosen_temperature, constants_loss, parameters_at


NAME = "imucal"
TITLE = "imucal's JSON (Ferraris or turntable calibration)"
SUFFIX = ".imucal.json"
KEEPS = "bias, full matrices, g-sensitivity; one temperature"
LOSES = "temperature dependence, uncertainties"

_DEGREE = math.pi / 180


class Settings(OneTemperature, frozen=True, kw_only=True):
    """`cal_type` is "Ferraris" or "Turntable", which imucal looks files up by."""

    cal_type: str = "Ferraris"
    comment: str = ""


def write(calibration: Calibration, settings: Settings) -> Export:
    """imucal's file of the parameters at `settings.temperature`, °C."""
    if settings.cal_type not in ("Ferraris", "Turntable"):
        raise WrongValue(
            f"imucal: cal_type = '{settings.cal_type}' must be 'Ferraris' or 'Turntable'."
        )
    temperature = chosen_temperature(calibration, settings.temperature)
    p = parameters_at(calibration, temperature)
    k_a, r_a = _scale_and_rotation(p.accel_matrix)
    k_g, r_g = _scale_and_rotation(p.gyro_matrix)
    content = {
        "acc_unit": "m/s^2",
        "gyr_unit": "deg/s",
        "from_acc_unit": "m/s^2",
        "from_gyr_unit": "deg/s",
        "comment": settings.comment or f"inertiax, parameters at {temperature:g} degC",
        "K_a": k_a.tolist(),
        "R_a": r_a.tolist(),
        "b_a": p.accel_bias.tolist(),
        "K_g": k_g.tolist(),
        "R_g": r_g.tolist(),
        "K_ga": (p.gyro_by_force / _DEGREE).tolist(),
        "b_g": (p.gyro_bias / _DEGREE).tolist(),
        "cal_type": settings.cal_type,
        "_format_version": "2.0.0",
    }
    return Export(
        files=(("", json.dumps(content, indent=4).encode() + b"\n"),),
        applied=lambda accel, gyro, _: _apply(content, accel, gyro),
        losses=constants_loss(calibration, temperature),
        notes=("imucal takes rates in deg/s: convert the gyro outputs before it",),
    )


def _scale_and_rotation(
    matrix: Float[np.ndarray, "3 3"],
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
    """M = K R, K diagonal with the lengths of M's rows."""
    length = np.linalg.norm(matrix, axis=1)
    return np.diag(length), matrix / length[:, None]


def _apply(content: dict, accel: np.ndarray, gyro: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    get = lambda key: np.asarray(content[key])
    inverse = lambda r, k: np.linalg.inv(get(r)) @ np.linalg.inv(get(k))
    force = (accel - get("b_a")) @ inverse("R_a", "K_a").T
    offset = force @ get("K_ga").T + get("b_g")
    return force, _DEGREE * (gyro / _DEGREE - offset) @ inverse("R_g", "K_g").T


def read(content: bytes, *, gravity: float = 9.80665) -> Calibration:
    """The calibration in imucal's file; its rates may be in deg/s or rad/s, its forces in m/s².

    Raises `ValueError` for raw units that imucal knows and we do not (such as counts, "a.u.").
    """
    said = json.loads(content)
    unit = {"deg/s": _DEGREE, "rad/s": 1.0}
    found = [said.get(k) for k in ("acc_unit", "from_acc_unit", "gyr_unit", "from_gyr_unit")]
    if found[:2] != ["m/s^2"] * 2 or found[2] not in unit or found[3] not in unit:
        raise ValueError(
            f"imucal: units acc_unit, from_acc_unit, gyr_unit, from_gyr_unit are {found}; m/s^2 and "
            "deg/s or rad/s are needed, so calibrate data in those units."
        )
    get = lambda key, *shape: numbers(said.get(key), shape, f"imucal: {key}")
    # Raw rates are in from_gyr_unit, calibrated ones in gyr_unit.
    raw, calibrated = unit[found[3]], unit[found[2]]
    d = raw * gravity * get("K_ga", 3, 3)
    return imported(
        triad("accel", get("K_a", 3, 3) @ get("R_a", 3, 3), get("b_a", 3), source=NAME),
        triad(
            "gyro",
            raw / calibrated * get("K_g", 3, 3) @ get("R_g", 3, 3),
            raw * get("b_g", 3),
            d,
            source=NAME,
        ),
        gravity=gravity,
    )
