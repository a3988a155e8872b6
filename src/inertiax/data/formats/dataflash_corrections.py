"""What ArduPilot did to the values of a log, by the log's own parameters (`PARM`), taken away again.

An `IMU` message holds (x − P(T − 35) + P(T_cal − 35) − offset) · scale in the sensor's axes (gyros without a scale),
turned by AHRS_ORIENTATION; a `MAG` message M SCALE (m + offset) + motor in the vehicle's axes. P is a cubic without
constant term, coefficients times 10⁶, T clamped to TMIN…TMAX, on where INS_TCAL_ENABLE is 1. A parameter that is set
anew counts from its message on.

**Reference:** ArduPilot, `AP_InertialSensor_Backend.cpp` (`_rotate_and_correct_accel`, `_rotate_and_correct_gyro`),
`AP_InertialSensor_tempcal.cpp` (`correct_sensor`), `AP_Compass_Backend.cpp` (`correct_field`).
"""

from typing import NamedTuple

import numpy as np
import polars as pl
from jaxtyping import Float

from ..compensated import WRONG_PARAMETERS
from .columns import AXES


PARAMETERS = "PARM"
_REFERENCE = 35.0  # °C
_FACTOR = 1e6
_COLDEST, _WARMEST = 0.0, 70.0  # °C, TMIN and TMAX where they were never set
_NO_CALTEMP = -300.0  # °C, likewise: clamped to TMIN
_LEAST_SCALE, _MOST_SCALE = 1.0 / 1.5, 1.5  # COMPASS_SCALE outside of these is none
_LATEST_OLD_NAME = 3  # IMUs from the fourth on have parameters of their own form, INS4_ACCOFFS_X


class Parameters:
    """The `PARM` messages of a log: each parameter's values, and from when they hold."""

    def __init__(self, found: list[tuple[str, dict[str, np.ndarray]]], stamps: dict[str, float]):
        self._told: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for name, fields in found:
            if name != PARAMETERS or not {"Name", "Value"} <= fields.keys():
                continue
            if fields["Name"].dtype.kind != "S" or fields["Value"].dtype.kind not in "fiu":
                continue
            stamp = next((t for t in stamps if t in fields), None)
            count = len(fields["Name"])
            # Without a stamp they are of the log's beginning.
            when = np.full(count, -np.inf) if stamp is None else stamps[stamp] * fields[stamp]
            names, number = np.unique(fields["Name"], return_inverse=True)
            order = np.argsort(number, kind="stable")
            ends = np.searchsorted(number[order], np.arange(1, len(names)))
            for one, mine in zip(names, np.split(order, ends), strict=True):
                key = one.decode("ascii", "replace")
                before = self._told.get(key, (np.zeros(0), np.zeros(0)))
                values = fields["Value"][mine].astype(float)
                self._told[key] = (
                    np.concatenate([before[0], when[mine]]),
                    np.concatenate([before[1], values]),
                )

    def __bool__(self) -> bool:
        return bool(self._told)

    def at(
        self, name: str, time: Float[np.ndarray, " rows"], default: float
    ) -> Float[np.ndarray, " rows"]:
        """A parameter's value at each time, s: the latest one told, before the first one that."""
        if name not in self._told:
            return np.full(len(time), default)
        when, values = self._told[name]
        order = np.argsort(when, kind="stable")
        row = np.searchsorted(when[order], time, side="right") - 1
        return np.where(np.isfinite(v := values[order][np.maximum(row, 0)]), v, default)

    def triad(
        self, prefix: str, time: Float[np.ndarray, " rows"], default: float
    ) -> Float[np.ndarray, "rows 3"]:
        """Those of three axes."""
        return np.stack([self.at(f"{prefix}_{a.upper()}", time, default) for a in AXES], axis=1)


class Uncorrected(NamedTuple):
    """Outputs as the sensors gave them, and what is to be said of them."""

    table: pl.DataFrame
    undone: tuple[str, ...]  # parameters' names whose effect was taken away
    doubts: tuple[str, ...]  # in words: what could not be


def uncorrected(table: pl.DataFrame, parameters: Parameters, instance: int) -> Uncorrected:
    """The outputs of IMU `instance` (from 0) before ArduPilot corrected them; of a table in SI with stamps."""
    time, said, doubts, made = table["time"].to_numpy(), [], [], []
    probe = table["temperature"].to_numpy() if "temperature" in table.columns else None
    turned = bool(parameters.at("AHRS_ORIENTATION", time, 0.0).any())
    for triad in ("accel", "gyro"):
        names = _names(instance + 1, triad)
        offset = parameters.triad(names.offset, time, 0.0)
        scale = np.ones_like(offset)
        if triad == "accel":
            scale = parameters.triad(names.scale, time, 1.0)
            scale = np.where(scale == 0.0, 1.0, scale)
        thermal, lacking = _thermal(parameters, names, time, probe)
        active = [names.offset] * bool(offset.any()) + [names.scale] * bool((scale != 1.0).any())
        active += [names.thermal] * (thermal is not None or lacking)
        if lacking or (turned and active):
            turning, cold = "AHRS_ORIENTATION turned them afterwards", "the log has no temperature"
            doubts.append(
                f"its {triad} values are after {', '.join(active)}, which cannot be taken away, for "
                f"{turning if turned else cold}: {WRONG_PARAMETERS}. Log with these at their defaults."
            )
            continue
        columns = [f"{triad}_{a}" for a in AXES]
        raw = table.select(columns).to_numpy() / scale + offset
        raw = raw if thermal is None else raw + thermal
        made += [pl.Series(c, raw[:, k]) for k, c in enumerate(columns)] if active else []
        said += active
    if turned and not doubts:
        doubts.append(
            "its accelerometers and gyros are in the vehicle's axes, by AHRS_ORIENTATION, where INS_* are in the "
            f"sensor's: {WRONG_PARAMETERS}. Log with AHRS_ORIENTATION 0."
        )
    return Uncorrected(table.with_columns(made), tuple(said), tuple(doubts))


def field_uncorrected(
    field: Float[np.ndarray, "rows 3"],
    time: Float[np.ndarray, " rows"],
    parameters: Parameters,
    instance: int,
) -> tuple[Float[np.ndarray, "rows 3"], tuple[str, ...]]:
    """M⁻¹ (m / SCALE) of a compass' field without its motor's part, `instance` from 0, and the parameters' names."""
    number = "" if instance == 0 else str(instance + 1)
    diagonal = parameters.triad(f"COMPASS_DIA{number}", time, 1.0)
    diagonal[~diagonal.any(axis=1)] = 1.0  # as ArduPilot takes zeros
    beside = parameters.triad(f"COMPASS_ODI{number}", time, 0.0)
    scale = parameters.at(f"COMPASS_SCALE{number}", time, 1.0)
    scale = np.where((scale >= _LEAST_SCALE) & (scale <= _MOST_SCALE), scale, 1.0)
    active = ["DIA"] * bool((diagonal != 1.0).any()) + ["ODI"] * bool(beside.any())
    active += ["SCALE"] * bool((scale != 1.0).any())
    if not active:
        return field, ()
    matrix = diagonal[:, :, None] * np.eye(3)
    for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        matrix[:, i, j] = matrix[:, j, i] = beside[:, k]
    matrix = scale[:, None, None] * matrix
    if not np.all(np.abs(np.linalg.det(matrix)) > 1e-6):  # no matrix of a compass
        return field, ()
    return np.linalg.solve(matrix, field[:, :, None])[:, :, 0], tuple(
        f"COMPASS_{a}{number}" for a in active
    )


class _Names(NamedTuple):
    """A triad's parameters, without the axis."""

    offset: str
    scale: str
    calibrated_at: str
    thermal: str
    orders: tuple[str, str, str]


def _names(number: int, triad: str) -> _Names:
    key = "ACC" if triad == "accel" else "GYR"
    if number > _LATEST_OLD_NAME:
        head = f"INS{number}_"
        static = f"{head}{key}OFFS", f"{head}{key}SCAL", f"{head}{key}_CALTEMP"
        thermal = f"{head}TCAL"
    else:
        first = key if number == 1 else f"{key}{number}"
        static = f"INS_{first}OFFS", f"INS_{first}SCAL", f"INS_{key}{number}_CALTEMP"
        thermal = f"INS_TCAL{number}"
    first, second, third = (f"{thermal}_{key}{order}" for order in (1, 2, 3))
    return _Names(*static, thermal, (first, second, third))


def _thermal(
    parameters: Parameters,
    names: _Names,
    time: Float[np.ndarray, " rows"],
    probe: Float[np.ndarray, " rows"] | None,
) -> tuple[Float[np.ndarray, "rows 3"] | None, bool]:
    """P(T − 35) − P(T_cal − 35), `None` where it is nothing; and whether there is no temperature to tell it."""
    on = parameters.at(f"{names.thermal}_ENABLE", time, 0.0) == 1.0
    coefficients = [parameters.triad(one, time, 0.0) / _FACTOR for one in names.orders]
    if not on.any() or not any(c[on].any() for c in coefficients):
        return None, False
    if probe is None:
        return None, True
    low = parameters.at(f"{names.thermal}_TMIN", time, _COLDEST)
    high = parameters.at(f"{names.thermal}_TMAX", time, _WARMEST)

    def part(at: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "rows 3"]:
        d = (np.minimum(np.maximum(at, low), high) - _REFERENCE)[:, None]
        first, second, third = coefficients
        return (first + (second + third * d) * d) * d

    calibrated = parameters.at(names.calibrated_at, time, _NO_CALTEMP)
    return np.where(on[:, None], part(probe) - part(calibrated), 0.0), False
