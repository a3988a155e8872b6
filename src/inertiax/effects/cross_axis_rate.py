"""Dependence of a gyro on products with the rates about its other axes."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import BEYOND_EARTH, by_grade, Effect, Variant
from .form_units import per_input, Settings
from .signal import Signal


def shape(signal: Signal, *, terms: str) -> Float[AnyArray, "time channels columns"]:
    """Products of rates about the input axis i and the two others p, o, (rad/s)²; magnitudes |p|, |o| in rad/s."""
    w = xp.asarray(signal.input)
    rates = {"i": w, "p": xp.roll(w, -1, axis=1), "o": xp.roll(w, -2, axis=1)}
    made = [
        xp.abs(rates[k[1]]) if k[0] == "|" else rates[k[0]] * rates[k[1]] for k in terms.split()
    ]
    return xp.stack(made, axis=-1)


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Single products and the sets of them."""
    forms = ["ip", "io", "po", "pp", "oo", "pp oo", "|p|", "|o|", "ip io po"]
    return tuple(Variant(k, {"terms": k}) for k in forms)


def _unit(unit: str, triad: str, settings: Settings, column: int) -> str:
    """A product of two rates, or the magnitude of one."""
    term = str(settings["terms"]).split()[column]
    return per_input(triad) if term.startswith("|") else unit


EFFECT = Effect(
    name="cross_axis_rate",
    title="cross-axis rate sensitivity",
    equation="c w_j w_k",
    units={"gyro": "rad/s/(rad/s)^2"},
    prior={"gyro": by_grade((1e-07, 0.0001), (1e-06, 0.001), (1e-05, 0.01))},
    shape=shape,
    unit_of_form=_unit,
    in_numpy=True,
    variants=variants,
    needs="rates about two axes",
    driver="rate",
    least_rate=BEYOND_EARTH,
    sentence="The output of {channels} depends on the rates about the other axes, beyond misalignment.",
    separating="rates about skew axes",
    instant=True,
    seen_in_means=True,
)
