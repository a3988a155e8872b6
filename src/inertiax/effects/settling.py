"""Settling: a transient after each re-positioning."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._typing import Scalar
from .effect import DEG_PER_HOUR, Effect, MICRO_G, Variant
from .signal import Signal


def shape(
    signal: Signal, *, time_constant: Scalar | float, size: str
) -> Float[Array, "time channels columns"]:
    """exp(-t_s / tau) after each move, of equal size or in proportion to the change of the input along the axis."""
    decay = jnp.exp(-jnp.asarray(signal.since_move) / time_constant)[:, None, None]
    if size == "equal":
        return decay
    move = jnp.asarray(signal.move)
    if size == "signed":
        return decay * move[:, :, None]
    return decay * jnp.linalg.norm(move, axis=1)[:, None, None]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Time constants from 0.7 s to the length of the longest rest; none where the device never moves."""
    if not np.any(np.diff(np.asarray(signal.since_move)) < 0.0):
        return ()
    longest = float(np.max(np.asarray(signal.since_move)))
    grid = np.geomspace(0.7, max(2.0, min(600.0, longest)), 12)
    if not np.any(np.asarray(signal.move)):
        sizes = ("equal",)
    else:
        sizes = ("equal", "signed", "distance")
    return tuple(
        Variant(f"time_constant={v:.4g}, {s}", {"time_constant": float(v), "size": s})
        for s in sizes
        for v in grid
    )


EFFECT = Effect(
    name="settling",
    title="settling after re-positioning (creep, eddy currents, fluid)",
    equation="c df exp(-t_s / tau), t_s since the move",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": {
            "navigation": (1 * MICRO_G, 50 * MICRO_G),
            "tactical": (5 * MICRO_G, 200 * MICRO_G),
            "consumer": (10 * MICRO_G, 500 * MICRO_G),
        },
        "gyro": {
            "navigation": (0.001 * DEG_PER_HOUR, 0.1 * DEG_PER_HOUR),
            "tactical": (1 * DEG_PER_HOUR, 20 * DEG_PER_HOUR),
            "consumer": (5 * DEG_PER_HOUR, 100 * DEG_PER_HOUR),
        },
    },
    shape=shape,
    variants=variants,
    needs="several blocks within each rest",
    driver="time_since_move",
    sentence="The output of {channels} settles after each re-positioning.",
    separating="longer rests, and the same position reached from two sides",
    nuisance="time_constant",
    once=True,
)
