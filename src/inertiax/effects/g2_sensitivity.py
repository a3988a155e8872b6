"""Anisoelastic sensitivity of a gyro: products of specific force."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, DEG_PER_HOUR, Effect, Variant
from .signal import Signal


PAIRS = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}


def shape(signal: Signal, *, terms: str) -> Float[AnyArray, "time channels columns"]:
    """Products of the specific force along two device axes, g²."""
    f = xp.asarray(signal.force)
    return xp.stack([f[:, i] * f[:, j] for i, j in (PAIRS[k] for k in terms.split())], axis=-1)[
        :, None, :
    ]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Single products, the squares, the mixed ones, and all that the sum rule leaves."""
    forms = [*PAIRS, "xx yy", "xy yz xz", "xx yy xy yz xz"]
    return tuple(Variant(k, {"terms": k}) for k in forms)


EFFECT = Effect(
    name="g2_sensitivity",
    title="g2-sensitivity, anisoelasticity (IEEE 517)",
    equation="f^T A f",
    units={"gyro": "rad/s/g^2"},
    prior={"gyro": by_grade((0.001, 0.1), (0.05, 5), (1, 500), unit=DEG_PER_HOUR)},
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="rests in positions with two axes loaded at once",
    driver="specific_force",
    sentence="The output of {channels} depends on products of specific force (anisoelasticity).",
    separating="centrifuge or vibration",
    requires=("force",),
    instant=True,
    seen_in_means=True,
)
