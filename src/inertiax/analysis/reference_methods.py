"""The ways of calibrating over temperature that the founding paper names, side by side.

* `traditional`: hold the temperature, estimate one constant set per experiment, fit curves to the sets.
* `first_approach` (the paper's reference [3]): let the temperature sweep the whole range in one run, extend
  every parameter by its linear temperature dependence, and estimate piece by piece.
* the iterative procedure, its Gauss-Newton form, the joint fit: see `procedure`.

`chamber_hours` says what each costs, from the time that the device needs to come to rest thermally.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..estimators import AbstractEstimator
from ..numerics.linear_algebra import scaled_inverse
from ..physics.temperature import AbstractBasis, Curve, Polynomial
from ..procedure.experiment_sets import ExperimentPass
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells


class Pieces(eqx.Module):
    """Curves of the first approach and the straight lines that they were drawn through."""

    curve: Curve
    covariance: Float[
        np.ndarray, "unknowns unknowns"
    ]  # of coefficients, row-major (size, parameters)
    ranges: tuple[tuple[float, float], ...] = eqx.field(static=True)  # °C, of each piece
    ends: Float[np.ndarray, "pieces 2 parameters"]  # a piece's parameters at its two nodes
    succeeded: Bool[np.ndarray, " pieces"]


def traditional(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells
) -> tuple[Curve, bool]:
    """One constant set per experiment, attributed to its mean temperature, then approximation.

    **Returns** the curves and whether they are finite numbers. What the temperature does within an
    experiment goes into the sets unseen: the method's error, not its covariance, tells how good it is.
    Raises `ValueError` with fewer experiments than basis functions.
    """
    # The first pass of the paper's iteration, from curves constant over temperature, is this method.
    coefficients = paper_passes(estimator, basis, dwells, passes=1)[1]
    return Curve(basis, jnp.asarray(coefficients)), bool(np.isfinite(coefficients).all())


def paper_passes(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells, *, passes: int
) -> Float[np.ndarray, "_ size parameters"]:
    """The first passes of the paper's iteration: the start, the traditional calibration, and so on.

    The same as `iterate(PaperIteration...)`'s history, driven from the host: compiled in seconds, without
    derivatives. Raises `ValueError` with fewer experiments than basis functions.
    """
    by_experiment = ExperimentPass(estimator, basis, dwells)
    history = [by_experiment.problem.start()]
    for _ in range(passes):
        history.append(by_experiment.refine(history[-1]))
    return np.stack(history)


def first_approach(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells, *, pieces: int
) -> Pieces:
    """Linear temperature dependence in each of `pieces` stretches of one sweep, joined into curves.

    In a piece, θ(T) = θ₀ + θ₁ (T − T_c) for every parameter at once, from its dwells alone. The joined
    curves are the least-squares fit to the pieces' values at two temperatures each, weighted by the
    pieces' covariances. Dwells go to pieces by their rank in time, in equal numbers.

    Raises `ValueError` where a piece would have too few dwells for its unknowns, or the pieces are too
    few for the basis.
    """
    used = np.flatnonzero(np.asarray(dwells.valid))
    used = used[np.argsort(np.asarray(dwells.time)[used], kind="stable")]
    unknowns = 2 * estimator.num_parameters
    longest = -(-len(used) // pieces)
    if 2 * pieces < basis.size:
        raise ValueError(
            f"`first_approach(pieces={pieces})`: {2 * pieces} values cannot determine curves with "
            f"{basis.size} coefficients; take at least {-(-basis.size // 2)} pieces."
        )
    rows = Problem(estimator, Polynomial(1, -1.0, 1.0), dwells[used[:1]])
    equations = len(used) // pieces * rows.at(rows.start()).residual.shape[1]
    if equations <= unknowns:
        raise ValueError(
            f"`first_approach(pieces={pieces})`: {len(used) // pieces} dwells in a piece are too few for "
            f"{unknowns} unknowns; take fewer pieces or visit the programme more often in the sweep."
        )
    values, weights, ranges, good = [], [], [], []
    for rows in np.array_split(used, pieces):
        part = _padded(dwells, rows, longest)
        low, high = (float(f(np.asarray(dwells.temperature)[rows])) for f in (np.min, np.max))
        # All pieces share one compiled program: the line lives in a scaled temperature.
        line = Polynomial(1, -1.0, 1.0)
        part = eqx.tree_at(
            lambda d: d.temperature,
            part,
            (2.0 * jnp.asarray(part.temperature) - (low + high)) / (high - low),
        )
        problem = Problem(estimator, line, part)
        coefficients, _, converged = problem.solve(problem.start())
        covariance = problem.covariance(coefficients)
        at_nodes = np.stack([np.asarray(line(jnp.asarray(x))) for x in line.nodes])
        mix = np.kron(at_nodes, np.eye(estimator.num_parameters))
        values.append(at_nodes @ coefficients)
        weights.append(np.linalg.inv(mix @ covariance @ mix.T))
        ranges.append((low, high))
        good.append(converged)
    curve, covariance = _join(basis, ranges, np.stack(values), weights)
    return Pieces(curve, covariance, tuple(ranges), np.stack(values), np.array(good))


def _padded(dwells: Dwells, rows: np.ndarray, length: int) -> Dwells:
    part = dwells[np.pad(rows, (0, length - len(rows)), mode="edge")]
    return eqx.tree_at(lambda d: d.valid, part, jnp.asarray(np.arange(length) < len(rows)))


def _join(
    basis: AbstractBasis,
    ranges: list[tuple[float, float]],
    values: Float[np.ndarray, "pieces 2 parameters"],
    weights: list[np.ndarray],
) -> tuple[Curve, np.ndarray]:
    """Weighted least squares of the curves through all pieces' values."""
    count = values.shape[2]
    normal = np.zeros((basis.size * count, basis.size * count))
    right = np.zeros(basis.size * count)
    line = Polynomial(1, -1.0, 1.0)
    for (low, high), own, weight in zip(ranges, values, weights, strict=True):
        at = 0.5 * (low + high) + 0.5 * (high - low) * np.array(line.nodes)
        phi = np.stack([np.asarray(basis(jnp.asarray(t))) for t in at])
        design = np.kron(phi, np.eye(count))
        normal += design.T @ weight @ design
        right += design.T @ weight @ own.reshape(-1)
    inverse = scaled_inverse(normal)
    coefficients = (inverse @ right).reshape(basis.size, count)
    return Curve(basis, jnp.asarray(coefficients)), inverse


def chamber_hours(
    *,
    experiments: int,
    experiment_time: float,
    step: float,
    change: float,
    time_constant: float = 1800.0,
    chamber_rate: float = 2.0 / 60.0,
) -> float:
    """Hours in the chamber for experiments `step` °C apart in which `change` °C is allowed.

    After a step the device follows with its thermal time constant τ; it has to be waited for until what
    is still to come is below the allowed change,

        soak = τ ln(step / change)   where step > change, else none,

    beside the chamber's own ramp, step / rate. The default time constant (half an hour) is an
    assumption, of the order of an IMU of a few kilograms; `chamber_rate` in °C/s.
    """
    soak = time_constant * float(np.log(step / change)) if step > change else 0.0
    return experiments * (experiment_time + soak + step / chamber_rate) / 3600.0
