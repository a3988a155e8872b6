"""The accelerometers' unit, by what gravity reads at rest."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .column_words import FORCE_UNITS, said
from .converters import ACCEL_SCALES, G, middle, nearest, PER_G_OF_HUNDREDTHS, rounded, whole
from .resting import poses, Resting
from .stated_scales import stated_force_scale


_NEAR = 0.2  # of gravity: raw biases and scales of consumer sensors stay within
# What 1 g reads; cm/s^2 and mg are too alike to be told apart by that.
_UNITS = {"m/s^2": G, "g": 1.0, "mg": 1000.0, "mm/s^2": 1000.0 * G}
_SAID = {**_UNITS, "cm/s^2": 100.0 * G}
NO_RESTS = "no rests were found"
OFF_GRAVITY = "where the accelerometers alone are quiet it is"
_FAR = (
    2.0  # by which a bias or a scale may be off where the file, or its numbers, leave no other unit
)
_ONE_POSE = 1.12  # of gravity, or gravity of it: 80 mg and 3 %, by which no sheet's part is off
_BIAS = 0.1  # g: what reads 1 g in one pose may be off by so much, and a part of 1024 counts be one of 981
_SCALE = 0.015  # relative: what a sphere through poses leaves, an error of scale
_POSES_OF_A_SPHERE = 6  # four unknowns, and something to spare
_TURNING = 0.9  # of the samples' norm: the means of a device that turned by 50° or more are shorter
_BLOCK = 20  # rows
_FEWEST_BLOCKS = 250
_SHAKEN = 0.05  # of the norm
_CALM = 0.3  # of the median norm: less is left where gravity was taken out
_OFFSET_SHOWS = 0.25  # of the radius: no bias is as large, so it is an offset of the converter


class TriadUnit(NamedTuple):
    """How a triad's outputs become SI: (output − offset) · factor."""

    unit: str
    scale: float | None  # with unit "count"
    scale_unit: str | None
    offset: float | tuple[float, float, float] | None
    factor: float  # m/s² or rad/s per output
    why: str
    certain: bool


def directions(
    values: Float[np.ndarray, "time 3"], means: Float[np.ndarray, "rest 3"]
) -> Float[np.ndarray, "rest 3"]:
    """Unit vectors of the specific force in each rest, biases taken away where the poses tell them.

    **Arguments:** `values` are all outputs, `means` those at rest.
    """
    up = means - sphere(means, middle(values)).center
    return up / np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-12)


class Sphere(NamedTuple):
    """What the accelerometers' means at rest lie on, in the log's units."""

    center: Float[np.ndarray, "3"]
    radius: float  # 1 g
    fitted: bool  # else the centre is assumed


def accel_unit(values: Float[np.ndarray, "time 3"], rests: Resting, hint: str = "") -> TriadUnit:
    """Unit, scale and offset of accelerometers.

    The means at rest lie on a sphere of 1 g. With six poses or more its centre is fitted; with fewer it is zero, or the
    middle of an unsigned converter's range. Where the device turned on, however slowly, means over its turns are
    shorter than 1 g, and single samples tell more.

    **Arguments:** `hint` is what the file says in words of the columns.
    """
    assert rests.accel is not None
    center, radius, fitted = sphere(rests.accel, middle(values))
    what = f"|a| is {radius:.4g} at rest ({rests.num_rests} rest{'s' * (rests.num_rests > 1)})"
    if rests.slowly:
        what = f"|a| is {radius:.4g} in {rests.num_rests} stretches in which it hardly turns"
    if rests.turned:
        what = f"|a| is {radius:.4g} on average; {NO_RESTS}"
    samples = float(np.median(np.linalg.norm(values - center, axis=1)))
    if not fitted and radius < _TURNING * samples:
        radius = samples
        what = f"|a| is {radius:.4g} in half of the samples; {NO_RESTS}"
    calm = calm_norm(values)
    if not fitted and unit_of(calm) is not None and unit_of(radius) is None:
        what = f"|a| is {calm:.4g} in the rows that move least"
        what += f"; {NO_RESTS}" if rests.turned else f"; {OFF_GRAVITY} {radius:.4g}"
        radius = calm
    unit = None if whole(values) else unit_of(radius)
    if unit is not None and not rests.turned and poses(directions(values, rests.accel)) == 1:
        off = radius / _UNITS[unit]
        if max(off, 1.0 / off) > _ONE_POSE:
            what += f", {off:.3g} of gravity: a bias, a scale or the unit is off, and one pose cannot tell which"
    offset = _offset(center, radius, fitted)
    stated = stated_force_scale(hint)
    if stated is not None and abs(radius * stated.factor / G - 1.0) < _NEAR:
        why = f"{stated.text}, as the file says; {what}"
        return TriadUnit("count", stated.scale, stated.scale_unit, offset, stated.factor, why, True)
    told = _written(radius, said(FORCE_UNITS, hint), what)
    if told is not None:
        return told
    by_unit = nearest(radius, (1000.0, 1000.0 * G, PER_G_OF_HUNDREDTHS), 0.015)
    if not whole(values) or by_unit not in (None, PER_G_OF_HUNDREDTHS):
        unit = unit_of(radius)
        # Means of poses tell 1 g to a few per cent, so that counts that are not whole are nearer to their data sheet.
        if fitted and unit is not None and abs(radius / _UNITS[unit] - 1.0) > 2.0 * _SCALE:
            unit = None if nearest(radius, ACCEL_SCALES, _SCALE) else unit
        if offset is None and unit is not None:
            return TriadUnit(unit, None, None, None, G / _UNITS[unit], what, True)
    scale = nearest(radius, ACCEL_SCALES, _NEAR) if offset is None else None
    if scale is not None:
        text = f"{what}: counts, {scale:g} per g by the usual data sheets"
        counts = whole(values) or fitted or len(rests.accel) == len(values)
        text += "" if counts else ", but they are not whole"
        others = _as_near(scale, radius, _SCALE if fitted else _BIAS)
        text += f"; but for a bias or an error of scale {' or '.join(others)}" if others else ""
        certain = counts and not others
        return TriadUnit("count", scale, "count per g", offset, G / scale, text, certain)
    if not fitted and offset is None and not whole(values):
        likely = next((u for u in ("g", "m/s^2") if 1 / _FAR < radius / _UNITS[u] < _FAR), None)
        if likely is not None:
            return _in(likely, f"likely {likely}, for these are no counts; {what}", radius)
    scale = rounded(radius)
    text = f"{what}: counts of a converter that is not known here; the scale is measured"
    return TriadUnit("count", scale, "count per g", offset, G / scale, text, fitted)


def _as_near(scale: float, radius: float, limit: float) -> list[str]:
    """What else gravity may read as `radius` within a relative limit: other data sheets' counts, and mg."""
    near = [s for s in ACCEL_SCALES if s != scale and abs(radius / s - 1.0) < limit]
    mg = ["mg"] if abs(radius / _UNITS["mg"] - 1.0) < limit else []
    return [f"{s:g} per g" for s in near] + mg


def _written(radius: float, unit: str | None, what: str) -> TriadUnit | None:
    """The unit that the file writes, where gravity reads about that; physics has it otherwise."""
    if unit is None or not 1 / _FAR < radius / _SAID[unit] < _FAR:
        return None
    return _in(unit, f"as the file says; {what}", radius)


def _in(unit: str, why: str, radius: float) -> TriadUnit:
    """A unit in which gravity may read amiss: by a bias in the axis that points up, or by a scale."""
    near = abs(radius / _SAID[unit] - 1.0) < _NEAR
    text = (
        why if near else f"{why}, so a bias or a scale is far off: poses of other axes tell which"
    )
    return TriadUnit(unit, None, None, None, G / _SAID[unit], text, near)


def lacks_gravity(values: Float[np.ndarray, "time 3"]) -> bool:
    """Whether the outputs are no counts and their norm goes from little to much: an acceleration without gravity.

    One with gravity that is shaken as much reads 1 g in the moments in which it moves least.
    """
    low, size, high = np.quantile(np.linalg.norm(values, axis=1), [0.05, 0.5, 0.95])
    shaken = not whole(values) and bool(high - low > size)
    calm = calm_norm(values)
    return bool(shaken and (calm < _CALM * size or unit_of(calm) is None))


def shaken(values: Float[np.ndarray, "time 3"]) -> bool:
    """Whether the norm's means over 20 rows scatter as those of a device in a hand or a bag, by 5 % and more."""
    count = len(values) // _BLOCK
    if count < _FEWEST_BLOCKS // 5:
        return False
    norm = np.linalg.norm(values[: count * _BLOCK], axis=1).reshape(count, _BLOCK).mean(axis=1)
    return bool(norm.std() > _SHAKEN * np.median(norm))


def calm_norm(values: Float[np.ndarray, "time 3"]) -> float:
    """Median norm in the fiftieth of the blocks of rows that scatter least; not a number in a short log."""
    count = len(values) // _BLOCK
    if count < _FEWEST_BLOCKS:
        return float("nan")
    block = values[: count * _BLOCK].reshape(count, _BLOCK, 3)
    calm = np.argsort(block.std(axis=1).sum(axis=1))[: count // 50]
    return float(np.median(np.linalg.norm(block[calm].mean(axis=1), axis=1)))


def unit_of(radius: float, near: float = _NEAR) -> str | None:
    """The unit in which gravity reads `radius`, within the relative `near`."""
    return next((u for u, reads in _UNITS.items() if abs(radius / reads - 1.0) < near), None)


def sphere(means: Float[np.ndarray, "rest 3"], offset: float) -> Sphere:
    """The sphere through the means; about `offset` where fewer than six poses tell no centre."""
    start = means - offset
    norm = np.linalg.norm(start, axis=1)
    radius = float(np.median(norm))
    if radius > 0 and poses(start / np.maximum(norm, 1e-12)[:, None]) >= _POSES_OF_A_SPHERE:
        # |m|² = 2 m·c + (r² − |c|²), linear in the unknowns.
        design = np.column_stack([2 * start / radius, np.ones(len(start))])
        found, _, _, singular = np.linalg.lstsq(design, (norm / radius) ** 2, rcond=None)
        square = float(found[3] + found[:3] @ found[:3])
        if singular[-1] > 0.05 * singular[0] and 0.25 < square < 4.0:
            return Sphere(offset + radius * found[:3], radius * float(np.sqrt(square)), True)
    return Sphere(np.full(3, offset), radius, False)


def _offset(
    center: Float[np.ndarray, "3"], radius: float, fitted: bool
) -> float | tuple[float, float, float] | None:
    """The converter's offset: none, half of its range, or each axis' own."""
    if np.abs(center).max() < _OFFSET_SHOWS * radius:
        return None
    half = 2.0 ** np.round(np.log2(np.abs(center).max()))
    if not fitted or np.all(np.abs(center - half) < _OFFSET_SHOWS * radius):
        return float(half)
    return (rounded(center[0]), rounded(center[1]), rounded(center[2]))
