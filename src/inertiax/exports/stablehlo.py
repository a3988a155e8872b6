"""The compensation as a serialized StableHLO program, by `jax.export`.

One function of (accel [n, 3], gyro [n, 3], temperature [n]) to (force, rate), any n, for CPU and GPU.
Reload it with `jax.export.deserialize(bytearray(content)).call(accel, gyro, temperature)`; inertiax is
not needed there.

**Reference:** JAX documentation, *Exporting and serializing staged-out computations*.
"""

from typing import Literal, TYPE_CHECKING

import numpy as np

from .._jax import jax, jnp
from ..calibration.calibration import Calibration
from .export import Export, Settings as Common


if TYPE_CHECKING:
    from jax.export import Exported


NAME = "stablehlo"
TITLE = "serialized StableHLO of the compensation (jax.export)"
SUFFIX = ".stablehlo"
KEEPS = "the compensation of accelerometers and gyros, as a program for any batch"
LOSES = "uncertainties; the parameters can no longer be read"

_PLATFORMS = ("cpu", "cuda", "rocm", "tpu")


class Settings(Common, frozen=True, kw_only=True):
    """`dtype` of inputs and outputs; double needs JAX's 64-bit mode where the program is used, too."""

    dtype: Literal["float32", "float64"] = "float64"


def write(calibration: Calibration, settings: Settings) -> Export:
    """The serialized program. Raises `ValueError` for float64 where JAX's 64-bit mode is off."""
    from jax import export as programs

    # What a plain array becomes says whether the mode is on.
    if settings.dtype == "float64" and jnp.zeros(0).dtype != jnp.float64:
        raise ValueError(
            "stablehlo: dtype = float64 needs JAX's 64-bit mode; switch jax_enable_x64 on, or use "
            "dtype=float32."
        )
    dtype = jnp.dtype(settings.dtype)
    cast = jax.tree.map(lambda x: jnp.asarray(x, dtype), calibration)
    (n,) = programs.symbolic_shape("n")
    shapes = [jax.ShapeDtypeStruct(s, dtype) for s in ((n, 3), (n, 3), (n,))]
    compensate = lambda accel, gyro, temperature: jax.vmap(cast)(accel, gyro, temperature)
    exported = programs.export(jax.jit(compensate), platforms=_PLATFORMS)(*shapes)
    content = _serialized(exported)

    def applied(accel: np.ndarray, gyro: np.ndarray, temperature: np.ndarray):
        program = programs.deserialize(bytearray(content))
        force, rate = program.call(*(jnp.asarray(x, dtype) for x in (accel, gyro, temperature)))
        return np.asarray(force, float), np.asarray(rate, float)

    single = ("digits beyond single precision",) if settings.dtype == "float32" else ()
    return Export(files=(("", content),), applied=applied, losses=single)


def _serialized(exported: "Exported") -> bytes:
    try:
        return bytes(exported.serialize())
    except ImportError:
        raise ValueError(
            "stablehlo: the package flatbuffers is missing: pip install 'inertiax[stablehlo]'."
        ) from None
