"""The invariant accelerometer problem for many devices in one program.

Same residual, parameters and gauge as `estimators.Invariant`, in units of g, written out for a batch:

    r = w (‖(E + Γ)⁻¹ (a' − a⁰)‖ − 1),   ∂r/∂a⁰ = −w v,   ∂r/∂Γ_ij = −w v_i f_j,

with f the specific force and v = (E + Γ)⁻ᵀ f/‖f‖.

Two Gauss-Newton steps bring a triad whose errors are of some per cent to within 10⁻⁶ of the
minimum; from there the normal matrix hardly changes, so its inverse is kept and the steps that are left cost
only residuals and gradient. They go on until the step is small: the answer is the exact minimum.

Arrays of few, large operations: what a processor does between them, and what the compiler does with them, costs
as much as the arithmetic.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..estimators.invariant import _COLUMNS, _ROWS
from .cholesky import sweep_lanes


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
    """‖f‖ and minus its derivatives by the nine parameters, elementwise; outputs in g."""
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
    w = weights * gravity
    start = jnp.zeros((9, a.shape[2]), a.dtype)
    none = jnp.zeros((10, 10, a.shape[2]), a.dtype)
    # In a loop, though only twice, so that it is compiled once.
    begin = (start, none, start)
    p, swept, scale = jax.lax.fori_loop(0, 2, lambda _, s: _full_step(s[0], a, w), begin)
    inverse, squared = swept[:9, :9], w * w

    def unsettled(state):
        return (state[1] < max_steps) & jnp.any(~state[2])

    def refine(state):
        p, k, done, steps = state
        step = _product(inverse, _gradient(p, a, squared))
        small = is_small(step, scale, tolerance, axis=0)
        p = jnp.where(done[None], p, p + step)
        return p, k + 1, done | small, steps + jnp.where(done, 0, 1)

    # NaN compares as false: a device that failed runs to the limit and is not converged.
    failed = jnp.isnan(p[0])
    first = (p, 2, failed, jnp.full(failed.shape, 2, jnp.int32))
    p, _, done, steps = jax.lax.while_loop(unsettled, refine, first)
    misfit = jnp.where(w > 0, predicted(p[:, None], a)[0] - 1.0, jnp.zeros_like(w)) * gravity
    units = jnp.concatenate([jnp.full((3,), gravity, a.dtype), jnp.ones((6,), a.dtype)])
    covariance = jnp.moveaxis(inverse, 2, 0) * (units[:, None] * units[None, :])[None]
    return BatchFit(
        parameters=p.T * units[None],
        covariance=covariance,
        misfit=misfit.T[:, :, None],
        converged=done & ~jnp.isnan(p[0]),
        num_steps=steps,
    )


def is_small(
    step: Array, scale: Array, tolerance: float, *, axis: int | tuple[int, ...]
) -> Bool[Array, " batch"]:
    """Whether steps (in g and per unit) are below `tolerance` in standard deviations, or nothing but rounding."""
    size = jnp.abs(step)
    told = jnp.max(size * scale, axis=axis) < tolerance
    return told | (jnp.max(size, axis=axis) < ROUNDINGS * jnp.finfo(step.dtype).eps)


def _full_step(p: Array, a: Array, w: Array) -> tuple[Array, Array, Array]:
    """A Gauss-Newton step, the swept normal matrix with the gradient beside it, and the norms of the
    Jacobian's columns."""
    size, columns = predicted(p[:, None], a)
    rows = jnp.stack([c * w for c in (*columns, size - 1.0)])
    normal = jnp.einsum("idl,jdl->ijl", rows, rows)
    swept = sweep_lanes(normal, 9)
    scale = jnp.sqrt(jnp.stack([normal[i, i] for i in range(9)]))
    return p + swept[:9, 9], swept, scale


def _gradient(p: Array, a: Array, squared: Array) -> Array:
    size, columns = predicted(p[:, None], a)
    residual = (size - 1.0) * squared
    return jnp.sum(jnp.stack([c * residual for c in columns]), axis=1)


def _product(matrix: Array, vector: Array) -> Array:
    """Of every lane, written out: a batched matrix product would move the batch out of the lanes."""
    total = matrix[:, 0] * vector[0][None]
    for j in range(1, matrix.shape[1]):
        total = total + matrix[:, j] * vector[j][None]
    return total
