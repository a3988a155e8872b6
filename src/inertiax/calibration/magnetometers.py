"""The magnetometers' part of a calibration: hard and soft iron over temperature, and the field they rest on."""

import numpy as np
from jaxtyping import Float

from .._jax import Array, eqx
from .._typing import Scalar, Vec3
from ..data.plausible_units import check_sample
from ..physics.leaves import as_leaf
from ..physics.magnetic_model import compensate_mag, MagnetometerErrors
from ..physics.shapes import check_given, check_one
from .triad import TriadCalibration


class MagnetometerCalibration(eqx.Module):
    """Hard iron, soft iron and the field of a current over temperature; calling it compensates one sample.

    `frame` is "accel" where the result is in the frame of the accelerometers, "own" where the triad's x axis is as it
    is and its y axis in its xy plane. Where the field's magnitude was not given, the scale is by convention:
    det(E + S) = 1 in the middle of the temperatures.

    Raises `ValueError` for parameters of another triad.
    """

    triad: TriadCalibration  # `mag.bias[i]`, `mag.matrix[i,j]`, `mag.current[i]`, SI
    field: Scalar | float = eqx.field(converter=as_leaf)  # T, magnitude at the test place
    # Rad, angle of the field below the horizontal and its 1 sigma; NaN where no vertical was known.
    dip: Scalar | float = eqx.field(converter=as_leaf, default=float("nan"))
    dip_sigma: Scalar | float = eqx.field(converter=as_leaf, default=float("nan"))
    field_given: bool = eqx.field(static=True, default=False)  # False: the scale is by convention
    frame: str = eqx.field(static=True, default="own")  # accel | own

    def __check_init__(self):
        wrong = [n for n in self.triad.names if not n.startswith("mag.")]
        if wrong:
            raise ValueError(
                f"`MagnetometerCalibration(triad=...)`: {wrong[0]!r} is not one of mag."
            )
        if self.frame not in ("accel", "own"):
            raise ValueError(
                f"`MagnetometerCalibration(frame={self.frame!r})`: it is 'accel' or 'own'."
            )

    def errors(self, temperature: Scalar | float) -> MagnetometerErrors:
        """The parameters at one temperature, °C."""
        p = self.triad.parameters(temperature)
        return MagnetometerErrors(p[:3], p[3:12].reshape(3, 3), p[12:15])

    def __call__(
        self, mag: Vec3, temperature: Scalar | float, current: Scalar | float = 0.0
    ) -> Float[Array, "3"]:
        """The field m = (E + S)⁻¹ (m' − b − c I), T, of one sample of outputs m' (T) at one temperature (°C) beside a
        current I (A); `vmap` it over samples. Raises `ValueError` for other shapes and implausible units."""
        call = "calibration.mag(mag, temperature, current)"
        check_given(call, temperature=temperature, current=current)
        check_one(call, mag=mag)
        looks = self.triad.curve.basis.size > 1
        check_sample(call, temperature if looks else np.nan, field=("mag", mag))
        return compensate_mag(self.errors(temperature), mag, current)
