"""What a triad goes through in one sample: the counterpart of `Signal` where time has not come yet."""

from collections.abc import Callable, Mapping
from typing import Any

from jaxtyping import Bool, Float

from .._records import field, Module
from .._typing import AnyArray, Scalar, Vec3
from . import arrays as xp
from .signal import Signal


class Moment(Module):
    """Inputs and circumstances of one triad in one sample, with the extent of the data of a fitted effect."""

    triad: str = field(static=True)  # "accel" or "gyro"
    time: Scalar | float  # s since power-on
    step: Scalar | float  # s since the sample before
    first: Bool[AnyArray, ""]  # whether there was none before
    input: Vec3  # g (accelerometers) or rad/s (gyros): what an ideal triad reads
    force: Vec3  # g
    rate: Vec3  # rad/s
    temperature: Scalar | float  # °C, by the probe
    at_rest: Bool[AnyArray, ""]
    # The model's outputs at another temperature, m/s² or rad/s.
    at_temperature: Callable[[Scalar | float], Float[AnyArray, "3"]]
    # E + Γ at this temperature: by rows the elements' own axes; `None` where they are the case's
    axes: Float[AnyArray, "3 3"] | None = None
    degree: int = field(static=True, default=0)  # of the model's polynomials in temperature
    low: Scalar | float = 0.0  # °C, mapped to -1 by the model's polynomials
    high: Scalar | float = 1.0  # °C, mapped to +1
    coldest: Scalar | float = 0.0  # °C, of the data that the effect was fitted on
    warmest: Scalar | float = 1.0  # °C
    greatest_input: Scalar | float = 0.0  # g or rad/s
    duration: Scalar | float = 0.0  # s


Shape = Float[AnyArray, "channels columns"]


class Online(Module):
    """An effect sample by sample, with what it remembers.

    `begin(settings, temperature)` is the state in equilibrium at a temperature (°C); `follow(state, moment,
    settings)` gives the next state and the effect's `shape` in that sample, `(3, columns)` or `(1, columns)`.
    """

    begin: Callable[[Mapping[str, Any], AnyArray], Any] = field(static=True)
    follow: Callable[[Any, Moment, Mapping[str, Any]], tuple[Any, Shape]] = field(static=True)


def of_the_moment(rows: Callable[[Moment, Mapping[str, Any]], Shape]) -> Online:
    """The form of an effect that remembers nothing: `rows(moment, settings)` is its shape in that sample."""

    def begin(settings: Mapping[str, Any], temperature: AnyArray) -> tuple:
        del settings, temperature
        return ()

    def follow(state: tuple, moment: Moment, settings: Mapping[str, Any]) -> tuple[tuple, Shape]:
        return state, rows(moment, settings)

    return Online(begin, follow)


def without_memory(shape: Callable[..., Float[AnyArray, "time channels columns"]]) -> Online:
    """The form of an effect that depends on nothing but the sample's force, rate and temperature."""
    return of_the_moment(lambda moment, settings: shape(_rows(moment), **settings)[0])


def _rows(moment: Moment) -> Signal:
    """A signal of the sample and, for shapes that are scaled by it, a row of the greatest input."""
    given = xp.asarray(moment.input)
    greatest = xp.full(3, moment.greatest_input, given.dtype)
    twice = lambda x: xp.stack([xp.asarray(x), xp.asarray(x)])
    zero = xp.zeros(2, given.dtype)
    return Signal(
        triad=moment.triad, time=zero, input=xp.stack([given, greatest]), output=twice(given), since_power=zero,
        since_start=zero, since_move=zero, move=xp.zeros((2, 3), given.dtype), at_rest=twice(moment.at_rest),
        temperature=twice(moment.temperature), force=twice(moment.force), rate=twice(moment.rate),
        degree=moment.degree, low=moment.low, high=moment.high,
    )  # fmt: skip
