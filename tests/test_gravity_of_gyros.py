"""An error of the reference g reaches the gyros' g-sensitivity: the derivative against fits with another g."""

import jax
import numpy as np
import pytest

import inertiax as ix


pytestmark = pytest.mark.slow

GRAVITY = 9.81


@pytest.mark.parametrize("by_reference", [True, False])
def test_d_moves_as_far_as_the_force_was_mistaken(by_reference):
    rng = np.random.default_rng(1)
    force = rng.normal(size=(40, 3))
    force *= GRAVITY / np.linalg.norm(force, axis=-1, keepdims=True)
    rate, sensitivity = rng.normal(size=(40, 3)), 1e-2 * rng.normal(size=(3, 3))

    def fit(larger):
        """Where g is really larger than what the station states."""
        real = force * (1.0 + larger)
        dwells = ix.Dwells.from_arrays(
            real,
            rate + real @ sensitivity.T / GRAVITY,
            sigma=(1e-3, 1e-6),
            reference_accel=force if by_reference else None,
            reference_gyro=rate,
            position=np.arange(40),
        )
        gyro = ix.ReferenceGyro(gravity=GRAVITY, g_sensitivity=True)
        return ix.fit(dwells, accel=ix.Invariant(gravity=GRAVITY), gyro=gyro)

    with jax.enable_x64(True):
        table = ix.derivatives(fit(0.0), [ix.sources.gravity(1e-3 * GRAVITY)])
        after, before = (fit(x).calibration.coefficients for x in (1e-3, -1e-3))
    found = 0.5 * (after - before)
    # Central differences of a smooth function: what is neglected is the third order of a part in a thousand.
    np.testing.assert_allclose(table.by_source[0][:, 0], found, rtol=1e-5, atol=1e-10)
    mine = [k for k, n in enumerate(table.names) if "g_sensitivity" in n]
    np.testing.assert_allclose(found[mine], 1e-3 * sensitivity.ravel(), rtol=1e-5)
