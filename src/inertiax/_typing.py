"""Array aliases, so that signatures stay short and say the shape."""

from collections.abc import Sequence
from typing import Any, TypeAlias

import jax
import numpy as np
from jaxtyping import Bool, Float, Int


AnyArray: TypeAlias = jax.Array | np.ndarray

Scalar: TypeAlias = Float[AnyArray, ""]
Vec3: TypeAlias = Float[AnyArray, "3"]
Mat3: TypeAlias = Float[AnyArray, "3 3"]
Times: TypeAlias = Float[AnyArray, " time"]
Triad: TypeAlias = Float[AnyArray, "time 3"]
Labels: TypeAlias = Int[AnyArray, " time"]
Mask: TypeAlias = Bool[AnyArray, " time"]

# What a user may give for an array: its shape and numbers are checked where it is taken.
Given: TypeAlias = AnyArray | Sequence[Any] | float | int | bool
