"""How alike dwells err that follow one another, and what that makes of the parameters' covariance.

Slow noise of a device (a bias that wanders within minutes) moves neighbouring dwells alike. Whitened rows of one axis
then have the covariance

    T = a I + b K,     K_ij = exp(-|t_i - t_j| / τ) within one experiment, 0 between two,

with a + b = σ². For misfits along the output alone, K_ij is times the cosine between the two outputs. a, b and τ are by
restricted likelihood (Patterson and Thompson, Biometrika 58, 1971), which allows for what the unknowns take: T is its
mean over shares b / σ² and logarithms of τ, for a record of a few τ does not tell them well, and the most likely ones
are on average too small.
The estimate stays that of least squares, whose covariance is P Jᵀ T J P with P = (JᵀJ)⁻¹ (the sandwich of
White, Econometrica 48, 1980).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import chdtri

from ..procedure.single_device import Problem


FEWEST = 8  # dwells more than unknowns of one axis, from which their correlation is looked at; convention
# Twice the gain of log likelihood from which dwells are taken as alike: rarer than 1e-3 for one variance, as misfits
# that follow something are (`misfit_pattern`), since a slow noise as long as the record leaves no bias known.
LEAST_GAIN = float(chdtri(1, 1e-3))
_SHARES = np.array([0.1, 0.25, 0.4, 0.55, 0.7, 0.8, 0.9, 0.96])  # b / σ² that are tried
_TIMES = 9  # values of τ that are tried


class SlowNoise(NamedTuple):
    """Covariance T of whitened rows: `own` I and for each time constant, s, what it has of `parts` times its K."""

    own: float = 1.0
    parts: tuple[float, ...] = ()
    times: tuple[float, ...] = ()

    @property
    def alike(self) -> float:
        """b, by how much variance dwells err alike."""
        return float(sum(self.parts))


def kernel(
    time: Float[np.ndarray, " dwell"],
    experiment: Float[np.ndarray, " dwell"],
    output: Float[np.ndarray, "dwell 3"] | None,
    constant: float,
) -> Float[np.ndarray, "dwell dwell"]:
    """K: how alike dwells err. `output` where a row is along it, else `None`; `constant` is τ, s."""
    found = np.exp(-np.abs(time[:, None] - time) / constant)
    found = np.where(experiment[:, None] == experiment, found, 0.0)
    if output is None:
        return found
    unit = output / np.linalg.norm(output, axis=1, keepdims=True)
    return found * (unit @ unit.T)


def kernel_of(problem: Problem, rows: int, constant: float) -> Float[np.ndarray, "dwell dwell"]:
    """K of a problem's dwells with `rows` rows each."""
    dwells, triad = problem.dwells, problem.estimator.triad
    count = problem.num_dwells
    output = np.asarray(getattr(dwells, triad), float)[:count] if rows == 1 else None
    time, experiment = (np.asarray(x, float)[:count] for x in (dwells.time, dwells.experiment))
    return kernel(time, experiment, output, constant)


def slow_noise_of(problem: Problem, coefficients: Float[np.ndarray, "size parameter"]) -> SlowNoise:
    """The slow noise that a fit's residuals show; none where too few dwells or too small a gain tell it."""
    design, residual = problem.rows(coefficients)
    count = problem.num_dwells
    rows = len(residual) // count
    unknowns = design.shape[1]
    if rows not in (1, 3) or count < unknowns / rows + FEWEST:
        return SlowNoise()
    size = np.linalg.norm(design, axis=0)
    columns = np.column_stack([design / np.where(size > 0.0, size, 1.0), residual])
    together = columns.reshape(count, rows, -1)
    time = np.asarray(problem.dwells.time, float)[:count]
    steps = np.diff(np.sort(time))
    steps = steps[steps > 0.0]
    if len(steps) == 0:
        return SlowNoise()
    white, _ = _likelihood(np.ones((1, count)), together)
    longest = max(float(np.ptp(time)), 2.0 * float(np.median(steps)))
    times = np.geomspace(0.5 * float(np.median(steps)), longest, _TIMES)
    tried = []
    for constant in times:
        values, vectors = np.linalg.eigh(kernel_of(problem, rows, float(constant)))
        turned = (vectors.T @ together.reshape(count, -1)).reshape(together.shape)
        shares = _SHARES[:, None]
        tried.append(_likelihood(1.0 - shares + shares * np.maximum(values, 0.0), turned))
    likelihood, variance = np.array(tried).transpose(1, 0, 2)
    best = float(likelihood.max())
    if best < float(white[0]) + 0.5 * LEAST_GAIN:
        return SlowNoise()
    weight = np.exp(likelihood - best)
    weight = variance * weight / np.sum(weight)
    parts = np.sum(weight * _SHARES, axis=1)
    own = float(np.sum(weight * (1.0 - _SHARES)))
    return SlowNoise(own, tuple(parts.tolist()), tuple(times.tolist()))


def _likelihood(
    variances: Float[np.ndarray, "case dwell"],
    together: Float[np.ndarray, "dwell row column"],
) -> tuple[Float[np.ndarray, " case"], Float[np.ndarray, " case"]]:
    """Restricted log likelihood at the most likely σ², and that σ², for variances of independent rows in units of it.

    The last column holds the residuals, the others the design.
    """
    count, rows, columns = together.shape
    gram = np.einsum("cd,dri,drj->cij", 1.0 / variances, together, together, optimize=True)
    normal, cross = gram[:, :-1, :-1], gram[:, :-1, -1:]
    taken = np.sum(cross * np.linalg.solve(normal, cross), axis=(1, 2))
    dof = count * rows - columns + 1
    variance = np.maximum(gram[:, -1, -1] - taken, np.finfo(float).tiny) / dof
    spread = rows * np.sum(np.log(variances), axis=1) + np.linalg.slogdet(normal)[1]
    return -0.5 * (spread + dof * np.log(variance)), variance


def slow_part(
    problem: Problem,
    coefficients: Float[np.ndarray, "size parameter"],
    covariance: Float[np.ndarray, "unknowns unknowns"],
    noise: SlowNoise,
) -> Float[np.ndarray, "unknowns unknowns"]:
    """b P Jᵀ K J P: what slow noise gives to the coefficients, with `covariance` P of independent dwells."""
    if noise.alike == 0.0:
        return np.zeros_like(covariance)
    design, residual = problem.rows(coefficients)
    rows = len(residual) // problem.num_dwells
    alike = sum(
        part * kernel_of(problem, rows, time)
        for part, time in zip(noise.parts, noise.times, strict=True)
    )
    by_dwell = (design @ covariance).reshape(problem.num_dwells, rows, -1)
    moved = np.einsum("nm,mru->nru", alike, by_dwell)
    found = np.einsum("nru,nrv->uv", by_dwell, moved)
    return 0.5 * (found + found.T)
