r"""A calibration at one temperature, joined with the biases that a warm-up in one pose shows over temperature.

Who has no chamber turns the device at room temperature, and leaves it in one pose while it warms up from the cold. The
first tells biases, scale factors and misalignments at one temperature $T_0$; the second how the outputs move:

$$p(T) = p + b_w(T) - b_w(T_0),$$

with the warm-up's biases $b_w$, of which only differences are told. In the basis of the warm-up, with $u$ the
coefficients of the constant function one and $\phi$ the basis, the biases' coefficients are
$u\,p + (I - u\,\phi(T_0)^T)\,c_w$, and their covariance follows; the two logs are independent. What a scale factor does
with temperature is counted as bias where gravity or a rate lies along its axis. The notes say so, and by how much
the two logs differ at $T_0$ (`turn_on`): the constants stay the first log's.
"""

from dataclasses import replace

import numpy as np

from ..physics.temperature import Constant, constant_one, Curve
from ..storage.wrong_value import WrongValue
from .pytree import Calibration
from .triad import TriadCalibration
from .turn_on import turn_on


WIDE = 10.0  # °C, beyond which a calibration by constants is not of one temperature
# Of the warm-up's range: so far beyond its ends its curve is continued (convention). A board that is turned by hand
# right after its warm-up still warms a little, and a curve that the range determines changes little so near to it.
BEYOND = 0.05


def with_warm_up(
    calibration: Calibration, warm_up: Calibration, temperature: float | None = None
) -> Calibration:
    """The calibration at one temperature with the warm-up's biases over temperature.

    **Arguments:** `temperature` (°C) is that of `calibration`; without it the middle of its `temperature_range`.
    Accelerometers that `calibration` lacks stay out, since one pose tells of them differences alone; gyros and a
    barometer are taken from the warm-up.

    A temperature dependence of `calibration` over `WIDE` or less is held at that temperature. Beyond the warm-up's ends
    by no more than `BEYOND` of its range its curve is continued; its covariance grows there as a polynomial's does.

    Raises `ValueError` where the devices have different names, where `calibration` has a temperature dependence over
    more or the warm-up has none, where no temperature is known, and where it lies farther outside of the warm-up's.
    """
    if calibration.device and warm_up.device and calibration.device != warm_up.device:
        raise ValueError(
            f"the warm-up is of device '{warm_up.device}', the calibration of '{calibration.device}'."
        )
    moves = any(not isinstance(t.curve.basis, Constant) for t in calibration.triads)
    covered = calibration.temperature_range
    if moves and (covered is None or float(covered[1]) - float(covered[0]) > WIDE):
        raise ValueError(
            "the calibration depends on temperature itself; it needs no warm-up. Give the one with constants first."
        )
    if all(isinstance(t.curve.basis, Constant) for t in warm_up.triads):
        raise ValueError(
            "the warm-up has no biases over temperature; give it `[model] temperature_degree`."
        )
    ends = warm_up.temperature_range
    if ends is None:
        raise ValueError("the warm-up has no temperatures; record them with it.")
    at = _temperature(calibration, temperature)
    low, high = map(float, ends)
    beyond = max(low - at, at - high, 0.0)
    if beyond > BEYOND * (high - low):
        wrong = ValueError if temperature is None else WrongValue
        raise wrong(
            f"the calibration was made at {at:.1f} °C, outside of the warm-up's {low:.1f} to {high:.1f} °C: let a "
            f"warm-up reach {at:.0f} °C, or turn the device by hand at a temperature between."
        )
    if moves:  # over a few degrees, that the device warmed by: the warm-up tells better
        calibration = replace(
            calibration,
            accel=None if calibration.accel is None else _held(calibration.accel, at),
            gyro=None if calibration.gyro is None else _held(calibration.gyro, at),
            cross_covariance=None,  # of coefficients that are no more; what is joined has none, see below
        )
    between = turn_on(calibration, warm_up, at).sentence
    said = (
        f"biases over temperature from a warm-up in one pose, joined at {at:.1f} °C: what scale factors do with "
        "temperature is counted as bias along gravity",
        *((f"the warm-up's curve is continued by {beyond:.1f} °C to there",) if beyond else ()),
        *((between,) if between else ()),
    )
    return replace(
        calibration,
        accel=None if calibration.accel is None else _joined(calibration.accel, warm_up.accel, at),
        gyro=warm_up.gyro
        if calibration.gyro is None
        else _joined(calibration.gyro, warm_up.gyro, at),
        temperature_range=(min(low, at), max(high, at)),
        notes=(*calibration.notes, *said),
        cross_covariance=None,
        baro=calibration.baro or warm_up.baro,
    )


def _temperature(calibration: Calibration, given: float | None) -> float:
    if given is not None:
        return float(given)
    ends = calibration.temperature_range
    if ends is None:
        raise ValueError("the calibration has no temperature; give the one that it was made at.")
    low, high = map(float, ends)
    if high - low > WIDE:
        raise ValueError(
            f"the calibration covers {low:.1f} to {high:.1f} °C with constants; give the temperature that it is meant "
            "for."
        )
    return 0.5 * (low + high)


def _held(triad: TriadCalibration, at: float) -> TriadCalibration:
    """A triad's parameters at one temperature as constants, φ(T₀) ⊗ E of its coefficients."""
    weights = np.kron(triad.curve.basis.rows(np.array([at])), np.eye(len(triad.names)))
    values = weights @ np.ravel(triad.curve.coefficients)
    covariance = weights @ np.asarray(triad.covariance) @ weights.T
    return replace(triad, curve=Curve(Constant(), values[None]), covariance=covariance)


def _joined(
    fixed: TriadCalibration, moving: TriadCalibration | None, at: float
) -> TriadCalibration:
    if moving is None or isinstance(moving.curve.basis, Constant):
        return fixed
    basis, one = moving.curve.basis, constant_one(moving.curve.basis)
    change = np.eye(len(one)) - np.outer(one, basis.rows(np.array([at]))[0])
    size, count = len(one), len(fixed.names)
    spread = np.kron(one[:, None], np.eye(count))  # of the constants onto the basis
    shift = np.zeros((size * count, size * len(moving.names)))
    for k, name in enumerate(fixed.names):
        if ".bias[" in name and name in moving.names:
            other = moving.names.index(name)
            shift[k::count, other :: len(moving.names)] = change
    coefficients = spread @ np.ravel(fixed.curve.coefficients)
    coefficients += shift @ np.ravel(moving.curve.coefficients)
    covariance = spread @ np.asarray(fixed.covariance) @ spread.T
    covariance += shift @ np.asarray(moving.covariance) @ shift.T
    curve = Curve(basis, coefficients.reshape(size, count))
    return TriadCalibration(curve, covariance, fixed.names, fixed.estimator)
