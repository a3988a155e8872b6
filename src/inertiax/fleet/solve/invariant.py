"""The invariant accelerometer problem for many devices in one program.

Second form of the residual of `estimators.Invariant`, with its parameters and gauge, in units of g, written out for a
batch (`tests/test_fleet_moments.py` holds the two together to rounding, `tests/test_fleet.py` the fits to 1e-5 sigma):

    r = w (‖f‖ − 1),   f = (E + Γ)⁻¹ (a' − a⁰) = X (a'; 1),

with the affine map X, lower triangular as Γ is. A step is taken in the frame of f (`moments`), where the
derivatives are products of f's components, and is the same Gauss-Newton step: a⁰ and Γ change by (E + Γ) β and
(E + Γ) G, and so does their covariance.

A normal matrix and its inverse cost several gradients, so a step with the first one's inverse comes between the
two Gauss-Newton steps that have their own; a triad whose errors are of some per cent is then within 10⁻⁸ of the
minimum. The steps that are left keep the inverse and go on until the step is small: the answer is the exact minimum.

Arrays of few, large operations: what a processor does between them, and what the compiler does with them, costs
as much as the arithmetic.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...estimators.invariant import _COLUMNS, _ROWS
from ...numerics.lane_cholesky import invert_lanes
from .moments import gradient, normal_matrix, square


SECOND = 2  # the step that has a normal matrix of its own, beside the first
# Of a step's residuals, in units of g: what is left of a step at the minimum.
ROUNDINGS = 16.0


class BatchFit(eqx.Module):
    """Many devices' solutions; arrays lead with the device. Parameters are those of `estimators.Invariant`,
    one set per basis function, row-major `(size, 9)`."""

    parameters: Float[Array, "devices unknowns"]
    covariance: Float[Array, "devices unknowns unknowns"]  # (JᵀJ)⁻¹; NaN where rank deficient
    misfit: Float[Array, "devices dwells rows"]  # SI, zero at padding
    converged: Bool[Array, " devices"]
    num_steps: Int[Array, " devices"]


def predicted(p: Array | list[Array], outputs: Array | list[Array]) -> tuple[Array, list[Array]]:
    """‖f‖ and minus its derivatives by the nine parameters, elementwise; outputs in g.

    Second form of `estimators.Invariant.misfit` and its derivative.
    """
    b0, b1, b2, g00, g10, g11, g20, g21, g22 = p
    d0, d1, d2 = 1.0 / (1.0 + g00), 1.0 / (1.0 + g11), 1.0 / (1.0 + g22)
    f0 = (outputs[0] - b0) * d0
    f1 = (outputs[1] - b1 - g10 * f0) * d1
    f2 = (outputs[2] - b2 - g20 * f0 - g21 * f1) * d2
    inverse = jax.lax.rsqrt(f0 * f0 + f1 * f1 + f2 * f2)
    v2 = f2 * inverse * d2
    v1 = (f1 * inverse - g21 * v2) * d1
    v0 = (f0 * inverse - g10 * v1 - g20 * v2) * d0
    size = (f0 * f0 + f1 * f1 + f2 * f2) * inverse
    # Or the compiler works all of it out anew for each of the columns.
    *v, f0, f1, f2 = jax.lax.optimization_barrier((v0, v1, v2, f0, f1, f2))
    f = (f0, f1, f2)
    return size, [*v, *(v[i] * f[j] for i, j in zip(_ROWS, _COLUMNS, strict=True))]


def fit_invariant(
    outputs: Float[Array, "3 dwells batch"],
    weights: Float[Array, "dwells batch"],
    gravity: Float[Array, ""],
    *,
    tolerance: float = 1e-6,
    max_steps: int = 20,
) -> BatchFit:
    """Constant parameters of a batch of devices; the batch is the *last* axis of the arguments.

    **Arguments:** `outputs` in m/s²; `weights` 1/σ of each dwell in s²/m, zero for padding; `tolerance` in
    standard deviations of a parameter. A device of fewer than nine independent positions has NaN
    covariance; one that does not settle in `max_steps` is not `converged`.
    """
    a = outputs / gravity
    squared = jnp.square(weights * gravity)
    lanes = a.shape[2]
    unit = jnp.broadcast_to(jnp.eye(3, 4, dtype=a.dtype)[:, :, None], (3, 4, lanes))
    none, zero = jnp.zeros((lanes,), bool), jnp.zeros((9, lanes), a.dtype)
    count = jnp.zeros((lanes,), jnp.int32)

    def factorised(kept: _Factor, x: Array, f: Array) -> _Factor:
        normal = normal_matrix(f, squared)
        scale = jnp.sqrt(jnp.stack([normal[i, i] for i in range(9)]))
        return _Factor(invert_lanes(normal), scale, x)

    def improve(state):
        x, f, factor, k, done, steps, before = state
        full = (k == 0) | (k == SECOND)
        factor = jax.lax.cond(full, factorised, lambda kept, x, f: kept, factor, x, f)
        step = _product(factor.inverse, gradient(f, squared))
        size = jnp.max(jnp.abs(step) * factor.scale, axis=0)
        small = (_left(size, before) < tolerance) | is_rounding(step) | jnp.isnan(size)
        x = _moved(x, jnp.where(done[None], jnp.zeros_like(step), step))
        left = jnp.where(done, 0, 1).astype(jnp.int32)
        return x, _forces(x, a), factor, k + 1, done | (small & (k > SECOND)), steps + left, size

    factor = _Factor(jnp.zeros((9, 9, lanes), a.dtype), zero, unit)
    begin = (unit, a, factor, 0, none, count, zero[0])
    going = lambda state: (state[3] < max_steps) & jnp.any(~state[4])
    x, f, factor, _, done, steps, _ = jax.lax.while_loop(going, improve, begin)
    misfit = jnp.where(weights > 0, jnp.sqrt(square(f)) - 1.0, jnp.zeros_like(weights)) * gravity
    units = jnp.concatenate([jnp.full((3,), gravity, a.dtype), jnp.ones((6,), a.dtype)])
    covariance = _spread(_matrix(factor.frame), factor.inverse)
    return BatchFit(
        parameters=_parameters(x).T * units[None],
        covariance=jnp.moveaxis(covariance, 2, 0) * (units[:, None] * units[None, :])[None],
        misfit=misfit.T[:, :, None],
        converged=done & ~jnp.isnan(x[0, 0]),
        num_steps=steps,
    )


def fit_chunks(
    outputs: Float[Array, "chunks 3 dwells batch"],
    weights: Float[Array, "chunks dwells batch"],
    gravity: Float[Array, ""],
    used: Int[Array, ""],
) -> BatchFit:
    """`fit_invariant` of the first `used` chunks one after the other, in one call: what stays in a core's cache.

    Results lead with chunk and device; they are zero in chunks that are not used, which cost nothing.
    """
    chunks, _, dwells, lanes = outputs.shape
    # Written out: asking for the shapes would trace it once more.
    chunk = BatchFit(
        parameters=jnp.zeros((lanes, 9), outputs.dtype),
        covariance=jnp.zeros((lanes, 9, 9), outputs.dtype),
        misfit=jnp.zeros((lanes, dwells, 1), outputs.dtype),
        converged=jnp.zeros(lanes, bool),
        num_steps=jnp.zeros(lanes, jnp.int32),
    )
    empty = jax.tree.map(lambda x: jnp.zeros((chunks, *x.shape), x.dtype), chunk)

    def one(k: Array, whole: BatchFit) -> BatchFit:
        fit = fit_invariant(outputs[k], weights[k], gravity)
        return jax.tree.map(lambda w, x: w.at[k].set(x), whole, fit)

    return jax.lax.fori_loop(jnp.zeros((), used.dtype), used, one, empty)


class _Factor(eqx.Module):
    """A normal matrix's inverse, the norms of the Jacobian's columns, and the map X in whose frame they are."""

    inverse: Float[Array, "9 9 batch"]
    scale: Float[Array, "9 batch"]
    frame: Float[Array, "3 4 batch"]


def is_small(
    step: Array, scale: Array, tolerance: float, *, axis: int | tuple[int, ...]
) -> Bool[Array, " batch"]:
    """Whether steps (in g and per unit) are below `tolerance` in standard deviations, or nothing but rounding."""
    told = jnp.max(jnp.abs(step) * scale, axis=axis) < tolerance
    return told | is_rounding(step, axis=axis)


def is_rounding(step: Array, *, axis: int | tuple[int, ...] = 0) -> Bool[Array, " batch"]:
    """Whether steps (in g and per unit) are nothing but rounding."""
    return jnp.max(jnp.abs(step), axis=axis) < ROUNDINGS * jnp.finfo(step.dtype).eps


def _left(size: Array, before: Array) -> Array:
    """Bound of what is left after a step, from its size and that of the one before: steps shrink at least so fast on.

    The factor ten is for directions in which they shrink slower. Source: Hairer & Wanner, *Solving ODEs II* (1996),
    section IV.8.
    """
    return jnp.where(size < 0.02 * before, 10.0 * size * (size / before), size)


def _forces(x: Array, a: Array) -> Array:
    """X (a; 1) of every dwell."""
    x = x[:, :, None]
    f0 = x[0, 0] * a[0] + x[0, 3]
    f1 = x[1, 0] * a[0] + x[1, 1] * a[1] + x[1, 3]
    f2 = x[2, 0] * a[0] + x[2, 1] * a[1] + x[2, 2] * a[2] + x[2, 3]
    return jnp.stack([f0, f1, f2])


def _moved(x: Array, step: Array) -> Array:
    """The map after a step: (E + G)⁻¹ (X − (0 β)), forwards as (E + G) is triangular."""
    shift, (g00, g10, g20, g11, g21, g22) = step[:3], step[3:]
    last = jnp.array([0.0, 0.0, 0.0, 1.0], x.dtype)[None, :, None]
    x = x - shift[:, None] * last
    d0, d1, d2 = 1.0 / (1.0 + g00), 1.0 / (1.0 + g11), 1.0 / (1.0 + g22)
    y0 = x[0] * d0[None]
    y1 = (x[1] - g10[None] * y0) * d1[None]
    y2 = (x[2] - g20[None] * y0 - g21[None] * y1) * d2[None]
    return jnp.stack([y0, y1, y2])


def _matrix(x: Array) -> Array:
    """E + Γ of a map."""
    d0, d1, d2 = 1.0 / x[0, 0], 1.0 / x[1, 1], 1.0 / x[2, 2]
    m10, m21 = -x[1, 0] * d0 * d1, -x[2, 1] * d1 * d2
    m20 = -(x[2, 0] * d0 + x[2, 1] * m10) * d2
    zero = jnp.zeros_like(d0)
    return jnp.stack([d0, zero, zero, m10, d1, zero, m20, m21, d2]).reshape(3, 3, -1)


def _parameters(x: Array) -> Array:
    """Of `estimators.Invariant`, the bias in units of g."""
    m = _matrix(x)
    bias = -(m[:, 0] * x[None, 0, 3] + m[:, 1] * x[None, 1, 3] + m[:, 2] * x[None, 2, 3])
    off = jnp.stack([m[i, j] - float(i == j) for i, j in zip(_ROWS, _COLUMNS, strict=True)])
    return jnp.concatenate([bias, off])


# The frame's unknowns go down G's columns, those of the estimator along its rows.
_ORDER = np.array([0, 1, 2, 3, 4, 6, 5, 7, 8])


def _spread(matrix: Array, covariance: Array) -> Array:
    """Covariance of the estimator's parameters from that of the frame's unknowns."""
    half = _turned(matrix, covariance)
    whole = _turned(matrix, jnp.swapaxes(half, 0, 1))
    return whole[_ORDER][:, _ORDER]


def _turned(matrix: Array, rows: Array) -> Array:
    """(E + Γ) times β and each column of G, as rows of an array (9, n, batch)."""
    m = matrix[:, :, None]

    def product(first: int, block: Array) -> Array:
        total = m[first:, first] * block[0][None]
        for k in range(1, len(block)):
            total = total + m[first:, first + k] * block[k][None]
        return total

    parts = [
        product(0, rows[:3]),
        product(0, rows[3:6]),
        product(1, rows[6:8]),
        product(2, rows[8:]),
    ]
    return jnp.concatenate(parts)


def _product(matrix: Array, vector: Array) -> Array:
    """Of every lane. A sum, which the compiler keeps; what is written out it works out anew wherever it is used."""
    return jnp.sum(matrix * vector[None], axis=1)
