"""How a triad's axes stand against its reference, of all 48 exchanges and mirrorings of axes."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from .evidence import DeviceLogs, Log
from .thresholds import Thresholds
from .turns import complexity, IDENTITY, PERMUTATIONS


@dataclasses.dataclass(frozen=True, eq=False)
class ReferenceRows:
    """Means of a triad beside those of its reference, over all recordings."""

    log: tuple[Log, ...]  # of each row
    start: np.ndarray
    output: Float[np.ndarray, "row 3"]
    ideal: Float[np.ndarray, "row 3"]
    group: np.ndarray  # runs (experiments) in their recordings

    def __getitem__(self, rows: np.ndarray) -> "ReferenceRows":
        logs = tuple(self.log[int(k)] for k in np.arange(len(self.log))[rows])
        return ReferenceRows(
            logs, self.start[rows], self.output[rows], self.ideal[rows], self.group[rows]
        )


@dataclasses.dataclass(frozen=True, eq=False)
class ReferenceExchange:
    """Which exchange of a triad's axes its reference tells."""

    rows: ReferenceRows
    ratio: float  # of the outputs to the reference, as given
    told: bool  # the axes can be told: unit and rows allow it
    best: int | None  # of PERMUTATIONS; `None` where none explains the outputs
    given: float  # misfit as given, of the reference's size
    misfit: float  # with the best

    @property
    def taken(self) -> Float[np.ndarray, "3 3"]:
        """The signed permutation that the outputs have to be taken by."""
        return PERMUTATIONS[IDENTITY if self.best is None else self.best].T


def exchange_by_reference(
    device: DeviceLogs, triad: str, limits: Thresholds
) -> ReferenceExchange | None:
    """What a triad's reference tells of its axes; `None` without outputs beside a reference.

    Accelerometers at rest, gyros at constant rates, for Earth's rate tells no axes.
    """
    rows = _gather(device, triad)
    if rows is None:
        return None
    if triad == "accel":
        size = float(device.site.gravity)
        ratio = float(np.median(np.linalg.norm(rows.output, axis=1))) / size
        told = 1 / limits.accel_ratio_error < ratio < limits.accel_ratio_error
    else:
        ideal = np.linalg.norm(rows.ideal, axis=1)
        if ideal.max() < 1e-2:
            return None
        rows = rows[ideal > 0.3 * ideal.max()]
        ideal = np.linalg.norm(rows.ideal, axis=1)
        ratio = float(np.median(np.linalg.norm(rows.output, axis=1) / ideal))
        size, told = float(np.median(ideal)), len(rows.log) >= 2
        if not 1 / limits.accel_ratio_error < ratio < limits.accel_ratio_error:
            rows = dataclasses.replace(rows, output=rows.output / max(ratio, 1e-300))
    # Of rests one may stand otherwise than its reference says; of plateaus one in three may be about the only axis that
    # is mirrored.
    about = np.abs(rows.ideal).argmax(axis=1) if triad == "gyro" else np.zeros(len(rows.log), int)
    best, (given, misfit) = _best_exchange(rows, about, size, limits)
    return ReferenceExchange(rows, ratio, told, best, given, misfit)


def taken_by_reference(
    device: DeviceLogs, triad: str, limits: Thresholds
) -> Float[np.ndarray, "3 3"]:
    """The signed permutation that a triad's outputs have to be taken by; E where no reference tells of one."""
    found = exchange_by_reference(device, triad, limits)
    return np.eye(3) if found is None or not found.told else found.taken


def _gather(device: DeviceLogs, triad: str) -> ReferenceRows | None:
    logs: list[Log] = []
    parts: list[tuple[np.ndarray, ...]] = []
    for number, log in enumerate(device.logs):
        over = log.over_rests if triad == "accel" else log.over_plateaus
        start = log.start if triad == "accel" else log.plateau_start
        output, ideal = over(triad), over(f"reference_{triad}")
        if output is None or ideal is None or not len(start):
            continue
        # Where the reference changes within, it says nothing of the mean.
        size = np.maximum(np.linalg.norm(ideal.mean, axis=1), 1e-12)
        steady = np.linalg.norm(ideal.std, axis=1) < 0.02 * size
        if triad == "accel":
            steady &= np.any(ideal.mean, axis=1)  # `check_moving_label` has seen the others
        runs = log.recording.experiment
        group = np.zeros(len(start)) if runs is None else runs[start].astype(float)
        logs += [log] * int(steady.sum())
        parts.append(
            (
                start[steady],
                output.mean[steady],
                ideal.mean[steady],
                group[steady] + 1e6 * number,
            )
        )
    if not logs:
        return None
    return ReferenceRows(tuple(logs), *(np.concatenate(p) for p in zip(*parts, strict=True)))


def left(
    rows: ReferenceRows, p: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "row 3"], Float[np.ndarray, " row"]]:
    """What P times the reference leaves of the output, without the median as bias where attitudes vary; its size."""
    left = rows.output - rows.ideal @ p.T
    return left, np.linalg.norm(left, axis=1)


def _best_exchange(
    rows: ReferenceRows, about: Int[np.ndarray, " row"], size: float, limits: Thresholds
) -> tuple[int | None, tuple[float, float]]:
    """The exchange that explains the outputs; `None` where none does. Costs as given and best, relative: the median of
    those rows that are `about` one axis, of the axis that is explained worst."""
    groups = [about == axis for axis in np.unique(about)]
    worst = lambda off: max(float(np.median(off[group])) for group in groups)
    costs = np.array([worst(left(rows, p)[1]) for p in PERMUTATIONS]) / size
    given = float(costs[IDENTITY])
    if given < limits.reference_disagrees:
        return IDENTITY, (given, given)
    least = float(costs.min())
    if least > limits.reference_agrees:
        return None, (given, least)
    near = [k for k in range(48) if costs[k] <= least + 0.05]
    best = min(near, key=lambda k: (complexity(PERMUTATIONS[k]), costs[k]))
    return best, (given, float(costs[best]))
