r"""What all rests of a gyro err alike because its outputs are rounded, or held, where noise does not dither them.

A rest's covariance holds its own rounding (`mean_noise.quantisation_floor`). But rests read the same bias, and so the
same distance from the steps of the converter: their rounding errors do not average out. For a phase that nothing is
known of, the errors of two means $m_j$ and $m_k$ have the covariance (Widrow, Kollár, *Quantization Noise*, 2008,
ch. 5)

$$V_{jk} = \frac{q^2}{2 \pi^2} \sum_i \frac{1}{i^2} e^{-4 \pi^2 i^2 \sigma^2 / q^2}
\cos \frac{2 \pi i (m_j - m_k)}{q},$$

with the step q and the noise σ before rounding: $q^2 / 12$ for rests that read one value. With the change S of the
coefficients by the rests' means, $S (V - \mathrm{diag} V) S^T$ is added to their covariance. A gyro that is held at one
value at rest without a step that shows (a dead band, a firmware that takes small rates for none) tells of its bias no
more than that it is like other gyros' (`FitLimits.usual_size`).
"""

from collections.abc import Sequence

import numpy as np
import scipy.special
from jaxtyping import Float

from .._jax import eqx
from ..data.recording import Recording
from ..plausibility.thresholds import DEFAULT
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from ..reduction.mean_noise import converter_steps
from .goodness_of_fit import usual_size
from .results import TriadResult


_HARMONICS = 12  # of the sum: what is left of 1/i² is 5 % of the variance
_MOST_RESTS = 200  # looked at for step and noise, which are the converter's and the device's
_LEAST = 1e-3  # of the variance of a bias, below which what is common changes no figure


def with_common_rounding(result: TriadResult, recordings: Sequence[Recording]) -> TriadResult:
    """The gyros' estimate with the covariance of what their rests err alike; as it is where noise dithers them."""
    dwells = result.dwells if result.fitted is None else result.fitted
    if result.estimator.triad != "gyro" or dwells.rows is None or dwells.gyro is None:
        return result
    rests = np.flatnonzero(np.asarray(dwells.position) >= 0)
    if not len(rests):
        return result
    alike = [_alike(recordings, dwells, rests, axis) for axis in range(3)]
    if all(u is None for u in alike):
        return result
    added = _moved(result, dwells, rests, alike)
    own = np.asarray(result.solution.covariance)
    if not np.any(np.diag(added) > _LEAST * np.diag(own)):
        return result
    return eqx.tree_at(
        lambda r: (r.solution.covariance, r.rounding),
        result,
        (own + added, added),
        is_leaf=lambda x: x is None,
    )


def _alike(
    recordings: Sequence[Recording], dwells: Dwells, rests: np.ndarray, axis: int
) -> Float[np.ndarray, "rest error"] | None:
    """A root of V of one axis' rests, rad/s; `None` where there is nothing in common."""
    rows = np.asarray(dwells.rows)[rests]
    some = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MOST_RESTS)).astype(int)]
    outputs = [np.asarray(recordings[k].gyro)[a:b, axis] for k, a, b, _ in some]
    mean = np.asarray(dwells.gyro)[rests, axis]
    first = recordings[int(some[0, 0])].gyro
    assert first is not None  # `dwells.gyro` are its means
    step = float(converter_steps(first)[axis])
    if step == 0.0:
        held = np.concatenate(outputs)
        value = np.partition(held, len(held) // 2)[len(held) // 2]
        if np.mean(held == value) <= DEFAULT.held_at_rest:
            return None
        return np.full((len(rests), 1), usual_size("gyro.bias[0]"))
    # The median over rests, for a knock dithers no rest but its own.
    most = float(np.median([np.var(x) for x in outputs])) / step**2
    noise = min(_noise(np.concatenate(outputs) / step), most)
    i = np.arange(1, _HARMONICS + 1)
    size = step / (np.sqrt(2.0) * np.pi * i) * np.exp(-2.0 * np.pi**2 * i**2 * noise)
    phase = 2.0 * np.pi * i * mean[:, None] / step
    return np.concatenate([size * np.cos(phase), size * np.sin(phase)], axis=1)


def _noise(levels: Float[np.ndarray, " sample"]) -> float:
    """σ² before rounding in squares of the step, by what falls below two neighbouring limits between levels.

    The rounded samples' variance tells it badly: beside a limit a little noise makes a quarter of a square. 0 where the
    samples have two levels at most: a single limit tells no width.
    """
    number = np.round(levels - levels.min()).astype(int)
    below = np.cumsum(np.bincount(number))[:-1] / len(number)
    if len(below) < 2:
        return 0.0
    pair = np.minimum(
        np.minimum(below[:-1], 1.0 - below[:-1]), np.minimum(below[1:], 1.0 - below[1:])
    )
    k = int(np.argmax(pair))
    apart = float(scipy.special.ndtri(below[k + 1]) - scipy.special.ndtri(below[k]))
    return 1.0 / apart**2 if 0.0 < apart < np.inf else 0.0


def _moved(
    result: TriadResult,
    dwells: Dwells,
    rests: np.ndarray,
    alike: Sequence[Float[np.ndarray, "rest error"] | None],
) -> Float[np.ndarray, "unknown unknown"]:
    """S (V − diag V) Sᵀ of the module."""
    problem = Problem(result.estimator, result.solution.curve.basis, dwells)
    coefficients = np.asarray(result.solution.curve.coefficients)
    design, _ = problem.rows(coefficients)
    own = problem.covariance(coefficients)
    here = problem.at(coefficients).residual
    added = np.zeros_like(own)
    for axis, errors in enumerate(alike):
        if errors is None:
            continue
        step = 1e-3  # rad/s; rows are linear in the means at rest
        shifted = np.array(problem.dwells.gyro, float)
        shifted[:, axis] += step
        there = eqx.tree_at(lambda d: d.gyro, problem.dwells, shifted)
        by_mean = (problem.at(coefficients, there).residual - here)[rests] / step
        whole = np.zeros((*here.shape, errors.shape[1]))
        whole[rests] = by_mean[:, :, None] * errors[:, None, :]
        slope = -own @ design.T @ problem.decorrelated(whole.reshape(-1, errors.shape[1]))
        each = np.einsum("nru,nr->un", design.reshape(*here.shape, -1)[rests], by_mean)
        apart = (own @ each) * np.sqrt(np.sum(np.square(errors), axis=1))
        added += slope @ slope.T - apart @ apart.T
    return added
