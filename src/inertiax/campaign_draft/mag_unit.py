"""The unit of magnetometers: turned, they move by 20 to 70 µT."""

import re
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import MAG_UNITS
from ..data.plausible_units import field_unit_guess, GREATEST_EARTH_FIELD, LEAST_EARTH_FIELD
from .accel_unit import sphere
from .companions import Companion
from .converters import rounded, whole


_UNITS = ("uT", "gauss", "mgauss", "nT", "T")
_WORDS = (
    ("mgauss", re.compile(r"milli_?gauss|mgauss|[\[(_ .]mg\b")),
    ("gauss", re.compile(r"gauss|[\[(_ .]gs?\b")),
    ("nT", re.compile(r"nano_?tesla|[\[(_ .]nt\b")),
    ("uT", re.compile(r"micro_?tesla|[\[(_ .][uµμ]t\b")),
)
_IRON = (
    5.0  # times the Earth's field, or a part of it: what magnets of the device itself make of it
)
_LEAST_ROWS = 10
_TURNED = 0.5  # of the magnitude without its middle, from 5 to 95 %: a device that was turned all ways is steadier
_ENOUGH = 500  # rows that tell a sphere
_ALL_WAYS = (
    0.05  # least share of the directions' squares along any axis; a third each is all ways alike
)
_USUAL_FIELD = 50.0  # µT, within a factor of 2.5 of the field of any place
_NEAR = 1.5  # by how much soft iron changes what the outputs move by


class FieldUnit(NamedTuple):
    """A unit of magnetometers, and what it rests on."""

    unit: str
    why: str
    certain: bool
    scale: float | None = None  # counts per µT, with unit "count"


def field_unit(
    outputs: Float[np.ndarray, "time 3"],
    names: tuple[str, str, str],
    hint: str,
    companion: Companion | None = None,
) -> FieldUnit | None:
    """The unit of magnetometers: by what they move by, else as the file says.

    Where neither tells it, canonical columns get the likely one, for without a line of their own they would be read in
    tesla; others get none.

    **Arguments:** `hint` is what the file says in words of the columns; `companion` is the scale of a chip whose
    accelerometers gravity tells.
    """
    told = mag_unit(outputs)
    counts = None if companion is None else _of_chip(outputs, companion)
    if counts is not None and said_field_unit(hint, outputs) is None:
        return counts
    if told is not None:
        why = f"turned, the outputs move by the Earth's field in {told}, and by no other unit's"
        return FieldUnit(told, why, True)
    told = said_field_unit(hint, outputs)
    if told is not None:
        return FieldUnit(told, "as the file says", True)
    if names != ("mag_x", "mag_y", "mag_z"):
        return _counts(outputs) if whole(outputs[np.isfinite(outputs).all(axis=1)]) else None
    likely = field_unit_guess(float(np.nanmedian(np.linalg.norm(outputs, axis=1))))
    why = "the device was not turned in all directions; likely by the size of a field"
    return FieldUnit(likely, why, False)


def _of_chip(outputs: Float[np.ndarray, "time 3"], companion: Companion) -> FieldUnit | None:
    """The scale of a chip, where whole numbers read a field of the Earth's size in it; other units may do so, too."""
    read = outputs[np.isfinite(outputs).all(axis=1)]
    if not len(read) or not whole(read):
        return None
    size = float(np.median(np.linalg.norm(read, axis=1))) / companion.scale
    if not in_earths_field(size, "uT"):
        return None
    return FieldUnit("count", f"{companion.text}, {size:.3g} uT", False, companion.scale)


def _counts(outputs: Float[np.ndarray, "time 3"]) -> FieldUnit | None:
    """Counts of a converter that is not known, by what they move by; `None` where the device was hardly turned."""
    read = outputs[np.isfinite(outputs).all(axis=1)]
    if len(read) < _LEAST_ROWS:
        return None
    about = read - _center(read)
    radius = float(np.median(np.linalg.norm(about, axis=1)))
    if not radius > 0.0 or not turned_all_ways(about):
        return None
    why = (
        f"counts that move by {radius:.4g}; the scale makes {_USUAL_FIELD:g} uT of that: hard iron in counts and the "
        "axes' ratio do not depend on it"
    )
    return FieldUnit("count", why, False, rounded(radius / _USUAL_FIELD))


def mag_unit(outputs: Float[np.ndarray, "time 3"]) -> str | None:
    """The unit in which the outputs move by the Earth's field about their middle; `None` where the device was hardly
    turned, or no unit or more than one fits."""
    read = outputs[np.isfinite(outputs).all(axis=1)]
    if len(read) < _LEAST_ROWS:
        return None
    about = np.linalg.norm(read - _center(read), axis=1)
    low, size, high = np.quantile(about, [0.05, 0.5, 0.95])
    if not size > 0.0 or (high - low) / size > _TURNED:
        return None
    fits = [
        u
        for u in _UNITS
        if LEAST_EARTH_FIELD / _NEAR < size * MAG_UNITS[u] < _NEAR * GREATEST_EARTH_FIELD
    ]
    return fits[0] if len(fits) == 1 else None


def in_earths_field(size: float, unit: str) -> bool:
    """Whether a magnitude is that of the Earth's field somewhere, without any iron of the device."""
    return LEAST_EARTH_FIELD < size * MAG_UNITS[unit] < GREATEST_EARTH_FIELD


def said_field_unit(hint: str, outputs: Float[np.ndarray, "time 3"]) -> str | None:
    """The unit that words of a file name, where the outputs read a field of the Earth's size in it; else `None`."""
    unit = next((u for u, words in _WORDS if words.search(hint)), None)
    size = float(np.nanmedian(np.linalg.norm(outputs, axis=1)))
    if unit is None or not _IRON > size * MAG_UNITS[unit] / GREATEST_EARTH_FIELD:
        return None
    return unit if size * MAG_UNITS[unit] > LEAST_EARTH_FIELD / _IRON else None


def turned_all_ways(about: Float[np.ndarray, "row 3"]) -> bool:
    """Whether outputs point in all directions from zero in the course of a log."""
    up = about / np.maximum(np.linalg.norm(about, axis=1), 1e-12)[:, None]
    return bool(np.linalg.eigvalsh(up.T @ up / len(up))[0] >= _ALL_WAYS)


def about_center(read: Float[np.ndarray, "row 3"]) -> Float[np.ndarray, "row 3"]:
    """The outputs without what stays with the device."""
    return read - _center(read)


def _center(read: Float[np.ndarray, "row 3"]) -> Float[np.ndarray, "3"]:
    """Of the sphere that the outputs lie on; their middle where few orientations tell no sphere."""
    middle = 0.5 * (read.min(axis=0) + read.max(axis=0))
    return middle + sphere(read[:: -(-len(read) // _ENOUGH)] - middle, 0.0).center
