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

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...estimators.invariant import _COLUMNS, _ROWS
from ...numerics.lane_cholesky import invert_lanes
from ...numerics.own_kernels import kept, one_kernel
from .moments import largest_of, monomials, products, square, squares


# The outputs' own noise makes the rows of repeated positions differ. A coefficient that nothing else tells is as
# uncertain as this (in g or per unit, whatever the noise), and by so much more, in variance, than the best told one;
# large misfits alone make all coefficients uncertain alike.
UNDETERMINED = 0.1
INFLATION = 1e4
# Of a step's residuals, in units of g: what is left of a step at the minimum.
ROUNDINGS = 16.0
# Times the largest misfit, in units of g: how much smaller than the first step the second one is at most.
FIRST = 4.0


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
    scaled = outputs * (1.0 / gravity), weights * gravity
    return _device_first(_fit_lanes(*scaled, gravity, tolerance, max_steps))


class _Lanes(NamedTuple):
    """A `BatchFit` with devices last, where they fill the vector lanes."""

    parameters: Float[Array, "9 batch"]
    covariance: Float[Array, "9 9 batch"]
    misfit: Float[Array, "dwells batch"]
    converged: Bool[Array, " batch"]
    num_steps: Int[Array, " batch"]


def _device_first(fit: _Lanes) -> BatchFit:
    return BatchFit(
        parameters=fit.parameters.T,
        covariance=jnp.moveaxis(fit.covariance, 2, 0),
        misfit=fit.misfit.T[:, :, None],
        converged=fit.converged,
        num_steps=fit.num_steps,
    )


def _fit_lanes(
    a: Array, root: Array, gravity: Array, tolerance: float = 1e-6, max_steps: int = 20
) -> _Lanes:
    """Of outputs in g and weights per g."""
    lanes = a.shape[2]
    none, count = jnp.zeros((lanes,), bool), jnp.ones((lanes,), jnp.int32)
    phi = _weighted(a, root)
    normal = squares(phi)
    diagonal = jnp.stack([normal[i, i] for i in range(9)])
    scale = jnp.sqrt(diagonal)
    largest = functools.reduce(jnp.maximum, jnp.square(scale))
    inverse = invert_lanes(normal)
    p = _product(inverse, products(_algebraic(a, root), phi)[0])
    centre, shrink = _centre(p)

    def improve(state):
        p, centre, shrink, beyond, k, done, steps, before = state
        pull = _pulls(beyond, root)
        slope, lift = products(pull[:1], phi)[0], _sum_of(pull[1])
        step = _product(inverse, _raised(slope, lift, centre)) * (1.0 / shrink)[None]
        size = largest_of(jnp.abs(step) * scale) * shrink
        rate = jnp.where(k == 1, FIRST * largest_of(jnp.abs(beyond)), size / before)
        small = (remainder(size, rate) < tolerance) | is_rounding(step) | jnp.isnan(size)
        p = p + jnp.where(done[None], jnp.zeros_like(step), step)
        left = jnp.where(done, 0, 1).astype(jnp.int32)
        centre, shrink = _centre(p)
        return p, centre, shrink, _excess(p, a, shrink), k + 1, done | small, steps + left, size

    begin = (
        p, centre, shrink, _excess(p, a, shrink), 1, none, count, jnp.zeros((lanes,), a.dtype)
    )  # fmt: skip
    going = lambda state: (state[4] < max_steps) & jnp.any(~state[5])
    p, centre, shrink, beyond, _, done, steps, _ = jax.lax.while_loop(going, improve, begin)
    x = _map(p, centre, shrink)
    misfit = (jnp.sqrt(1.0 + beyond) - 1.0) * gravity
    misfit = jnp.where(root > 0, misfit, jnp.zeros_like(root))
    variance = largest_of(jnp.stack([inverse[i, i] for i in range(9)]))
    repeated = (variance > UNDETERMINED**2) & (variance * largest > INFLATION)
    determined = ~(repeated | jnp.isnan(variance) | jnp.isnan(x[0, 0]))
    size = jnp.where(determined, jnp.ones((), a.dtype), jnp.full((), jnp.nan, a.dtype))
    units = jnp.concatenate([jnp.full((3, 1), gravity, a.dtype), jnp.ones((6, 1), a.dtype)])
    turn = _turn(_matrix(x), centre, units)
    return _Lanes(
        parameters=_parameters(x) * units,
        covariance=_turned_back(_by_columns(turn, inverse), turn, size),
        misfit=misfit,
        converged=done & determined,
        num_steps=steps,
    )


def fit_chunks(
    outputs: Float[Array, "chunks 3 dwells batch"],
    weights: Float[Array, "chunks dwells batch"],
    gravity: Float[Array, ""],
    used: Int[Array, ""],
    *,
    whole: bool = False,
) -> BatchFit:
    """`fit_invariant` of the first `used` chunks one after the other, in one call: what stays in a core's cache.

    Results lead with chunk and device; they are zero in chunks that are not used, which cost nothing. With `whole` a
    chunk is one kernel (`numerics.own_kernels`, which says what its compilation asks for).
    """
    chunks, _, dwells, lanes = outputs.shape
    solve = one_kernel(_fit_lanes) if whole else _fit_lanes
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
        fit = _device_first(solve(at(outputs) * (1.0 / gravity), at(weights) * gravity, gravity))
        place = lambda w, x: jax.lax.dynamic_update_index_in_dim(w, x, k, 0)
        return jax.tree.map(place, whole, fit)

    return jax.lax.fori_loop(jnp.zeros((), used.dtype), used, one, empty)


def is_rounding(step: Array, *, axis: int | tuple[int, ...] = 0) -> Bool[Array, " batch"]:
    """Whether steps (in g and per unit) are nothing but rounding."""
    return jnp.max(jnp.abs(step), axis=axis) < ROUNDINGS * jnp.finfo(step.dtype).eps


def remainder(size: Array, rate: Array) -> Array:
    """Bound of what is left after a step, from its size and how much smaller the next one is.

    The factor ten is for directions in which they shrink slower. Source: Hairer & Wanner, *Solving ODEs II* (1996),
    section IV.8.
    """
    return jnp.where(rate < 0.02, 10.0 * size * rate, size)


@kept
def _weighted(a: Array, root: Array) -> Array:
    return monomials(a) * root[None]


@kept
def _algebraic(a: Array, root: Array) -> Array:
    return (0.5 * root * (square(a) - 1.0))[None]


@kept
def _excess(p: Array, a: Array, shrink: Array) -> Array:
    """‖f‖² − 1."""
    return (_form(p, a) - 1.0) * shrink[None]


@kept
def _pulls(beyond: Array, root: Array) -> Array:
    """Over 1/σ, that of φ; and that of the change of ρ."""
    pull = root * (1.0 - jax.lax.rsqrt(1.0 + beyond))
    return jnp.stack([pull, pull * beyond * root])


@kept
def _sum_of(rows: Array) -> Array:
    return functools.reduce(jnp.add, rows)


@kept
def _raised(slope: Array, lift: Array, centre: Array) -> Array:
    return slope + lift[None] * monomials(centre)


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


@kept
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


@kept
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


@kept
def _matrix(x: Array) -> Array:
    """E + Γ of a map."""
    d0, d1, d2 = 1.0 / x[0, 0], 1.0 / x[1, 1], 1.0 / x[2, 2]
    m10, m21 = -x[1, 0] * d0 * d1, -x[2, 1] * d1 * d2
    m20 = -(x[2, 0] * d0 + x[2, 1] * m10) * d2
    zero = jnp.zeros_like(d0)
    return jnp.stack([d0, zero, zero, m10, d1, zero, m20, m21, d2]).reshape(3, 3, -1)


@kept
def _parameters(x: Array) -> Array:
    """Of `estimators.Invariant`, the bias in units of g."""
    m = _matrix(x)
    bias = -(m[:, 0] * x[None, 0, 3] + m[:, 1] * x[None, 1, 3] + m[:, 2] * x[None, 2, 3])
    off = jnp.stack([m[i, j] - float(i == j) for i, j in zip(_ROWS, _COLUMNS, strict=True)])
    return jnp.concatenate([bias, off])


# Pairs of components, in the order of the unknowns.
_FIRST, _SECOND = np.array([0, 1, 2, 1, 2, 2]), np.array([0, 0, 0, 1, 1, 2])
_EQUAL = _FIRST == _SECOND


@kept
def _turn(matrix: Array, bias: Array, units: Array) -> Float[Array, "9 9 batch"]:
    """By which the estimator's parameters follow the form's coefficients, near the minimum.

    With a = M f + b and ‖f‖ = 1, φ(a) = H φ(f); a change p of the form moves the frame by Hᵀ p, and that the
    parameters: (E + Γ) times β and each column of G.
    """
    whole = jnp.asarray(_EQUAL, matrix.dtype)[None, :, None]
    low = jnp.concatenate([matrix, bias[:, None] * whole], axis=1)
    one, other = matrix[_FIRST], matrix[_SECOND]
    b, c = bias[_FIRST][:, None], bias[_SECOND][:, None]
    crossed = one[:, _SECOND] * other[:, _FIRST] * (1.0 - whole)
    squares = one[:, _FIRST] * other[:, _SECOND] + crossed + b * c * whole
    high = jnp.concatenate([b * other + c * one, squares], axis=1)
    rows = jnp.swapaxes(jnp.concatenate([low, high]), 0, 1)
    m = matrix[:, :, None]

    def product(first: int, last: int, column: int, block: Array) -> Array:
        """Rows of M times a block whose first row stands at that column's diagonal."""
        terms = (m[first:last, column + k] * block[k][None] for k in range(len(block)))
        return functools.reduce(jnp.add, terms)

    # The frame's unknowns go down G's columns, those of the estimator along its rows.
    columns = rows[3:6], rows[6:8], rows[8:]
    parts = [product(0, 3, 0, rows[:3])]
    parts += [product(i, i + 1, j, columns[j]) for i, j in zip(_ROWS, _COLUMNS, strict=True)]
    return jnp.concatenate(parts) * units[:, None]


@kept
def _by_columns(matrix: Array, other: Array) -> Array:
    """A B of every lane."""
    return functools.reduce(
        jnp.add, (matrix[:, k, None] * other[None, k] for k in range(len(other)))
    )


@kept
def _turned_back(matrix: Array, other: Array, size: Array) -> Array:
    """A Bᵀ of every lane, times `size`."""
    terms = (matrix[:, k, None] * other[None, :, k] for k in range(other.shape[1]))
    return functools.reduce(jnp.add, terms) * size[None, None]


@kept
def _product(matrix: Array, vector: Array) -> Array:
    """Of every lane."""
    return functools.reduce(jnp.add, (matrix[:, k] * vector[None, k] for k in range(len(vector))))
