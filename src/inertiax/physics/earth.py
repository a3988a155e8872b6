"""Gravity and Earth rate at a site.

The local level frame is ENU: x east, y north, z up. A triad at rest reads the specific force
`(0, 0, +g)` there.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._typing import Scalar
from .wgs84 import (
    EARTH_RATE as EARTH_RATE,
    EQUATOR_GRAVITY as EQUATOR_GRAVITY,
    FLATTENING as FLATTENING,
    GRAVITY_RATIO as GRAVITY_RATIO,
    POLE_GRAVITY as POLE_GRAVITY,
    SEMI_MAJOR_AXIS as SEMI_MAJOR_AXIS,
)


def gravity(latitude: Scalar | float, height: Scalar | float = 0.0) -> Float[Array, ""]:
    """Normal gravity of WGS 84, m/s²: Somigliana's formula with a second-order height term,

    $$\\gamma = \\gamma_e \\frac{1 + k \\sin^2\\varphi}{\\sqrt{1 - e^2 \\sin^2\\varphi}}, \\qquad
    \\gamma_h = \\gamma \\Big(1 - \\frac{2h}{a}(1 + f + m - 2f\\sin^2\\varphi) +
    \\frac{3h^2}{a^2}\\Big).$$

    It is a model of the ellipsoid: the measured value of a place differs from it by up to some
    1e-3 m/s² (an anomaly of 100 mGal), so a survey's value is to be preferred.

    **Arguments:** geodetic `latitude` in rad, `height` above the ellipsoid in m.

    **Reference:** NGA.STND.0036_1.0.0, equations 4-1 and 4-3.
    """
    a, f = SEMI_MAJOR_AXIS, FLATTENING
    k = (1.0 - f) * POLE_GRAVITY / EQUATOR_GRAVITY - 1.0
    sin2 = jnp.sin(latitude) ** 2
    on_ellipsoid = EQUATOR_GRAVITY * (1.0 + k * sin2) / jnp.sqrt(1.0 - f * (2.0 - f) * sin2)
    h = jnp.asarray(height) / a
    return on_ellipsoid * (1.0 - 2.0 * h * (1.0 + f + GRAVITY_RATIO - 2.0 * f * sin2) + 3.0 * h**2)


def earth_rate(latitude: Scalar | float) -> Float[Array, "3"]:
    """Angular rate of the Earth in the local level frame (ENU), rad/s:
    $\\Omega\\,(0, \\cos\\varphi, \\sin\\varphi)$, for a `latitude` in rad."""
    phi = jnp.asarray(latitude)
    return EARTH_RATE * jnp.stack([jnp.zeros_like(phi), jnp.cos(phi), jnp.sin(phi)])


def rest_force(magnitude: Scalar | float) -> Float[Array, "3"]:
    """Specific force at rest in the local level frame (ENU), m/s²: $(0, 0, g)$."""
    g = jnp.asarray(magnitude)
    return jnp.stack([jnp.zeros_like(g), jnp.zeros_like(g), g])


def rest_readings(
    case_to_level: Float[Array, "3 3"], magnitude: Scalar | float, latitude: Scalar | float
) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """What ideal triads read at rest: specific force (m/s²) and absolute rate (rad/s) in the case
    frame, $R^T (0, 0, g)$ and $R^T \\Omega$, where `case_to_level` is R."""
    return case_to_level.T @ rest_force(magnitude), case_to_level.T @ earth_rate(latitude)
