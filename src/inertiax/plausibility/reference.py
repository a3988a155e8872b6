"""Outputs against the reference columns: unit, signs and axes, single rests, the reference's gravity, remounting."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ..data.formats.columns import AXES
from . import remedies
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .gyro_turns import describe
from .thresholds import Thresholds
from .turns import complexity, IDENTITY, PERMUTATIONS


@dataclasses.dataclass(frozen=True, eq=False)
class _Rows:
    """Means of a triad beside those of its reference, over all recordings."""

    log: tuple[Log, ...]  # of each row
    start: np.ndarray
    output: Float[np.ndarray, "row 3"]
    ideal: Float[np.ndarray, "row 3"]
    group: np.ndarray  # runs (experiments) in their recordings

    def __getitem__(self, rows: np.ndarray) -> "_Rows":
        logs = tuple(self.log[int(k)] for k in np.arange(len(self.log))[rows])
        return _Rows(logs, self.start[rows], self.output[rows], self.ideal[rows], self.group[rows])


def check_accel_reference(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Accelerometers at rest against reference_accel."""
    rows = _gather(device, "accel")
    if rows is None:
        return []
    gravity = device.site.gravity
    found = _gravity(device, rows, limits)
    ratio = np.median(np.linalg.norm(rows.output, axis=1)) / gravity
    if not 1 / limits.accel_ratio_error < ratio < limits.accel_ratio_error:
        return found  # the unit is told of already
    best, cost = _best_exchange(rows, gravity, limits)
    if best is None:
        return [*found, *_disagrees(rows, cost, limits)]
    if best != IDENTITY:
        return [*found, _axes("accel", device, rows, best, cost)]
    single = _single_rests(rows, gravity, limits)
    return [*found, *single, *([] if single else _remounted(rows, limits))]


def check_gyro_reference(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Gyros at constant rates against reference_gyro: unit and axes."""
    rows = _gather(device, "gyro")
    if rows is None:
        return []
    size = np.linalg.norm(rows.ideal, axis=1)
    rows = rows[size > 0.3 * size.max()]
    if size.max() < 1e-2:  # Earth's rate tells no unit
        return []
    ratio = float(
        np.median(np.linalg.norm(rows.output, axis=1) / np.linalg.norm(rows.ideal, axis=1))
    )
    found = []
    if not 1 / limits.accel_ratio_error < ratio < limits.accel_ratio_error:
        remedy, unit = remedies.rescaled("gyro", device.columns, 1.0 / max(ratio, 1e-300))
        said = "check the units of gyro and reference_gyro" if unit is None else f"likely {unit}"
        text = (
            f"{rows.log[0].name}: gyro reads {ratio:.4g} times reference_gyro while turning; {said} (or "
            "reference_gyro's unit is wrong)."
        )
        numbers = {"ratio": ratio, "plateaus": len(rows.log)}
        found.append(finding("gyro_unit", "error", "gyro", text, remedy=remedy, **numbers))
        rows = dataclasses.replace(rows, output=rows.output / max(ratio, 1e-300))
    size = float(np.median(np.linalg.norm(rows.ideal, axis=1)))
    best, cost = _best_exchange(rows, size, limits)
    if len(rows.log) >= 2 and best is not None and best != IDENTITY:
        found.append(_axes("gyro", device, rows, best, cost))
    return found


def _gather(device: DeviceLogs, triad: str) -> _Rows | None:
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
    return _Rows(tuple(logs), *(np.concatenate(p) for p in zip(*parts, strict=True)))


def _left(
    rows: _Rows, p: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "row 3"], Float[np.ndarray, " row"]]:
    """What P times the reference leaves of the output, without the median as bias where attitudes vary; its size."""
    left = rows.output - rows.ideal @ p.T
    return left, np.linalg.norm(left, axis=1)


def _best_exchange(
    rows: _Rows, size: float, limits: Thresholds
) -> tuple[int | None, tuple[float, float]]:
    """The exchange that explains the outputs; `None` where none does. Costs as given and best, relative."""
    costs = np.array([np.median(_left(rows, p)[1]) for p in PERMUTATIONS]) / size
    given = float(costs[IDENTITY])
    if given < limits.reference_disagrees:
        return IDENTITY, (given, given)
    least = float(costs.min())
    if least > limits.reference_agrees:
        return None, (given, least)
    near = [k for k in range(48) if costs[k] <= least + 0.05]
    best = min(near, key=lambda k: (complexity(PERMUTATIONS[k]), costs[k]))
    return best, (given, float(costs[best]))


def _axes(
    triad: str, device: DeviceLogs, rows: _Rows, best: int, cost: tuple[float, float]
) -> Finding:
    p = PERMUTATIONS[best].T  # what the outputs have to be taken by
    return finding(
        "axes",
        "error",
        triad,
        f"{rows.log[0].name}: {triad} differs from reference_{triad} by {cost[0]:.2f} of its size, and by "
        f"{cost[1]:.2f} when {triad} {describe(p)} (or the reference's axes are wrong).",
        remedy=remedies.exchanged(triad, device.columns, p),
        rows=len(rows.log),
        as_given=cost[0],
        misfit=cost[1],
        matrix=[float(v) for v in p.ravel()],
    )


def _disagrees(rows: _Rows, cost: tuple[float, float], limits: Thresholds) -> list[Finding]:
    del limits
    return [
        finding(
            "reference",
            "error",
            "reference_accel",
            f"{rows.log[0].name}: at half of the {len(rows.log)} rests accel differs from reference_accel by "
            f"{cost[0]:.2f} of gravity or more, and no exchange of axes explains it: the reference columns do not "
            "belong to these rests.",
            rests=len(rows.log),
            as_given=cost[0],
            misfit=cost[1],
        )
    ]


def _single_rests(rows: _Rows, gravity: float, limits: Thresholds) -> list[Finding]:
    """Rests whose reference is another one's, or of the wrong sign."""
    left, size = _left(rows, np.eye(3))
    far = size > limits.reference_disagrees * gravity
    if not far.any():
        return []
    swapped = _exchanged_rests(rows, far, gravity, limits)
    places = ", ".join(_place(rows, int(k)) for k in np.flatnonzero(far)[:4])
    if swapped:
        a, b = swapped
        text = (
            f"{rows.log[a].name}: the rests at {_place(rows, a)} and {_place(rows, b)} stand as each other's "
            "reference says: their positions are exchanged."
        )
        return [finding("positions", "error", "reference_accel", text, rests=int(far.sum()))]
    mirrored = [
        axis for axis in range(3)
        if np.all(np.abs(left[far] + 2 * np.eye(3)[axis] * rows.ideal[far])[:, axis] < 0.15 * gravity)
        and np.all(np.abs(np.delete(left[far], axis, axis=1)) < 0.15 * gravity)
    ]  # fmt: skip
    k = int(np.argmax(size))
    sign = f": the sign of reference_accel_{AXES[mirrored[0]]} is wrong" if mirrored else ""
    measured, ideal = (", ".join(f"{v:.2f}" for v in x[k]) for x in (rows.output, rows.ideal))
    return [
        finding(
            "reference",
            "error",
            "reference_accel",
            f"{rows.log[k].name}: accel and reference_accel contradict each other at {int(far.sum())} of {len(far)} "
            f"rests (at {places}), for example ({measured}) and ({ideal}) m/s²{sign}; or the device stood "
            "otherwise there than planned.",
            rests=int(far.sum()),
            of=len(far),
            largest=float(size.max()),
        )
    ]


def _exchanged_rests(
    rows: _Rows, far: Bool[np.ndarray, " row"], gravity: float, limits: Thresholds
) -> tuple[int, int] | None:
    index = np.flatnonzero(far)
    near = limits.reference_agrees * gravity
    for a in index:
        for b in index[index > a]:
            there = np.linalg.norm(rows.output[a] - rows.ideal[b]) < near
            if there and np.linalg.norm(rows.output[b] - rows.ideal[a]) < near:
                return int(a), int(b)
    return None


def _place(rows: _Rows, k: int) -> str:
    recording = rows.log[k].recording
    row = int(rows.start[k])
    position = "" if recording.position is None else f", position {recording.position[row]}"
    several = len({log.name for log in rows.log}) > 1
    name = f"{rows.log[k].name}, " if several else ""
    return f"{name}{rows.log[k].moment(recording.time[row])}{position}"


def _gravity(device: DeviceLogs, rows: _Rows, limits: Thresholds) -> list[Finding]:
    """The reference's norm against [site] gravity, where all rests have one norm."""
    size = np.linalg.norm(rows.ideal, axis=1)
    gravity, usual = device.site.gravity, float(np.median(size))
    off = usual / gravity - 1.0
    if np.ptp(size) > 2e-3 * usual or abs(off) < limits.reference_gravity or abs(off) > 0.05:
        return []
    return [
        finding(
            "gravity",
            "warning",
            "reference_accel",
            f"{rows.log[0].name}: reference_accel has a norm of {usual:.6g} m/s² at rest, but [site] gravity is "
            f"{gravity:.6g} ({1e6 * off:.0f} ppm): one of them is another place's, and scale factors by one "
            "estimator differ by that from the other's.",
            reference=usual,
            site=gravity,
            ppm=1e6 * off,
        )
    ]


def _remounted(rows: _Rows, limits: Thresholds) -> list[Finding]:
    """Runs between which the device turned in its mount: the rotation of each run against the others."""
    runs = [np.flatnonzero(rows.group == g) for g in np.unique(rows.group)]
    runs = [r for r in runs if len(r) >= 4]
    if len(runs) < 2:
        return []
    bias, matrix = _line_fit(rows)
    if matrix is None:
        return []
    turns, errors = [], []
    for r in runs:
        ideal = rows.ideal[r] @ matrix.T
        left = rows.output[r] - bias - ideal
        design = np.concatenate([_cross_matrix(-v) for v in ideal])  # φ × f
        if np.linalg.svd(design, compute_uv=False)[-1] < 0.5 * np.linalg.norm(ideal[0]):
            return []
        turn = np.linalg.lstsq(design, left.ravel(), rcond=None)[0]
        rest = left.ravel() - design @ turn
        turns.append(turn)
        errors.append(float(np.sqrt(np.mean(rest**2)) / np.linalg.norm(ideal[0])))
    turns = np.array(turns)
    apart = np.linalg.norm(turns - np.median(turns, axis=0), axis=1)
    worst = int(np.argmax(apart))
    if apart[worst] < limits.remounted or apart[worst] < 4.0 * max(errors):
        return []
    row = int(runs[worst][0])
    return [
        finding(
            "remounted",
            "warning",
            "accel",
            f"{rows.log[row].name}: in the run that begins at {_place(rows, row)} the device stands turned by "
            f"{np.degrees(apart[worst]):.2f}° against the other runs: it was mounted anew.",
            angle=float(apart[worst]),
            runs=len(runs),
        )
    ]


def _line_fit(
    rows: _Rows,
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"] | None]:
    """output = bias + matrix · ideal over all rests."""
    design = np.concatenate([np.ones((len(rows.log), 1)), rows.ideal], axis=1)
    scale = np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)
    if len(design) < 6 or scale[-1] < 0.05 * scale[0]:
        return np.zeros(3), None
    solution = np.linalg.lstsq(design, rows.output, rcond=None)[0]
    return solution[0], solution[1:].T


def _cross_matrix(v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
