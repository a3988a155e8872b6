"""Errors of the table's axes: index error, wobble, non-orthogonality."""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect, inputs, Variant
from .signal import Signal


def shape(
    signal: Signal, *, axis: str, form: str, pole: int = 0
) -> Float[AnyArray, "time channels columns"]:
    """Rotation about the inner axis in first or second harmonics of its angle, or non-orthogonality of the two axes.

    The inner angle is told by the specific force across the inner axis. Where that axis stands upright it is not, and
    the axis is taken to stand at its zero, which lies on the first (`pole` 0) or second of the other two device axes.
    """
    f = xp.asarray(signal.force)
    u = inputs(signal)
    k = "xyz".index(axis)
    p, q = (k + 1) % 3, (k + 2) % 3
    across = xp.sqrt(xp.maximum(f[:, p] ** 2 + f[:, q] ** 2, 1e-4))
    c, s = f[:, p] / across, f[:, q] / across
    turned = _vector({p: -u[:, q], q: u[:, p]})
    if form != "skew":
        angles = {"index": [c, s], "second": [c**2 - s**2, 2.0 * c * s]}[form]
        return turned[:, :, None] * xp.stack(angles, axis=-1)[:, None, :]
    upright = across < 0.1
    c, s = xp.where(upright, 1.0 - pole, c), xp.where(upright, float(pole), s)
    # A turn about the level direction that stays with the outer axis. The inner axis carries its own rates along.
    along = _vector({p: c, q: s})
    given = u if signal.triad == "accel" else _vector({p: u[:, p], q: u[:, q]})
    return xp.cross(given, along)[:, :, None]


def _vector(components: dict[int, Float[AnyArray, " time"]]) -> Float[AnyArray, "time 3"]:
    """The given components, and zero for the third."""
    zero = xp.zeros_like(next(iter(components.values())))
    return xp.stack([components[k] if k in components else zero for k in range(3)], axis=-1)


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Each device axis as the inner axis."""
    found = [
        Variant(f"{form} about {axis}", {"axis": axis, "form": form})
        for form in ("index", "second")
        for axis in "xyz"
    ]
    for axis in "xyz":
        label = f"skew about {axis}"
        found.append(Variant(label, {"axis": axis, "form": "skew", "pole": 0}))
        f = np.asarray(signal.force)
        if np.any(np.abs(f[:, "xyz".index(axis)]) > 0.995):
            found.append(Variant(f"{label}, other zero", {"axis": axis, "form": "skew", "pole": 1}))
    return tuple(found)


EFFECT = Effect(
    name="table_axis_error",
    title="axis wobble, orthogonality and index error (IEEE 1554)",
    equation="d(phi) = a cos phi + b sin phi + ...",
    units={"accel": "rad", "gyro": "rad"},
    prior={
        "accel": by_grade((5e-06, 0.0002), (2e-05, 0.001), (0.0001, 0.005)),
        "gyro": by_grade((5e-06, 0.0002), (2e-05, 0.001), (0.0001, 0.005)),
    },
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="a reference, and many angles about each axis",
    driver="attitude",
    sentence="The table's axes have an error that repeats with the angle.",
    separating="remount the device by 90 and 180 degrees: the error stays with the table",
    requires=("force",),
    common=True,
    seen_in_means=True,
)
