"""Many devices' dwells to their parameters: padded, chunked, solved, weighted anew.

The invariant accelerometer problem has programs of its own; the reference and static estimators, which are
linear in their parameters, share one.
"""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Literal, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ...calibrate.slow_noise import SlowNoise
from ...estimators import AbstractEstimator, Invariant, NOMINAL_SIGMA
from ...numerics.aligned_arrays import empty_aligned
from ...numerics.own_kernels import is_tried, OPTIONS
from ...numerics.paule_mandel import batched_excess_deviation, widened
from ...physics.temperature import AbstractBasis, Constant
from ...reduction.dwells import Dwells, with_harmless_padding
from .invariant import BatchFit, fit_chunks
from .linear import fit_linear
from .refined_noise import refined_sigma
from .thermal import fit_thermal_invariant


# Devices solved at once: what stays in a core's cache (measured in benchmarks/fleet/solve.py).
LANES = 64
BLOCKS = 16
# Lots of `LANES` in one call of the compiled program, which is told how many of them are used; a call costs as much as
# a hundred devices.
CHUNKS = 32
# Calls of a part at most, all rounds of which are done by one thread: what a round costs beside its solves, and
# the lanes that it leaves empty, are shared.
CALLS = 4
# On an accelerator: what keeps it busy, in some hundred MB of its memory.
LANES_THERE, BLOCKS_THERE = 2**16, 2**11

Precision = Literal["float64", "float32"]
Rows = slice | np.ndarray  # of devices
Tree = TypeVar("Tree")


class FleetFit(eqx.Module):
    """Solutions of many devices, NumPy, leading with the device in the order given."""

    parameters: Float[np.ndarray, "devices unknowns"]  # row-major (basis, parameters), SI
    covariance: Float[np.ndarray, "devices unknowns unknowns"]  # NaN where rank deficient
    misfit: Float[np.ndarray, "devices dwells rows"]  # SI; zero at padding
    own_sigma: Float[np.ndarray, "devices dwells rows"]  # of the misfit, by the dwells' own noise
    valid: Bool[np.ndarray, "devices dwells"]
    scatter: Float[np.ndarray, " devices"]  # beyond that noise, SI
    chi2_per_dof: Float[np.ndarray, " devices"]  # with the dwells' own noise; NaN where unknown
    converged: Bool[np.ndarray, " devices"]
    num_steps: Int[np.ndarray, " devices"]
    # Of each device, within the covariance; None where it was not looked for.
    slow: tuple[SlowNoise, ...] | None = eqx.field(static=True, default=None)


def fit_fleet(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    *,
    threads: int | None = None,
    precision: Precision = "float64",
    refined: bool = False,
) -> FleetFit:
    """Calibrate one triad of many devices, as `calibrate` does one: joint fit, then weights with the scatter
    between dwells that the misfit shows (Paule and Mandel 1982), then again.

    **Arguments:** `dwells` has a leading device axis, see `stack_dwells`; `threads` solve chunks side by
    side (default: one for each core); `precision` of the invariant problem's arithmetic, "float64" whatever JAX
    is set to, or "float32" for accelerators that are slow with more: estimates then end within some 10⁻⁷ of
    gravity of the minimum, and weights and results stay float64.

    Raises `ValueError` where "float32" is asked of another estimator.
    """
    if precision == "float32" and not _is_batched(estimator):
        raise ValueError(
            "`fit_fleet(precision='float32')` is for the invariant estimator without robust loss; got "
            f"{type(estimator).__name__}. Leave it out."
        )
    dwells = with_harmless_padding(dwells)
    count, cores = len(dwells.valid), threads or os.cpu_count() or 1
    size = _chunk(estimator, basis, count)
    # Parts enough for several cores, but of a size that is not that of the machine, so that results are not either.
    step = _part_size(basis, size, count)
    parts = [slice(s, min(s + step, count)) for s in range(0, count, step)]
    fit = _unsolved(estimator, basis, dwells)
    if len(parts) <= 1:
        _fit_part(estimator, basis, dwells, fit, size, precision, refined)
        return fit
    one = lambda part: _fit_part(
        estimator, basis, _part(dwells, part), _part(fit, part), size, precision, refined
    )
    # The first part compiles; the others then run the same program side by side.
    one(parts[0])
    with ThreadPoolExecutor(cores) as pool:
        list(pool.map(one, parts[1:]))
    return fit


def _part_size(basis: AbstractBasis, size: int, count: int) -> int:
    """Devices of a part, in calls of `size`."""
    if not isinstance(basis, Constant):
        return size * CALLS
    # What a call does not use costs nothing on processors, so that parts may be smaller.
    least = size // 2 if size == LANES * CHUNKS and jax.default_backend() == "cpu" else size
    return least * min(max(count // (4 * least), 1), CALLS)


def _unsolved(estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells) -> FleetFit:
    """Room for the solutions, which parts write in place."""
    valid = np.asarray(dwells.valid)
    rows = 1 if isinstance(estimator, Invariant) else 3
    count, unknowns = len(valid), basis.size * estimator.num_parameters
    return FleetFit(
        parameters=np.empty((count, unknowns)),
        covariance=np.empty((count, unknowns, unknowns)),
        misfit=np.empty((*valid.shape, rows)),
        own_sigma=np.empty((*valid.shape, rows)),
        valid=valid,
        scatter=np.empty(count),
        chi2_per_dof=np.empty(count),
        converged=np.empty(count, bool),
        num_steps=np.empty(count, np.int32),
    )


def _fit_part(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    fit: FleetFit,
    size: int,
    precision: Precision,
    refined: bool,
) -> None:
    """`fit_fleet` of some of the devices into `fit`, in calls of `size`."""
    own, scatter, unknowns = fit.own_sigma, fit.scatter, fit.parameters.shape[1]
    own[:] = _own_sigma(estimator, dwells)
    kept = np.broadcast_to(fit.valid[:, :, None], own.shape).reshape(len(own), -1)
    variance = np.where(kept, np.square(own).reshape(kept.shape), 1.0)
    known = np.all(variance > 0, axis=1)
    dof = kept.sum(axis=1) - unknowns
    scatter[:] = np.where(known, 0.0, NOMINAL_SIGMA)
    solved: Rows = slice(0, len(scatter))
    weighed = own
    if refined and isinstance(estimator, Invariant) and _is_batched(estimator):
        _solve(estimator, basis, dwells, fit, weighed, solved, size, precision)
        weighed = refined_sigma(basis, dwells, fit.parameters, own)
    for k in range(3):
        _solve(estimator, basis, dwells, fit, weighed, solved, size, precision)
        square = np.square(fit.misfit[solved]).reshape(-1, kept.shape[1])
        square = np.where(kept[solved], square, 0.0)
        chi2 = _chi2(square, variance[solved])
        if k == 0:
            fit.chi2_per_dof[:] = np.where(known & (dof > 0), chi2 / np.maximum(dof, 1), np.nan)
        elif k == 2:
            break
        # The others' misfit, and so their scatter, is what it was.
        before, sure = scatter[solved], known[solved]
        settled = _paule_mandel(square, variance[solved], dof[solved], chi2, sure)
        settled = np.where(
            np.isfinite(settled) & (settled > 0), settled, np.where(sure, 0.0, before)
        )
        changed = np.flatnonzero(np.abs(settled - before) > 1e-3 * settled)
        if not len(changed):
            break
        scatter[solved] = settled
        if len(changed) < len(settled):
            solved = changed if isinstance(solved, slice) else solved[changed]


def _part(tree: Tree, rows: Rows) -> Tree:
    return jax.tree.map(lambda x: np.asarray(x)[rows], tree)


def _own_sigma(
    estimator: AbstractEstimator, dwells: Dwells
) -> Float[np.ndarray, "devices dwells rows"]:
    """Standard deviation of a misfit by the dwell's own noise."""
    covariance = np.asarray(getattr(dwells, f"{estimator.triad}_covariance"))
    if not isinstance(estimator, Invariant):
        return np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    a0, a1, a2 = np.moveaxis(np.asarray(dwells.accel), -1, 0)
    c = np.moveaxis(covariance, (-2, -1), (0, 1))
    b0, b1 = 2.0 * a0, 2.0 * a1
    # Written out: NumPy's products of many small matrices cost as much as the solve.
    total = a0 * a0 * c[0, 0] + a1 * (a1 * c[1, 1] + b0 * c[1, 0])
    total += a2 * (a2 * c[2, 2] + b0 * c[2, 0] + b1 * c[2, 1])
    return np.sqrt(total / (a0 * a0 + a1 * a1 + a2 * a2))[:, :, None]


def _chunk(estimator: AbstractEstimator, basis: AbstractBasis, count: int) -> int:
    """Devices solved at once: one of a few numbers, so that compiled programs are shared."""
    constant = isinstance(basis, Constant) and isinstance(estimator, Invariant)
    needed = 1 << max(count - 1, 0).bit_length()
    if jax.default_backend() != "cpu":
        return min(LANES_THERE if constant else BLOCKS_THERE, needed)
    # Chunks that are not used cost nothing, and empty lanes less than another program.
    return LANES * CHUNKS if constant else min(BLOCKS, needed)


def _solve(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    fit: FleetFit,
    own: np.ndarray,
    rows: Rows,
    size: int,
    precision: Precision,
) -> None:
    """One weighted solve of some devices into their rows of `fit`, in calls of one compiled shape."""
    for some in _calls(rows, size):
        # JAX's precision is a setting of each thread.
        with jax.enable_x64(True):
            found = _solve_call(
                estimator, basis, dwells, own[some], fit.scatter[some], fit.valid[some], some,
                size, precision,
            )  # fmt: skip
        for name in ("parameters", "covariance", "misfit", "converged", "num_steps"):
            place = getattr(fit, name)
            count = some.stop - some.start if isinstance(some, slice) else len(some)
            place[some] = np.asarray(getattr(found, name))[:count]


def _calls(rows: Rows, size: int) -> Iterator[Rows]:
    if not isinstance(rows, slice):
        yield from (rows[s : s + size] for s in range(0, len(rows), size))
        return
    for start in range(rows.start, rows.stop, size):
        yield slice(start, min(start + size, rows.stop))


def _solve_call(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    own: np.ndarray,
    scatter: np.ndarray,
    valid: np.ndarray,
    rows: Rows,
    size: int,
    precision: Precision,
) -> BatchFit:
    """At most `size` devices; those that fill up to it may follow in the result."""
    if isinstance(estimator, Invariant) and _is_batched(estimator):
        sigma = np.sqrt(np.square(own[:, :, 0]) + np.square(scatter)[:, None])
        weights = np.where(valid, 1.0 / sigma, 0.0)
        gravity = np.asarray(estimator.gravity, precision)
        outputs = np.asarray(dwells.accel)[rows]
        if isinstance(basis, Constant):
            return _solve_lanes(outputs, weights, gravity, size)
        outputs, temperature, weights = (
            _filled(np.asarray(x, precision), size)
            for x in (outputs, np.asarray(dwells.temperature)[rows], weights)
        )
        return _thermal(outputs, temperature, weights, gravity, basis)
    whole = jax.tree.map(partial(_filled, size=size), _part(dwells, rows))
    return _linear(estimator, basis, whole, jnp.asarray(_filled(scatter, size)))


def _filled(rows: np.ndarray, size: int) -> np.ndarray:
    """The last row repeated up to `size`."""
    rows = np.asarray(rows)
    return rows if len(rows) == size else rows[np.minimum(np.arange(size), len(rows) - 1)]


def _solve_lanes(
    outputs: np.ndarray, weights: np.ndarray, gravity: np.ndarray, size: int
) -> BatchFit:
    """Constant parameters: chunks of lanes in one call, of which only the used ones cost anything."""
    lanes = min(LANES, size) if jax.default_backend() == "cpu" else size
    dwells, used = outputs.shape[1], -(-len(outputs) // lanes)
    a = empty_aligned((size // lanes, 3, dwells, lanes), gravity.dtype)
    w = empty_aligned((size // lanes, dwells, lanes), gravity.dtype)
    filled = _filled(outputs, used * lanes).reshape(used, lanes, dwells, 3)
    a[:used] = filled.transpose(0, 3, 2, 1)
    w[:used] = _filled(weights, used * lanes).reshape(used, lanes, dwells).transpose(0, 2, 1)
    fit = solve_chunks(a, w, gravity, np.int32(used))
    return jax.tree.map(lambda x: np.asarray(x).reshape(-1, *x.shape[2:]), fit)


def _is_batched(estimator: AbstractEstimator) -> bool:
    """Whether the problem has a program of its own."""
    return isinstance(estimator, Invariant) and estimator.robust is None


_plain = jax.jit(fit_chunks)
_whole = jax.jit(partial(fit_chunks, whole=True), compiler_options=OPTIONS)
_refused: set[tuple[int, ...]] = set()


def solve_chunks(
    outputs: Float[np.ndarray, "chunks 3 dwells batch"],
    weights: Float[np.ndarray, "chunks dwells batch"],
    gravity: Float[np.ndarray, ""] | Float[jax.Array, ""],
    used: np.int32,
) -> BatchFit:
    """`fit_chunks`, compiled: each chunk as one kernel where XLA makes one."""
    if is_tried() and outputs.shape not in _refused:
        try:
            return _whole(outputs, weights, gravity, used)
        except jax.errors.JaxRuntimeError:  # of a shape that it does not: the same in many kernels
            _refused.add(outputs.shape)
    return _plain(outputs, weights, gravity, used)


@eqx.filter_jit
def _thermal(outputs, temperature, weights, gravity, basis) -> BatchFit:
    return fit_thermal_invariant(outputs, temperature, weights, jnp.asarray(gravity), basis)


@eqx.filter_jit
def _linear(estimator, basis, dwells, scatter) -> BatchFit:
    return fit_linear(estimator, basis, jax.tree.map(jnp.asarray, dwells), scatter)


def _chi2(square: np.ndarray, variance: np.ndarray) -> Float[np.ndarray, " devices"]:
    """Σ r²/s²; a row without noise of its own does not count."""
    ratio = np.divide(square, variance, out=np.zeros_like(square), where=variance > 0)
    return ratio.sum(axis=1)


def _paule_mandel(
    square: np.ndarray, variance: np.ndarray, dof: np.ndarray, chi2: np.ndarray, known: np.ndarray
) -> Float[np.ndarray, " devices"]:
    """Excess deviation of every device; 0 where χ² is below its expectation (`widened`)."""
    freedom = widened(np.maximum(dof, 1).astype(float))
    scatter = np.zeros(len(dof))
    noisy = np.flatnonzero(~(known & (chi2 <= freedom)) & (dof > 0))
    if len(noisy):
        scatter[noisy] = batched_excess_deviation(square[noisy], variance[noisy], freedom[noisy])
    return scatter
