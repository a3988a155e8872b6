"""Maximum likelihood of noise terms on a log's spectrum, behind a low-pass filter (Whittle's).

    m = Σ θ e / (1 + c₁ x + c₂ x² + …) + floor,   θ ≥ 0

θ are the squares of the coefficients, e the spectra that coefficients of one would give, and x grows with the square
of the frequency. Minimised is Σ n (log m + p / m), the deviance of independent χ² ordinates; uncertainties
allow for the correlation of neighbouring ordinates.

**Reference:** Whittle, *Ark. Mat.* 2 (1953) 423.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import toeplitz
from scipy.optimize import nnls
from scipy.sparse import csr_array

from .spectrum import TAPERS


_MOST_PASSES = 100
_LEAST_STEP = 1e-3
_SETTLED = 1e-4  # of the deviance, whose limits are some units away
_RIDGE = 1e-11  # of columns of length one
_LEAST_SHARE = (
    1e-6  # of the power that a model holds at least, so that no step ends at a model of zero
)


class Problem(NamedTuple):
    """What is fitted: bins of a spectrum, the terms' spectra, and the powers of x that the filter may have."""

    power: Float[np.ndarray, " bin"]
    expected: Float[np.ndarray, "bin term"]
    width: Float[np.ndarray, " bin"]  # ordinates in the bin
    floor: Float[np.ndarray, " bin"]  # known noise that the filter does not touch
    powers: Float[np.ndarray, "bin order"]  # x, x², …, with x = 1 at the band's end

    @property
    def order(self) -> int:
        """Number of coefficients of the filter."""
        return self.powers.shape[1]

    def with_terms(self, kept: Bool[np.ndarray, " term"] | Int[np.ndarray, " kept"]) -> "Problem":
        """The same with these terms only: a mask, or their indices."""
        return self._replace(expected=self.expected[:, kept])

    def with_order(self, order: int) -> "Problem":
        """The same with fewer coefficients of the filter."""
        return self._replace(powers=self.powers[:, :order])


class Fit(NamedTuple):
    """The likeliest model of a problem."""

    squares: Float[np.ndarray, " term"]  # θ
    filter: Float[np.ndarray, " order"]  # c
    model: Float[np.ndarray, " bin"]
    deviance: float  # −2 log L up to a constant


def deviance(problem: Problem, model: Float[np.ndarray, " bin"]) -> float:
    """−2 log L of independent ordinates, each the mean of the tapers', up to a constant."""
    return 2.0 * float(problem.width @ (np.log(model) + problem.power / model))


def model_of(
    problem: Problem, squares: Float[np.ndarray, " term"], filter: Float[np.ndarray, " order"]
) -> Float[np.ndarray, " bin"]:
    """Expected spectrum of a fit."""
    divisor = 1.0 + problem.powers @ filter
    return problem.expected @ squares / divisor + problem.floor


def maximum_likelihood(
    problem: Problem,
    *,
    start: Fit | None = None,
    held: tuple[int, float] | None = None,
) -> Fit:
    """The likeliest squares and filter, by Fisher's scoring with the squares kept at zero or more.

    `start` is a fit of the same terms to begin with, perhaps of a filter of lower order; `held` keeps one term (its
    index) at a given square.
    """
    which, kept = (-1, 0.0) if held is None else held
    free = np.arange(problem.expected.shape[1]) != which
    squares = np.zeros(len(free)) if start is None else start.squares
    squares = np.where(free, squares, kept)
    filter = np.zeros(problem.order)
    model, now = problem.power, np.inf
    if start is not None:
        filter[: len(start.filter)] = start.filter
        model = _model(problem, squares, filter)
        now = deviance(problem, model)
    for _ in range(_MOST_PASSES):
        new, bent = _scored(problem, squares, filter, model, free)
        step = 1.0
        # Whole steps may swing between two terms of nearly the same shape.
        while step > _LEAST_STEP:
            trial = squares + step * (new - squares)
            trial_filter = filter + step * (bent - filter)
            if not problem.order or np.all(problem.powers @ trial_filter > -1.0):
                model_there = _model(problem, trial, trial_filter)
                there = deviance(problem, model_there)
                if there < now:
                    break
            step *= 0.5
        else:
            break
        fallen = now - there
        squares, filter, model, now = trial, trial_filter, model_there, there
        if fallen < _SETTLED:
            break
    return Fit(squares, filter, model, now)


def _model(
    problem: Problem, squares: Float[np.ndarray, " term"], filter: Float[np.ndarray, " order"]
) -> Float[np.ndarray, " bin"]:
    return np.maximum(model_of(problem, squares, filter), _LEAST_SHARE * problem.power)


def _scored(
    problem: Problem,
    squares: Float[np.ndarray, " term"],
    filter: Float[np.ndarray, " order"],
    model: Float[np.ndarray, " bin"],
    free: Bool[np.ndarray, " term"],
) -> tuple[np.ndarray, np.ndarray]:
    """Fisher's scoring: the next squares and filter."""
    slopes = jacobian(problem, squares, filter)
    terms, bends = slopes[:, : len(squares)], slopes[:, len(squares) :]
    if not squares.any():  # nothing yet that the filter could bend
        bends = bends[:, :0]
    target = problem.power - problem.floor - terms[:, ~free] @ squares[~free]
    target = target + bends @ filter[: bends.shape[1]]
    weight = np.sqrt(problem.width) / model
    rows = np.concatenate([bends, terms[:, free]], axis=1) * weight[:, None]
    scale = np.sqrt(np.einsum("ij,ij->j", rows, rows)) + 1e-300
    found = _least_squares(rows / scale, target * weight, bends.shape[1]) / scale
    new, order = squares.copy(), bends.shape[1]
    new[free] = found[order:]
    return new, found[:order] if order else filter


def _least_squares(rows: np.ndarray, target: np.ndarray, unbounded: int) -> np.ndarray:
    """Least squares with all but the first `unbounded` unknowns at zero or more; columns have length one."""
    gram = rows.T @ rows
    # Terms may have nearly the same shape in a narrow band.
    gram.flat[:: len(gram) + 1] += _RIDGE
    left = np.linalg.cholesky(gram).T
    right = np.linalg.solve(left.T, rows.T @ target)
    # Rows below the unbounded ones do not hold these; they follow from their own rows afterwards.
    lower = np.ascontiguousarray(left[unbounded:, unbounded:])
    bounded = nnls(lower, right[unbounded:])[0] if len(lower) else np.zeros(0)
    if not unbounded:
        return bounded
    upper = left[:unbounded]
    rest = right[:unbounded] - upper[:, unbounded:] @ bounded
    return np.concatenate([np.linalg.solve(upper[:, :unbounded], rest), bounded])


def jacobian(
    problem: Problem, squares: Float[np.ndarray, " term"], filter: Float[np.ndarray, " order"]
) -> Float[np.ndarray, "bin parameter"]:
    """Derivatives of the model by the squares, then by the filter's coefficients."""
    divisor = (1.0 + problem.powers @ filter)[:, None]
    terms = problem.expected / divisor
    return np.concatenate([terms, -(terms @ squares)[:, None] * problem.powers / divisor], axis=1)


# Uncertainty -----------------------------------------------------------------------------------------


def variance(problem: Problem, fit: Fit, own: int) -> tuple[float, float]:
    """Variance of one square: the diagonal elements of H⁻¹ J H⁻¹ and of H⁻¹.

    J is the covariance of the score: ordinates within a taper's width correlate. Terms that were found
    to be zero are left out for the others' uncertainty; their own is that of being let free.
    """
    used = np.union1d(np.flatnonzero(fit.squares > 0), [own])
    right, naive = (float(c[used == own, used == own][0]) for c in covariance(problem, fit, used))
    return right, naive


def covariance(
    problem: Problem, fit: Fit, used: np.ndarray
) -> tuple[Float[np.ndarray, "used used"], Float[np.ndarray, "used used"]]:
    """H⁻¹ J H⁻¹ and H⁻¹ of the squares of the terms `used`, the filter free, the other terms held."""
    slopes = jacobian(problem, fit.squares, fit.filter)
    num = len(fit.squares)
    chosen = slopes[:, np.concatenate([used, np.arange(num, slopes.shape[1])])]
    rows = chosen * (np.sqrt(problem.width) / fit.model)[:, None]
    scale = np.linalg.norm(rows, axis=0)
    rows = rows / (scale + 1e-300)
    bread = np.linalg.pinv(rows.T @ rows)
    right = bread @ (rows.T @ _correlated(problem.width, rows)) @ bread
    scales = np.outer(scale, scale)
    count = len(used)
    return (right / scales)[:count, :count], (bread / scales)[:count, :count]


def _correlated(width: Float[np.ndarray, " bin"], v: np.ndarray) -> np.ndarray:
    """C v for the covariance C of relative bin means times √width."""
    result = spread_of_means() * v
    single = int(np.sum(width == 1.0))
    if single:
        result[:single] = _correlation(single) @ v[:single]
    return result


@cache
def _correlation(single: int) -> csr_array:
    """Covariance of the lowest relative ordinates."""
    alone = ordinate_covariance()
    matrix = toeplitz(np.concatenate([alone, np.zeros(max(single - len(alone), 0))])[:single])
    # Near zero frequency an ordinate meets its mirror image as well.
    index = np.arange(1, single + 1)
    together = index[:, None] + index[None, :]
    near = together < len(alone)
    return csr_array(matrix + np.where(near, alone[np.minimum(together, len(alone) - 1)], 0.0))


@cache
def spread_of_means() -> float:
    """Variance of a wide bin's relative mean, times its width."""
    alone = ordinate_covariance()
    return float(alone[0] + 2.0 * alone[1:].sum())


@cache
def ordinate_covariance() -> Float[np.ndarray, " lag"]:
    """Covariance of two relative ordinates by the steps between them: Σ |Σ h_a h_b e^{iωt}|² / T²."""
    size = 4096
    t = np.arange(size)
    tapers = np.sqrt(2.0 / size) * np.sin(np.pi * np.arange(1, TAPERS + 1)[:, None] * t / size)
    products = tapers[:, None, :] * tapers[None, :, :]
    transform = np.fft.rfft(products, axis=2)[:, :, : 2 * TAPERS]
    return np.sum(np.square(np.abs(transform)), axis=(0, 1)) / TAPERS**2
