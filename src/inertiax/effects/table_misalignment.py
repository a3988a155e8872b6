"""Constant small rotation of the device on the table."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect, inputs
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """θ × input for unit rotations about the three device axes."""
    u = inputs(signal)
    x, y, z = u[:, 0], u[:, 1], u[:, 2]
    o = xp.zeros_like(x)
    return xp.stack(
        [xp.stack([o, -z, y], -1), xp.stack([z, o, -x], -1), xp.stack([-y, x, o], -1)], axis=1
    )


EFFECT = Effect(
    name="table_misalignment",
    title="misalignment of the device on the table (IEEE 1554)",
    equation="theta x f",
    units={"accel": "rad", "gyro": "rad"},
    prior={
        "accel": by_grade((5e-06, 0.001), (1e-05, 0.005), (0.0001, 0.02)),
        "gyro": by_grade((5e-06, 0.001), (1e-05, 0.005), (0.0001, 0.02)),
    },
    shape=shape,
    in_numpy=True,
    needs="a reference, and a model without misalignments of its own",
    driver="attitude",
    sentence="The device stands on the table with a small constant rotation.",
    separating="remount by 90 and 180 degrees",
    common=True,
    seen_in_means=True,
)
