"""Is the calibration good? A short plain answer, what it rests on, and what to record next.

Judged are, by the limits of `goodness_of_fit`: the misfit against the dwells' noise; orientations, rates and
temperatures that the data cover; the least certain parameter; and signs of a mistake (an axis of the wrong
sign, swapped axes, a wrong unit, a rest that was none). Warnings of the estimation and of the plausibility checks
count as well.
"""

import math
from typing import NamedTuple

import numpy as np

from .._records import field, Module
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.quantities import customary_units, label, rms_text, with_sigma
from ..plausibility.other_unit import SAID as OTHER_UNIT
from ..reduction.dwells import Dwells
from .attitudes_over_temperature import is_of_one_attitude
from .data_coverage import input_of, Judged, orientations, rates, redundancy, temperatures
from .goodness_of_fit import (
    ATTENTION,
    begun,
    Finding,
    FINE,
    grade_misfit,
    grade_parameters,
    LIMITS,
    matrix_mistakes,
    misfit_words,
    UNUSABLE,
    usual_size,
)
from .misfit_pattern import follows_temperature, FORCE, LEVER_ARMS, remedy
from .pipeline import DeviceResult, MagnetometerResult, TriadResult
from .untold_earth import earth_in_g_sensitivity


GRID = 25  # temperatures at which parameters are judged, over the calibrated range
TRIAD_NAMES = {"accel": "Accelerometers", "gyro": "Gyros", "mag": "Magnetometers"}


class TriadVerdict(NamedTuple):
    """One triad in one sentence."""

    name: str  # as in `TRIAD_NAMES`
    verdict: str  # as of `Quality`
    text: str


class Quality(Module):
    """The answer. `verdict` is "good", "usable" (something asks for attention) or "doubtful" (a sign of
    a mistake, which no uncertainty allows for, or data that do not determine it)."""

    verdict: str = field(static=True)
    answer: str = field(static=True)  # one sentence
    findings: tuple[Finding, ...]
    next: tuple[str, ...] = field(static=True)  # what to record next, most useful first
    triads: tuple[TriadVerdict, ...] = field(static=True)


class Weakest(NamedTuple):
    """The least certain parameter, by what its 1-sigma does to the output."""

    label: str
    sigma: str  # with its unit
    temperature: float | None  # °C, where it is least certain; None without temperature model
    effect: float  # m/s² or rad/s


def judge(result: DeviceResult) -> Quality:
    """The quality of one device's calibration."""
    findings: list[Finding] = []
    advice: list[str] = []
    triads: list[TriadVerdict] = []
    # Errors of plausibility that the user forced the run past.
    forced = [f.statement for f in result.plausibility if f.severity == "error"]
    findings += [Finding("plausibility", UNUSABLE, text) for text in forced]
    for triad, estimate in _both(result):
        name = TRIAD_NAMES[estimate.estimator.triad]
        own = _mistakes(name, triad, estimate, result.calibration)
        own += [*_ended(name, estimate, result), _misfit(name, triad, estimate)]
        for topic in (redundancy, orientations, rates, temperatures, _weakest_finding):
            finding, wanted = topic(name, triad, estimate, result.calibration)
            own += [] if finding is None else [finding]
            advice += [] if wanted is None else [wanted]
        if follows_temperature(estimate.follows):
            advice.insert(0, f"{name}: rests after the device has reached its temperature.")
        own += _outliers(name, estimate)
        own += earth_in_g_sensitivity(name, triad, estimate, result.calibration)
        if estimate.contradicted is not None:
            said = f"{estimate.contradicted.statement}. Biases at rest are all that is told"
            own.append(Finding("motions", UNUSABLE, f"{name}: {said}."))
        triads.append(_triad_verdict(name, own))
        findings += own
    accel = result.accel
    if accel is not None and result.calibration.accel is None:
        if accel.chi2_per_dof > LIMITS.undecided_ratio**2:
            findings.append(_one_pose(TRIAD_NAMES["accel"], accel, ATTENTION))
    if result.mag is not None:
        own = _magnetometers(result.mag)
        triads.append(_triad_verdict("Magnetometers", own))
        findings += own
    held = result.calibration
    if held.accel is None and held.gyro is None and held.mag is None and held.baro is None:
        findings.append(Finding("empty", UNUSABLE, _EMPTY))
    said = [w for w in result.warnings if w not in forced]
    findings += [_of_warning(w, result) for w in said]
    # The sort is stable: of like grade, the first that was looked at.
    ranked = sorted(findings, key=lambda f: -f.grade)
    verdict, start = VERDICTS[ranked[0].grade], _WORDS[ranked[0].grade]
    rest = _GOOD if ranked[0].grade == FINE else begun(ranked[0].text, str.lower)
    also = _further_misfit(ranked)
    return Quality(
        verdict,
        f"{start}: {rest}{also}",
        tuple(findings),
        _of_one_wish(advice),
        tuple(triads),
    )


def _of_warning(warning: str, result: DeviceResult) -> Finding:
    """A warning; unusable of two units, or of constants that a warm-up in one pose beside other poses contradicts."""
    text = begun(warning, str.upper)
    constant = [r for c, r in _both(result) if c.curve.basis.size == 1]
    if is_of_one_attitude(warning) and any(
        math.sqrt(r.chi2_per_dof) >= LIMITS.noise_ratio for r in constant
    ):
        return Finding(
            ONE_ATTITUDE, UNUSABLE, f"Constants are right at none of its temperatures. {text}"
        )
    return Finding("warning", UNUSABLE if OTHER_UNIT in warning else ATTENTION, text)


ONE_ATTITUDE = "one_attitude"  # topic: a hand log and a warm-up in one campaign
_GOOD = "the uncertainties hold what the model leaves, and the data cover what the model needs."
_EMPTY = (
    "The calibration holds no parameter, for one pose at one temperature tells none; rest in six orientations or more, "
    "or give reference_accel_x/y/z. What the outputs do in time 'inertiax diagnose' tells all the same."
)
# Of the worst finding's grade.
VERDICTS = {FINE: "good", ATTENTION: "usable", UNUSABLE: "doubtful"}
_WORDS = {FINE: "Good", ATTENTION: "Usable, with a reservation", UNUSABLE: "Do not use it yet"}


def _triad_verdict(name: str, findings: list[Finding]) -> TriadVerdict:
    """The worst finding as the triad's sentence; of a good one, what is left and what is least certain."""
    worst = max(findings, key=lambda f: f.grade)
    verdict, start = VERDICTS[worst.grade], _WORDS[worst.grade]
    shown = [worst]
    if worst.grade == FINE:
        shown = [f for f in findings if f.topic in ("misfit", "weakest")]
    said = "; ".join(f.text.removeprefix(f"{name}: ").rstrip(".") for f in shown)
    return TriadVerdict(name, verdict, f"{name}: {begun(start, str.lower)}; {said}.")


def _of_one_wish(advice: list[str]) -> tuple[str, ...]:
    """What to record next; what several triads ask for alike is one line with all their names."""
    names: dict[str, list[str]] = {}
    for line in dict.fromkeys(advice):
        name, between, wanted = line.partition(": ")
        named = name in TRIAD_NAMES.values() and bool(between)
        names.setdefault(wanted if named else line, []).extend([name] * named)
    joined = lambda who: " and ".join([who[0], *map(str.lower, who[1:])])
    return tuple(f"{joined(who)}: {line}" if who else line for line, who in names.items())


def _further_misfit(ranked: list[Finding]) -> str:
    """What another triad's misfit asks for, beside the first finding."""
    first = ranked[0].text.partition(":")[0]
    if ranked[0].grade == FINE or first not in TRIAD_NAMES.values():
        return ""
    others = [f.text for f in ranked if f.topic == "misfit" and f.grade != FINE]
    return "".join(f" {text}" for text in others if text.partition(":")[0] != first)


def _both(result: DeviceResult) -> list[tuple[TriadCalibration, TriadResult]]:
    pairs = (
        (result.calibration.accel, result.accel),
        (result.calibration.gyro, result.gyro),
    )
    return [(c, r) for c, r in pairs if c is not None and r is not None]


# Of the field: a misfit of 5 % is 3° of heading, and iron near by or a wrong column; an uncertainty of 2 % is 1°.
_GROSS_FIELD, _UNSURE_FIELD = 0.05, 0.02


def _magnetometers(mag: MagnetometerResult) -> list[Finding]:
    """What is left of the field's magnitude, and how well the hard and the soft iron are known."""
    field = float(np.asarray(mag.estimator.field))
    ratio = math.sqrt(mag.chi2_per_dof)
    left = f"Magnetometers: {rms_text('T', mag.rms)} rms of a field of {1e6 * field:.1f} µT is left"
    grade = UNUSABLE if mag.rms > _GROSS_FIELD * field else FINE
    if grade == FINE and ratio > LIMITS.noise_ratio:
        grade = ATTENTION
        left += f", {ratio:.1f} times what the noise predicts: iron near by, or a field that is not uniform"
    elif grade == UNUSABLE:
        left += ": look for iron near by, exchanged columns or a wrong unit"
    hard, soft = mag.worst_sigmas
    known = FINE if max(hard / field, soft) <= _UNSURE_FIELD else ATTENTION
    text = f"Magnetometers: hard iron is known to {1e6 * hard:.2g} µT, soft iron to {100 * soft:.2g} % (1 sigma)"
    return [Finding("misfit", grade, f"{left}."), Finding("weakest", known, f"{text}.")]


# Misfit ----------------------------------------------------------------------------------------------


def _misfit(name: str, triad: TriadCalibration, estimate: TriadResult) -> Finding:
    ratio = math.sqrt(estimate.chi2_per_dof)  # NaN stays NaN
    unit, rms = estimate.misfit_unit, estimate.rms
    if triad.mean_output is not None and ratio > LIMITS.undecided_ratio:
        return _one_pose(name, estimate, UNUSABLE)
    words = misfit_words(unit, rms, ratio, estimate.scatter)
    grade = int(grade_misfit(unit, rms, ratio))
    named = estimate.follows in (LEVER_ARMS, FORCE)
    if named and grade == UNUSABLE:  # no other cause need be looked for
        left = f"{rms_text(unit, rms)} rms is left, {ratio:.{1 if ratio < 100 else 0}f} times the noise"
        cure = remedy(estimate.follows, estimate.estimator.triad)
        words = f"{left}, and most of it follows {estimate.follows}; {cure}"
    elif estimate.follows and grade != UNUSABLE:
        what = "rests differ" if unit == "rad" else words.partition(";")[0]
        held = (
            "The uncertainties take it for slow noise of the device"
            if estimate.slow_noise.probability > 0.5
            else "Parameters may be off by more than is stated"
        )
        words = (
            f"{what}, and most of it follows {estimate.follows}, so that it does not average out. "
            f"{held}; {remedy(estimate.follows, estimate.estimator.triad)}"
        )
        grade = ATTENTION
    return Finding("misfit", grade, f"{name}: {words}.")


def _one_pose(name: str, estimate: TriadResult, grade: int) -> Finding:
    """Rests of one pose that differ by far more than their noise."""
    ratio = math.sqrt(estimate.chi2_per_dof)
    beside = "beside the temperature's curve " if estimate.solution.curve.basis.size > 1 else ""
    text = (
        f"{name}: {beside}rests of one pose differ by {rms_text(estimate.misfit_unit, estimate.rms)} rms, "
        f"{ratio:.3g} times the noise: the device tilted, or its outputs wandered, and no parameter holds that."
    )
    return Finding("misfit", grade, text)


def _ended(name: str, estimate: TriadResult, result: DeviceResult) -> list[Finding]:
    """Channels whose range ends within what rests feel: the poses that would tell them best are not told."""
    ends: dict[str, list[str]] = {}
    for found in result.plausibility:
        evidence = dict(found.evidence)
        if found.kind == "saturation" and found.what.startswith(estimate.estimator.triad):
            if evidence.get("rows_at_rest"):
                ends.setdefault(found.what, []).append(f"{evidence['value']:.3g}".replace("-", "−"))
    unit = "m/s²" if estimate.estimator.triad == "accel" else "rad/s"
    return [
        Finding(
            "range",
            ATTENTION,
            f"{name}: {channel} ends at {' and '.join(values)} {unit} at rest; such rests are left out, so that this "
            "axis is told worst where it matters: record with a wider range.",
        )
        for channel, values in ends.items()
    ]


def _outliers(name: str, estimate: TriadResult) -> list[Finding]:
    """Single dwells far from all others, by the robust spread of the misfits."""
    relative = np.abs(np.asarray(estimate.misfit)) / np.maximum(np.asarray(estimate.sigma), 1e-300)
    worst = relative.max(axis=1)
    usual = max(float(np.median(relative)) / 0.6745, 1.0)
    far = np.flatnonzero(worst > LIMITS.outlier * usual)
    if not 0 < len(far) <= max(1, len(worst) // 10):
        return []
    times = ", ".join(_moment(estimate.dwells, int(k)) for k in far[:4])
    return [
        Finding(
            "rests",
            ATTENTION,
            f"{name}: {len(far)} of {len(worst)} dwells are {worst[far].max():.0f} sigma off (at "
            f"{times}): the device moved or was touched there, or a position is mislabelled.",
        )
    ]


def _moment(dwells: Dwells, k: int) -> str:
    """When a dwell was, and in which recording of the list where clocks begin anew."""
    time, rows = np.asarray(dwells.time), dwells.rows
    said = f"{float(time[k]):.0f} s"
    if rows is None or not np.any(np.diff(time) < 0.0):
        return said
    return f"{said} of recording {int(rows[k, 0]) + 1}"


# The weakest parameter -------------------------------------------------------------------------------


def weakest(
    triad: TriadCalibration, result: TriadResult, temperature_range: tuple[float, float] | None
) -> Weakest:
    """The parameter whose 1-sigma, anywhere in the range, moves the output most.

    A bias counts as it is, a matrix element times the largest input in the data (g, or the largest
    reference rate), g-sensitivity times 1 g.
    """
    grid = np.linspace(*temperature_range, GRID) if temperature_range is not None else np.zeros(1)
    _, sigmas = triad.over(grid)
    inputs = np.array([input_of(n, result) for n in triad.names])
    effect = sigmas * inputs
    row, column = np.unravel_index(int(np.argmax(effect)), effect.shape)
    name = triad.names[column]
    factor, unit = customary_units(triad)[column]
    sigma = factor * float(sigmas[row, column])
    return Weakest(
        label(name),
        f"{with_sigma(0.0, sigma)[1]} {unit}",
        None if temperature_range is None else float(grid[row]),
        float(effect[row, column]),
    )


def _weakest_finding(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> Judged:
    bounds = calibration.temperature_range
    unsure = unsure_finding(name, triad, bounds)
    if unsure is not None:
        return unsure, None
    text = weakest_sentence(name, weakest(triad, estimate, bounds))
    return Finding("weakest", FINE, text), None


def unsure_finding(
    name: str, triad: TriadCalibration, bounds: tuple[float, float] | None
) -> Finding | None:
    """The parameter whose sigma is largest against its usual size, where one is not small; `None` where all are.

    **Arguments:** `name` as in `TRIAD_NAMES`; `bounds` are the temperatures, °C, between which it is looked for.
    """
    grid = np.linspace(*bounds, GRID) if bounds is not None else np.zeros(1)
    values, sigmas = triad.over(grid)
    grades = grade_parameters(triad.names, values, sigmas)
    if grades.max() == FINE:
        return None
    relative = np.nan_to_num(sigmas / [usual_size(n) for n in triad.names], nan=np.inf)
    row, k = np.unravel_index(
        int(np.argmax(grades * 1e6 + np.minimum(relative, 1e5))), grades.shape
    )
    factor, unit = customary_units(triad)[k]
    value, sigma = with_sigma(factor * float(values[row, k]), factor * float(sigmas[row, k]))
    where = "" if bounds is None else f" at {grid[row]:.0f} °C"
    why = (
        "less certain than such errors are large, so that none would be as good"
        if grades[row, k] == UNUSABLE
        else "its uncertainty is not small against its size"
    )
    text = f"{name}: {label(triad.names[k])} is {value} ± {sigma} {unit}{where}: {why}."
    return Finding("weakest", int(grades[row, k]), text)


def weakest_sentence(name: str, found: Weakest) -> str:
    """The least certain parameter in words; `name` as in `TRIAD_NAMES`."""
    where = "" if found.temperature is None else f" (at {found.temperature:.0f} °C)"
    return f"{name}: least certain is {found.label}, ± {found.sigma}{where}."


# Mistakes --------------------------------------------------------------------------------------------


def _mistakes(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> list[Finding]:
    if triad.estimator == "static":
        return []
    bounds = calibration.temperature_range
    middle = 0.0 if bounds is None else float(np.mean(bounds))
    (values,), (sigmas,) = triad.over(np.array([middle]))
    mistakes = matrix_mistakes(triad.names, values, sigmas)
    found = [Finding(t, UNUSABLE, f"{name}: {said}") for t, said in mistakes]
    alike = None if found or triad.estimator != "gravity" else _common_scale(triad.names, values)
    return found if alike is None else [Finding("unit", ATTENTION, f"{name}: {alike}")]


# Relative: MEMS scale factors are within 3 % (L3G4200D, MPU-6050 data sheets), and each has an error of its own.
_NO_SENSOR, _ALIKE = 0.03, 0.2


def _common_scale(names: tuple[str, ...], values: np.ndarray) -> str | None:
    """In words that all three gyros are off alike, by more than sensors are; gravity's turns tell no clock from it."""
    own = [k for i in range(3) for k, n in enumerate(names) if n == f"gyro.matrix[{i},{i}]"]
    scales = values[own]
    common = float(np.mean(scales))
    if len(own) < 3 or abs(common) < _NO_SENSOR or np.std(scales) > _ALIKE * abs(common):
        return None
    return (
        f"all three read {1.0 + common:.3f} times the truth: the clock (stamps that are {abs(common):.1%} too "
        f"{'long' if common > 0 else 'short'}) or the range, for sensors differ from each other; check the sampling "
        "rate."
    )
