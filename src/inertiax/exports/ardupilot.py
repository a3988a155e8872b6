"""ArduPilot's parameters: thermal `INS_TCAL*` and static `INS_*OFFS`, `INS_ACCSCAL`; `COMPASS_*` of magnetometers.

ArduPilot corrects v = v' − P(T − 35) + P(T_cal − 35), then subtracts the offset that holds at T_cal, then
(accelerometers only) multiplies by a scale; P is a cubic without constant term, its coefficients times 10⁶,
and T is clamped to TMIN…TMAX. One switch turns P on for both triads; of a triad whose bias does not depend on
temperature P is zero. Compasses (mgauss) have no temperature: S (m' + OFS) SCALE + MOT · A, S symmetric: the motors'
part comes after the matrix, "calculated based on final field outputs, not on the raw outputs", so it is −S c. Their
axes are the vehicle's: COMPASS_ORIENT, or AHRS_ORIENTATION inside of the board, has turned m' before.

**Reference:** ArduPilot, `AP_InertialSensor_tempcal.cpp` and `AP_InertialSensor_Backend.cpp`,
`AP_Compass_Backend.cpp` (`rotate_field`, `correct_field`).
"""

import re
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration
from ..calibration.magnetometers import MagnetometerCalibration
from ..physics.temperature import Constant, Polynomial
from .cubic import bias_curve, cubic, moves, nodes
from .export import AppliedField, Export, Settings as Common
from .imported import calibration as imported, triad
from .magnetometer_parameters import field_span, GAUSS, symmetric_field
from .parameters import axis_by_axis_loss, HELD, parameters_over, temperature_span
from .slot import slot_of


NAME = "ardupilot"
MAGNETOMETERS = True  # are held
TITLE = "ArduPilot's parameters (INS_TCAL*, INS_*OFFS, INS_ACCSCAL)"
SUFFIX = ".parm"
KEEPS = (
    "bias as a cubic in temperature, accelerometer scale factors (constants); magnetometers at one temperature: "
    "hard iron, soft iron, the battery current's field"
)
LOSES = (
    "misalignments, gyro scale factors, temperature dependence of scale and of the magnetometers, degrees above 3, "
    "g-sensitivity, the magnetometers' rotation, uncertainties"
)

_REFERENCE = 35.0  # °C
_FACTOR = 1e6
_MGAUSS = 1e3 * GAUSS  # in a T


class Settings(Common, frozen=True, kw_only=True):
    """Which of ArduPilot's IMUs this is."""

    instance: int | None = None  # 1 to 3; by default that of the log's device, where `imu0` is 1


def _number(instance: int) -> str:
    """The IMU's number in names such as INS_ACC2OFFS_X; the first has none."""
    return "" if instance == 1 else str(instance)


def write(calibration: Calibration, settings: Settings) -> Export:
    """ArduPilot's parameter file of both triads."""
    slot = slot_of(calibration, settings.instance, controller="ardupilot", first=1, last=3)
    low, high = temperature_span(calibration)
    at = float(np.clip(_REFERENCE, low, high))
    accel, gyro, scale = _fits(calibration, low, high)
    thermal = any(fit[1:].any() for fit in (accel, gyro))
    there = np.array([at - _REFERENCE])

    def applied(a: np.ndarray, w: np.ndarray, temperature: np.ndarray):
        d = np.clip(temperature, low, high) - _REFERENCE

        def one(x: np.ndarray, fit: np.ndarray):
            c = _unscaled(fit)
            c[0] = 0.0
            return x - cubic(c, d) + cubic(c, there)[0] - _offset(fit, at)

        return one(a, accel) * scale, one(w, gyro)

    present = {"ACC": calibration.accel is not None, "GYR": calibration.gyro is not None}
    lines = _lines(slot.number, accel, gyro, scale, (low, high, at), present)
    field: _Compass | None = None
    if calibration.mag is not None:
        span = field_span(calibration.mag, low, high)
        field = _compass(slot.number, calibration.mag, *span)
        lines += field.lines
    return Export(
        files=(("", "\n".join(lines).encode() + b"\n"),),
        applied=applied,
        applied_field=None if field is None else field.applied,
        losses=(*axis_by_axis_loss(calibration), *(() if field is None else field.losses)),
        notes=(
            *slot.notes,
            *((HELD.format(name="ArduPilot"),) if thermal else ()),
            "ArduPilot takes an accelerometer calibration only with the sensor's own INS_ACC_ID, and "
            "learns gyro offsets anew at each start unless INS_GYR_CAL is 0",
            *_axes(calibration),
        ),
    )


def _axes(calibration: Calibration) -> tuple[str, ...]:
    """The axes that ArduPilot applies the file in, of what was calibrated."""
    notes = []
    if calibration.accel is not None or calibration.gyro is not None:
        notes.append(
            "axes of accelerometers and gyros must be the sensor's own after its mounting rotation, before the "
            "board's (AHRS_ORIENTATION)"
        )
    if calibration.mag is not None:
        notes.append(
            "axes of the compass must be the vehicle's, after COMPASS_ORIENT (a compass outside of the board) or "
            "AHRS_ORIENTATION, as in a log's MAG messages"
        )
    return tuple(notes)


def _lines(
    n: int,
    accel: Float[np.ndarray, "4 3"],
    gyro: Float[np.ndarray, "4 3"],
    scale: Float[np.ndarray, "3"],
    temperatures: tuple[float, float, float],
    present: dict[str, bool],
) -> list[str]:
    """The lines of what was calibrated; the rest keeps what the autopilot has."""
    if not any(present.values()):
        return []
    low, high, at = temperatures
    thermal = any(fit[1:].any() for fit in (accel, gyro))
    values = {f"INS_TCAL{n}_TMIN": low, f"INS_TCAL{n}_TMAX": high} if thermal else {}
    for key, fit in (("ACC", accel), ("GYR", gyro)):
        if not present[key]:
            continue
        offset = _offset(fit, at)
        for axis, name in enumerate("XYZ"):
            for order in (1, 2, 3) if thermal else ():
                values[f"INS_TCAL{n}_{key}{order}_{name}"] = fit[order, axis]
            values[f"INS_{key}{_number(n)}OFFS_{name}"] = offset[axis]
        values[f"INS_{key}{n}_CALTEMP"] = at
    for axis, name in enumerate("XYZ" if present["ACC"] else ""):
        values[f"INS_ACC{_number(n)}SCAL_{name}"] = scale[axis]
    lines = [f"{name} {float(value):.9g}" for name, value in values.items()]
    return [f"INS_TCAL{n}_ENABLE {int(thermal)}", *lines]


class _Compass(NamedTuple):
    """The magnetometers' lines, what ArduPilot makes of outputs with them, and what they lose."""

    lines: list[str]
    applied: AppliedField
    losses: tuple[str, ...]


def _compass(n: int, mag: MagnetometerCalibration, low: float, high: float) -> _Compass:
    """The magnetometers in mgauss, at the temperature between `low` and `high` (°C) nearest to 35."""
    at = float(np.clip(_REFERENCE, low, high))
    found, over = (symmetric_field(mag, t) for t in (np.array([at]), nodes(low, high)))
    values = {
        "OFS": -_MGAUSS * found.bias[0],
        "DIA": np.diagonal(found.scale),
        "ODI": found.scale[(0, 0, 1), (1, 2, 2)],
    }
    lines = [f"COMPASS_SCALE{_number(n)} 1"]  # what the vehicle has would multiply the matrix
    if found.current.any():
        values["MOT"] = -_MGAUSS * found.scale @ found.current
        lines.append("COMPASS_MOTCT 2")  # by the battery's current
    held = {key: _single(given) for key, given in values.items()}
    for key, given in held.items():
        names = [f"COMPASS_{key}{_number(n)}_{axis}" for axis in "XYZ"]
        lines += [f"{name} {float(v):.9g}" for name, v in zip(names, given, strict=True)]
    losses = over.losses
    if moves(over.bias):
        losses = (*losses, f"temperature dependence of the hard iron: it is that at {at:g} °C")

    def applied(m: np.ndarray, temperature: np.ndarray, current: np.ndarray):
        (x, y, z), (xy, xz, yz) = held["DIA"], held["ODI"]
        elliptical = np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]])
        corrected = (_MGAUSS * m + held["OFS"]) @ elliptical.T
        return (corrected + np.outer(current, held.get("MOT", np.zeros(3)))) / _MGAUSS

    return _Compass(lines, applied, losses)


def _offset(fit: Float[np.ndarray, "4 3"], at: float) -> Float[np.ndarray, "3"]:
    """The bias at a temperature, °C, in ArduPilot's single precision."""
    return _single(cubic(_unscaled(fit), np.array([at - _REFERENCE]))[0])


def _single(x: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
    """The numbers as ArduPilot's single precision holds them."""
    return x.astype(np.float32).astype(float)


def _unscaled(fit: Float[np.ndarray, "4 3"]) -> Float[np.ndarray, "4 3"]:
    return fit / np.array([[1.0], [_FACTOR], [_FACTOR], [_FACTOR]])


def _fits(
    calibration: Calibration, low: float, high: float
) -> tuple[Float[np.ndarray, "4 3"], Float[np.ndarray, "4 3"], Float[np.ndarray, "3"]]:
    """Bias cubics about 35 °C (the higher terms times 10⁶) and the scale, in single precision."""
    p = parameters_over(calibration, nodes(low, high))
    fit = lambda values: bias_curve(values, low, high, _REFERENCE).coefficients
    scale = np.diagonal(np.linalg.inv(p.accel_matrix), axis1=1, axis2=2)
    scale = 0.5 * (scale.min(axis=0) + scale.max(axis=0))
    times = np.array([[1.0], [_FACTOR], [_FACTOR], [_FACTOR]])
    return _single(times * fit(p.accel_bias)), _single(times * fit(p.gyro_bias)), _single(scale)


_LINE = re.compile(r"([A-Z0-9_]+)[\s,=]+([-+0-9.eE]+)")


def read(content: bytes, *, instance: int = 1) -> Calibration:
    """The calibration in a `.parm` file: thermal and static offsets and accelerometer scales.

    Compasses are not read: the file does not say which field they are scaled to.
    """
    n = instance
    found: dict[str, float] = {}
    for line in content.decode().splitlines():
        match = _LINE.fullmatch(line.strip())
        if match:
            found[match[1]] = float(match[2])
    get = lambda name: np.array([found.get(f"INS_{name}_{axis}", 0.0) for axis in "XYZ"])
    if not any(k.startswith((f"INS_TCAL{n}_", f"INS_ACC{_number(n)}OFFS")) for k in found):
        raise ValueError(f"ardupilot: no INS_TCAL{n}_* or INS_ACC{_number(n)}OFFS_* in the file.")
    low, high = (found.get(f"INS_TCAL{n}_{k}", 0.0) for k in ("TMIN", "TMAX"))
    thermal = found.get(f"INS_TCAL{n}_ENABLE", 0.0) == 1 and high > low
    basis = Polynomial(3, low, high) if thermal else Constant()
    at = np.asarray(basis.nodes)
    triads = []
    for kind, key in (("accel", "ACC"), ("gyro", "GYR")):
        bias = np.broadcast_to(get(f"{key}{_number(n)}OFFS"), (len(at), 3))
        if thermal:
            higher = [get(f"TCAL{n}_{key}{order}") / _FACTOR for order in (1, 2, 3)]
            c = np.stack([np.zeros(3), *higher])
            when = np.clip(found.get(f"INS_{key}{n}_CALTEMP", _REFERENCE), low, high)
            bias = bias + cubic(c, at - _REFERENCE) - cubic(c, np.array([when - _REFERENCE]))
        scale = np.ones(3)
        if kind == "accel" and f"INS_ACC{_number(n)}SCAL_X" in found:
            scale = get(f"ACC{_number(n)}SCAL")
        matrix = np.broadcast_to(np.diag(1.0 / scale), (len(at), 3, 3))
        triads.append(triad(kind, matrix, bias, basis=basis, source=NAME))
    span = (low, high) if thermal else None
    compass = any(k.startswith("COMPASS_") for k in found)
    notes = ("the compasses in the file (COMPASS_*) are not read",) if compass else ()
    return imported(triads[0], triads[1], temperature_range=span, notes=notes)
