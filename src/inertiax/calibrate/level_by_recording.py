"""How far biases differ from recording to recording: another day or switching on has a level of its own.

The rests' means less what the fit says of them have a mean and a standard error in each recording. Where these means
differ by more than rests of one recording do, their standard deviation between recordings (Paule and Mandel) is how
far the bias of one switching on is from the stated one, whose interval is that of the mean over the recordings.
"""

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from ..calibration.over_rows import curve_parameters, times
from ..calibration.quantities import DEG_PER_HOUR
from ..model_selection.model_spec import LEAST_SPAN
from ..numerics.linear_algebra import scaled_inverse
from ..numerics.paule_mandel import excess_deviation
from ..procedure.single_device import Problem
from .results import DeviceResult, TriadResult


_FEWEST = 3  # rests of a recording that tell its level and scatter
_FREEDOM = 5  # rows beyond the unknowns that tell the accelerometers' scatter; convention
_FAR = 4.0  # standard errors between two recordings; chance has it in 6 of 100 000 pairs of an axis
# Of directions that tell a bias, their least spread to the largest, in which the noise of a rest's direction is small:
# rests farther than some 10° from one plane (convention). On one face the lean that biases and noise feign is 1e-2.
_FLAT = 0.1
_NAMES = {"accel": "accelerometers", "gyro": "gyros"}

LogNumbers = Int[np.ndarray, " recording"]
Levels = tuple[Float[np.ndarray, "recording 3"], Float[np.ndarray, "recording 3"]]


def level_words(result: DeviceResult, gravity: float) -> dict[str, str]:
    """In words, by triad, how far biases differ between recordings; without a triad that does by no more than chance.

    **Arguments:** `gravity` in m/s², which makes g-sensitivity's force dimensionless.
    """
    found = {t: triad_words(getattr(result, t), gravity) for t in _NAMES}
    return {triad: words for triad, words in found.items() if words is not None}


def triad_words(
    estimate: TriadResult | None, gravity: float, logs: LogNumbers | None = None
) -> str | None:
    """The same of one triad; `None` where recordings differ by no more than chance, or have temperatures of their own:
    levels could be those of what the curve over temperature leaves out.

    **Arguments:** `logs` is the number of the log that each recording is of, where several are parts of one.
    """
    if estimate is None or _temperatures_apart(estimate, logs):
        return None
    found = levels(estimate, gravity, logs=logs)
    if found is None:
        return None
    slopes = levels(estimate, gravity, slopes=True, logs=logs)
    triad = estimate.estimator.triad
    per, unit = (1.0, "m/s²") if triad == "accel" else (DEG_PER_HOUR, "°/h")
    level, error = found
    said = []
    if slopes is not None and _apart(*slopes) >= _FAR:
        sizes = ", ".join(f"{per * np.ptp(slopes[0][:, k]):.3g}" for k in range(3))
        said.append(
            f"{_NAMES[triad]}: over temperature the biases of the {len(slopes[0])} recordings have slopes that differ "
            f"by up to {sizes} {unit}/°C in x, y, z: a lag behind the probe, hysteresis, or another device; the curve "
            "is a mean of theirs"
        )
    if _apart(level, error) < _FAR:
        return "; ".join(said) or None
    between = [excess_deviation(level[:, k] - level[:, k].mean(), error[:, k], 1) for k in range(3)]
    sizes = ", ".join(f"{s * per:.3g}" for s in between)
    said.append(
        f"{_NAMES[triad]}: the biases of the {len(level)} recordings differ by {sizes} {unit} in x, y, z (1 sigma "
        f"between recordings), as each day or switching on has a bias of its own; the stated bias and its "
        "interval are those of their mean, and the bias of one switching on is that far from it"
    )
    return "; ".join(said)


def _apart(
    level: Float[np.ndarray, "recording 3"], error: Float[np.ndarray, "recording 3"]
) -> float:
    """The largest difference of two recordings in standard errors."""
    # A recording stands no error off itself, not even one whose error is nought.
    both = np.maximum(np.hypot(error[:, None], error[None]), np.finfo(float).tiny)
    return float((np.abs(level[:, None] - level[None]) / both).max())


def levels(
    estimate: TriadResult, gravity: float, *, slopes: bool = False, logs: LogNumbers | None = None
) -> Levels | None:
    """Each recording's mean of the rests' outputs less the fit, and its standard error, m/s² or rad/s.

    `None` where there are not two recordings with rests enough, or where their poses do not tell all three axes.
    The levels of accelerometers sum to zero.

    **Arguments:** `gravity` in m/s², which makes g-sensitivity's force dimensionless. With `slopes` those over
    temperature beside the levels, per °C, where every recording has `LEAST_SPAN` of it. `logs` as of `triad_words`.
    """
    dwells = estimate.dwells
    number = _numbers(estimate, logs)
    if number is None:
        return None
    drivers = [np.ones(len(number))]
    if slopes:
        heat = _within(np.asarray(dwells.temperature), number)
        if heat is None:
            return None
        drivers.append(heat)
    if estimate.estimator.triad == "accel":
        return _of_rows(estimate, number, drivers)
    return _of_means(estimate, number, drivers, gravity)


def _within(
    temperature: Float[np.ndarray, " dwell"], number: Int[np.ndarray, " dwell"]
) -> Float[np.ndarray, " dwell"] | None:
    """Temperature less its mean in each recording; `None` where one has hardly any span."""
    made = np.zeros(len(temperature))
    for k in np.unique(number):
        own = temperature[number == k]
        if np.ptp(own) < LEAST_SPAN:
            return None
        made[number == k] = own - own.mean()
    return made


def _of_rows(
    estimate: TriadResult, number: Int[np.ndarray, " dwell"], drivers: list[np.ndarray]
) -> Levels | None:
    """By the accelerometers' rows, which may be of |a| alone: least squares of a bias of each recording's own beside
    the model's parameters, which would take up part of it.

    Levels sum to zero; their errors are quasi standard errors, so that of two recordings they add in squares to the
    variance of the difference.

    **Reference:** Firth and de Menezes (2004), Biometrika 91: 65.
    """
    problem = Problem(estimate.estimator, estimate.solution.curve.basis, estimate.dwells)
    coefficients = np.asarray(estimate.solution.curve.coefficients)
    model, residual = problem.rows(coefficients)
    names = estimate.estimator.names
    at = [names.index(f"accel.bias[{i}]") for i in range(3)]
    bias = np.asarray(problem.at(coefficients).jacobian)[:, :, at]
    kept, counts = np.unique(number, return_counts=True)
    if len(kept) < 2 or counts.min() < _FEWEST:
        return None
    if any(_flat(bias[number == k].reshape(-1, 3)) for k in kept):
        return None
    contrast = scipy.linalg.null_space(np.ones((1, len(kept))))
    mine = (number[:, None] == kept) @ contrast
    made = [np.einsum("ndi,nk->ndki", bias, d[:, None] * mine) for d in drivers]
    own = [problem.decorrelated(x.reshape(len(residual), -1)) for x in made]
    both = np.concatenate([model, *own], axis=1)
    size = np.linalg.norm(both, axis=0)
    freedom = len(residual) - both.shape[1]
    solution, _, rank, _ = np.linalg.lstsq(both / size, -residual, rcond=1e-10)
    if freedom < _FREEDOM or rank < both.shape[1]:
        return None
    square = float(np.square(residual + both / size @ solution).sum()) / freedom
    inverse = square * scaled_inverse(both.T @ both)
    first = both.shape[1] - 3 * contrast.shape[1]  # of the last driver
    level = contrast @ (solution / size)[first:].reshape(-1, 3)
    spread = inverse[first:, first:].reshape(len(kept) - 1, 3, len(kept) - 1, 3)
    error = [_quasi_errors(contrast @ spread[:, i, :, i] @ contrast.T) for i in range(3)]
    return level, np.stack(error, axis=1)


def _flat(rows: Float[np.ndarray, "row 3"]) -> bool:
    """Whether rows of biases lie so near to one plane that they tell two axes at most."""
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    spread = np.linalg.svd(rows / np.maximum(size, np.finfo(float).tiny), compute_uv=False)
    return bool(len(spread) < 3 or spread[-1] < _FLAT * spread[0])


def _quasi_errors(
    covariance: Float[np.ndarray, "recording recording"],
) -> Float[np.ndarray, " recording"]:
    """Errors whose squares add up, two by two, to the variances of differences, in least squares."""
    one, two = np.triu_indices(len(covariance), 1)
    own = np.diagonal(covariance)
    difference = own[one] + own[two] - 2.0 * covariance[one, two]
    pairs = np.zeros((len(one), len(covariance)))
    pairs[np.arange(len(one)), one] = pairs[np.arange(len(one)), two] = 1.0
    square = np.linalg.lstsq(pairs, difference, rcond=None)[0]
    return np.sqrt(np.maximum(square, 0.0))


def _of_means(
    estimate: TriadResult,
    number: Int[np.ndarray, " dwell"],
    drivers: list[np.ndarray],
    gravity: float,
) -> Levels | None:
    """By the gyros' means at rest, which motions between rests do not have rows of: in each recording by least squares
    of the drivers, of the last of which this is."""
    dwells = estimate.dwells
    if dwells.gyro is None:
        return None
    rest = np.asarray(dwells.position) >= 0
    own = [rest & (number == k) for k in np.unique(number)]
    own = [rows for rows in own if rows.sum() >= _FEWEST]
    if len(own) < 2:
        return None
    own_names = estimate.estimator.names
    at = curve_parameters(estimate.solution.curve, own_names, np.asarray(dwells.temperature))
    known = at.bias
    if dwells.accel is not None:
        d = at.further.reshape(3, 3, -1)
        known = known + times(d, np.asarray(dwells.accel).T) / gravity
    if dwells.reference_gyro is not None:
        turn = np.asarray(dwells.reference_gyro).T
        known = known + turn + times(at.matrix, turn)
    left = np.asarray(dwells.gyro) - known.T
    x = np.stack(drivers, axis=1)
    fits = [np.linalg.lstsq(x[rows], left[rows], rcond=None)[0] for rows in own]
    inside = np.concatenate([left[rows] - x[rows] @ f for rows, f in zip(own, fits, strict=True)])
    degrees = len(inside) - len(drivers) * len(own)
    if degrees < 1:
        return None
    scatter = np.sqrt(np.sum(inside**2, axis=0) / degrees)
    spread = [np.sqrt(np.linalg.pinv(x[rows].T @ x[rows])[-1, -1]) for rows in own]
    return np.stack([f[-1] for f in fits]), np.outer(spread, scatter)


def _numbers(estimate: TriadResult, logs: LogNumbers | None) -> Int[np.ndarray, " dwell"] | None:
    """Number of the recording that each dwell is of, or of its log."""
    if estimate.dwells.rows is None:
        return None
    number = np.asarray(estimate.dwells.rows)[:, 0]
    return number if logs is None else logs[number]


def _temperatures_apart(estimate: TriadResult, logs: LogNumbers | None) -> bool:
    """Whether no two recordings share a temperature; those without any share theirs."""
    number = _numbers(estimate, logs)
    if number is None:
        return False
    temperature = np.asarray(estimate.dwells.temperature)
    ranges = sorted(
        (temperature[number == k].min(), temperature[number == k].max()) for k in np.unique(number)
    )
    return len(ranges) > 1 and all(
        high < low for (_, high), (low, _) in zip(ranges[:-1], ranges[1:])
    )
