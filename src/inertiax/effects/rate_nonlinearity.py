"""Scale-factor nonlinearity of a gyro."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import BEYOND_EARTH, by_grade, Effect, fixed
from .form_units import Settings
from .signal import Signal


def shape(signal: Signal, *, power: int) -> Float[AnyArray, "time channels columns"]:
    """ω|ω| or ω³ with ω in rad/s."""
    w = xp.asarray(signal.input)
    return (w * xp.abs(w) ** (power - 1))[:, :, None]


def _unit(unit: str, triad: str, settings: Settings, column: int) -> str:
    """With the power of the form."""
    del triad, column
    return unit.replace("^n", f"^{settings['power']}")


EFFECT = Effect(
    name="rate_nonlinearity",
    title="scale-factor nonlinearity (IEEE 952, 1431)",
    equation="c w |w| or c w^3",
    units={"gyro": "rad/s/(rad/s)^n"},
    prior={"gyro": by_grade((1e-07, 5e-05), (1e-06, 0.0005), (1e-05, 0.005))},
    shape=shape,
    unit_of_form=_unit,
    in_numpy=True,
    variants=fixed(("quadratic", {"power": 2}), ("cubic", {"power": 3})),
    needs="three or more rates of each sign",
    driver="rate",
    least_rate=BEYOND_EARTH,
    sentence="The scale factor of {channels} depends on the rate.",
    separating="more rates of both signs, integer turns",
    instant=True,
    seen_in_means=True,
)
