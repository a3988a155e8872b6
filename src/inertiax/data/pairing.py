"""One recording from the two triads' files, put onto one time base where each has stamps of its own."""

import numpy as np
from jaxtyping import Float, Int

from .._records import field, Module
from .._typing import Mask
from .formats.streams import onto
from .recording import Recording


_LONGEST_BRIDGE = (
    5.0  # usual steps of a triad; over a longer gap straight lines would make samples up
)


class Paired(Module):
    """A recording of both triads, and what was done to make it."""

    recording: Recording
    note: str | None = field(static=True)  # `None` where both files have the same stamps


def pair(accel: Recording, gyro: Recording, *, counted: bool = False) -> Paired:
    """One recording from the two triads' files.

    Where rows or stamps differ, the triad with fewer samples in the time that both cover is put onto the other's
    stamps by straight lines. Rows within a gap of more than five usual steps of that triad are left out.

    **Arguments:** `counted` says that the times are row numbers over a rate, so that rows must agree.

    Raises `ValueError` where the triads were not logged at the same time, or counted rows differ in number.
    """
    if counted and accel.num_samples != gyro.num_samples:
        raise ValueError(
            f"{_both(accel, gyro)}: {accel.num_samples} and {gyro.num_samples} rows; files of the two triads without "
            "stamps must have the same rows."
        )
    if _same_stamps(accel, gyro):
        return Paired(_joined(accel, gyro, accel, f"{accel.name} + {gyro.name}"), None)
    _require_overlap(accel, gyro)
    gyro_leads = _within(gyro, accel).sum() > _within(accel, gyro).sum()
    base, other = (gyro, accel) if gyro_leads else (accel, gyro)
    rows = np.asarray(_within(base, other) & ~_in_gaps(base.time, other.time))
    if not rows.any():
        raise ValueError(
            f"{_both(accel, gyro)}: no stamp of one triad lies between two samples of the other."
        )
    base = base[rows]
    moved = _onto(other, base.time)
    found = _joined(
        *((moved, base) if gyro_leads else (base, moved)), base, f"{accel.name} + {gyro.name}"
    )
    return Paired(
        found, found.name + _statement(base, other, "accelerometers" if gyro_leads else "gyros")
    )


def _both(accel: Recording, gyro: Recording) -> str:
    return f"'{accel.name}' and '{gyro.name}'"


def _same_stamps(accel: Recording, gyro: Recording) -> bool:
    """As many rows, with stamps within half a step of each other: one clock, rounded twice."""
    if accel.num_samples != gyro.num_samples:
        return False
    step = np.median(np.diff(accel.time)) if accel.num_samples > 1 else 1.0
    return bool(np.abs(accel.time - gyro.time).max() <= 0.5 * step)


def _require_overlap(accel: Recording, gyro: Recording) -> None:
    first, last = _span(accel, gyro)
    if last < first:
        a, g = accel.time, gyro.time
        raise ValueError(
            f"{_both(accel, gyro)}: the two triads were not logged at the same time ({a[0]:.3f} to {a[-1]:.3f} s and "
            f"{g[0]:.3f} to {g[-1]:.3f} s); files of one log are needed, with stamps of one clock and one unit."
        )


def _span(one: Recording, other: Recording) -> tuple[float, float]:
    return max(one.time[0], other.time[0]), min(one.time[-1], other.time[-1])


def _within(base: Recording, other: Recording) -> Mask:
    """Rows in the time that both cover."""
    first, last = _span(base, other)
    return (base.time >= first) & (base.time <= last)


def _in_gaps(time: Float[np.ndarray, " time"], other: Float[np.ndarray, " other"]) -> Mask:
    """Rows between two samples of the other triad that are too far apart for a straight line."""
    if len(other) < 2:
        return np.zeros(len(time), bool)
    steps = np.diff(other)
    after = np.clip(np.searchsorted(other, time, side="right") - 1, 0, len(steps) - 1)
    between = time > other[after]
    return between & (steps[after] > _LONGEST_BRIDGE * np.median(steps))


def _onto(other: Recording, time: Float[np.ndarray, " time"]) -> Recording:
    """A triad's columns at other stamps: numbers by straight lines, labels and slower sensors as they were last."""
    straight = lambda x: None if x is None else onto(time, other.time, x, other.name)
    held = np.clip(np.searchsorted(other.time, time, side="right") - 1, 0, None)
    last = lambda x: None if x is None else x[held]
    supply = straight(None if other.supply is None else other.supply[:, None])
    return Recording(
        time=time,
        accel=straight(other.accel),
        gyro=straight(other.gyro),
        temperature=straight(other.temperature),
        experiment=last(other.experiment),
        position=last(other.position),
        reference_accel=straight(other.reference_accel),
        reference_gyro=straight(other.reference_gyro),
        supply=None if supply is None else supply[:, 0],
        mag=last(other.mag),
        current=last(other.current),
        pressure=last(other.pressure),
        device=other.device,
        name=other.name,
    )


def _joined(accel: Recording, gyro: Recording, base: Recording, name: str) -> Recording:
    """Both triads; what only one of the files has besides is taken from it."""

    def either(column: str) -> Float[np.ndarray, " ..."] | Int[np.ndarray, " ..."] | None:
        own = getattr(accel, column)
        return getattr(gyro, column) if own is None else own

    return Recording(
        time=base.time,
        accel=accel.accel,
        gyro=gyro.gyro,
        temperature=either("temperature"),
        experiment=either("experiment"),
        position=either("position"),
        reference_accel=accel.reference_accel,
        reference_gyro=gyro.reference_gyro,
        supply=either("supply"),
        mag=either("mag"),
        current=either("current"),
        pressure=either("pressure"),
        device=accel.device or gyro.device,
        name=name,
    )


def _statement(base: Recording, other: Recording, moved: str) -> str:
    """What was interpolated, and how far from its own samples."""
    fixed = "gyros" if moved == "accelerometers" else "accelerometers"
    nearest = np.searchsorted(other.time, base.time).clip(1, max(other.num_samples - 1, 1))
    before, after = other.time[nearest - 1], other.time[np.minimum(nearest, other.num_samples - 1)]
    away = np.minimum(np.abs(base.time - before), np.abs(after - base.time))
    return (
        f": the triads have stamps of their own; the {moved} are put onto the {base.num_samples} stamps of "
        f"the {fixed} by straight lines, up to {1e3 * away.max():.3g} ms (median {1e3 * np.median(away):.3g} ms) "
        f"from their nearest own sample. A delay between the two streams is not in the stamps and is left as it is."
    )
