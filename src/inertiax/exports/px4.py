"""PX4's parameters: thermal offsets `TC_A*`, `TC_G*`, `TC_M*` and static `CAL_ACC*`, `CAL_GYRO*`, `CAL_MAG*`.

PX4 corrects (x' − thermal(T) − offset) · scale axis by axis, thermal(T) = X3 ΔT³ + X2 ΔT² + X1 ΔT + X0 with
ΔT = clamp(T, TMIN, TMAX) − TREF; gyros have no scale. The thermal polynomial takes the whole bias and the static
offset is zero; of a triad whose bias does not depend on temperature the offset takes it, and its thermal correction is
switched off. The accelerometers' scale is the diagonal of (E + Γ)⁻¹ over the range. Magnetometers (gauss) have a
symmetric matrix S and the field of the power: S (m' − thermal(T) + COMP · kA − offset); their offset is the hard iron
at TREF, so that firmware without `TC_M*` has it, too.

**Reference:** PX4-Autopilot, `TemperatureCompensation.cpp` and `sensor_calibration/Accelerometer.hpp`,
`Magnetometer.cpp`.
"""

import re
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..calibration.barometer import BarometerCalibration
from ..calibration.calibration import Calibration
from ..calibration.magnetometers import MagnetometerCalibration
from ..physics.temperature import Constant, Polynomial, to_powers
from .cubic import bias_curve, BiasCurve, cubic, cubic_misfit, nodes
from .export import AppliedField, Export, Settings as Common
from .imported import calibration as imported, triad
from .magnetometer_parameters import field_span, GAUSS, symmetric_field
from .parameters import axis_by_axis_loss, HELD, parameters_over, temperature_span
from .slot import slot_of


NAME = "px4"
MAGNETOMETERS = True  # are held
BAROMETER = True
TITLE = "PX4's parameters (TC_* and CAL_*, QGroundControl's .params)"
SUFFIX = ".params"
KEEPS = (
    "bias as a cubic in temperature, accelerometer scale factors (constants); magnetometers: hard iron as a cubic, "
    "soft iron, the battery current's field; the barometer"
)
LOSES = (
    "misalignments, gyro scale factors, temperature dependence of scale and soft iron, degrees above 3, "
    "g-sensitivity, the magnetometers' rotation, uncertainties"
)

_INT, _FLOAT = 6, 9  # MAVLink parameter types


class Settings(Common, frozen=True, kw_only=True):
    """Which of PX4's sensors this is, and the device numbers PX4 knows it by."""

    instance: int | None = None  # 0 to 3; by default that of the log's device, where `imu0` is 0
    accel_id: int = 0  # `device_id` of sensor_accel in a log; PX4 ignores a calibration of 0
    gyro_id: int = 0
    mag_id: int = 0
    baro_id: int = 0


def write(calibration: Calibration, settings: Settings) -> Export:
    """PX4's parameter file of both triads."""
    slot = slot_of(calibration, settings.instance, controller="px4", first=0, last=3)
    n = slot.number
    low, high = temperature_span(calibration)
    reference = float(np.float32(0.5 * (low + high)))
    accel, gyro, scale = _fits(calibration, low, high, reference)
    present = calibration.accel is not None, calibration.gyro is not None
    lines = [
        *_thermal(n, settings, accel, gyro, present, (reference, low, high)),
        *_static(n, settings, accel, gyro, scale, present),
    ]
    field: _Field | None = None
    if calibration.mag is not None:
        field = _field(n, settings.mag_id, calibration.mag, *field_span(calibration.mag, low, high))
        lines += field.lines

    def applied(a: np.ndarray, w: np.ndarray, temperature: np.ndarray):
        d = np.clip(temperature, low, high) - reference
        return (a - accel.over(d)) * scale, w - gyro.over(d)

    notes = (
        *slot.notes,
        "axes must be the sensor's own, before PX4's rotation to the body",
    )
    if accel.thermal or gyro.thermal or (field is not None and field.thermal):
        notes = (*notes, HELD.format(name="PX4"))
    if settings.accel_id == 0 or settings.gyro_id == 0:
        notes = (
            "PX4 wants the sensors' own numbers, device_id in its logs of sensor_accel and sensor_gyro: give --set "
            "accel_id=... --set gyro_id=...",
            *notes,
        )
    if calibration.baro is not None:
        lines += _barometer(n, settings.baro_id, calibration.baro)
    if calibration.mag is not None and settings.mag_id == 0:
        notes = ("PX4 wants the magnetometers' own number: give --set mag_id=...", *notes)
    return Export(
        files=(("", "\n".join(lines).encode() + b"\n"),),
        applied=applied,
        applied_field=None if field is None else field.applied,
        losses=(*axis_by_axis_loss(calibration), *(() if field is None else field.losses)),
        notes=notes,
    )


def _line(name: str, value: float | int) -> str:
    if isinstance(value, int):
        return f"1\t1\t{name}\t{value}\t{_INT}"
    return f"1\t1\t{name}\t{value:.9g}\t{_FLOAT}"


def _thermal(
    n: int,
    settings: Settings,
    accel: BiasCurve,
    gyro: BiasCurve,
    present: tuple[bool, bool],
    temperatures: tuple[float, float, float],
) -> list[str]:
    lines = []
    rows = zip("AG", (settings.accel_id, settings.gyro_id), (accel, gyro), present, strict=True)
    for letter, number, bias, calibrated in rows:
        if calibrated:
            lines.append(_line(f"TC_{letter}_ENABLE", int(bias.thermal)))
            if bias.thermal:
                lines += _cubics(f"TC_{letter}{n}", number, bias.coefficients, temperatures)
    return lines


def _cubics(
    prefix: str,
    number: int,
    fit: Float[np.ndarray, "4 3"],
    temperatures: tuple[float, float, float],
) -> list[str]:
    """One sensor's thermal offsets."""
    lines = [_line(f"{prefix}_ID", number)]
    for axis in range(3):
        for order in (3, 2, 1, 0):
            lines.append(_line(f"{prefix}_X{order}_{axis}", float(fit[order, axis])))
    for key, value in zip(("TREF", "TMIN", "TMAX"), temperatures, strict=True):
        lines.append(_line(f"{prefix}_{key}", float(value)))
    return lines


class _Field(NamedTuple):
    """The magnetometers' lines, what PX4 makes of outputs with them, and what they lose."""

    lines: list[str]
    applied: AppliedField
    thermal: bool
    losses: tuple[str, ...]


def _field(n: int, number: int, mag: MagnetometerCalibration, low: float, high: float) -> _Field:
    """The magnetometers in gauss; the power is the battery's current, kA."""
    reference = float(np.float32(0.5 * (low + high)))
    found = symmetric_field(mag, nodes(low, high))
    bias = bias_curve(GAUSS * found.bias, low, high, reference)
    left, losses = cubic_misfit(found.bias), found.losses
    if left:
        said = f"the part of the hard iron that no cubic in temperature follows (up to {1e6 * left:.2g} µT)"
        losses = (*losses, said)
    scale, power = found.scale, -1e3 * GAUSS * found.current
    lines = [_line("TC_M_ENABLE", int(bias.thermal))]
    if bias.thermal:
        change = np.concatenate([np.zeros((1, 3)), bias.coefficients[1:]])
        lines += _cubics(f"TC_M{n}", number, change, (reference, low, high))
    lines += [_line(f"CAL_MAG{n}_ID", number), *_offsets(f"CAL_MAG{n}", bias.coefficients[0])]
    lines += [_line(f"CAL_MAG{n}_{a}SCALE", float(scale[k, k])) for k, a in enumerate("XYZ")]
    beside = (scale[0, 1], scale[0, 2], scale[1, 2])
    lines += [_line(f"CAL_MAG{n}_{a}ODIAG", float(x)) for a, x in zip("XYZ", beside, strict=True)]
    if power.any():
        lines.append(_line("CAL_MAG_COMP_TYP", 2))  # by the battery's current
        lines += [_line(f"CAL_MAG{n}_{a}COMP", float(x)) for a, x in zip("XYZ", power, strict=True)]

    def applied(m: np.ndarray, temperature: np.ndarray, current: np.ndarray):
        d = np.clip(temperature, low, high) - reference
        return (GAUSS * m - bias.over(d) + power * current[:, None] / 1e3) @ scale.T / GAUSS

    return _Field(lines, applied, bias.thermal, losses)


def _offsets(prefix: str, offset: Float[np.ndarray, "3"]) -> list[str]:
    """Static offsets of one sensor."""
    return [_line(f"{prefix}_{a}OFF", float(x)) for a, x in zip("XYZ", offset, strict=True)]


def _static(
    n: int,
    settings: Settings,
    accel: BiasCurve,
    gyro: BiasCurve,
    scale: Float[np.ndarray, "3"],
    present: tuple[bool, bool],
) -> list[str]:
    """Static offsets, and the accelerometers' scale; what was not calibrated keeps what the autopilot has."""
    lines = []
    numbers = settings.accel_id, settings.gyro_id
    sensors = zip(("ACC", "GYRO"), numbers, (accel, gyro), present, strict=True)
    for sensor, number, bias, calibrated in sensors:
        if calibrated:
            lines.append(_line(f"CAL_{sensor}{n}_ID", number))
            offset = np.zeros(3) if bias.thermal else bias.coefficients[0]
            lines += _offsets(f"CAL_{sensor}{n}", offset)
    if present[0]:
        pairs = zip("XYZ", scale.tolist(), strict=True)
        lines += [_line(f"CAL_ACC{n}_{axis}SCALE", value) for axis, value in pairs]
    return lines


def _fits(
    calibration: Calibration, low: float, high: float, reference: float
) -> tuple[BiasCurve, BiasCurve, Float[np.ndarray, "3"]]:
    """Bias cubics of both triads and the accelerometers' scale, as PX4's single precision keeps them."""
    p = parameters_over(calibration, nodes(low, high))
    scale = np.diagonal(np.linalg.inv(p.accel_matrix), axis1=1, axis2=2)
    scale = 0.5 * (scale.min(axis=0) + scale.max(axis=0))
    if np.any(scale < 0.1) or np.any(scale > 3):
        raise ValueError(
            f"px4: accelerometer scales {scale.tolist()} are outside PX4's 0.1 to 3; calibrate data in "
            "m/s²."
        )
    single = lambda x: x.astype(np.float32).astype(float)

    def fit(values: np.ndarray) -> BiasCurve:
        found = bias_curve(values, low, high, reference)
        return found._replace(coefficients=single(found.coefficients))

    return fit(p.accel_bias), fit(p.gyro_bias), single(scale)


def _barometer(n: int, number: int, baro: BarometerCalibration) -> list[str]:
    """The barometer's lines, Pa: zero at the reference temperature, of degree five at most."""
    basis = baro.curve.basis
    if not isinstance(basis, Polynomial) or basis.degree > 5:
        raise ValueError("px4: the barometer's curve must be a polynomial of degree 5 or less.")
    reference = float(baro.reference)
    powers = to_powers(basis, np.asarray(baro.curve.coefficients), reference)[:, 0]
    powers[0] = 0.0  # the pressure of the place
    found = np.pad(powers, (0, 6 - len(powers)))
    lines = [_line("TC_B_ENABLE", 1), _line(f"TC_B{n}_ID", number)]
    lines += [_line(f"TC_B{n}_X{order}", float(found[order])) for order in (5, 4, 3, 2, 1, 0)]
    ends = (reference, float(basis.low), float(basis.high))
    keys = ("TREF", "TMIN", "TMAX")
    return lines + [_line(f"TC_B{n}_{k}", v) for k, v in zip(keys, ends, strict=True)]


_LINE = re.compile(r"\d+\s+\d+\s+([A-Z0-9_]+)\s+(\S+)\s+\d+")


def read(content: bytes, *, instance: int = 0) -> Calibration:
    """The calibration in a `.params` file: thermal and static offsets and accelerometer scales.

    Magnetometers are not read: the file does not say which field they are scaled to.
    """
    found: dict[str, float] = {}
    for line in content.decode().splitlines():
        match = _LINE.fullmatch(line.strip())
        if match:
            found[match[1]] = float(match[2])
    n = instance
    if not any(k.startswith((f"TC_A{n}_", f"TC_G{n}_", f"CAL_ACC{n}_")) for k in found):
        raise ValueError(f"px4: no TC_* or CAL_* parameters of sensor {n} in the file.")
    triads, ranges = [], []
    for kind, letter, sensor in (("accel", "A", "ACC"), ("gyro", "G", "GYRO")):
        get = lambda name, default=0.0, s=sensor: found.get(f"CAL_{s}{n}_{name}", default)
        offset = np.array([get(f"{axis}OFF") for axis in "XYZ"])
        scale = np.array([get(f"{axis}SCALE", 1.0) for axis in "XYZ"])
        enabled = found.get(f"TC_{letter}_ENABLE", 0.0) > 0
        low, high = (found.get(f"TC_{letter}{n}_{k}", 0.0) for k in ("TMIN", "TMAX"))
        basis = Polynomial(3, low, high) if enabled and high > low else Constant()
        at = np.asarray(basis.nodes)
        x = lambda j, axis, s=letter: found.get(f"TC_{s}{n}_X{j}_{axis}", 0.0)
        coefficients = np.array([[x(j, axis) for axis in range(3)] for j in range(4)])
        d = np.clip(at, low, high) - found.get(f"TC_{letter}{n}_TREF", 25.0)
        if not enabled:
            coefficients, d = np.zeros((4, 3)), np.zeros(len(at))
        matrix = np.broadcast_to(np.diag(1.0 / scale), (len(at), 3, 3))
        triads.append(
            triad(kind, matrix, offset + cubic(coefficients, d), basis=basis, source=NAME)
        )
        ranges.append((low, high) if high > low and enabled else None)
    spans = [r for r in ranges if r is not None]
    span = (max(r[0] for r in spans), min(r[1] for r in spans)) if spans else None
    magnetometers = any(k.startswith((f"CAL_MAG{n}_", f"TC_M{n}_")) for k in found)
    notes = ("the magnetometers in the file (CAL_MAG*, TC_M*) are not read",)
    return imported(
        triads[0], triads[1], temperature_range=span, notes=notes if magnetometers else ()
    )
