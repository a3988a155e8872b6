"""What the dwells cover: orientations, rates and temperatures, and what to record next."""

import numpy as np
from jaxtyping import Float

from .._jax import eqx, jax
from .._typing import AnyArray
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.quantities import rms_text
from ..estimators import NOMINAL_SIGMA
from ..physics.directions import nearest_by_hand, up_in_words
from ..physics.temperature import Constant
from ..procedure.single_device import linearise, Problem
from ..reduction.dwells import Dwells
from .between_dwell_variance import noise_is_untold
from .goodness_of_fit import ATTENTION, Finding, FINE, LIMITS
from .results import TriadResult


Judged = tuple[Finding | None, str | None]

ONE_TEMPERATURE = 1.0  # °C, less than a recording at one temperature moves. Convention.

_SHORT = (
    3.0  # s of rest in all, which a log of a device that is carried may hold by chance. Convention.
)

# Of one pose over a range of temperatures, which tells changes of the biases alone.
_JOIN = (
    "A log turned by hand at one temperature, calibrated for itself; `inertiax export HAND/calibration.json --warm-up "
    "THIS/calibration.json --to FORMAT` joins both."
)


# Cosine from which a rest is in an orientation: a hand sets it down no better than to 10°.
_THERE = float(np.cos(np.radians(10.0)))


def orientations(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> Judged:
    """Whether the rests leave no large cone of orientations out, and the orientation to add."""
    if not name.startswith("Acc"):
        return None, None
    if triad.estimator == "static":
        return None, _JOIN if _warms_in_one_pose(calibration) else None
    directions = _directions(estimate.dwells)
    angle, emptiest = empty_cone(directions)
    fine = angle <= LIMITS.empty_cone
    text = (
        f"{name}: {len(directions)} orientations; the largest cone without any has a half angle of "
        f"{angle:.0f}°."
    )
    wanted = _next_orientation(estimate)
    if wanted is None and not fine:
        wanted = emptiest
    advice = None
    if wanted is not None:
        wanted = nearest_by_hand(wanted)
        a = "another" if len(directions) and np.max(directions @ wanted) > _THERE else "a"
        advice = f"{name}: {a} rest {up_in_words(wanted)}."
    return Finding("orientations", FINE if fine else ATTENTION, text), advice


def redundancy(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> Judged:
    """Whether more equations than unknowns are left, so that the misfit tests the model."""
    del calibration
    if triad.estimator == "static" or estimate.dwells.motion is not None:
        return None, None
    rows, unknowns = np.asarray(estimate.misfit).size, np.asarray(triad.curve.coefficients).size
    if rows > unknowns:
        return None, None
    text = f"{name}: {rows} equations tell {unknowns} parameters, so that nothing is left to test the fit by"
    if noise_is_untold(estimate.dwells, rows - unknowns):
        text += f"; no row tells its noise either, and ± is for {rms_text(estimate.misfit_unit, NOMINAL_SIGMA)} in each"
    text += "."
    return Finding("redundancy", ATTENTION, text), None


def _warms_in_one_pose(calibration: Calibration) -> bool:
    """Whether the accelerometers' biases count from their mean output, over a range of temperatures."""
    return calibration.accel is not None and calibration.accel.mean_output is not None


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
    inputs = np.array([input_of(n, estimate) for n in estimate.estimator.names])
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
    like = jax.tree.map(
        lambda x: np.repeat(np.asarray(x)[[middle]], len(forces), 0), problem.dwells
    )
    given = [k for k in ("accel", "reference_accel") if getattr(like, k) is not None]
    rests = eqx.tree_at(
        lambda d: [d.valid, *(getattr(d, k) for k in given)],
        like,
        [np.ones(len(forces), bool), *[forces] * len(given)],
    )
    vectors = np.repeat(problem.vectors(coefficients)[[middle]], len(forces), 0)
    return linearise(problem.estimator, vectors, rests).jacobian


def rates(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> Judged:
    """Whether the turns tell all axes of the gyros, and those to add."""
    if not name.startswith("Gyro"):
        return None, None
    if triad.estimator == "static":
        text = f"{name}: bias only; scale factors and misalignments were not calibrated."
        tilts = f"{name}: tilts by hand between rests, or a rate table."
        advice = _JOIN if _warms_in_one_pose(calibration) else tilts
        seconds = float(
            np.asarray(estimate.dwells.duration)[np.asarray(estimate.dwells.valid)].sum()
        )
        if seconds < _SHORT:
            text = (
                f"{name}: {seconds:.2g} s of rest in all, in which a hand or a vehicle turns unseen, so that biases "
                "may be off by tenths of a degree per second; record 10 s on a table."
            )
            return Finding("rates", ATTENTION, text), advice
        return Finding("rates", FINE, text), advice
    if triad.estimator == "gravity":
        motion = estimate.dwells.motion
        count = 0 if motion is None else int(np.sum(np.asarray(motion.valid)))
        fine = count >= LIMITS.motions
        advice = None if fine else f"{name}: more tilts between rests, about all three axes."
        text = f"{name}: {count} motions of any size between undisturbed rests are used."
        return Finding("rates", FINE if fine else ATTENTION, text), advice
    if estimate.dwells.reference_gyro is None:
        return None, None
    known = np.asarray(estimate.dwells.reference_gyro)
    low, high = np.rad2deg(known.min(axis=0)), np.rad2deg(known.max(axis=0))
    lacking = [
        f"{sign}{axis}"
        for k, axis in enumerate("xyz")
        for sign, value in (("+", high[k]), ("−", -low[k]))
        if value < 0.5 * np.max(np.abs([low, high]))
    ]
    text = f"{name}: rates from {low.min():.3g} to {high.max():.3g} deg/s"
    if not lacking:
        return Finding("rates", FINE, f"{text}, both ways about every axis."), None
    about = ", ".join(lacking)
    return Finding("rates", ATTENTION, f"{text}, but none such about {about}."), (
        f"{name}: turns about {about} at the rates of the other axes."
    )


def temperatures(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> Judged:
    """Whether the dwells leave no large part of the temperature range out, and where to add some."""
    if calibration.temperature_range is None or isinstance(triad.curve.basis, Constant):
        return None, None
    ordered = np.sort(np.asarray(estimate.dwells.temperature))
    found = gap_finding(name, ordered, each_of_one=_a_temperature_each(estimate))
    if found.fine:
        return found, None
    at = int(np.argmax(np.diff(ordered)))
    return (
        found,
        f"{name}: an experiment at about {0.5 * (ordered[at] + ordered[at + 1]):.0f} °C.",
    )


def gap_finding(
    name: str, ordered: Float[np.ndarray, " dwell"], *, each_of_one: bool = False
) -> Finding:
    """Whether rising temperatures, °C, leave a large part of their range out.

    **Arguments:** `name` as in `fit_quality.TRIAD_NAMES`; `each_of_one` says that each recording has one temperature.
    """
    gaps = np.diff(ordered)
    at = int(np.argmax(gaps))
    text = f"{name}: {round(float(ordered[0]))} to {round(float(ordered[-1]))} °C"  # never -0
    if gaps[at] <= LIMITS.temperature_gap * (ordered[-1] - ordered[0]):
        return Finding("temperature", FINE, f"{text} without a large gap.")
    between = f"{ordered[at]:.0f} and {ordered[at + 1]:.0f} °C"
    if each_of_one:
        between += (
            ", and each recording has one temperature: where the device was switched off between them, what a "
            "switching on changes cannot be told from what the temperature does, and is in the slopes"
        )
    return Finding("temperature", ATTENTION, f"{text}, but nothing between {between}.")


def _a_temperature_each(estimate: TriadResult) -> bool:
    """Whether several recordings were each made at one temperature, and in one experiment each."""
    rows = estimate.dwells.rows
    if rows is None:
        return False
    recording, temperature = np.asarray(rows)[:, 0], np.asarray(estimate.dwells.temperature)
    spans = [np.ptp(temperature[recording == k]) for k in np.unique(recording)]
    return len(spans) > 1 and bool(max(spans) < ONE_TEMPERATURE)


def input_of(name: str, result: TriadResult) -> float:
    """What a parameter acts on, by the data: 9.81 m/s² or the largest reference rate, rad/s; 1 for biases and D."""
    if ".matrix" not in name:
        return 1.0
    if name.startswith("accel"):
        return 9.81
    reference = result.dwells.reference_gyro
    if reference is None:
        return 1.0
    return float(np.max(np.linalg.norm(np.asarray(reference), axis=1)))
