"""What a sensor triad goes through along time: everything a physical effect may depend on.

A `Signal` is sampled like the recording. Fields that a campaign does not tell are `None`, and an
effect that needs one of them is not testable there.
"""

from collections.abc import Callable

from jaxtyping import Float, Shaped

from .._records import field, Module
from .._typing import AnyArray, Scalar


class Signal(Module):
    """Inputs, outputs and circumstances of one triad, along time, in the device's frame."""

    triad: str = field(static=True)  # "accel" or "gyro"
    time: Float[AnyArray, " time"]  # s since the campaign began
    # g (accelerometers) or rad/s (gyros): what an ideal triad reads
    input: Float[AnyArray, "time 3"]
    output: Float[AnyArray, "time 3"]  # m/s² or rad/s: what the triad puts out; effects add to it
    since_power: Float[AnyArray, " time"]  # s since the power came on
    since_start: Float[AnyArray, " time"]  # s since the first power-on
    since_move: Float[AnyArray, " time"]  # s since the last re-positioning
    move: Float[AnyArray, "time 3"]  # change of `input` by the last re-positioning
    at_rest: Shaped[AnyArray, " time"]  # true or, at block means, 1
    temperature: Float[AnyArray, " time"] | None = None  # °C, by the probe
    temperature_rate: Float[AnyArray, " time"] | None = None  # °C/s
    force: Float[AnyArray, "time 3"] | None = None  # g
    rate: Float[AnyArray, "time 3"] | None = None  # rad/s
    # rad/s², where it is not that of `rate` from row to row: a reference may jump at the ends of a plateau
    rate_change: Float[AnyArray, "time 3"] | None = None
    room: Float[AnyArray, "time 3 3"] | None = None  # columns: the room's axes seen by the device
    upright: bool = field(static=True, default=False)  # whether the last of those axes is up
    oriented: bool = field(static=True, default=False)  # whether they are north, west and up
    vibration: Float[AnyArray, " time"] | None = (
        None  # g², mean square of the specific force's scatter
    )
    resolution: Float[AnyArray, "3"] | None = None  # least step of the outputs, m/s² or rad/s
    scatter: Float[AnyArray, "3"] | None = None  # 1 sigma of one sample
    supply: Float[AnyArray, " time"] | None = None  # V
    expected: Float[AnyArray, "time 3"] | None = None  # m/s² or rad/s: outputs by the fitted model
    # °C, since the last pause: by how much the elements were then warmer than a recorded past has them
    ahead: Float[AnyArray, " time"] | None = None
    # s since a power-on or the end of a pause in which nobody recorded the temperature; `None`: as `since_power`
    since_pause: Float[AnyArray, " time"] | None = None
    # s since the first row, or since the end of a pause after which elements begin in equilibrium with the probe, for
    # nobody recorded how it came to its temperature; `None`: since the first row
    since_anew: Float[AnyArray, " time"] | None = None
    at_temperature: Callable[[Float[AnyArray, " time"]], Float[AnyArray, "time 3"]] | None = None
    # E + Γ at a temperature in the middle: by rows the elements' own axes; `None` where they are the case's
    axes: Float[AnyArray, "3 3"] | None = None
    degree: int = field(static=True, default=0)  # of the model's polynomials in temperature
    low: Scalar | float = 0.0  # °C, mapped to -1 by the model's polynomials
    high: Scalar | float = 1.0  # °C, mapped to +1

    @property
    def rows_for(self) -> Float[AnyArray, " time"]:
        """Seconds since the temperature is recorded without a pause."""
        return self.since_power if self.since_pause is None else self.since_pause

    @property
    def duration(self) -> float:
        """Length of the campaign, s."""
        return float(self.time[-1] - self.time[0])
