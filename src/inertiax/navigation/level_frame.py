"""The frame that a filter navigates in: east, north and up at an origin, fixed to the turning Earth.

Positions are metres from the origin along axes that do not turn as the device moves, so that Earth rate is constant
and nothing needs 64 bits. What changes with place is gravity, which follows the plumb line over the ellipsoid:

    g(p) = −γ(φ, h) u,   u ∝ (e/(R_N + h₀), n/(R_M + h₀), 1 + z/R),   h = h₀ + z + (e² + n²)/2R

with φ = φ₀ + n/(R_M + h₀). At 50 km from the origin this leaves out less than 1e-5 g (terms in p³/R³ and f p²/R²).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._typing import Scalar, Vec3
from ..physics import earth, rotation
from ..physics.leaves import is_traced
from .checks import HIGHEST, LOWEST
from .strapdown import radii


class LevelFrame(eqx.Module):
    """East, north and up at an origin.

    `gravity` is the surveyed value at the origin (m/s²); without it, the ellipsoid's normal gravity.

    Raises `ValueError` for a latitude beyond ±90° (it is in rad), or a gravity or height that no place on Earth has.
    """

    latitude: Scalar | float  # rad
    height: Scalar | float = 0.0  # m above the ellipsoid
    gravity: Scalar | float | None = None  # m/s² at the origin

    def __check_init__(self):
        if not is_traced(self.latitude) and not abs(self.latitude) <= 1.5708:
            raise ValueError(
                f"`LevelFrame(latitude=...)` is in rad, from −π/2 to π/2; got {self.latitude}."
            )
        if not is_traced(self.height) and not LOWEST <= self.height <= HIGHEST:
            raise ValueError(
                f"`LevelFrame(height=...)` is in m above the ellipsoid; got {self.height}."
            )
        given = self.gravity
        if given is not None and not is_traced(given) and not 9.7 < given < 9.9:
            raise ValueError(f"`LevelFrame(gravity=...)` is in m/s², 9.7 to 9.9; got {given}.")

    def earth_rate(self, like: Array) -> Float[Array, "3"]:
        """Earth's angular rate in the frame, rad/s, in the precision of `like`."""
        return earth.earth_rate(jnp.asarray(self.latitude, like.dtype))

    def gravity_at(self, position: Vec3) -> Float[Array, "3"]:
        """Gravity, plumb-line acceleration at rest, at a position (m) in the frame, m/s²."""
        p = jnp.asarray(position)
        latitude, height = (jnp.asarray(x, p.dtype) for x in (self.latitude, self.height))
        meridian, normal = radii(latitude)
        mean = jnp.sqrt(meridian * normal) + height
        north = p[1] / (meridian + height)
        up = jnp.stack([p[0] / (normal + height), north, 1.0 + p[2] / mean])
        above = p[2] + (p[0] ** 2 + p[1] ** 2) / (2.0 * mean)
        size = earth.gravity(latitude + north, height + above)
        if self.gravity is not None:
            size = size + jnp.asarray(self.gravity, p.dtype) - earth.gravity(latitude, height)
        return -size * up / jnp.sqrt(jnp.vdot(up, up))

    def gravity_gradient(self, position: Vec3) -> Float[Array, "3 3"]:
        """∂g/∂p, 1/s²: −g/R across the plumb line, +2g/R along it, to 2 parts in a thousand of it.

        Only the error's propagation uses it, where Schuler's period of 84 min is what it stands for.
        """
        p = jnp.asarray(position)
        latitude = jnp.asarray(self.latitude, p.dtype)
        meridian, normal = radii(latitude)
        g = earth.gravity(latitude)
        return jnp.diag(
            jnp.stack([-g / normal, -g / meridian, 2.0 * g / jnp.sqrt(meridian * normal)])
        )


def earth_turn(frame: LevelFrame, times: Float[Array, " time"]) -> Float[Array, "time 3 3"]:
    """Rotations exp(−ω_ie t) by which Earth's turning changes an attitude in the frame; times in s."""
    rate = frame.earth_rate(times)
    return jax.vmap(lambda t: rotation.exp(-t * rate))(times)
