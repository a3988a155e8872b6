"""Errors of the table's axes: index error, wobble, non-orthogonality."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .effect import Effect, inputs, Variant
from .signal import Signal


def shape(signal: Signal, *, axis: str, form: str) -> Float[Array, "time channels columns"]:
    """Rotation about the inner axis in first or second harmonics of its angle, or non-orthogonality of the two axes."""
    f = jnp.asarray(signal.force)
    u = inputs(signal)
    k = "xyz".index(axis)
    p, q = (k + 1) % 3, (k + 2) % 3
    across = jnp.sqrt(jnp.maximum(f[:, p] ** 2 + f[:, q] ** 2, 1e-4))
    c, s = f[:, p] / across, f[:, q] / across
    angles = {
        "index": [c, s],
        "second": [c**2 - s**2, 2.0 * c * s],
        "skew": [jnp.where(across > 0.1, f[:, k] / across, 0.0)],
    }[form]
    turned = jnp.zeros_like(u).at[:, p].set(-u[:, q]).at[:, q].set(u[:, p])
    return turned[:, :, None] * jnp.stack(angles, axis=-1)[:, None, :]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Each device axis as the inner axis."""
    return tuple(
        Variant(f"{form} about {axis}", {"axis": axis, "form": form})
        for form in ("index", "second", "skew")
        for axis in "xyz"
    )


EFFECT = Effect(
    name="table_axis_error",
    title="axis wobble, orthogonality and index error (IEEE 1554)",
    equation="d(phi) = a cos phi + b sin phi + ...",
    units={"accel": "rad", "gyro": "rad"},
    prior={
        "accel": {
            "navigation": (5e-06, 0.0002),
            "tactical": (2e-05, 0.001),
            "consumer": (0.0001, 0.005),
        },
        "gyro": {
            "navigation": (5e-06, 0.0002),
            "tactical": (2e-05, 0.001),
            "consumer": (0.0001, 0.005),
        },
    },
    shape=shape,
    variants=variants,
    needs="a reference, and many angles about each axis",
    driver="attitude",
    sentence="The table's axes have an error that repeats with the angle.",
    separating="remount the device by 90 and 180 degrees: the error stays with the table",
    requires=("force",),
    common=True,
)
