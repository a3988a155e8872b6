"""Tilt of the pier or foundation, out of level from the start or slowly changing."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect, inputs, Variant
from .signal import Signal


DAY = 86400.0  # s
LONG = 2e4  # s; a good part of a day


def shape(signal: Signal, *, course: str) -> Float[AnyArray, "time channels columns"]:
    """Small rotations about the room's axes: constant, growing linearly, or in sine and cosine of a day's period.

    The vertical axis is left out where it is known and gravity is the input, which it does not turn.
    """
    u = inputs(signal)
    time = xp.asarray(signal.time)
    if course == "constant":
        courses = [xp.ones_like(time)]
    elif course == "linear":
        courses = [time / (time[-1] - time[0])]
    else:
        phase = 2.0 * xp.pi * time / DAY
        courses = [xp.sin(phase), xp.cos(phase)]
    room = xp.asarray(signal.room)
    axes = range(2) if signal.upright and signal.triad == "accel" else range(3)
    turned = [xp.cross(room[:, :, k], u) for k in axes]
    return xp.stack([c[:, None] * t for t in turned for c in courses], axis=-1)


def variants(signal: Signal) -> tuple[Variant, ...]:
    """A linear tilt; where the vertical is known, also one that stays, and one with a day's period.

    Of a few hours the latter shows a tilt that was there from the start and grows.
    """
    courses = ["linear"]
    if signal.upright:
        courses = ["24 h", "linear", "constant"]
    elif signal.duration > LONG:
        courses = ["24 h", "linear"]
    return tuple(Variant(c, {"course": c}) for c in courses)


EFFECT = Effect(
    name="pier_tilt",
    title="pier tilt (IEEE 1554)",
    equation="theta(t) x f, theta fixed to the room",
    units={"accel": "rad", "gyro": "rad"},
    prior={
        "accel": by_grade((1e-06, 2e-05), (1e-06, 5e-05), (1e-06, 0.0001)),
        "gyro": by_grade((1e-06, 2e-05), (1e-06, 5e-05), (1e-06, 0.0001)),
    },
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="positions turned about the vertical in a known way, or hours of recording",
    driver="time",
    sentence="The pier stands out of level or tilts slowly.",
    separating="a level or tiltmeter on the pier; repeat at another hour",
    requires=("room",),
    common=True,
)
