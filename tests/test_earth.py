"""Gravity and Earth rate against published values."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.physics import earth


@pytest.mark.parametrize(
    "degrees, published, tolerance",
    [
        # Defining values of WGS 84, to their last digit.
        (0.0, 9.7803253359, 1e-10),
        (90.0, 9.8321849378, 1e-10),
        # GRS 80's table; its constants lie 1.43e-6 m/s² above those of WGS 84 at both ends.
        (45.0, 9.806199203 - 1.43e-6, 1e-8),
    ],
)
def test_gravity_on_the_ellipsoid_is_the_published_value(degrees, published, tolerance):
    np.testing.assert_allclose(
        earth.gravity(np.deg2rad(degrees)), published, rtol=0, atol=tolerance
    )


def test_gravity_falls_by_the_free_air_gradient():
    # 0.3086 mGal/m, the textbook free-air gradient near 45°, to its last digit.
    slope = jax.grad(earth.gravity, argnums=1)(np.deg2rad(45.0), 0.0)
    np.testing.assert_allclose(slope, -3.086e-6, atol=5e-10)


def test_gravity_at_height_follows_newtons_law():
    # Between 0 and 10 km, an independent account: attraction GM/r² of the mean sphere less the
    # centrifugal term at the pole, where there is none; oblateness enters at 1e-3 of the change.
    r = 6356752.3142
    expected = (r / (r + 1e4)) ** 2
    ratio = earth.gravity(np.pi / 2, 1e4) / earth.gravity(np.pi / 2, 0.0)
    assert abs((1 - ratio) / (1 - expected) - 1) < 5e-3


def test_the_papers_reference_gravity_is_that_of_its_town():
    # Ramenskoye, 55.57° N, ~130 m; gravity anomalies there stay within 1e-3 m/s².
    assert abs(earth.gravity(np.deg2rad(55.57), 130.0) - 9.815179) < 1e-3


def test_earth_rate_points_north_at_the_equator_and_up_at_the_pole():
    # atol: cos(π/2) is not exactly zero.
    np.testing.assert_allclose(earth.earth_rate(0.0), [0, 7.292115e-5, 0], atol=1e-20)
    np.testing.assert_allclose(earth.earth_rate(np.pi / 2), [0, 0, 7.292115e-5], atol=1e-20)


def test_earth_rate_at_30_degrees_north():
    # 15.041067 °/h; north 15.041067 cos 30° = 13.025946 °/h, up 7.520534 °/h.
    per_hour = np.rad2deg(np.asarray(earth.earth_rate(np.deg2rad(30.0)))) * 3600
    np.testing.assert_allclose(per_hour, [0.0, 13.025946, 7.520534], atol=1e-6)


def test_level_triads_at_rest_read_gravity_up_and_earth_rate():
    force, rate = earth.rest_readings(jnp.eye(3), 9.8, np.deg2rad(30.0))
    np.testing.assert_allclose(force, [0, 0, 9.8])
    np.testing.assert_allclose(rate, earth.earth_rate(np.deg2rad(30.0)))
