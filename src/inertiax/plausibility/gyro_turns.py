"""The gyros' unit, signs and axes, and the unit of time: the integrated rates must turn gravity as it turned."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from ..reduction.missed_turns import missed
from . import remedies
from .dead_channels import is_dead
from .evidence import DeviceLogs, Log
from .exchanged_axes import taken_by_reference
from .finding import Finding, finding
from .gyro_in_motion import unit_in_motion
from .one_gyro_axis import axis_factor, one_axis_finding
from .thresholds import Thresholds
from .turned_frame import turned_frame
from .turns import (
    complexity,
    describe,
    DETERMINANTS,
    IDENTITY,
    misfit_as_given,
    misfits,
    Motions,
    motions_of,
    PERMUTATIONS,
    score,
)


_DEG = np.pi / 180
# What the values may have to be multiplied by: angle units, seconds, and converters' usual counts and ranges.
FACTORS: tuple[float, ...] = (
    1.0,
    *(_DEG, 1 / _DEG, _DEG / 3600, 3600 / _DEG, 3600.0, 1 / 3600),
    *(1e3, 1e-6, 1e6, 1e3 / _DEG),
    *(unit / c for unit in (_DEG, 1.0) for c in remedies.COUNTS_PER_DPS),
    *(0.5, 2.0, 0.25, 4.0, 0.125, 8.0),
)
_FOR_FACTOR = 12  # motions
# Half of the way, as a logarithm, from one of the factors to the next: 1 to 2.
_BETWEEN = 0.5 * math.log(2.0)
_MUCH_LESS = 2.0  # of the misfit: as in `_search`, where simpler and better are weighed
_TIME_FACTORS = (1e-3, 1e3, 1e-6, 1e6)
_BLIND = 0.8  # of gravity's turn: as much is missed by rates that have nothing to do with it
_MOTIONS_TO_SEE = 8


@dataclasses.dataclass(frozen=True)
class _Best:
    """The exchange and factor that explain the motions."""

    factor: float
    p: int
    misfit: float  # rad
    given: float  # rad, as given


def check_gyro_turns(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Each recording with enough motions alone, the others together."""
    if is_dead(device, "accel", limits) or is_dead(device, "gyro", limits):
        return []
    groups: list[tuple[tuple[Log, ...], Motions]] = []
    left: list[Log] = []
    for log in device.logs:
        motions = motions_of((log,), limits.least_tilt)
        if motions is not None and motions.count >= limits.fewest_motions:
            groups.append(((log,), motions))
        elif motions is not None:
            left.append(log)
    together = motions_of(tuple(left), limits.least_tilt) if left else None
    if together is not None and together.count >= limits.fewest_motions:
        groups.append((tuple(left), together))
    if not groups:
        return []
    # Axes that references tell are judged by them; here they are as those say.
    force, rate = (taken_by_reference(device, triad, limits) for triad in ("accel", "gyro"))
    told = bool(np.any(force != np.eye(3)) or np.any(rate != np.eye(3)))
    found: list[Finding] = []
    for logs, motions in groups:
        right = dataclasses.replace(
            motions,
            angle=motions.angle @ rate.T,
            before=motions.before @ force.T,
            after=motions.after @ force.T,
        )
        for one in _judge(device, logs, right, limits):
            # A line for the same key would undo the references'.
            found.append(dataclasses.replace(one, remedy=None) if told else one)
    return found


def _judge(
    device: DeviceLogs, logs: tuple[Log, ...], motions: Motions, limits: Thresholds
) -> list[Finding]:
    given = float(score(misfit_as_given(motions)))
    if given < limits.turn_agrees:
        return [
            *_small_factor(device, logs, motions, limits),
            *_single_motions(logs, motions, limits),
            *turned_frame(logs, motions, limits),
        ]
    best = _search(motions, given, limits)
    apart = axis_factor(motions, given, limits)
    # An exchange may come near what an axis of half or twice the scale does; each has a choice or two to itself.
    if apart is not None and (best is None or _MUCH_LESS * apart.misfit < best.misfit):
        if _alike(motions)[1] < apart.misfit:  # one factor for all has no choice of axes to itself
            told = _small_factor(device, logs, motions, limits)
            if told:
                return told
        return [one_axis_finding(device, _names(logs), motions, given, apart, limits)]
    if best is None:
        # The stillest stretches of a device that moves all along are no rests.
        told = [f for log in logs for f in unit_in_motion(device, log, limits)]
        told = told or _small_factor(device, logs, motions, limits)
        return told or _unexplained(device, logs, motions, given, limits)
    ratio = 1.0 / _refined(motions, best)
    found = []
    if best.factor != 1.0:
        found += _unit(device, logs, motions, best, ratio, limits)
    if best.p != IDENTITY:
        found += _axes(device, logs, motions, best)
    return found


def _search(motions: Motions, given: float, limits: Thresholds) -> _Best | None:
    """The simplest of the best exchanges and factors, where it is certainly better than what is given."""
    scores = np.stack([score(misfits(motions, factor)) for factor in FACTORS])
    least = float(scores.min())
    good = least < limits.turn_agrees and given > limits.turn_gain * least
    if not good or given < limits.turn_disagrees:
        return None
    near = [
        (factor != 1.0, _cost(PERMUTATIONS[p]), float(scores[k, p]), k, p)
        for k, factor in enumerate(FACTORS)
        for p in range(48)
        if scores[k, p] <= least + 0.5 * (limits.turn_agrees - least) and scores[k, p] < 2.0 * least
    ]
    _, _, left, k, p = min(near)
    return _Best(FACTORS[k], p, left, given)


def _cost(p: Float[np.ndarray, "3 3"]) -> int:
    """Axes moved or negated in the triad that has to change least."""
    if np.linalg.det(p) > 0:
        return min(complexity(p), complexity(-p))
    return complexity(p)


def _refined(motions: Motions, best: _Best) -> float:
    """The factor, to a percent, from some of the motions."""
    some = slice(None, None, max(motions.count // _FOR_FACTOR, 1))
    turned = PERMUTATIONS[best.p] * DETERMINANTS[best.p]
    moved = dataclasses.replace(
        motions,
        angle=motions.angle[some] @ turned.T * DETERMINANTS[best.p],
        before=motions.before[some],
        after=motions.after[some],
    )
    cost = lambda log: float(score(misfit_as_given(moved, best.factor * float(np.exp(log)))))
    from scipy.optimize import minimize_scalar  # slow to import, and seldom needed

    found = minimize_scalar(
        cost, bounds=(-_BETWEEN, _BETWEEN), method="bounded", options={"xatol": 3e-3}
    )
    return best.factor * float(np.exp(found.x))


def _unit(
    device: DeviceLogs,
    logs: tuple[Log, ...],
    motions: Motions,
    best: _Best,
    ratio: float,
    limits: Thresholds,
) -> list[Finding]:
    step = float(np.median([log.step for log in logs]))
    common = {"ratio": ratio, "pairs": motions.count, "misfit": best.misfit, "as_given": best.given}
    turned = (
        f"{_names(logs)}: the integrated rates turn {ratio:.3g} times as far as gravity does in "
        f"{_counted(motions, limits)}"
    )
    if best.factor in _TIME_FACTORS and not 1e-4 <= step <= 0.5:
        remedy = remedies.time_unit(device.columns, best.factor)
        said = "" if remedy is None else f', likely unit "{remedy.split(chr(34))[-2]}"'
        text = f"{turned}, and the usual step in time is {step:.3g} s: the unit of time is wrong{said}."
        return [finding("time_unit", "error", "time", text, remedy=remedy, step=step, **common)]
    remedy, unit = remedies.rescaled("gyro", device.columns, best.factor)
    if unit == remedies.ANOTHER_SCALE and not remedies.is_usual(device.columns, best.factor):
        # No converter has that scale. Where rows are counted at a rate, that is the weaker of the two assumptions.
        counted = remedies.rate(device.columns)
        remedy, unit = (
            (remedy, unit) if counted is None else (remedies.rows_at(counted * ratio), None)
        )
    said = "the gyros' unit or scale is wrong" + (
        f", or the sampling rate: {ratio / step:.3g} Hz would agree, {1.0 / step:.3g} Hz is given"
        if unit is None
        else f", likely {unit}"
    )
    return [finding("gyro_unit", "error", "gyro", f"{turned}: {said}.", remedy=remedy, **common)]


def _axes(
    device: DeviceLogs, logs: tuple[Log, ...], motions: Motions, best: _Best
) -> list[Finding]:
    """The exchange in the triad where it is simpler; a proper one may be either triad's."""
    p = PERMUTATIONS[best.p]
    readings = [("gyro", p)]
    if DETERMINANTS[best.p] > 0:
        readings += [("accel", p.T), ("accel", -p.T)]
    triad, change = min(readings, key=lambda r: complexity(r[1]))
    words = [f"{t} {describe(c)}" for t, c in sorted(readings, key=lambda r: complexity(r[1]))]
    if np.array_equal(p, -np.eye(3)):
        words.append("two axes of both triads are exchanged, which makes their frame left-handed")
    also = f" (as well explained by: {'; '.join(words[1:])})" if len(words) > 1 else ""
    remedy = remedies.exchanged(triad, device.columns, change)
    if best.factor != 1.0 and triad == "gyro":
        remedy = None  # the unit's line is for the same key
    return [
        finding(
            "axes",
            "error",
            triad,
            f"{_names(logs)}: gravity's turns between rests and the gyros' disagree by {best.given:.2f} rad on "
            f"average, and by {best.misfit:.2f} rad when {words[0]}{also}.",
            remedy=remedy,
            pairs=motions.count,
            as_given=best.given,
            misfit=best.misfit,
            matrix=[float(v) for v in change.ravel()],
        )
    ]


def _small_factor(
    device: DeviceLogs, logs: tuple[Log, ...], motions: Motions, limits: Thresholds
) -> list[Finding]:
    """A common scale factor of all gyros (or of the clock) that no sensor has."""
    if motions.count < 2 * limits.fewest_motions:
        return []
    factor, better = _alike(motions)
    given = float(score(misfit_as_given(motions)))
    if abs(factor - 1.0) < limits.rate_off or better > 0.6 * given or given < 0.03:
        return []
    counted = remedies.rate(device.columns)
    said, remedy = "look at the clock, and at the gyros' range or scale", None
    if counted is not None:
        few = factor > 1.0
        rows = f"{1.0 - 1.0 / factor:.0%} of them were lost" if few else "some are doubled"
        said = f"rows are counted at {counted:g} Hz, and {counted / factor:.4g} Hz would agree: that is their rate, or "
        said += f"{rows}, or the gyros' scale is wrong. Of lost or doubled rows a rate mends the mean alone, and each "
        said += "motion stays off by its own: log a clock beside them"
        remedy = remedies.rows_at(counted / factor)
    return [
        finding(
            "gyro_unit",
            "warning",
            "gyro",
            f"{_names(logs)}: the integrated rates turn {1 / factor:.3g} times as far as gravity does in "
            f"{_counted(motions, limits)}, about all axes alike: {said}.",
            remedy=remedy,
            ratio=1.0 / factor,
            pairs=motions.count,
            misfit=float(better),
            as_given=float(given),
        )
    ]


def _alike(motions: Motions) -> tuple[float, float]:
    """The factor of all gyros that explains the motions best, and what it leaves, rad."""
    factor = _refined(motions, _Best(1.0, IDENTITY, 0.0, 0.0))
    return factor, float(score(misfit_as_given(motions, factor)))


def _single_motions(logs: tuple[Log, ...], motions: Motions, limits: Thresholds) -> list[Finding]:
    """Motions that turn gravity otherwise, among others that do not."""
    misfit = misfit_as_given(motions)
    off = missed(misfit, motions.path)
    number = int(off.sum())
    if not number:
        return []
    began = [t for t, is_off in zip(motions.began, off, strict=True) if is_off]
    where = ", ".join(f"{t:.1f} s" for t in began[:3]) + ", …" * (number > 3)
    return [
        finding(
            "motions",
            "warning",
            "gyro",
            f"{_names(logs)}: in {number} of {_counted(motions, limits)} (from {where}) the integrated rates miss "
            f"gravity's turn by {float(misfit[off].min()):.2f} rad or more, in the others by "
            f"{float(np.median(misfit)):.2f} rad: rows were lost or doubled or gyros clipped there. A calibration "
            f"leaves {'it' if number == 1 else 'them'} out.",
            motions=number,
            pairs=motions.count,
            began=began,
            largest=float(misfit.max()),
        )
    ]


def _unexplained(
    device: DeviceLogs,
    logs: tuple[Log, ...],
    motions: Motions,
    given: float,
    limits: Thresholds,
) -> list[Finding]:
    # Where gravity turns by little, rates that turn nothing miss it by no more than that.
    blind = given > _BLIND * float(score(motions.tilt)) and motions.count >= _MOTIONS_TO_SEE
    if given < limits.turn_disagrees and not blind:
        return []
    # A table's references tell unit and axes, and its motions are no rows of a calibration.
    on_table = all(
        log.labelled and log.recording.reference_accel is not None and len(log.plateau_start) > 0
        for log in logs
    )
    used = " They are not used, for references tell both triads." if on_table else ""
    counted = remedies.rate(device.columns)
    clock = (
        "" if counted is None else f", another rate than {counted:g} Hz, at which rows are counted"
    )
    return [
        finding(
            "axes",
            "note" if on_table else "warning",
            "gyro",
            f"{_names(logs)}: the integrated rates do not turn gravity as it turned in {_counted(motions, limits)} "
            f"({given:.2f} rad on average), and no exchange of axes, no unit and no factor of one axis or two explains "
            f"it: gyros clipped in the motions, rows lost or too far apart for them{clock}, or rests that are not at "
            f"rest.{used}",
            pairs=motions.count,
            as_given=given,
        )
    ]


def _counted(motions: Motions, limits: Thresholds) -> str:
    """How many motions are looked at; a calibration uses smaller ones, too, and none at a rest that it leaves out."""
    return (
        f"{motions.count} motions of {math.degrees(limits.least_tilt):.0f}° or more between rests"
    )


def _names(logs: tuple[Log, ...]) -> str:
    return logs[0].name if len(logs) == 1 else f"{logs[0].name} and {len(logs) - 1} more"
