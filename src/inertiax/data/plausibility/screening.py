"""What in a recording looks wrong before any fit: units, saturation, gaps, contradictions.

A wrong unit is an error, since every later number would be wrong; what a user may have meant to
record (a gap, a saturated axis) is a note.
"""

import numpy as np
from jaxtyping import Float

from ..._typing import Mask
from ..formats.columns import ACCEL_UNITS, AXES, GYRO_UNITS
from ..recording import ModelChoice, Recording
from .pose_rows import refuse_pose_rows


def screen(recordings: tuple[Recording, ...], gravity: float) -> tuple[str, ...]:
    """Notes on what looks odd. Raises `ValueError` where a unit must be wrong.

    **Arguments:** `gravity` in m/s².
    """
    notes: list[str] = []
    for recording in recordings:
        _check_accel_unit(recording, gravity)
        _check_gyro_unit(recording)
        refuse_pose_rows(recording)
        notes += _clock(recording)
        notes += _saturated(recording, "accel", "m/s²")
        notes += _saturated(recording, "gyro", "rad/s")
        notes += _stuck(recording)
    return (*notes, *_overlaps(recordings))


def _at_rest(recording: Recording) -> Mask:
    """Rows said to be at rest; all rows where the recording does not say (mostly rest, too)."""
    if recording.position is not None and np.any(recording.position >= 0):
        return recording.position >= 0
    if recording.reference_gyro is not None:
        return np.linalg.norm(recording.reference_gyro, axis=1) < 0.01
    return np.ones(recording.num_samples, bool)


def _likely(ratio: float, units: dict[str, float], columns: str) -> str:
    """The unit that would bring a norm `ratio` times too large back to what it should be."""
    for unit, si in units.items():
        if si != 1.0 and 1 / 3 < ratio * si < 3:
            return f'likely unit "{unit}": write [columns] {columns} = {{ unit = "{unit}" }}'
    if ratio > 10:
        return (
            f'likely raw counts: write [columns] {columns} = {{ unit = "count", scale = ..., '
            "offset = ... }"
        )
    return "check unit, scale and offset"


def _check_accel_unit(recording: Recording, gravity: float) -> None:
    if recording.accel is None:
        return
    rows = _at_rest(recording)
    norm = np.linalg.norm(recording.accel[rows if rows.any() else slice(None)], axis=1)
    norm = float(np.median(norm))
    if not gravity / 3 < norm < 3 * gravity:
        raise ValueError(
            f"{recording.name}: accel has a median norm of {norm:.4g} m/s² at rest, not within a "
            f"factor 3 of gravity ({gravity:.4g}); {_likely(norm / gravity, ACCEL_UNITS, 'accel')}."
        )


def _check_gyro_unit(recording: Recording) -> None:
    if recording.gyro is None:
        return
    norm = np.linalg.norm(recording.gyro, axis=1)
    rows = _at_rest(recording)
    still = float(np.median(norm[rows])) if rows.any() else 0.0
    if still > 10.0:
        raise ValueError(
            f"{recording.name}: gyro has a median norm of {still:.4g} rad/s at rest, more than 10; "
            "likely raw counts or another unit: write [columns] gyro = { unit = ... } with deg/s, "
            "deg/h, or count with scale and offset."
        )
    if recording.reference_gyro is None:
        return
    reference = np.linalg.norm(recording.reference_gyro, axis=1)
    turning = reference > max(0.1, 0.3 * float(reference.max()))
    if not turning.any():
        return
    ratio = float(np.median(norm[turning] / reference[turning]))
    if not 1 / 3 < ratio < 3:
        raise ValueError(
            f"{recording.name}: gyro reads {ratio:.4g} times reference_gyro while turning, not within a "
            f"factor 3; {_likely(ratio, GYRO_UNITS, 'gyro')} (or reference_gyro's unit is wrong)."
        )


def _clock(recording: Recording) -> list[str]:
    steps = np.diff(recording.time)
    if len(steps) < 10:
        return []
    usual = float(np.median(steps))
    if not 1e-6 < usual < 100:
        return [
            f"{recording.name}: the usual step in time is {usual:.4g} s; check the unit of time "
            "([columns] time)."
        ]
    gaps = np.flatnonzero(steps > 20 * usual)
    if not len(gaps):
        return []
    widest = gaps[np.argmax(steps[gaps])]
    return [
        f"{recording.name}: {len(gaps)} gap(s) in time of more than 20 usual steps ({usual:.4g} s); "
        f"the longest is {steps[widest]:.4g} s after row {widest} ({recording.time[widest]:.6g} s)."
    ]


def _saturated(recording: Recording, triad: str, unit: str) -> list[str]:
    values = getattr(recording, triad)
    if values is None:
        return []
    notes = []
    for axis, name in enumerate(AXES):
        x = values[:, axis]
        for extreme in (x.max(), x.min()):
            if _holds(x, float(extreme)):
                count = int((x == extreme).sum())
                notes.append(
                    f"{recording.name}: {triad}_{name} looks saturated at {extreme:.6g} {unit} "
                    f"({count} samples at exactly this extreme value)."
                )
    return notes


def _holds(x: Float[np.ndarray, " time"], extreme: float) -> bool:
    """Whether runs at the extreme are too long for this channel's own habit of repeating values.

    A channel that repeats its last value with probability p stays L samples at one value by chance
    with probability about N p^L; below one in a thousand it must be the end of the range.
    """
    there = x == extreme
    if there.sum() < 5 or there.all():
        return False
    elsewhere = ~there[1:] & ~there[:-1]
    if elsewhere.sum() < 20:
        return False
    repeats = (np.sum((x[1:] == x[:-1]) & elsewhere) + 1) / (elsewhere.sum() + 2)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(np.int8)))
    longest = int((edges[1::2] - edges[::2]).max())
    return longest >= 5 and bool(len(x) * repeats**longest < 1e-3)


def _stuck(recording: Recording) -> list[str]:
    notes = []
    for triad in ("accel", "gyro"):
        values = getattr(recording, triad)
        if values is None or recording.num_samples < 100:
            continue
        for axis, name in enumerate(AXES):
            if np.ptp(values[:, axis]) == 0:
                notes.append(
                    f"{recording.name}: {triad}_{name} never changes ({values[0, axis]:.6g}); the "
                    "channel looks dead."
                )
    return notes


def _overlaps(recordings: tuple[Recording, ...]) -> list[str]:
    notes = []
    for device in dict.fromkeys(r.device for r in recordings):
        mine = sorted((r for r in recordings if r.device == device), key=lambda r: r.time[0])
        for before, after in zip(mine, mine[1:], strict=False):
            if after.time[0] < before.time[-1]:
                notes.append(
                    f"{before.name} and {after.name} overlap in time, so their order is not known; "
                    "drift over the campaign cannot be judged."
                )
                break
    return notes


def check_model_columns(model: ModelChoice, recordings: tuple[Recording, ...]) -> None:
    """Raise `ValueError` where `[model]` asks for columns that no recording has."""
    needs = (
        (model.accel_estimator is not None, "accel_estimator", model.accel_estimator, "accel"),
        (model.accel_estimator == "reference", "accel_estimator", "reference", "reference_accel"),
        (model.gyro_estimator is not None, "gyro_estimator", model.gyro_estimator, "gyro"),
        (model.gyro_estimator == "reference", "gyro_estimator", "reference", "reference_gyro"),
        (model.gyro_estimator == "gravity", "gyro_estimator", "gravity", "accel"),
        (model.g_sensitivity is True, "g_sensitivity", True, "gyro"),
        (
            bool(model.temperature_degree),
            "temperature_degree",
            model.temperature_degree,
            "temperature",
        ),
    )
    for asked, key, value, column in needs:
        if asked and all(getattr(r, column) is None for r in recordings):
            columns = column if column == "temperature" else f"{column}_x/y/z"
            said = str(value).lower() if isinstance(value, bool) else repr(value)
            raise ValueError(
                f"[model] {key} = {said} needs the column(s) {columns}, which no recording has; map "
                f"them under [columns] or change {key}."
            )
    force = any(r.accel is not None or r.reference_accel is not None for r in recordings)
    if model.g_sensitivity and not force:
        raise ValueError(
            "[model] g_sensitivity = true needs the specific force, accel_x/y/z or "
            "reference_accel_x/y/z, which no recording has; set it to false."
        )
