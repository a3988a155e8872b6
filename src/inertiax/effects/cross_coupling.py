"""Cross-coupling coefficients Kip, Kio, Kpo."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect, fixed, MICRO_G
from .signal import Signal


def shape(signal: Signal, *, terms: str) -> Float[AnyArray, "time channels columns"]:
    """Products of the specific force along the input axis i and the two others p, o, g²."""
    f = xp.asarray(signal.input)
    p, o = xp.roll(f, -1, axis=1), xp.roll(f, -2, axis=1)
    products = {"ip": f * p, "io": f * o, "po": p * o}
    return xp.stack([products[k] for k in terms.split()], axis=-1)


EFFECT = Effect(
    name="cross_coupling",
    title="Kip, Kio, Kpo, cross-coupling coefficients (IEEE 1293)",
    equation="Kip f_i f_p + Kio f_i f_o + Kpo f_p f_o",
    units={"accel": "m/s^2/g^2"},
    prior={"accel": by_grade((1, 30), (10, 500), (50, 5000), unit=MICRO_G)},
    shape=shape,
    in_numpy=True,
    variants=fixed(
        ("ip", {"terms": "ip"}),
        ("io", {"terms": "io"}),
        ("po", {"terms": "po"}),
        ("ip io", {"terms": "ip io"}),
        ("all", {"terms": "ip io po"}),
    ),
    needs="positions with two axes loaded at once",
    driver="specific_force",
    sentence="The output of {channels} depends on products of the specific force along two axes.",
    separating="positions along body diagonals; remount by 90 degrees to tell it from the table",
    instant=True,
    seen_in_means=True,
)
