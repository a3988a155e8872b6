"""Is the calibration good? A short plain answer, what it rests on, and what to record next.

Judged are: the misfit against the dwells' noise; orientations, rates and temperatures that the data
cover; the parameter that is told worst; and signs of a mistake (an axis of the wrong sign, swapped axes,
a wrong unit, a rest that was none). Warnings of the estimation and of the screening of the recordings
(saturation, gaps, dead channels) count as well.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from .._typing import AnyArray, Scalar
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.quantities import customary_units, label, rms_text, with_sigma
from ..estimators import AbstractEstimator
from ..physics.temperature import Constant, Curve
from ..procedure.single_device import linearise, Problem
from ..reduction.dwells import Dwells
from .pipeline import DeviceResult, TriadResult


TRIAD_NAMES = {"accel": "Accelerometers", "gyro": "Gyros"}

_EMPTY = 60.0  # degrees; half angle of a cone without any orientation
_GAP = 0.3  # of the temperature range, without any dwell
_WRONG_SCALE = 0.2  # no sensor's scale factor is off by that: a unit or a range
_WRONG_AXIS = 0.3  # rad; no misalignment inside a device is that large
_OUTLIER = 5.0  # standard deviations of one dwell's misfit
_FAR = 3.0  # times the noise: the misfit asks for an explanation


class Finding(eqx.Module):
    """One thing that was looked at."""

    topic: str = eqx.field(static=True)  # misfit | orientations | rates | temperature | weakest | …
    fine: bool = eqx.field(static=True)
    text: str = eqx.field(static=True)  # one sentence


class Quality(eqx.Module):
    """The answer. `verdict` is "good", "usable" (something asks for attention) or "doubtful" (a sign of
    a mistake, which no uncertainty allows for)."""

    verdict: str = eqx.field(static=True)
    answer: str = eqx.field(static=True)  # one sentence
    findings: tuple[Finding, ...]
    next: tuple[str, ...] = eqx.field(static=True)  # what to record next, most useful first


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
    mistakes: list[Finding] = []
    for triad, estimate in _both(result):
        name = TRIAD_NAMES[estimate.estimator.triad]
        mistakes += _mistakes(name, triad, estimate, result.calibration)
        findings.append(_misfit(name, estimate))
        for topic in (_orientations, _rates, _temperatures, _weakest_finding):
            finding, wanted = topic(name, triad, estimate, result.calibration)
            findings += [] if finding is None else [finding]
            advice += [] if wanted is None else [wanted]
        findings += _outliers(name, estimate)
    findings += [Finding("warning", False, w[0].upper() + w[1:]) for w in result.warnings]
    every = (*mistakes, *findings)
    poor = [f for f in every if not f.fine]
    if mistakes:
        verdict, answer = "doubtful", f"Do not use it yet: {_lower(mistakes[0].text)}"
    elif poor:
        verdict, answer = "usable", f"Usable, with a reservation: {_lower(poor[0].text)}"
    else:
        verdict = "good"
        answer = "Good: the model explains the data, and the data cover what the model needs."
    return Quality(verdict, answer, every, tuple(dict.fromkeys(advice)))


def _both(result: DeviceResult) -> list[tuple[TriadCalibration, TriadResult]]:
    pairs = (
        (result.calibration.accel, result.accel),
        (result.calibration.gyro, result.gyro),
    )
    return [(c, r) for c, r in pairs if c is not None and r is not None]


def _lower(text: str) -> str:
    return text[0].lower() + text[1:]


# Misfit ----------------------------------------------------------------------------------------------


def _misfit(name: str, estimate: TriadResult) -> Finding:
    rms = rms_text(estimate.misfit_unit, estimate.rms)
    chi2 = estimate.chi2_per_dof
    if not math.isfinite(chi2):
        return Finding("misfit", True, f"{name}: {rms} rms is left; the noise itself is not known.")
    times = math.sqrt(chi2)
    fine = estimate.scatter == 0.0 or times < _FAR
    words = "as the noise predicts" if estimate.scatter == 0.0 else f"{times:.1f} times the noise"
    return Finding("misfit", fine, f"{name}: {rms} rms is left, {words}.")


def _outliers(name: str, estimate: TriadResult) -> list[Finding]:
    """Single dwells far from all others, by the robust spread of the misfits."""
    relative = np.abs(np.asarray(estimate.misfit)) / np.maximum(np.asarray(estimate.sigma), 1e-300)
    worst = relative.max(axis=1)
    usual = max(float(np.median(relative)) / 0.6745, 1.0)
    far = np.flatnonzero(worst > _OUTLIER * usual)
    if not 0 < len(far) <= max(1, len(worst) // 10):
        return []
    times = ", ".join(f"{float(estimate.dwells.time[k]):.0f} s" for k in far[:4])
    return [
        Finding(
            "rests",
            False,
            f"{name}: {len(far)} of {len(worst)} dwells are {worst[far].max():.0f} sigma off (at "
            f"{times}): the device moved or was touched there, or a position is mislabelled.",
        )
    ]


# Coverage --------------------------------------------------------------------------------------------

_Judged = tuple[Finding | None, str | None]


def _orientations(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> _Judged:
    del calibration
    if triad.estimator == "static" or not name.startswith("Acc"):
        return None, None
    directions = _directions(estimate.dwells)
    angle, emptiest = empty_cone(directions)
    fine = angle <= _EMPTY
    text = (
        f"{name}: {len(directions)} orientations; the largest cone without any has a half angle of "
        f"{angle:.0f}°."
    )
    wanted = _next_orientation(estimate)
    if wanted is None and not fine:
        wanted = emptiest
    advice = None if wanted is None else f"{name}: a rest with {_in_axes(wanted)} up."
    return Finding("orientations", fine, text), advice


def _directions(dwells: Dwells) -> Float[np.ndarray, "dwell 3"]:
    resting = np.asarray(dwells.position) >= 0
    chosen = dwells.accel if dwells.accel is not None else dwells.reference_accel
    force = np.asarray(chosen)[resting] if chosen is not None else np.zeros((0, 3))
    return force / np.linalg.norm(force, axis=1, keepdims=True)


def empty_cone(
    directions: Float[np.ndarray, "dwell 3"],
) -> tuple[float, Float[np.ndarray, "3"]]:
    """Half angle (degrees) and axis of the largest cone that no direction is in."""
    grid = _grid()
    if len(directions) == 0:
        return 180.0, grid[0]
    nearest = np.max(grid @ directions.T, axis=1)
    at = int(np.argmin(nearest))
    return float(np.rad2deg(np.arccos(np.clip(nearest[at], -1.0, 1.0)))), grid[at]


def _grid(number: int = 400) -> Float[np.ndarray, "direction 3"]:
    """Directions spread evenly over the sphere (Fibonacci's spiral)."""
    k = np.arange(number) + 0.5
    z, turn = 1.0 - 2.0 * k / number, np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def _next_orientation(estimate: TriadResult) -> Float[np.ndarray, "3"] | None:
    """The orientation whose rest would make the worst parameter most certain; None where it would
    gain less than a tenth."""
    dwells, solution = estimate.dwells, estimate.solution
    if dwells.accel is None or not np.all(np.isfinite(np.asarray(solution.covariance))):
        return None
    middle = int(np.argsort(np.asarray(dwells.temperature))[dwells.num_dwells // 2])
    problem = Problem(estimate.estimator, solution.curve.basis, dwells)
    gravity = float(np.median(np.linalg.norm(np.asarray(dwells.accel), axis=1)))
    grid = _grid(100)
    jacobian = _rest_jacobians(problem, solution.curve.coefficients, middle, gravity * grid)
    if not np.all(np.isfinite(jacobian)):  # dwells without a noise figure, and none found
        return None
    spread = np.kron(problem.phi[middle][:, None], np.eye(jacobian.shape[2]))
    covariance = spread.T @ np.asarray(solution.covariance) @ spread
    inputs = np.array([_input(n, estimate) for n in estimate.estimator.names])
    before = np.sqrt(np.diagonal(covariance)) * inputs
    after = []
    for j in jacobian:
        gain = covariance @ j.T @ np.linalg.inv(np.eye(len(j)) + j @ covariance @ j.T)
        left = np.diagonal(covariance - gain @ j @ covariance)
        after.append(np.max(np.sqrt(np.maximum(left, 0.0)) * inputs))
    best = int(np.argmin(after))
    return grid[best] if after[best] < 0.9 * before.max() else None


def _rest_jacobians(
    problem: Problem, coefficients: AnyArray, middle: int, forces: Float[np.ndarray, "rest 3"]
) -> Float[np.ndarray, "rest row parameter"]:
    """Residual Jacobians of rests like the dwell `middle` but with each specific force."""
    # As many dwells as the problem has, so that the program that is there already serves.
    rows = np.arange(max(len(forces), len(problem.phi))) % len(forces)
    like = jax.tree.map(lambda x: np.repeat(np.asarray(x)[[middle]], len(rows), 0), problem.dwells)
    given = [k for k in ("accel", "reference_accel") if getattr(like, k) is not None]
    rests = eqx.tree_at(
        lambda d: [d.valid, *(getattr(d, k) for k in given)],
        like,
        [np.ones(len(rows), bool), *[forces[rows]] * len(given)],
    )
    vectors = np.repeat(problem.vectors(coefficients)[[middle]], len(rows), 0)
    return np.asarray(linearise(problem.estimator, vectors, rests)[1])[: len(forces)]


def _in_axes(direction: Float[np.ndarray, "3"]) -> str:
    """A direction in words: the device's axes that point up, largest part first."""
    order = np.argsort(-np.abs(direction))
    kept = [k for k in order if abs(direction[k]) > 0.35]
    return " and ".join(f"{'+' if direction[k] > 0 else '−'}{'xyz'[k]}" for k in kept)


def _rates(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> _Judged:
    del calibration
    if not name.startswith("Gyro"):
        return None, None
    if triad.estimator == "static":
        text = f"{name}: bias only; scale factors and misalignments were not calibrated."
        return Finding(
            "rates", True, text
        ), f"{name}: tilts by hand between rests, or a rate table."
    if triad.estimator == "gravity":
        motion = estimate.dwells.motion
        count = 0 if motion is None else int(np.sum(np.asarray(motion.valid)))
        fine = count >= 12
        advice = None if fine else f"{name}: more tilts between rests, about all three axes."
        return Finding("rates", fine, f"{name}: {count} motions between rests are used."), advice
    rates = np.asarray(estimate.dwells.reference_gyro)
    low, high = np.rad2deg(rates.min(axis=0)), np.rad2deg(rates.max(axis=0))
    lacking = [
        f"{sign}{axis}"
        for k, axis in enumerate("xyz")
        for sign, value in (("+", high[k]), ("−", -low[k]))
        if value < 0.5 * np.max(np.abs([low, high]))
    ]
    text = f"{name}: rates from {low.min():.3g} to {high.max():.3g} deg/s"
    if not lacking:
        return Finding("rates", True, f"{text}, both ways about every axis."), None
    about = ", ".join(lacking)
    return Finding("rates", False, f"{text}, but none such about {about}."), (
        f"{name}: turns about {about} at the rates of the other axes."
    )


def _temperatures(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> _Judged:
    if calibration.temperature_range is None or isinstance(triad.curve.basis, Constant):
        return None, None
    ordered = np.sort(np.asarray(estimate.dwells.temperature))
    span = float(ordered[-1] - ordered[0])
    gaps = np.diff(ordered)
    at = int(np.argmax(gaps))
    text = f"{name}: {ordered[0]:.0f} to {ordered[-1]:.0f} °C"
    if gaps[at] <= _GAP * span:
        return Finding("temperature", True, f"{text} without a large gap."), None
    between = f"{ordered[at]:.0f} and {ordered[at + 1]:.0f} °C"
    return (
        Finding("temperature", False, f"{text}, but nothing between {between}."),
        f"{name}: an experiment at about {0.5 * (ordered[at] + ordered[at + 1]):.0f} °C.",
    )


# The weakest parameter -------------------------------------------------------------------------------


def weakest(
    triad: TriadCalibration, result: TriadResult, temperature_range: tuple[float, float] | None
) -> Weakest:
    """The parameter whose 1-sigma, anywhere in the range, moves the output most.

    A bias counts as it is, a matrix element times the largest input in the data (g, or the largest
    reference rate), g-sensitivity times 1 g.
    """
    grid = np.linspace(*temperature_range, 25) if temperature_range is not None else np.zeros(1)
    _, sigmas = triad.over(grid)
    inputs = np.array([_input(n, result) for n in triad.names])
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


def _input(name: str, result: TriadResult) -> float:
    if ".matrix" not in name:
        return 1.0
    if name.startswith("accel"):
        return 9.81
    reference = result.dwells.reference_gyro
    if reference is None:
        return 1.0
    return float(np.max(np.linalg.norm(np.asarray(reference), axis=1)))


def _weakest_finding(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> _Judged:
    found = weakest(triad, estimate, calibration.temperature_range)
    where = "" if found.temperature is None else f" (at {found.temperature:.0f} °C)"
    text = f"{name}: least certain is {found.label}, ± {found.sigma}{where}."
    return Finding("weakest", math.isfinite(found.effect), text), None


# Mistakes --------------------------------------------------------------------------------------------


def _mistakes(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> list[Finding]:
    if triad.estimator == "static":
        return []
    bounds = calibration.temperature_range
    middle = 0.0 if bounds is None else float(np.mean(bounds))
    matrix = np.asarray(_matrix(estimate.estimator, triad.curve, np.asarray(middle)))
    found: list[Finding] = []
    for k, axis in enumerate("xyz"):
        if matrix[k, k] < -0.5:
            found.append(_mistake("sign", f"{name}: axis {axis} has the wrong sign."))
        elif abs(matrix[k, k]) > _WRONG_SCALE:
            times = 1.0 + matrix[k, k]
            text = f"{name}: axis {axis} reads {times:.3g} times the truth; look at unit and range."
            found.append(_mistake("unit", text))
    off = np.abs(matrix - np.diag(np.diagonal(matrix)))
    if off.max() > _WRONG_AXIS and not any(f.topic == "sign" for f in found):
        i, j = np.unravel_index(int(np.argmax(off)), off.shape)
        text = f"{name}: axis {'xyz'[i]} reads much of axis {'xyz'[j]}; are axes swapped or turned?"
        found.insert(0, _mistake("frame", text))
    return found


@eqx.filter_jit  # one program instead of one for each step
def _matrix(estimator: AbstractEstimator, curve: Curve, temperature: Scalar) -> Float[Array, "3 3"]:
    return estimator.unpack(curve(temperature)).matrix


def _mistake(topic: str, text: str) -> Finding:
    return Finding(topic, False, text)
