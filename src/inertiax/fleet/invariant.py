"""The invariant accelerometer problem for many devices in one program.

Same residual, parameters and gauge as `estimators.Invariant`, in units of g, written out for a batch:

    r = w (‖(E + Γ)⁻¹ (a' − a⁰)‖ − 1),   ∂r/∂a⁰ = −w v,   ∂r/∂Γ_ij = −w v_i f_j,

with f the specific force and v = (E + Γ)⁻ᵀ f/‖f‖.

Two Gauss-Newton steps bring a triad whose errors are of some per cent to within 10⁻⁶ of the
minimum; from there the normal matrix hardly changes, so its factor is kept and the steps that are left cost
only residuals and gradient. They go on until the step is small: the answer is the exact minimum.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..estimators.invariant import _COLUMNS, _ROWS
from .cholesky import factor_lanes, invert_lanes, Lane, Lower, solve_lanes


class BatchFit(eqx.Module):
    """Many devices' solutions; arrays lead with the device. Parameters are those of `estimators.Invariant`,
    one set per basis function, row-major `(size, 9)`."""

    parameters: Float[Array, "devices unknowns"]
    covariance: Float[Array, "devices unknowns unknowns"]  # (JᵀJ)⁻¹; NaN where rank deficient
    misfit: Float[Array, "devices dwells rows"]  # SI, zero at padding
    converged: Bool[Array, " devices"]
    num_steps: Int[Array, " devices"]


def predicted(p: list[Array], outputs: list[Array]) -> tuple[Array, list[Array]]:
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
    v, f = (v0, v1, v2), (f0, f1, f2)
    size = (f0 * f0 + f1 * f1 + f2 * f2) * inverse
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
    a = [outputs[i] / gravity for i in range(3)]
    w = weights * gravity
    zero = jnp.zeros_like(a[0][0])
    # In a loop, though only twice, so that it is compiled once.
    begin = ([zero] * 9, [[zero] * (i + 1) for i in range(9)], [zero] * 9)
    p, lower, scale = jax.lax.fori_loop(0, 2, lambda _, s: _full_step(s[0], a, w), begin)

    def unsettled(state):
        return (state[1] < max_steps) & jnp.any(~state[2])

    def refine(state):
        p, k, done, steps = state
        q, size = _kept_step(p, a, w, lower, scale)
        p = [jnp.where(done, x, y) for x, y in zip(p, q, strict=True)]
        return p, k + 1, done | (size < tolerance), steps + jnp.where(done, 0, 1)

    # NaN compares as false: a device that failed runs to the limit and is not converged.
    settled = jnp.isnan(p[0])
    first = (p, 2, settled, jnp.full_like(zero, 2, dtype=jnp.int32))
    p, _, done, steps = jax.lax.while_loop(unsettled, refine, first)
    misfit = (
        jnp.where(w > 0, predicted([x[None] for x in p], a)[0] - 1.0, jnp.zeros_like(w)) * gravity
    )
    units = jnp.concatenate([jnp.full((3,), gravity), jnp.ones((6,), w.dtype)])
    covariance = invert_lanes(lower) * (units[:, None] * units[None, :])[None]
    return BatchFit(
        parameters=jnp.stack(p, axis=1) * units[None],
        covariance=covariance,
        misfit=misfit.T[:, :, None],
        converged=done & ~jnp.isnan(p[0]),
        num_steps=steps,
    )


def _full_step(p: list[Lane], a: list[Array], w: Array) -> tuple[list[Lane], Lower, list[Lane]]:
    """A Gauss-Newton step, the factor of its normal matrix, and the norms of the Jacobian's columns."""
    size, columns = predicted([x[None] for x in p], a)
    residual = (size - 1.0) * w
    columns = [c * w for c in columns]
    normal = [[jnp.sum(columns[i] * columns[j], axis=0) for j in range(i + 1)] for i in range(9)]
    lower = factor_lanes(normal)
    step = solve_lanes(lower, [jnp.sum(c * residual, axis=0) for c in columns])
    moved = [x + d for x, d in zip(p, step, strict=True)]
    return moved, lower, [jnp.sqrt(normal[i][i]) for i in range(9)]


def _kept_step(
    p: list[Lane], a: list[Array], w: Array, lower: Lower, scale: list[Lane]
) -> tuple[list[Lane], Lane]:
    """A step with a kept factor, and its size in standard deviations."""
    size, columns = predicted([x[None] for x in p], a)
    residual = (size - 1.0) * w * w
    step = solve_lanes(lower, [jnp.sum(c * residual, axis=0) for c in columns])
    sizes = [jnp.abs(d) * s for d, s in zip(step, scale, strict=True)]
    largest = sizes[0]
    for s in sizes[1:]:
        largest = jnp.maximum(largest, s)
    return [x + d for x, d in zip(p, step, strict=True)], largest
