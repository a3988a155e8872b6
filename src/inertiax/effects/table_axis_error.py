"""Errors of the table's axes: index error, wobble, non-orthogonality."""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import by_grade, Effect, inputs, Variant
from .signal import Signal


OUTER = "index of the outer axis"
ONE_AXIS = 0.01  # of the squares of level rates along their main direction: what others may have


def shape(
    signal: Signal, *, axis: str, form: str, pole: int = 0, azimuth: Scalar | float = 0.0
) -> Float[AnyArray, "time channels columns"]:
    """Rotation about the inner axis in first or second harmonics of its angle, or non-orthogonality of the two axes.

    Axes that are not square turn what is outside of the inner one, i, about their common normal o × i. Where the
    room's axes are known, o is a level direction of the room, by its `azimuth` from the first of them, rad. Else the
    inner angle is told by the specific force across the inner axis. Where that axis stands upright it is not, and the
    axis is taken to stand at its zero, which lies on the first (`pole` 0) or second of the other two device axes.
    """
    f = xp.asarray(signal.force)
    u = inputs(signal)
    k = "xyz".index(axis)
    p, q = (k + 1) % 3, (k + 2) % 3
    # The inner axis carries its own rates along.
    given = u if signal.triad == "accel" else _vector({p: u[:, p], q: u[:, q]})
    if form in ("skew in the room", OUTER):
        room = xp.asarray(signal.room)
        outer = room[:, :, 0] * xp.cos(azimuth) + room[:, :, 1] * xp.sin(azimuth)
        if form == OUTER:
            return xp.cross(outer, u)[:, :, None]
        return xp.cross(given, _vector({p: outer[:, q], q: -outer[:, p]}))[:, :, None]
    across = xp.sqrt(xp.maximum(f[:, p] ** 2 + f[:, q] ** 2, 1e-4))
    c, s = f[:, p] / across, f[:, q] / across
    if form != "skew":
        turned = _vector({p: -u[:, q], q: u[:, p]})
        angles = {"index": [c, s], "second": [c**2 - s**2, 2.0 * c * s]}[form]
        return turned[:, :, None] * xp.stack(angles, axis=-1)[:, None, :]
    upright = across < 0.1
    c, s = xp.where(upright, 1.0 - pole, c), xp.where(upright, float(pole), s)
    # A turn about the level direction that stays with the outer axis.
    return xp.cross(given, _vector({p: c, q: s}))[:, :, None]


def _vector(components: dict[int, Float[AnyArray, " time"]]) -> Float[AnyArray, "time 3"]:
    """The given components, and zero for the third."""
    zero = xp.zeros_like(next(iter(components.values())))
    return xp.stack([components[k] if k in components else zero for k in range(3)], axis=-1)


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Each device axis as the inner axis; of accelerometers that all level turns across it turn about one axis of the
    room, an index error of that one, which is what a pier's tilt about it is."""
    found = [
        Variant(f"{form} about {axis}", {"axis": axis, "form": form})
        for form in ("index", "second")
        for axis in "xyz"
    ]
    for axis in "xyz":
        label = f"skew about {axis}"
        azimuth = _outer_azimuth(signal, "xyz".index(axis))
        if azimuth is not None:
            settings = {"axis": axis, "form": "skew in the room", "azimuth": azimuth}
            found.append(Variant(label, settings))
            if signal.triad == "accel" and not any(v.label == OUTER for v in found):
                found.append(Variant(OUTER, {**settings, "form": OUTER}))
            continue
        found.append(Variant(label, {"axis": axis, "form": "skew", "pole": 0}))
        f = np.asarray(signal.force)
        if np.any(np.abs(f[:, "xyz".index(axis)]) > 0.995):
            found.append(Variant(f"{label}, other zero", {"axis": axis, "form": "skew", "pole": 1}))
    return tuple(found)


def _outer_azimuth(signal: Signal, inner: int) -> float | None:
    """Direction of the level axis that all turns across the inner axis have, rad from the room's first axis; `None`
    where there is no such axis, or the room's are not known."""
    if signal.room is None or signal.rate is None or not signal.upright:
        return None
    across = np.array(signal.rate, float)
    across[:, inner] = 0.0
    level = np.einsum("tij,ti->tj", np.asarray(signal.room)[:, :, :2], across)
    spread, directions = np.linalg.eigh(level.T @ level)
    if not spread[0] < ONE_AXIS * spread[1]:
        return None
    return float(np.arctan2(directions[1, 1], directions[0, 1]))


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
