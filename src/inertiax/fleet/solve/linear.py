"""Estimators whose residuals are linear in the parameters (reference, static), for many devices in one program.

Second form of `procedure.thermal_iterations.joint_fit` for them, held to it to 1e-6 sigma by `tests/test_fleet.py`.
One Gauss-Newton step from anywhere is the answer. The normal matrix is a sum of Kronecker products of the
basis and the dwells' parameter Jacobians, as in `thermal`; the formulas are the estimators' own. Dwells that share an
error of their positioning have it taken from their rows first (`procedure.shared_errors`).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...estimators import AbstractEstimator
from ...numerics.lane_cholesky import inverse_blocks
from ...physics.temperature import AbstractBasis
from ...procedure.shared_errors import shared_errors, SharedErrors
from ...reduction.dwells import Dwells
from .invariant import BatchFit


def fit_linear(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    scatter: Float[Array, " batch"],
    *,
    tolerance: float = 1e-6,
) -> BatchFit:
    """Curves of a batch of devices; `dwells` leads with the device.

    A second step serves as the test of convergence: it is rounding where the residual is linear, and a device
    for which it is above `tolerance` standard deviations is not `converged`.
    """
    size, parameters = basis.size, estimator.num_parameters
    phi = jax.vmap(jax.vmap(basis))(dwells.temperature)
    kept = jnp.asarray(dwells.valid)

    def one(vector: Array, dwell: Dwells, extra: Array) -> tuple[Array, Array]:
        weighted = eqx.tree_at(lambda e: e.scatter, estimator, extra)
        return weighted.residual(vector, dwell), jax.jacfwd(weighted.residual)(vector, dwell)

    def rows(c: Array) -> tuple[Array, Array]:
        vectors = jnp.matmul(phi, c)
        inner = jax.vmap(one, in_axes=(0, 0, None))
        residual, jacobian = jax.vmap(inner)(vectors, dwells, scatter)
        zero = jnp.zeros((), residual.dtype)
        return (
            jnp.where(kept[:, :, None], residual, zero),
            jnp.where(kept[:, :, None, None], jacobian, zero),
        )

    start = jnp.zeros((len(kept), size, parameters), phi.dtype)
    residual, jacobian = rows(start)
    products = jnp.einsum("bnri,bnrj->bnij", jacobian, jacobian)
    pairs = (phi[:, :, :, None] * phi[:, :, None, :]).reshape(*phi.shape[:2], size * size)
    sums = jnp.matmul(
        jnp.swapaxes(pairs, 1, 2), products.reshape(*phi.shape[:2], parameters * parameters)
    ).reshape(-1, size, size, parameters, parameters)
    normal = jnp.swapaxes(sums, 2, 3).reshape(-1, size * parameters, size * parameters)
    shared, design = _shared(estimator, dwells, scatter), None
    if shared is not None:
        design = (phi[:, :, None, :, None] * jacobian[:, :, :, None, :]).reshape(
            *jacobian.shape[:3], size * parameters
        )
        design = jax.vmap(SharedErrors.decorrelated)(shared, design)
        normal = jnp.einsum("bnru,bnrv->buv", design, design)
    covariance = inverse_blocks(normal, parameters)

    def step(residual: Array) -> Array:
        if shared is not None and design is not None:
            white = jax.vmap(SharedErrors.decorrelated)(shared, residual[..., None])[..., 0]
            gradient = jnp.einsum("bnru,bnr->bu", design, white)[:, None, :]
            return -jnp.matmul(gradient, covariance).reshape(start.shape)
        of_row = jnp.einsum("bnri,bnr->bni", jacobian, residual)
        gradient = jnp.matmul(jnp.swapaxes(phi, 1, 2), of_row).reshape(-1, 1, size * parameters)
        return -jnp.matmul(gradient, covariance).reshape(start.shape)

    c = start + step(residual)
    left = rows(c)[0]
    second = step(left)
    scale = jnp.sqrt(jnp.diagonal(normal, axis1=1, axis2=2)).reshape(start.shape)
    c = c + second
    misfit = jax.vmap(jax.vmap(lambda v, d: estimator.misfit(v, d)[0]))(jnp.matmul(phi, c), dwells)
    if shared is not None:
        misfit = jax.vmap(SharedErrors.of_misfit)(shared, misfit, left)
    return BatchFit(
        parameters=c.reshape(-1, size * parameters),
        covariance=covariance,
        misfit=jnp.where(kept[:, :, None], misfit, jnp.zeros_like(misfit)),
        converged=jnp.max(jnp.abs(second) * scale, axis=(1, 2)) < tolerance,
        num_steps=jnp.full(len(kept), 2, jnp.int32),
    )


def _shared(
    estimator: AbstractEstimator, dwells: Dwells, scatter: Float[Array, " batch"]
) -> SharedErrors | None:
    """What dwells share, device by device; `None` where nothing is."""
    if dwells.positioning is None and dwells.table_accel is None:
        return None

    def one(device: Dwells, extra: Array) -> SharedErrors | None:
        return shared_errors(eqx.tree_at(lambda e: e.scatter, estimator, extra), device)

    return jax.vmap(one)(dwells, scatter)
