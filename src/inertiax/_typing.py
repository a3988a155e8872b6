"""Array aliases, so that signatures stay short and say the shape."""

from collections.abc import Sequence
from typing import Any, TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

from ._records import WITHOUT_JAX


if TYPE_CHECKING or not WITHOUT_JAX:
    import jax

    AnyArray: TypeAlias = jax.Array | np.ndarray
else:
    AnyArray = Any

Scalar: TypeAlias = Float[AnyArray, ""]
Vec3: TypeAlias = Float[AnyArray, "3"]
Mat3: TypeAlias = Float[AnyArray, "3 3"]
Times: TypeAlias = Float[AnyArray, " time"]
Triad: TypeAlias = Float[AnyArray, "time 3"]
Labels: TypeAlias = Int[AnyArray, " time"]
Mask: TypeAlias = Bool[AnyArray, " time"]

# What a user may give for an array: its shape and numbers are checked where it is taken.
Given: TypeAlias = AnyArray | Sequence[Any] | float | int | bool
