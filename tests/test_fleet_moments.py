"""Sums over dwells in the frame of the specific force, and chunks of lanes in one call."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fleet_data import dwell_means, GRAVITY, parameters
from inertiax.fleet import fit_invariant
from inertiax.fleet.solve.invariant import fit_chunks
from inertiax.fleet.solve.moments import gradient, normal_matrix


DIRECTIONS = ((0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2))


@pytest.mark.parametrize("dwells", [18, 50])  # in one expression, and in three parts
def test_moments_are_the_normal_matrix_of_numerical_derivatives(dwells):
    rng = np.random.default_rng(4)
    u = rng.normal(0, 1, (3, dwells, 5))
    u *= (1.0 + rng.normal(0, 1e-3, (dwells, 5))) / np.linalg.norm(u, axis=0)
    weight = rng.uniform(0.5, 2.0, (dwells, 5))

    def residual(step: np.ndarray, lane: int) -> np.ndarray:
        change = np.zeros((3, 3))
        change[tuple(zip(*DIRECTIONS, strict=True))] = step[3:]
        moved = u[:, :, lane] - step[:3, None] - change @ u[:, :, lane]
        return weight[:, lane] * (np.linalg.norm(moved, axis=0) - 1.0)

    normal = np.asarray(normal_matrix(jnp.asarray(u), jnp.asarray(weight**2)))
    pull = np.asarray(gradient(jnp.asarray(u), jnp.asarray(weight**2)))
    for lane in range(5):
        jacobian = np.stack(
            [(residual(h, lane) - residual(-h, lane)) / 2e-5 for h in 1e-5 * np.eye(9)], axis=1
        )
        # Central differences of a step 1e-5 are good to 1e-10.
        np.testing.assert_allclose(normal[:, :, lane], jacobian.T @ jacobian, atol=1e-8)
        np.testing.assert_allclose(
            pull[:, lane], -jacobian.T @ residual(np.zeros(9), lane), atol=1e-9
        )


def test_chunks_are_the_batch_and_those_not_used_are_left_out():
    rng = np.random.default_rng(6)
    made = [dwell_means(rng, parameters(rng, 0), 2)[0] for _ in range(12)]
    outputs = np.stack(made) + rng.normal(0, 1e-4, (12, *made[0].shape))
    lanes = outputs.reshape(3, 4, -1, 3).transpose(0, 3, 2, 1)
    weights = np.full((3, lanes.shape[2], 4), 1e4)
    gravity = jnp.asarray(GRAVITY)
    fit = jax.jit(fit_chunks)(lanes, weights, gravity, jnp.int32(2))
    one = jax.jit(fit_invariant)
    for k in range(2):
        alone = one(lanes[k], weights[k], gravity)
        # The same program but for what the compiler joins: rounding.
        np.testing.assert_allclose(fit.parameters[k], alone.parameters, rtol=0, atol=1e-12)
        assert bool(alone.converged.all()) and bool(fit.converged[k].all())
    assert not np.asarray(fit.parameters[2]).any() and not np.asarray(fit.converged[2]).any()
