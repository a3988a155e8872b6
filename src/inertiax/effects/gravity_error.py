"""Wrong reference value of gravity."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import any_grade, Effect
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """The specific force itself, m/s²."""
    return xp.asarray(signal.input)[:, :, None] * 9.80665


EFFECT = Effect(
    name="gravity_error",
    title="error of the reference gravity",
    equation="(g_true / g_assumed - 1) f",
    units={"accel": "1"},
    prior={"accel": any_grade(1e-07, 0.003)},
    shape=shape,
    in_numpy=True,
    needs="a device whose scale factors are known otherwise",
    driver="specific_force",
    sentence="The assumed gravity is wrong.",
    separating="a gravity reference; the same scale change on all three axes points to it",
    common=True,
    seen_in_means=True,
)
