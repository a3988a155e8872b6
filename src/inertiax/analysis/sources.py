"""Uncertainties of rig, environment and device, as disturbances of what dwells should have read.

Each function returns a `Source` of a stated 1-sigma size. Signs are "actual less stated": a gravity of
+1e-5 means that the real g is larger than the number in the campaign file. Of the temperature it is what was read that
is off: "read less actual".
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._typing import AnyArray, Scalar
from ..data.plausible_units import check_from_zero
from ..physics import rotation
from ..physics.leaves import as_leaf
from ..reduction.dwells import Dwells


class Scene(eqx.Module):
    """What the dwells felt, row by row."""

    force: Float[AnyArray, "dwells 3"] | None  # m/s²
    rate: Float[AnyArray, "dwells 3"] | None  # rad/s
    heating: Float[AnyArray, " dwells"]  # dT/dt, °C/s


class Disturbance(eqx.Module):
    """Change of what was felt (`force`, `rate`), of the outputs, or of the probe; `None`: none."""

    force: Float[Array, "dwells 3"] | None = None
    rate: Float[Array, "dwells 3"] | None = None
    accel: Float[Array, "dwells 3"] | None = None
    gyro: Float[Array, "dwells 3"] | None = None
    temperature: Float[Array, " dwells"] | None = None
    # The accelerometers' calibration, by the same stated quantity, takes the change of force up: what gyros are told of
    # the force stays as it was.
    with_calibration: bool = eqx.field(static=True, default=False)

    def touches(self, dwells: Dwells) -> bool:
        """Whether anything that the dwells hold changes."""
        accel = self.force is not None or self.accel is not None
        gyro = self.rate is not None or self.gyro is not None
        return (
            (accel and dwells.accel is not None)
            or (gyro and dwells.gyro is not None)
            or self.temperature is not None
        )


Effect = Callable[[Float[Array, "dwells width"], Scene, Dwells], Disturbance]


class Source(eqx.Module):
    """One uncertainty: its size, how often it is drawn anew, and what it does.

    `effect(values, scene, dwells)` works row by row: what a dwell's draw does, it does to that dwell.

    Raises `ValueError` for a size that is negative or implausible in its unit.
    """

    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    size: Scalar | float = eqx.field(converter=as_leaf)  # 1 sigma, in `unit`
    per: str = eqx.field(static=True)  # drawn for each "dwell", "experiment" or once a "campaign"
    width: int = eqx.field(static=True)  # numbers in a draw
    effect: Effect = eqx.field(static=True)

    def __check_init__(self):
        greatest = _LARGEST.get(self.unit, np.inf)
        check_from_zero(f"sources: {self.name} (size=...)", self.size, greatest, self.unit)


# The name of the source that each function makes.
NAMES = {
    "output_noise": "output noise",
    "repositioning": "re-positioning",
    "day_to_day": "experiment-to-experiment bias",
    "probe_noise": "probe, each dwell",
    "probe_offset": "probe offset",
    "timing": "timing of the probe",
    "gravity": "reference g",
    "table_angles": "table angles",
    "positioning": "positioning",
    "mounting": "mounting",
    "table_rate": "table rate",
}
# Of an uncertainty, by its unit: beyond it the number is the quantity itself, or in another unit.
_LARGEST = {"rad": 0.5, "m/s^2": 5.0, "rad/s": 5.0, "degC": 50.0}


def _rotated(vectors: AnyArray | None, angles: Array) -> Array | None:
    """Change of a vector fixed in the room when the case turns by small rotation vectors."""
    if vectors is None:
        return None
    turned = jax.vmap(lambda a, v: rotation.exp(-a) @ v)(angles, jnp.asarray(vectors))
    return turned - jnp.asarray(vectors)


# What the functions below make is these same functions each time, so that a program is compiled once for all sizes.


def _by_covariances(values: Array, scene: Scene, dwells: Dwells) -> Disturbance:
    del scene
    own = lambda c, v: None if c is None else jnp.einsum("nij,nj->ni", _roots(c), v)
    return Disturbance(
        accel=own(dwells.accel_covariance, values[:, :3]),
        gyro=own(dwells.gyro_covariance, values[:, 3:]),
    )


def _roots(covariances: AnyArray) -> Float[Array, "dwells 3 3"]:
    """Lower triangular L with L Lᵀ = C; a direction without variance has a column of zeros."""
    c = jnp.moveaxis(jnp.asarray(covariances), 0, -1)
    zero = jnp.zeros_like(c[0, 0])

    def pivot(variance: Array) -> tuple[Array, Array]:
        kept = variance > 0.0
        root = jnp.sqrt(jnp.where(kept, variance, 1.0))
        return jnp.where(kept, root, 0.0), jnp.where(kept, 1.0 / root, 0.0)

    l00, i00 = pivot(c[0, 0])
    l10, l20 = c[1, 0] * i00, c[2, 0] * i00
    l11, i11 = pivot(c[1, 1] - l10**2)
    l21 = (c[2, 1] - l20 * l10) * i11
    l22, _ = pivot(c[2, 2] - l20**2 - l21**2)
    rows = [l00, zero, zero, l10, l11, zero, l20, l21, l22]
    return jnp.moveaxis(jnp.stack(rows).reshape(3, 3, -1), -1, 0)


def _on_accel(values: Array, scene: Scene, dwells: Dwells) -> Disturbance:
    del scene, dwells
    return Disturbance(accel=values)


def _on_gyro(values: Array, scene: Scene, dwells: Dwells) -> Disturbance:
    del scene, dwells
    return Disturbance(gyro=values)


def _on_probe(values: Array, scene: Scene, dwells: Dwells) -> Disturbance:
    del scene, dwells
    return Disturbance(temperature=values[:, 0])


def _late(values: Array, scene: Scene, dwells: Dwells) -> Disturbance:
    del dwells
    return Disturbance(temperature=-values[:, 0] * scene.heating)


def _along_force(values: Array, scene: Scene, dwells: Dwells) -> Disturbance:
    del dwells
    assert scene.force is not None
    magnitude = jnp.linalg.norm(jnp.asarray(scene.force), axis=1, keepdims=True)
    return Disturbance(force=jnp.asarray(scene.force) / magnitude * values, with_calibration=True)


def _turned(angles: Array, scene: Scene, dwells: Dwells) -> Disturbance:
    del dwells
    return Disturbance(force=_rotated(scene.force, angles), rate=_rotated(scene.rate, angles))


def _along_rate(values: Array, scene: Scene, dwells: Dwells) -> Disturbance:
    turning = jnp.where(jnp.asarray(dwells.position) < 0, 1.0, 0.0)[:, None]
    assert scene.rate is not None
    return Disturbance(rate=values * turning * jnp.asarray(scene.rate))


def _bias(name: str, size: float, per: str, triad: str) -> Source:
    accel = triad == "accel"
    unit, effect = ("m/s^2", _on_accel) if accel else ("rad/s", _on_gyro)
    return Source(NAMES[name], unit, size, per, 3, effect)


def output_noise() -> Source:
    """Noise of the dwell means, by their own covariances; `size` 1 is that noise."""
    return Source(NAMES["output_noise"], "1", 1.0, "dwell", 6, _by_covariances)


def repositioning(size: float, *, triad: str = "accel") -> Source:
    """Bias that differs from dwell to dwell, each axis on its own: m/s² or rad/s."""
    return _bias("repositioning", size, "dwell", triad)


def day_to_day(size: float, *, triad: str = "accel") -> Source:
    """Bias that differs from experiment to experiment, each axis on its own: m/s² or rad/s."""
    return _bias("day_to_day", size, "experiment", triad)


def probe_noise(size: float) -> Source:
    """Error of the probe that differs from dwell to dwell, °C; positive where it reads too high."""
    return Source(NAMES["probe_noise"], "degC", size, "dwell", 1, _on_probe)


def probe_offset(size: float) -> Source:
    """Constant offset of the probe, °C; positive where it reads too high."""
    return Source(NAMES["probe_offset"], "degC", size, "campaign", 1, _on_probe)


def timing(size: float) -> Source:
    """Temperature stamped late by a constant time, s; to first order also a probe's lag."""
    return Source(NAMES["timing"], "s", size, "campaign", 1, _late)


def gravity(size: float) -> Source:
    """True g less the stated one, m/s²: a positive value is a specific force greater than the calibration takes it."""
    return Source(NAMES["gravity"], "m/s^2", size, "campaign", 1, _along_force)


def table_angles(
    size: float,
    outer_axes: Float[AnyArray, "dwells 3"],
    inner_axes: Float[AnyArray, "dwells 3"],
) -> Source:
    """Error of each axis of a two-axis table at each positioning, rad.

    **Arguments:** unit vectors of both axes in the case frame at each dwell; `table_axes` computes
    them from attitudes.
    """

    def effect(values: Array, scene: Scene, dwells: Dwells) -> Disturbance:
        # A mean over whole revolutions does not know where the turn started.
        rest = jnp.where(jnp.asarray(dwells.position) >= 0, 1.0, 0.0)[:, None]
        about_outer = values[:, :1] * jnp.asarray(outer_axes)
        turned = rest * (about_outer + values[:, 1:] * jnp.asarray(inner_axes))
        return _turned(turned, scene, dwells)

    return Source(NAMES["table_angles"], "rad", size, "dwell", 2, effect)


def positioning(size: float) -> Source:
    """Error of attitude at each positioning about every axis, rad, where no table is described."""
    return Source(NAMES["positioning"], "rad", size, "dwell", 3, _turned)


def mounting(size: float) -> Source:
    """Constant rotation of the device on the table about every axis, rad."""
    return Source(NAMES["mounting"], "rad", size, "campaign", 3, _turned)


def table_rate(size: float) -> Source:
    """Relative error of the table's rate, or of the clock; of turns, not of rests."""
    return Source(NAMES["table_rate"], "1", size, "campaign", 1, _along_rate)


def table_axes(
    attitudes: Float[AnyArray, "dwells 3 3"], outer_axis: AnyArray, inner_axis: AnyArray
) -> tuple[Float[np.ndarray, "dwells 3"], Float[np.ndarray, "dwells 3"]]:
    """Both axes in the case frame, from case-to-level attitudes; the outer axis is fixed in the room,
    the inner one in the case."""
    rotations = np.asarray(attitudes)
    outer = np.einsum("nij,i->nj", rotations, np.asarray(outer_axis))
    return outer, np.tile(np.asarray(inner_axis), (len(rotations), 1))
