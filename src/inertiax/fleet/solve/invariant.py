"""The invariant accelerometer problem for many devices in one program.

Second form of the residual of `estimators.Invariant`, with its parameters and gauge, in units of g, written out for a
batch (`tests/test_fleet_moments.py` holds the two together to rounding, `tests/test_fleet.py` the fits to 1e-5 sigma):

    r = w (‖f‖ − 1),   f = (E + Γ)⁻¹ (a' − a⁰) = X (a'; 1),

with the affine map X, lower triangular as Γ is. ‖f‖ = 1 is an ellipsoid of the outputs, and any ellipsoid is one such
map, so the unknowns are its coefficients p = (β, G) here,

    F(a) = aᵀ a − 2 p · φ(a) = 1,   ‖f‖² = (F + ρ − 1)/ρ,   ρ = 1 + β · b,   b = Q⁻¹ β,   Q = E − G − Gᵀ,

with the nine monomials φ (`moments`). F is linear in p: that Σ w² (F − 1)² is least is one linear system, and leaves
errors of the size of the misfits times the noise. From there on go steps for Σ r² itself,

    ∂r/∂p = −w (φ(a) − (1 − ‖f‖²) φ(b)) / (ρ ‖f‖),

with the inverse at hand: Jᵀ J is Σ w² φφᵀ/ρ² but for terms as small as the misfits in units of g. Steps shrink by as
much each, and go on until they are small: the answer is the exact minimum. Covariances leave those terms out.
Source of the linear start, the algebraic fit: Gander, Golub & Strebel, *Least-squares fitting of circles and ellipses*,
BIT 34 (1994) 558.

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
from .moments import monomials, normal_matrix, square, total


# The outputs' own noise makes the rows of repeated positions differ. A coefficient that nothing else tells is as
# uncertain as this (in g or per unit, whatever the noise), and by so much more, in variance, than the best told one;
# large misfits alone make all coefficients uncertain alike.
UNDETERMINED = 0.1
INFLATION = 1e4
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
    covariance and is not `converged`; one that does not settle in `max_steps` is not `converged`.
    """
    a = outputs / gravity
    squared = jnp.square(weights * gravity)
    lanes = a.shape[2]
    none, count = jnp.zeros((lanes,), bool), jnp.ones((lanes,), jnp.int32)
    phi = monomials(a)
    normal = normal_matrix(phi, squared)
    scale = jnp.sqrt(jnp.stack([normal[i, i] for i in range(9)]))
    largest = jnp.max(jnp.square(scale), axis=0)
    inverse = invert_lanes(normal)
    p = _product(inverse, total(phi, 0.5 * squared * (square(a) - 1.0)))
    excess = lambda p, shrink: (_form(p, a) - 1.0) * shrink[None]  # ‖f‖² − 1

    def improve(state):
        p, centre, shrink, k, done, steps, before = state
        beyond = excess(p, shrink)
        pull = squared * (1.0 - jax.lax.rsqrt(1.0 + beyond))
        slope = total(phi, pull) + total(beyond[None], pull) * monomials(centre)
        step = _product(inverse, slope) / shrink[None]
        size = jnp.max(jnp.abs(step) * scale, axis=0) * shrink
        small = (_left(size, before) < tolerance) | is_rounding(step) | jnp.isnan(size)
        p = p + jnp.where(done[None], jnp.zeros_like(step), step)
        left = jnp.where(done, 0, 1).astype(jnp.int32)
        return p, *_centre(p), k + 1, done | small, steps + left, size

    begin = (p, *_centre(p), 1, none, count, jnp.zeros((lanes,), a.dtype))
    going = lambda state: (state[3] < max_steps) & jnp.any(~state[4])
    p, centre, shrink, _, done, steps, _ = jax.lax.while_loop(going, improve, begin)
    x = _map(p, centre, shrink)
    misfit = (jnp.sqrt(1.0 + excess(p, shrink)) - 1.0) * gravity
    misfit = jnp.where(weights > 0, misfit, jnp.zeros_like(weights))
    units = jnp.concatenate([jnp.full((3,), gravity, a.dtype), jnp.ones((6,), a.dtype)])
    covariance = _spread(_matrix(x), centre, inverse)
    variance = jnp.max(jnp.stack([inverse[i, i] for i in range(9)]), axis=0)
    repeated = (variance > UNDETERMINED**2) & (variance * largest > INFLATION)
    determined = ~(repeated | jnp.isnan(variance) | jnp.isnan(x[0, 0]))
    covariance = jnp.where(determined[None, None], covariance, jnp.full((), jnp.nan, a.dtype))
    return BatchFit(
        parameters=_parameters(x).T * units[None],
        covariance=jnp.moveaxis(covariance, 2, 0) * (units[:, None] * units[None, :])[None],
        misfit=misfit.T[:, :, None],
        converged=done & determined,
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
        at = lambda x: jax.lax.dynamic_index_in_dim(x, k, keepdims=False)
        fit = fit_invariant(at(outputs), at(weights), gravity)
        place = lambda w, x: jax.lax.dynamic_update_index_in_dim(w, x, k, 0)
        return jax.tree.map(place, whole, fit)

    return jax.lax.fori_loop(jnp.zeros((), used.dtype), used, one, empty)


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


def _form(p: Array, a: Array) -> Array:
    """F = aᵀ a − 2 p · φ(a) of every dwell, which is 1 on the ellipsoid."""
    b0, b1, b2, g00, g10, g20, g11, g21, g22 = 2.0 * p[:, None]
    form = a[0] * (a[0] - (b0 + g00 * a[0] + g10 * a[1] + g20 * a[2]))
    form = form + a[1] * (a[1] - (b1 + g11 * a[1] + g21 * a[2]))
    return form + a[2] * (a[2] - (b2 + g22 * a[2]))


def _quadratic(p: Array) -> list[Array]:
    """Q = E − (G + Gᵀ): elements 00, 10, 20, 11, 21, 22."""
    g00, g10, g20, g11, g21, g22 = p[3:]
    return [1.0 - 2.0 * g00, -g10, -g20, 1.0 - 2.0 * g11, -g21, 1.0 - 2.0 * g22]


def _centre(p: Array) -> tuple[Float[Array, "3 batch"], Float[Array, " batch"]]:
    """Centre b = Q⁻¹ β of the ellipsoid and 1/ρ, ρ = 1 + β · b."""
    q00, q10, q20, q11, q21, q22 = _quadratic(p)
    c00, c10, c20 = q11 * q22 - q21 * q21, q21 * q20 - q10 * q22, q10 * q21 - q11 * q20
    c11, c21, c22 = q00 * q22 - q20 * q20, q10 * q20 - q00 * q21, q00 * q11 - q10 * q10
    inverse = 1.0 / (q00 * c00 + q10 * c10 + q20 * c20)
    b0 = (c00 * p[0] + c10 * p[1] + c20 * p[2]) * inverse
    b1 = (c10 * p[0] + c11 * p[1] + c21 * p[2]) * inverse
    b2 = (c20 * p[0] + c21 * p[1] + c22 * p[2]) * inverse
    return jnp.stack([b0, b1, b2]), 1.0 / (1.0 + b0 * p[0] + b1 * p[1] + b2 * p[2])


def _map(p: Array, centre: Array, shrink: Array) -> Float[Array, "3 4 batch"]:
    """X with f = X (a; 1): lower triangular, ‖f‖² − 1 = (F − 1)/ρ. NaN where it is no ellipsoid."""
    q00, q10, q20, q11, q21, q22 = (q * shrink for q in _quadratic(p))
    y22 = jnp.sqrt(q22)
    y20, y21 = q20 / y22, q21 / y22
    y11 = jnp.sqrt(q11 - y21 * y21)
    y10 = (q10 - y21 * y20) / y11
    y00 = jnp.sqrt(q00 - y10 * y10 - y20 * y20)
    zero = jnp.zeros_like(y00)
    rows = jnp.stack([y00, zero, zero, y10, y11, zero, y20, y21, y22]).reshape(3, 3, -1)
    return jnp.concatenate([rows, -_product(rows, centre)[:, None]], axis=1)


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


# Pairs of components, in the order of the unknowns.
_FIRST, _SECOND = np.array([0, 1, 2, 1, 2, 2]), np.array([0, 0, 0, 1, 1, 2])
_EQUAL = _FIRST == _SECOND


def _spread(matrix: Array, bias: Array, inverse: Array) -> Array:
    """Covariance of the estimator's parameters from (Σ w² φφᵀ)⁻¹ of the outputs' φ.

    With a = M f + b and ‖f‖ = 1, φ(a) = H φ(f); a change p of the form moves the frame by Hᵀ p, and that the
    parameters (`_turned`).
    """
    whole = jnp.asarray(_EQUAL, matrix.dtype)[None, :, None]
    low = jnp.concatenate([matrix, bias[:, None] * whole], axis=1)
    one, other = matrix[_FIRST], matrix[_SECOND]
    b, c = bias[_FIRST][:, None], bias[_SECOND][:, None]
    crossed = one[:, _SECOND] * other[:, _FIRST] * (1.0 - whole)
    squares = one[:, _FIRST] * other[:, _SECOND] + crossed + b * c * whole
    high = jnp.concatenate([b * other + c * one, squares], axis=1)
    turn = _turned(matrix, jnp.swapaxes(jnp.concatenate([low, high]), 0, 1))[_ORDER]

    def half(_, state):
        turn, inner = state
        total = turn[:, 0, None] * inner[None, 0]
        for k in range(1, 9):
            total = total + turn[:, k, None] * inner[None, k]
        return turn, jnp.swapaxes(total, 0, 1)

    return jax.lax.fori_loop(0, 2, half, (turn, inverse))[1]


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
