"""How alike dwells err that follow one another, and what that makes of the parameters' covariance.

Slow noise of a device (a bias that wanders within minutes) moves neighbouring dwells alike. Whitened rows of one axis
then have the covariance

    T = a I + b K,     K_ij = exp(-|t_i - t_j| / τ) within one experiment, 0 between two,

with a + b = σ². For misfits along the output alone, K_ij is times the cosine between the two outputs. Of gyros by
gravity's turn the rows are the rates at rest. a, b and τ are by restricted likelihood (Patterson and Thompson,
Biometrika 58, 1971), which allows for what the unknowns take. T is its mean over shares b / σ², logarithms of τ and
whether there is slow noise at all, for which the odds before are `ODDS`: a record of a few τ tells none of these well,
and intervals from the most likely ones, or from slow noise that passes a test, are too short.
What a rig is stated to do is in T as it is stated: with its mean share r of the rows' variance, the device's own
noise has (a − r) / (1 − r) of what its rows were given.
The estimate stays that of least squares, whose covariance is P Jᵀ T J P with P = (JᵀJ)⁻¹ (the sandwich of
White, Econometrica 48, 1980).

In one experiment the biases are those of its mean: with x the whitened slow noise of the dwells and Mᵀ x its mean over
their samples, added to the biases at all temperatures, K gives (J P + M)ᵀ K (J P + M). In M stands what the device
has of the rows' covariance, since what a rig errs is no bias of the device. How far the device was off all
along no row of the log can tell, and intervals that extrapolate it held 87 to 92 % under flicker and a random walk.
What several experiments have each of its own they do tell: their biases are those of the device, and M is zero.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..data.recording import Rig
from ..estimators import AbstractEstimator
from ..numerics.paule_mandel import widened
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from .alike_dwells import AlikeDwells
from .covariance_shares import given, OF_THE_DEVICE, root, shares


FEWEST = 8  # dwells more than unknowns of one axis, from which their correlation is looked at; convention
ODDS = 0.5  # that there is slow noise, before the rows are looked at; convention
_LEAST = (
    0.01  # probability of slow noise below which there is none; it would change no sigma by 1 %
)
_SHARES = np.array([0.1, 0.25, 0.4, 0.55, 0.7, 0.82, 0.92, 0.97, 0.99])  # b / σ² that are tried
_LONGEST = 4.0  # τ over the length of the record; of a random walk 85 % of the variance at that lag, 63 % with one
_TIMES = 9  # values of τ that are tried
_HUGE = 600.0  # log likelihood, whose exponential a double holds


class SlowNoise(NamedTuple):
    """Covariance T of whitened rows: `own` of what the device does to each, and for each time constant, s, what it has
    of `parts` times its K."""

    own: float = 1.0
    parts: tuple[float, ...] = ()
    times: tuple[float, ...] = ()
    probability: float = 0.0  # that there is any

    @property
    def alike(self) -> float:
        """b, by how much variance dwells err alike."""
        return float(sum(self.parts))


def with_slow_noise(
    problem: Problem,
    coefficients: Float[np.ndarray, "size parameter"],
    covariance: Float[np.ndarray, "unknowns unknowns"],
    rig: Rig,
) -> tuple[Float[np.ndarray, "unknowns unknowns"], SlowNoise]:
    """The covariance with T and M of the module in the place of `covariance` P, and the slow noise of the residuals."""
    jacobian = problem.at(coefficients).jacobian
    of_source = shares(
        problem.estimator, problem.dwells[: problem.num_dwells], rig, jacobian.shape[1]
    )
    noise, scatter = (of_source[s] for s in OF_THE_DEVICE)
    device = within(problem, noise + scatter)
    kept = _kept(problem, jacobian.shape[1])
    stated = 1.0 - float(np.mean(np.trace(device, axis1=1, axis2=2))) / kept
    slow = slow_noise_of(problem, coefficients, min(max(stated, 0.0), 1.0))
    if slow.alike == 0.0:
        return covariance, slow
    design = problem.weighted(problem.decorrelated(problem.design(jacobian)))
    changed = (slow.own - 1.0) * given(problem, device, design, covariance)
    return covariance + changed + slow_part(problem, coefficients, covariance, slow, device), slow


def wander(dwells: Dwells, estimator: AbstractEstimator, noise: SlowNoise) -> float:
    """1 sigma, m/s² or rad/s, of what dwells that follow one another have in common; in one experiment at its end."""
    covariance = np.asarray(getattr(dwells, f"{estimator.triad}_covariance"), float)
    # Rates at rest have their scatter in the covariance; the estimator's is of the tilts.
    scatter = 0.0 if dwells.motion is not None else float(np.asarray(estimator.scatter))
    variance = float(np.mean(np.trace(covariance, axis1=1, axis2=2))) / 3.0 + scatter**2
    alike = noise.alike
    if alike > 0.0 and of_one_log(dwells):
        time = np.asarray(dwells.time, float)
        rows = np.full((len(time), 1, 1), -1.0 / len(time))
        rows[np.argmax(time)] += 1.0
        in_time = AlikeDwells(time, np.zeros(len(time)), None)
        alike = in_time.product(rows, np.array(noise.parts), np.array(noise.times))[0, 0]
    return float(np.sqrt(alike * variance))


def of_one_log(dwells: Dwells) -> bool:
    """Whether biases are those of the mean over one experiment, M of the module."""
    return len(np.unique(np.asarray(dwells.experiment))) == 1


def within(
    problem: Problem, share: Float[np.ndarray, "dwell row row"]
) -> Float[np.ndarray, "dwell row row"]:
    """The part of a share that is of the rows which slow noise moves."""
    kept = _kept(problem, share.shape[1])
    part = np.zeros_like(share)
    part[:, :kept, :kept] = share[:, :kept, :kept]
    return part


def _kept(problem: Problem, rows: int) -> int:
    """Of a dwell's rows those, from the first, that slow noise moves: not the tilts of gravity after motions."""
    return rows if problem.dwells.motion is None else 3


def _alike(problem: Problem, rows: int) -> AlikeDwells:
    """K of a problem's dwells with `rows` rows each."""
    return AlikeDwells(*_when(problem), _directions(problem) if rows == 1 else None)


def slow_noise_of(
    problem: Problem, coefficients: Float[np.ndarray, "size parameter"], stated: float = 0.0
) -> SlowNoise:
    """The slow noise that a fit's residuals show; none where too few dwells tell it.

    **Arguments:** `stated` is the rig's mean share of the rows' variance, r of the module.
    """
    design, residual = problem.rows(coefficients)
    count = problem.num_dwells
    columns = np.column_stack([design, residual]).reshape(count, len(residual) // count, -1)
    together = columns[:, : _kept(problem, columns.shape[1])]
    size = np.sqrt(np.sum(np.square(together), axis=(0, 1)))
    size[-1] = 1.0  # the residual's own
    together = together[:, :, size > 0.0] / size[size > 0.0]
    rows, unknowns = together.shape[1], together.shape[2] - 1
    if rows not in (1, 3) or count < unknowns / rows + FEWEST:
        return SlowNoise()
    time = np.asarray(problem.dwells.time, float)[:count]
    steps = np.diff(np.sort(time))
    steps = steps[steps > 0.0]
    if len(steps) == 0:
        return SlowNoise()
    flat = together.reshape(-1, unknowns + 1)
    white, _ = _likelihood((flat.T @ flat)[None], np.zeros(1), len(flat))
    longest = max(float(np.ptp(time)), 2.0 * float(np.median(steps)))
    times = np.geomspace(0.5 * float(np.median(steps)), _LONGEST * longest, _TIMES)
    cases = np.tile(_SHARES, _TIMES), np.repeat(times, len(_SHARES))
    whitened = _alike(problem, rows).whitened(together, *cases)
    likelihood, variance = (
        x.reshape(_TIMES, len(_SHARES)) for x in _likelihood(*whitened, len(flat))
    )
    gain = np.exp(np.minimum(likelihood - white[0], _HUGE))
    odds = ODDS * float(np.mean(gain))
    probability = odds / (1.0 + odds)
    if probability < _LEAST:
        return SlowNoise()
    weight = probability * gain / np.sum(gain)
    # As the scatter between dwells, which these rows are whitened with: their mean over what the residuals leave open.
    freedom = float(len(flat) - unknowns)
    variance = variance * (freedom / widened(freedom))
    parts = np.sum(weight * variance * _SHARES, axis=1)
    alone = np.maximum(variance * (1.0 - _SHARES) - stated, 0.0) / max(1.0 - stated, 1e-12)
    own = 1.0 - probability + float(np.sum(weight * alone))
    return SlowNoise(own, tuple(parts.tolist()), tuple(times.tolist()), probability)


def _likelihood(
    gram: Float[np.ndarray, "case column column"],
    volume: Float[np.ndarray, " case"],
    count: int,
) -> tuple[Float[np.ndarray, " case"], Float[np.ndarray, " case"]]:
    """Restricted log likelihood of `count` rows at the most likely σ², and that σ², by XᵀT⁻¹X and log det T.

    The last column of X holds the residuals, the others the design.
    """
    normal, cross = gram[:, :-1, :-1], gram[:, :-1, -1:]
    taken = np.sum(cross * np.linalg.solve(normal, cross), axis=(1, 2))
    dof = count - gram.shape[1] + 1
    variance = np.maximum(gram[:, -1, -1] - taken, np.finfo(float).tiny) / dof
    spread = volume + np.linalg.slogdet(normal)[1]
    return -0.5 * (spread + dof * np.log(variance)), variance


def slow_part(
    problem: Problem,
    coefficients: Float[np.ndarray, "size parameter"],
    covariance: Float[np.ndarray, "unknowns unknowns"],
    noise: SlowNoise,
    device: Float[np.ndarray, "dwell row row"],
) -> Float[np.ndarray, "unknowns unknowns"]:
    """b (J P + M)ᵀ K (J P + M): what slow noise gives to the coefficients; `covariance` is P.

    **Arguments:** `device` is the device's share of the rows (`covariance_shares`), within what slow noise moves.
    """
    if noise.alike == 0.0:
        return np.zeros_like(covariance)
    design, residual = problem.rows(coefficients)
    rows = _kept(problem, len(residual) // problem.num_dwells)
    moved_by = (design @ covariance).reshape(problem.num_dwells, -1, len(covariance))[:, :rows]
    if rows == 1:  # each axis moves the row as far as the output is along it
        moved_by = _directions(problem)[:, :, None] * moved_by
    if of_one_log(problem.dwells):
        moved_by = moved_by + _of_log(problem, device[:, :rows, :rows])
    return AlikeDwells(*_when(problem), None).product(
        moved_by, np.array(noise.parts), np.array(noise.times)
    )


def _when(problem: Problem) -> tuple[Float[np.ndarray, " dwell"], Float[np.ndarray, " dwell"]]:
    """Times, s, and numbers of the experiments of a problem's dwells."""
    dwells, count = problem.dwells, problem.num_dwells
    return np.asarray(dwells.time, float)[:count], np.asarray(dwells.experiment, float)[:count]


def _directions(problem: Problem) -> Float[np.ndarray, "dwell 3"]:
    """Unit vectors along the outputs."""
    output = np.asarray(getattr(problem.dwells, problem.estimator.triad), float)
    output = output[: problem.num_dwells]
    return output / np.linalg.norm(output, axis=1, keepdims=True)


def _of_log(
    problem: Problem, device: Float[np.ndarray, "dwell row row"]
) -> Float[np.ndarray, "dwell 3 unknowns"]:
    """M of the module."""
    estimator, count = problem.estimator, problem.num_dwells
    weight = np.asarray(problem.dwells.count, float)[:count]
    given = np.asarray(getattr(problem.dwells, f"{estimator.triad}_covariance"), float)[:count]
    # Rates at rest have their scatter in the covariance; the estimator's is of the tilts.
    scatter = 0.0 if problem.dwells.motion is not None else float(np.asarray(estimator.scatter))
    total = given + scatter**2 * np.eye(3)
    if device.shape[1] == 1:
        unit = _directions(problem)
        sigma = np.sqrt(np.einsum("ni,nij,nj->n", unit, total, unit) * device[:, 0, 0])
        deviation = sigma[:, None, None] * np.eye(3)
    else:
        deviation = np.linalg.cholesky(total) @ root(device)
    own = [estimator.names.index(f"{estimator.triad}.bias[{axis}]") for axis in range(3)]
    constant = problem.interpolated(np.ones((problem.basis.size, 1)))[:, 0]
    made = np.zeros((count, 3, problem.basis.size, estimator.num_parameters))
    by_axis = (weight / np.sum(weight))[:, None, None] * np.swapaxes(deviation, 1, 2)
    made[:, :, :, own] = by_axis[:, :, None, :] * constant[:, None]
    return made.reshape(count, 3, -1)
