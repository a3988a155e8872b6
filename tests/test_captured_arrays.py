"""Arrays that a program of 32 bits captured are fitted in 64 bits all the same: JAX keeps what it made of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import inertiax as ix


UP = np.random.default_rng(3).normal(size=(24, 3))
FORCE = 9.81 * UP / np.linalg.norm(UP, axis=1, keepdims=True)
BIAS = np.array([0.02, -0.03, 0.01])  # m/s²
# Of numbers near ten in 64 bits rounding leaves 1e-14; in 32 it leaves 1e-6.
ROUNDING = 1e-11  # m/s²


@pytest.fixture(autouse=True)
def narrow():
    """JAX's default of 32 bits."""
    with jax.enable_x64(False):
        yield


def capture(*trees):
    """A program, as a user's own loss that refers to its arrays by name; JAX keeps them as long as it lives."""
    wide = [x for x in jax.tree.leaves(trees) if getattr(x, "dtype", None) == np.float64]
    assert wide
    program = jax.jit(lambda s: sum(jnp.sum(s * x) for x in wide))
    program(1.0)
    return program


def dwells(*lead):
    return ix.Dwells.from_arrays(np.broadcast_to(FORCE + BIAS, (*lead, 24, 3)).copy(), sigma=1e-4)


@pytest.mark.parametrize("lead", [(), (2,)])
def test_fit(lead):
    rests, estimator = dwells(*lead), ix.Invariant(gravity=9.81)
    kept = capture(rests, estimator)
    found = ix.fit(rests, accel=estimator).calibration
    assert kept is not None
    assert abs(np.asarray(found.coefficients)[..., :3] - BIAS).max() < ROUNDING


@pytest.mark.slow
def test_joint_fit():
    rests, estimator = dwells(), ix.Invariant(gravity=9.81)
    kept = capture(rests, estimator)
    found = ix.joint_fit(estimator, ix.Constant(), rests)
    assert kept is not None
    assert abs(found.curve.coefficients[0, :3] - BIAS).max() < ROUNDING


@pytest.mark.slow
def test_derivatives():
    found = ix.fit(dwells(), accel=ix.Invariant(gravity=9.81))
    kept = capture(found)
    table = ix.derivatives(found, ix.sources.gravity(9.81e-4))
    assert kept is not None
    # 100 ppm of g are 100 ppm of scale factor.
    assert table.sigma[0, table.names.index("accel.matrix[0,0]")] == pytest.approx(1e-4, rel=1e-9)
