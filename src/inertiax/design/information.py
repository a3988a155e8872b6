"""What one position tells: the Jacobian rows of an ideal triad at rest on the table.

Rows are per unit noise: parameters that are biases are counted in g, so that all are dimensionless and
of one size, and a row has variance (σ/g)² in them, whatever the noise σ of a dwell mean.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._typing import AnyArray
from ..estimators import AbstractEstimator, Invariant
from ..reduction.dwells import Dwells
from ..simulate.programme import Table


GRAVITY = 9.80665  # m/s²; only a unit here, the rows do not depend on it


def unit_scales(estimator: AbstractEstimator) -> Float[np.ndarray, " parameters"]:
    """Size of one dimensionless unit of each parameter: g for biases (m/s²), 1 for the matrix."""
    return np.array([GRAVITY if ".bias" in name else 1.0 for name in estimator.names])


def ideal_rows(
    estimator: AbstractEstimator, table: Table, angles: Float[AnyArray, "positions 2"]
) -> Float[Array, "positions rows parameters"]:
    """∂r/∂θ of an ideal accelerometer triad at table angles (outer, inner; rad), differentiable in them.

    Raises `ValueError` for estimators of gyros, whose programme is made of rates, not of rests.
    """
    if estimator.triad != "accel":
        raise ValueError(
            f"`ideal_rows({type(estimator).__name__}, ...)`: positions at rest are designed for "
            f"accelerometers; gyros need rates, see `simulate.motion.turns_about_three_axes`."
        )
    scales = jnp.asarray(unit_scales(estimator))
    ideal = _ideal(estimator)

    def one(pair: Array) -> Array:
        up = table.attitude(pair[0], pair[1]).T @ jnp.array([0.0, 0.0, GRAVITY])
        zero = jnp.zeros(estimator.num_parameters)
        return jax.jacfwd(ideal.residual)(zero, _dwell(up)) * scales[None, :]

    return jax.vmap(one)(jnp.asarray(angles))


def host_rows(
    estimator: AbstractEstimator, table: Table, angles: Float[AnyArray, "positions 2"]
) -> Float[np.ndarray, "positions rows parameters"]:
    """`ideal_rows` in NumPy; all numbers of positions share one compiled program."""
    return _in_chunks(_rows, estimator, table, np.asarray(angles, float))[0]


def host_slopes(
    estimator: AbstractEstimator, table: Table, angles: Float[AnyArray, "positions 2"]
) -> tuple[
    Float[np.ndarray, "positions rows parameters"], Float[np.ndarray, "positions rows parameters 2"]
]:
    """`host_rows` and their derivatives by each position's own two angles."""
    rows, slopes = _in_chunks(_rows_and_slopes, estimator, table, np.asarray(angles, float))
    return rows, slopes


_CHUNK = 64  # positions in one call of a compiled program


def _in_chunks(
    program: Callable[[AbstractEstimator, Table, np.ndarray], tuple[Array, ...]],
    estimator: AbstractEstimator,
    table: Table,
    angles: np.ndarray,
) -> list[np.ndarray]:
    count = len(angles)
    padded = np.concatenate([angles, np.zeros((-count % _CHUNK, 2))])
    parts = [program(estimator, table, piece) for piece in padded.reshape(-1, _CHUNK, 2)]
    return [np.concatenate([np.asarray(x) for x in own])[:count] for own in zip(*parts)]


@eqx.filter_jit
def _rows(estimator: AbstractEstimator, table: Table, angles: AnyArray) -> tuple[Array, ...]:
    return (ideal_rows(estimator, table, angles),)


@eqx.filter_jit
def _rows_and_slopes(
    estimator: AbstractEstimator, table: Table, angles: AnyArray
) -> tuple[Array, ...]:
    one = lambda pair: ideal_rows(estimator, table, pair[None])[0]
    return jax.vmap(one)(angles), jax.vmap(jax.jacfwd(one))(angles)


def _ideal(estimator: AbstractEstimator) -> AbstractEstimator:
    """The estimator with g as the unit here and nothing but the dwell's own noise."""
    changed = eqx.tree_at(lambda e: e.scatter, estimator, jnp.zeros(()))
    if isinstance(estimator, Invariant):
        return eqx.tree_at(lambda e: e.gravity, changed, jnp.asarray(GRAVITY))
    return changed


def _dwell(force: Float[Array, "3"]) -> Dwells:
    """One rest with noise of one g, so that rows come out per unit noise."""
    zero = jnp.zeros(())
    return Dwells(
        time=zero,
        duration=zero + 1.0,
        count=zero + 1.0,
        temperature=zero,
        experiment=jnp.zeros((), int),
        position=jnp.zeros((), int),
        valid=jnp.ones((), bool),
        accel=force,
        accel_covariance=GRAVITY**2 * jnp.eye(3),
        reference_accel=force,
    )


def sphere_average(estimator: AbstractEstimator, table: Table) -> Float[np.ndarray, "_ _"]:
    """Mean of JᵀJ over all directions of gravity in the case.

    It is of degree 4 in the direction, and the twelve vertices of an icosahedron integrate degree 5
    exactly (a spherical 5-design), so no other quadrature is needed.
    """
    ratio = 0.5 * (1.0 + 5.0**0.5)
    signs = [(a, b * ratio) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    corners = np.array([np.roll([0.0, a, b], k) for k in range(3) for a, b in signs]) / np.hypot(
        1.0, ratio
    )
    angles = np.stack([np.arccos(corners[:, 2]), np.arctan2(corners[:, 0], corners[:, 1])], axis=1)
    rows = host_rows(estimator, table, angles)
    return np.einsum("nri,nrj->ij", rows, rows) / len(corners)
