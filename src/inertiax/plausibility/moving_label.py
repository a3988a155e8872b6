"""A label of `position` that a station writes while the device moves, and that nobody told to mean −1."""

import numpy as np
from jaxtyping import Bool

from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


_FEWEST = 4  # rests of the label
_PARTS = (
    0.5  # rests of the label for each other one: rates may be labelled so as well, which joins them
)
_LOUDER = 5.0  # times the scatter of the other rests' samples


def check_moving_label(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """A label between all others in which the device moves, or the reference tells no force at all.

    No device on the ground feels a specific force of zero, so that a reference of exactly zero is none.
    """
    del limits
    labels, between, zero, loud = _rests(device)
    for label in np.unique(labels[zero | (between & loud)]):
        mine = labels == label
        count = int(mine.sum())
        if count < _FEWEST or not (zero[mine].all() or (between[mine] & loud[mine]).mean() > 0.5):
            continue
        # A device moves between any two positions. A position that is shaken does not part all the others.
        if mine.all() or (not zero[mine].all() and count < _PARTS * (len(labels) - count)):
            continue
        why = "reference_accel is zero" if zero[mine].all() else "the device moves"
        name = device.columns.label("position") or "position"
        return [
            finding(
                "positions",
                "error",
                "position",
                f"{device.logs[0].name}: in all {count} dwells of position {label}, between the others, {why}: it is "
                "what the station writes while it moves, and −1 here.",
                remedy=f'position = {{ name = "{name}", moving = {label} }}',
                label=int(label),
                rests=count,
            )
        ]
    return []


def _rests(
    device: DeviceLogs,
) -> tuple[np.ndarray, Bool[np.ndarray, " rest"], Bool[np.ndarray, " rest"], np.ndarray]:
    """Of all labelled rests the label, whether others lie on both sides, whether the reference is zero, and whether the
    accelerometers are far louder than usual."""
    labels, between, zero, loud = [], [], [], []
    for log in device.logs:
        mine, accel = log.labels("position"), log.over_rests("accel")
        if mine is None or accel is None or len(mine) < 2 * _FEWEST:
            continue
        ideal = log.over_rests("reference_accel")
        scatter = np.linalg.norm(accel.std, axis=1)
        labels.append(mine)
        padded = np.concatenate([[mine[0] - 1], mine, [mine[-1] - 1]])
        between.append((padded[:-2] != mine) & (padded[2:] != mine))
        none = np.zeros(len(mine), bool)
        zero.append(none if ideal is None else ~np.any(ideal.mean, axis=1))
        quiet = [np.median(scatter[mine != k]) if np.any(mine != k) else np.inf for k in mine]
        loud.append(scatter > _LOUDER * np.array(quiet))
    if not labels:
        nothing = np.zeros(0, bool)
        return np.zeros(0, np.int64), nothing, nothing, nothing
    return (
        np.concatenate(labels),
        np.concatenate(between),
        np.concatenate(zero),
        np.concatenate(loud),
    )
