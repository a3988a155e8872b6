"""Whether numbers are plausible in the units that they are said to be in, one line each."""

from typing import Any

import numpy as np

from ..physics.celsius import not_celsius
from ..physics.leaves import is_traced


LEAST_FORCE, GREATEST_FORCE = (
    3.0,
    2000.0,
)  # m/s², median magnitude: below is g, above mm/s² or counts
GREATEST_RATE = 100.0  # rad/s, median magnitude: 5700 °/s, more than rate tables turn
# m/s², median magnitude of rests without reference: 9.8 m/s² in mg, which no centrifuge without reference is.
MILLI_G = (900.0, 1100.0)
# m/s², median magnitude of a run: a device that mostly rests or flies level, in g.
ONE_G = (0.9, 1.1)
# Densities and instabilities in SI: ten times the noise of the worst sensors that are sold.
GREATEST_NOISE = {"accel": 1.0, "gyro": 0.5}
# Ratio of outputs to reference that a scale factor error does not make, but a unit.
LEAST_RATIO, GREATEST_RATIO = 0.2, 5.0
DEGREES = 57.3
# s from sample to sample. Hourly means are the slowest logs; a device whose samples are 2 s and more apart and that
# turns by more than half a turn between some is not sampled so slowly (500 Hz in ms).
SLOWEST, SLOWLY, TURNED_SHARE = 3600.0, 2.0, 0.02
QUICKLY = 1e-4  # s from sample to sample: 10 kHz, more than IMUs give
FINER = {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}  # s, units that loggers count in
LEAST_OF_LARGEST = 0.1  # of the largest reference, from which outputs tell a unit
# m/s²: gravity of no other body that people calibrate on is outside, but 1 g, 981 gal and 9810 mm/s² are.
LEAST_GRAVITY, GREATEST_GRAVITY = 1.5, 30.0
# T, median magnitude: beyond, no magnetometer for the Earth's field goes, whatever iron is near.
GREATEST_FIELD = 5e-3
# Of one sample, which may be the peak of a shock or a spin: 1000 g, and 11 500 °/s.
PEAK_FORCE, PEAK_RATE = 1e4, 200.0  # m/s², rad/s
PEAKS = {
    "force": (PEAK_FORCE, "m/s² (mm/s² or counts?)"),
    "rate": (PEAK_RATE, "rad/s (deg/s?)"),
    "field": (GREATEST_FIELD, "T, about 5e-5 (uT?)"),
}
LEAST_EARTH_FIELD, GREATEST_EARTH_FIELD = 20e-6, 70e-6  # T: 22 in South America, 67 near the poles


def whole_numbers(call: str, values: np.ndarray) -> np.ndarray:
    """Numbers as integers. Raises `ValueError` where one is not whole."""
    wrong = ~(values == np.round(values))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ValueError(f"`{call}`: must hold whole numbers; row {row} is {values[row]:g}.")
    return values.astype(int)


def check_steps(call: str, time: np.ndarray, gyro: np.ndarray | None) -> None:
    """Raise `ValueError` for times of samples that are none in s: too far apart for any log, or for how the device
    turns between them."""
    if len(time) < 2 or not np.all(np.isfinite(time)):
        return
    step = float(np.median(np.diff(time)))
    turned = 0.0
    if gyro is not None and np.shape(gyro) == (len(time), 3):
        turned = step * float(np.nanquantile(np.linalg.norm(gyro, axis=1), 1.0 - TURNED_SHARE))
    if step <= SLOWEST and not (step >= SLOWLY and turned > np.pi):
        return
    why = f", in which the device turns by {turned:.3g} rad" if turned > np.pi else ""
    # Only those in which a log would be sampled as IMUs are; a tenth of a millisecond in µs is no 10 kHz by rounding.
    fitting = [unit for unit, size in FINER.items() if 1.01 * QUICKLY < step * size < SLOWLY]
    asked = f" (in {' or '.join(fitting)}?)" if fitting else ""
    raise ValueError(f"`{call}(time=...)`: samples are {step:g} s apart{why}; it is in s{asked}.")


def check_stamps_differ(call: str, given: Any) -> None:
    """Raise `ValueError` for times whose few bits make one of two samples, as JAX's default 32 do of clocks."""
    time = np.asarray(given)
    if time.dtype.kind != "f" or time.dtype.itemsize >= 8:
        return
    same = np.flatnonzero(np.diff(time) == 0.0)
    if not same.size:
        return
    row = int(same[0])
    bits, least = 8 * time.dtype.itemsize, np.spacing(abs(time[row]))
    if least < 0.5 * (float(time[-1]) - float(time[0])) / (len(time) - 1):
        return  # samples are farther apart than the bits round: a stamp that the logger repeated
    raise ValueError(
        f"`{call}(time=...)`: rows {row} and {row + 1} are both {time[row]:g} s in {bits} bits, which tell {least:.2g} "
        "s apart there; give 64 bits (NumPy), or count from the first sample before rounding."
    )


def check_temperature(call: str, values: Any, valid: Any, name: str = "temperature") -> None:
    """Raise `ValueError` for temperatures that are no °C."""
    if values is None or is_traced(values) or is_traced(valid) or not np.any(valid):
        return
    wrong = not_celsius(values[valid])
    if wrong is not None:
        raise ValueError(f"`{call}({name}=...)`: {wrong}.")


def check_gravity(call: str, gravity: Any) -> None:
    """Raise `ValueError` for a gravity that is none in m/s²."""
    if is_traced(gravity):
        return
    if np.shape(gravity) != ():
        raise ValueError(f"`{call}(gravity=...)`: shape {np.shape(gravity)}; it is one number.")
    if not LEAST_GRAVITY <= float(gravity) <= GREATEST_GRAVITY:
        raise ValueError(
            f"`{call}(gravity=...)`: {float(gravity):g}; it is in m/s², about 9.8 (in g?)."
        )


def check_from_zero(call: str, value: Any, greatest: float, unit: str) -> None:
    """Raise `ValueError` for an uncertainty or density that is negative or too large for its unit; `None` passes."""
    if value is None or is_traced(value):
        return
    size = np.asarray(value, float)
    if not (np.all(size >= 0.0) and np.all(size <= greatest)):
        worst = farthest_outside(size, 0.0, greatest)
        raise ValueError(
            f"`{call}`: {worst:g}; it is in {unit}, from 0 to {greatest:g} (another unit?)."
        )


def farthest_outside(values: Any, least: float, greatest: float) -> float:
    """The number that is farthest from a range, with its sign; one that is no number comes first."""
    flat = np.asarray(values, float).ravel()
    away = np.maximum(least - flat, flat - greatest)
    return float(flat[np.argmax(np.where(np.isnan(away), np.inf, away))])


def check_force(call: str, name: str, values: Any, valid: Any) -> None:
    """Raise `ValueError` for specific forces that are none in m/s²."""
    size = _size(values, valid)
    if size is None or LEAST_FORCE <= size <= GREATEST_FORCE:
        return
    guess = "in g?" if 0.1 < size < LEAST_FORCE else "in mm/s² or counts?"
    raise ValueError(
        f"`{call}({name}=...)`: median magnitude {size:g}; it is in m/s², about 9.8 at rest ({guess})."
    )


def check_rest_force(call: str, name: str, values: Any, valid: Any) -> None:
    """Raise `ValueError` for specific forces without reference that are those of rests in mg."""
    size = _size(values, valid)
    if size is not None and MILLI_G[0] < size < MILLI_G[1]:
        raise ValueError(
            f"`{call}({name}=...)`: median magnitude {size:g}; it is in m/s², about 9.8 at rest (in mg?)."
        )


def check_run(call: str, accel: Any, gyro: Any, temperature: Any) -> None:
    """Raise `ValueError` for a run's outputs that are none in m/s², rad/s and °C; it may be a fall or a shot, and a
    temperature that is no number passes."""
    every = np.ones(np.shape(accel)[:-1], bool)
    size = _size(accel, every)
    if size is not None and (ONE_G[0] < size < ONE_G[1] or size > GREATEST_FORCE):
        guess = "in g?" if size < GREATEST_FORCE else "in mm/s² or counts?"
        raise ValueError(
            f"`{call}(accel=...)`: median magnitude {size:g}; it is in m/s² ({guess})."
        )
    check_rate(call, "gyro", gyro, every)
    if not is_traced(temperature):
        check_temperature(call, np.asarray(temperature), np.isfinite(temperature))


def check_sample(call: str, temperature: Any, **quantities: tuple[str, Any]) -> None:
    """Raise `ValueError` for one sample that is none in SI and °C: of `force`, `rate` and `field`, each with its
    argument's name.

    One sample may fall, so that 1 m/s² is no sign of g. What is no number passes: it stands where nothing was read.
    """
    for kind, (name, vector) in quantities.items():
        greatest, right = PEAKS[kind]
        if not is_traced(vector) and (size := float(np.linalg.norm(vector))) > greatest:
            raise ValueError(f"`{call}`: {name} has magnitude {size:g}; it is in {right}.")
    if is_traced(temperature) or np.ndim(temperature) or not np.isfinite(temperature):
        return
    wrong = not_celsius(np.asarray(temperature))
    if wrong is not None:
        raise ValueError(f"`{call}`: temperature is {wrong}.")


def check_rate(call: str, name: str, values: Any, valid: Any) -> None:
    """Raise `ValueError` for rates that are none in rad/s."""
    size = _size(values, valid)
    if size is not None and size > GREATEST_RATE:
        raise ValueError(
            f"`{call}({name}=...)`: median magnitude {size:g}; it is in rad/s (deg/s?)."
        )


def check_field(call: str, values: Any, valid: Any) -> None:
    """Raise `ValueError` for magnetic fields that are none in T."""
    size = _size(values, valid)
    if size is not None and size > GREATEST_FIELD:
        raise ValueError(
            f"`{call}(mag=...)`: median magnitude {size:g}; it is in T, about 5e-5 ({field_unit_guess(size)}?)."
        )


def check_earth_field(call: str, field: Any) -> None:
    """Raise `ValueError` for a magnitude that the Earth's magnetic field has nowhere; `None` passes."""
    if field is None or is_traced(field):
        return
    if not LEAST_EARTH_FIELD <= float(field) <= GREATEST_EARTH_FIELD:
        raise ValueError(
            f"`{call}(magnetic_field=...)`: {float(field):g}; it is in T, from {LEAST_EARTH_FIELD:g} to "
            f"{GREATEST_EARTH_FIELD:g} on Earth (48.6 uT is 48.6e-6)."
        )


def field_unit_guess(size: float) -> str:
    """The unit in which a median magnitude would be the Earth's field, give or take what iron adds."""
    units = {"gauss": 1e-4, "uT": 1e-6, "mgauss": 1e-7, "nT": 1e-9}
    return min(units, key=lambda u: abs(np.log(size * units[u] / 45e-6)))


def check_ratio(
    call: str, name: str, values: Any, reference: Any, valid: Any, least: float
) -> None:
    """Raise `ValueError` where outputs and reference differ by a factor that is one of units.

    References below `least` tell nothing, nor does a tenth of a device's largest: rests, however many, of which
    outputs tell biases, lie below `least` in the right unit only.
    """
    if values is None or reference is None or any(map(is_traced, (values, reference, valid))):
        return
    length = np.linalg.norm(reference, axis=-1)
    largest = np.max(length, axis=-1, keepdims=True, initial=0.0, where=valid)
    used = valid & (length > np.maximum(least, LEAST_OF_LARGEST * largest))
    if not used.any():
        return
    ratio = float(np.median(np.linalg.norm(values, axis=-1)[used] / length[used]))
    if LEAST_RATIO <= ratio <= GREATEST_RATIO:
        return
    wrong = name if ratio > 1.0 else f"reference_{name}"
    factor = max(ratio, 1.0 / ratio)
    degrees = name == "gyro" and 0.5 < factor / DEGREES < 2.0
    guess = "deg/s?" if degrees else "another unit?"
    right = "rad/s" if name == "gyro" else "m/s²"
    raise ValueError(
        f"`{call}({wrong}=...)`: {factor:.3g} times its counterpart, {name} against reference_{name}; both are in "
        f"{right} ({guess})."
    )


def _size(values: Any, valid: Any) -> float | None:
    """Median magnitude of valid rows."""
    if values is None or is_traced(values) or is_traced(valid) or not np.any(valid):
        return None
    return float(np.median(np.linalg.norm(values, axis=-1)[valid]))
