"""How far biases differ from recording to recording: another day or switching on has a level of its own.

The rests' means less what the fit says of them have a mean and a standard error in each recording. Where these means
differ by more than rests of one recording do, their standard deviation between recordings (Paule and Mandel) is how
far the bias of one switching on is from the stated one, whose interval is that of the mean over the recordings.
"""

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from ..calibration.quantities import DEG_PER_HOUR
from ..numerics.linear_algebra import scaled_inverse
from ..numerics.paule_mandel import excess_deviation
from ..physics.error_model import GyroErrors
from ..procedure.single_device import Problem
from .results import DeviceResult, TriadResult


_FEWEST = 3  # rests of a recording that tell its level and scatter
_FREEDOM = 5  # rows beyond the unknowns that tell the accelerometers' scatter; convention
_FAR = 4.0  # standard errors between two recordings; chance has it in 6 of 100 000 pairs of an axis
_NAMES = {"accel": "accelerometers", "gyro": "gyros"}

Levels = tuple[Float[np.ndarray, "recording 3"], Float[np.ndarray, "recording 3"]]


def level_words(result: DeviceResult, gravity: float) -> dict[str, str]:
    """In words, by triad, how far biases differ between recordings; without a triad that does by no more than chance.

    **Arguments:** `gravity` in m/s², which makes g-sensitivity's force dimensionless.
    """
    found = {t: triad_words(getattr(result, t), gravity) for t in _NAMES}
    return {triad: words for triad, words in found.items() if words is not None}


def triad_words(estimate: TriadResult | None, gravity: float) -> str | None:
    """The same of one triad; `None` where recordings differ by no more than chance."""
    found = None if estimate is None else levels(estimate, gravity)
    if estimate is None or found is None:
        return None
    level, error = found
    apart = np.abs(level[:, None] - level[None]) / np.hypot(error[:, None], error[None])
    if apart.max() < _FAR:
        return None
    triad = estimate.estimator.triad
    per, unit = (1.0, "m/s²") if triad == "accel" else (DEG_PER_HOUR, "°/h")
    between = [excess_deviation(level[:, k] - level[:, k].mean(), error[:, k], 1) for k in range(3)]
    sizes = ", ".join(f"{s * per:.3g}" for s in between)
    cause = "as each day or switching on has a bias of its own"
    if _temperatures_apart(estimate):
        cause += ", or as temperature does what the model leaves out: each recording has temperatures of its own"
    return (
        f"{_NAMES[triad]}: the biases of the {len(level)} recordings differ by {sizes} {unit} in x, y, z (1 sigma "
        f"between recordings), {cause}; the stated bias and its interval are those of their mean, and the bias of one "
        "switching on is that far from it"
    )


def levels(estimate: TriadResult, gravity: float) -> Levels | None:
    """Each recording's mean of the rests' outputs less the fit, and its standard error, m/s² or rad/s.

    `None` where there are not two recordings with rests enough, or where their poses do not tell all three axes.
    The levels of accelerometers sum to zero.

    **Arguments:** `gravity` in m/s², which makes g-sensitivity's force dimensionless.
    """
    dwells = estimate.dwells
    if dwells.rows is None:
        return None
    number = np.asarray(dwells.rows)[:, 0]
    if estimate.estimator.triad == "accel":
        return _of_rows(estimate, number)
    return _of_means(estimate, number, gravity)


def _of_rows(estimate: TriadResult, number: Int[np.ndarray, " dwell"]) -> Levels | None:
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
    contrast = scipy.linalg.null_space(np.ones((1, len(kept))))
    mine = (number[:, None] == kept) @ contrast
    own = np.einsum("ndi,nk->ndki", bias, mine).reshape(len(residual), -1)
    both = np.concatenate([model, problem.decorrelated(own)], axis=1)
    size = np.linalg.norm(both, axis=0)
    freedom = len(residual) - both.shape[1]
    solution, _, rank, _ = np.linalg.lstsq(both / size, -residual, rcond=1e-10)
    if freedom < _FREEDOM or rank < both.shape[1]:
        return None
    square = float(np.square(residual + both / size @ solution).sum()) / freedom
    inverse = square * scaled_inverse(both.T @ both)
    first = model.shape[1]
    level = contrast @ (solution / size)[first:].reshape(-1, 3)
    spread = inverse[first:, first:].reshape(len(kept) - 1, 3, len(kept) - 1, 3)
    error = [_quasi_errors(contrast @ spread[:, i, :, i] @ contrast.T) for i in range(3)]
    return level, np.stack(error, axis=1)


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
    estimate: TriadResult, number: Int[np.ndarray, " dwell"], gravity: float
) -> Levels | None:
    """By the gyros' means at rest, which motions between rests do not have rows of."""
    dwells = estimate.dwells
    if dwells.gyro is None:
        return None
    rest = np.asarray(dwells.position) >= 0
    own = [rest & (number == k) for k in np.unique(number)]
    own = [rows for rows in own if rows.sum() >= _FEWEST]
    if len(own) < 2:
        return None
    curve = estimate.solution.curve
    left = np.empty(np.shape(dwells.gyro))
    for k, temperature in enumerate(np.asarray(dwells.temperature)):
        errors = estimate.estimator.unpack(curve(temperature))
        assert isinstance(errors, GyroErrors)
        known = np.asarray(errors.bias)
        if dwells.accel is not None:
            known = known + np.asarray(errors.g_sensitivity) @ np.asarray(dwells.accel)[k] / gravity
        if dwells.reference_gyro is not None:
            known = known + (np.eye(3) + np.asarray(errors.matrix)) @ dwells.reference_gyro[k]
        left[k] = np.asarray(dwells.gyro)[k] - known
    level = np.stack([left[rows].mean(axis=0) for rows in own])
    inside = np.concatenate([left[rows] - left[rows].mean(axis=0) for rows in own])
    degrees = len(inside) - len(own)
    scatter = np.sqrt(np.sum(inside**2, axis=0) / degrees)
    error = np.stack([scatter / np.sqrt(rows.sum()) for rows in own])
    return level, error


def _temperatures_apart(estimate: TriadResult) -> bool:
    """Whether no two recordings share a temperature, so that their levels may be those of temperatures."""
    temperature = np.asarray(estimate.dwells.temperature)
    number = np.asarray(estimate.dwells.rows)[:, 0]
    ranges = sorted(
        (temperature[number == k].min(), temperature[number == k].max()) for k in np.unique(number)
    )
    return all(high < low for (_, high), (low, _) in zip(ranges[:-1], ranges[1:]))
