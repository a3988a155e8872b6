"""Sensitivity of a gyro to specific force: matrix D."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import DEG_PER_HOUR, Effect, fixed
from .signal import Signal


def shape(signal: Signal, *, axes: str) -> Float[AnyArray, "time channels columns"]:
    """Specific force along the device's axes, g."""
    f = xp.asarray(signal.force)
    return xp.stack([f[:, "xyz".index(k)] for k in axes], axis=-1)[:, None, :]


EFFECT = Effect(
    name="g_sensitivity",
    title="g-sensitivity, mass unbalance (IEEE 517, 1431)",
    equation="D f",
    units={"gyro": "rad/s/g"},
    prior={
        "gyro": {
            "navigation": (0.001 * DEG_PER_HOUR, 10 * DEG_PER_HOUR),
            "tactical": (0.5 * DEG_PER_HOUR, 30 * DEG_PER_HOUR),
            "consumer": (10 * DEG_PER_HOUR, 1000 * DEG_PER_HOUR),
        }
    },
    shape=shape,
    in_numpy=True,
    variants=fixed(
        ("row", {"axes": "xyz"}), ("x", {"axes": "x"}), ("y", {"axes": "y"}), ("z", {"axes": "z"})
    ),
    needs="rests in positions that differ in specific force",
    driver="specific_force",
    sentence="The output of {channels} depends on specific force (matrix D).",
    separating="turn the heading in the same position: specific force stays, Earth rate and magnetic field turn",
    requires=("force",),
    instant=True,
    seen_in_means=True,
)
