"""Vibration rectification: bias in proportion to the mean square of vibration."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect, MICRO_G
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """Mean square of the specific force about its mean, g²."""
    return xp.asarray(signal.vibration)[:, None, None]


EFFECT = Effect(
    name="vibration_rectification",
    title="vibration rectification (VRE)",
    equation="K_v a_rms^2",
    units={"accel": "m/s^2/g^2"},
    prior={"accel": by_grade((10, 60), (20, 500), (20, 2000), unit=MICRO_G)},
    shape=shape,
    in_numpy=True,
    needs="vibration that differs between rests",
    driver="vibration",
    sentence="The bias of {channels} shifts with the vibration level.",
    separating="shaker or table drive on and off; log the vibration",
    requires=("vibration",),
    slow=True,
    wants_rests=True,
)
