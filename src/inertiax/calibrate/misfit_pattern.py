"""Whether what is left of a fit follows something that a sensor's error follows: then it does not average out.

Scatter between dwells is taken into the uncertainties as if it were drawn anew for each dwell. Where it follows the
running time, the force or its square it is the same wherever that is the same, and a bias may be ten of the stated
sigmas off while everything else looks well. `diagnose` tells what it is; here is asked only whether it is there.

Over less than `LEAST_SPAN` parameters are constants, and what biases do with temperature is in none of them. Few rests
hide most of it: nine parameters of 18 rests follow it, and what is left may be as noise predicts.
"""

from collections.abc import Iterator

import numpy as np
import scipy.linalg
import scipy.special
from jaxtyping import Float

from .._jax import jax
from ..estimators import AbstractEstimator, Invariant, ReferenceAccel, ReferenceGyro
from ..model_selection.model_spec import LEAST_SPAN
from ..physics.temperature import AbstractBasis, Constant
from ..physics.wgs84 import EARTH_RATE
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from ..reduction.rig_errors import positionings, turned_by
from .untold_earth import is_no_more, no_reference_tells


# Chance of a false word where scatter was found and is white. Real scatter is not quite, and is most of what is looked
# at here; a word costs no more than a diagnosis. Convention.
RARE = 1e-3
# Part of the scatter that must be explained by it: else it is not what the uncertainties are made of. Convention.
MOST = 0.5
# rad/s: slower references show no scale factor, and so nothing that goes with the square of the rate. Convention.
SLOW = 0.1

# Of the Earth's rate: its vertical part from six degrees of latitude on, and how alike rests tell it. Convention.
_TOLD = 0.1
# Chance above which the eight numbers by which a g-sensitivity is not alike on all axes are noise. Convention.
ALIKE = 1e-2
# °C; over less a usual bias (0.2 mg/°C) moves by less than 0.2 mm/s², the noise of a rest of some seconds. Convention.
WARMED = 0.1
# Chance of a false word where the temperature moved: there a slope is what to expect, 5 mm/s² per °C in cheap sensors.
EXPECTED = 0.05
# m/s² and rad/s per °C, the steepest slope of a bias that is looked for: cheap sensors over their range (InvenSense,
# MPU-6050 product specification: 35 mg over 70 °C, 20 °/s over 125 °C). What takes more is nothing that so small a
# change of temperature does.
STEEPEST = {"accel": 5e-3, "gyro": 3e-3}

LEVER_ARMS = "ω²r of a lever arm"
FORCE = "the specific force"
FORCE_OR_EARTH = "the specific force, by no more than the Earth's rate would that a reference lacks"
FORCE_OR_HEADING = (
    "the specific force, by no more than the Earth's rate makes, whose heading no reference tells"
)
VERTICAL = (
    "the vertical, as where [site] latitude is another, or a g-sensitivity is alike on all axes"
)
POSITIONING = "how the case lies at each positioning, which differs by"
_TEMPERATURE = "the temperature, which moved by"


def misfit_pattern(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    coefficients: Float[np.ndarray, "size parameter"],
    dwells: Dwells,
) -> str:
    r"""What the scatter between dwells follows, in words; empty where it follows nothing that is looked for.

    For each driver d (the running time, the square of the input) a bias of each axis in proportion to it is tried:
    columns $\partial r/\partial b_i\, d_i$ of the whitened residual r, beside the model's own columns; of
    accelerometers on a turning table, too, what one lever arm adds; and where no rig states it, three angles of each
    positioning that several dwells share. Said is the driver with the rarest F ratio, where it is rarer than `RARE`
    and takes more than `MOST` of what is beyond the dwells' noise. Where constants were fitted over a temperature
    that moves by `WARMED` to `LEAST_SPAN`, it is tried first, with or without scatter: said where it is rarer than
    `EXPECTED` and slopes of `STEEPEST` at most take more than `MOST`. Gyros are tried against the specific force, too,
    where no g-sensitivity is estimated: on a table all means, of those that are calibrated by gravity's rotation the
    means at rest.

    **Arguments:** the estimator with the scatter between dwells that was found, and the curve that was fitted. Nothing
    else is looked for without scatter, nor anything in a static fit, which has no input. An ordinary F test; no source.
    """
    if dwells.motion is not None:
        return _of_rests(estimator, basis, dwells)
    if not isinstance(estimator, (Invariant, ReferenceAccel, ReferenceGyro)):
        return ""
    problem = Problem(estimator, basis, dwells)
    model, residual = problem.rows(coefficients)
    now = problem.at(coefficients)
    temperature = np.asarray(dwells.temperature)
    span = float(np.ptp(temperature))
    if isinstance(basis, Constant) and WARMED <= span < LEAST_SPAN:
        columns = _biases(estimator, now.jacobian, (temperature - temperature.mean())[:, None])
        chance, share = _f_test(model, residual, columns)
        by_usual = _explained(model, residual, columns, STEEPEST[estimator.triad])
        if chance < EXPECTED and min(share, by_usual) > MOST:
            return f"{_TEMPERATURE} {span:.2f} °C"
    if not float(estimator.scatter) > 0.0:
        return ""
    beyond = 1.0 - np.square(now.sigma).sum() / max(np.square(now.misfit).sum(), 1e-300)
    trials = dict(_trials(estimator, problem, now.jacobian))
    if FORCE in trials and _holds_earth_rate(dwells):
        # A rate along the vertical is a bias of each axis in proportion to the force on it, all of one size.
        upward = trials[FORCE][:, [0, 4, 8]].sum(axis=1, keepdims=True)
        beside = np.concatenate([model, upward], axis=1)
        if _f_test(beside, residual, trials[FORCE])[0] > ALIKE:
            trials[VERTICAL] = upward
            del trials[FORCE]
    elif FORCE in trials and not _beyond_earth(model, residual, trials[FORCE]):
        trials[FORCE_OR_EARTH] = trials.pop(FORCE)
    found = [(*_f_test(model, residual, columns), name) for name, columns in trials.items()]
    turned = _of_positionings(estimator, problem, now.jacobian)
    if turned is not None:
        angle = float(np.degrees(typical_size(model, residual, turned))) * 3600.0
        size = f"{float(f'{angle:.2g}'):g} arcsec"
        found.append((*_f_test(model, residual, turned), f"{POSITIONING} {size} (1 sigma)"))
    chance, share, name = min(found, default=(1.0, 0.0, ""))
    return name if chance < RARE and share > MOST * beyond else ""


def remedy(follows: str, triad: str) -> str:
    """What to do about that in a `triad`, in words."""
    if follows == LEVER_ARMS:
        return "set lever_arms = true under [model], and it is estimated"
    if follows == FORCE and triad == "gyro":
        return "set g_sensitivity = true under [model], and it is estimated"
    if follows == VERTICAL:
        return "look at [site] latitude first: g_sensitivity = true takes its error in and leaves it in the biases"
    if follows == FORCE_OR_EARTH:
        return "[site] latitude gives it to a table's angles; else 'inertiax diagnose' looks for the cause"
    if follows == FORCE_OR_HEADING:
        return (
            "a g-sensitivity would take that rate in, which is no property of the gyros; a table's angles with "
            "[site] latitude tell them apart"
        )
    if follows.startswith(POSITIONING):
        return "write that under [rig] as position_uncertainty, and ± holds it"
    if follows_temperature(follows):
        return "constants leave out what biases do with temperature"
    return "'inertiax diagnose' looks for the cause"


def follows_temperature(follows: str) -> bool:
    """Whether an answer of `misfit_pattern` is that the biases moved with a temperature that constants leave out."""
    return follows.startswith(_TEMPERATURE)


def _f_test(
    model: Float[np.ndarray, "row unknown"],
    residual: Float[np.ndarray, " row"],
    columns: Float[np.ndarray, "row column"],
) -> tuple[float, float]:
    """Chance that as much of the whitened residual is explained by noise, and the part of its square."""
    frame = _span(model)
    residual = residual - frame @ (frame.T @ residual)
    own = _span(columns - frame @ (frame.T @ columns))
    size, dof = own.shape[1], len(residual) - frame.shape[1] - own.shape[1]
    if size == 0 or dof < size:
        return 1.0, 0.0
    drop, total = float(np.square(own.T @ residual).sum()), float(residual @ residual)
    ratio = (drop / size) / max((total - drop) / dof, 1e-300)
    return float(scipy.special.fdtrc(size, dof, ratio)), drop / max(total, 1e-300)


def _explained(
    model: Float[np.ndarray, "row unknown"],
    residual: Float[np.ndarray, " row"],
    columns: Float[np.ndarray, "row column"],
    most: float,
) -> float:
    """Part of the whitened residual's square that the columns take beside a model, none with more than `most`."""
    from scipy.optimize import lsq_linear  # slow to import, and seldom needed

    frame = _span(model)
    residual = residual - frame @ (frame.T @ residual)
    off = columns - frame @ (frame.T @ columns)
    found = lsq_linear(off, residual, (-most, most))
    return 1.0 - 2.0 * float(found.cost) / max(float(residual @ residual), 1e-300)


def _trials(
    estimator: AbstractEstimator,
    problem: Problem,
    jacobian: Float[np.ndarray, "dwell row parameter"],
) -> Iterator[tuple[str, Float[np.ndarray, "row axis"]]]:
    """What may be followed, in words, with whitened columns of a bias in proportion to it."""
    scaled = lambda driver: _biases(estimator, jacobian, driver)
    dwells, many = problem.dwells, problem.num_dwells
    time = np.asarray(dwells.time)[:many]
    yield "the running time", scaled((time - time.mean())[:, None] / (np.ptp(time) + 1e-300))
    turning = np.asarray(dwells.reference_gyro if dwells.reference_gyro is not None else [0.0])[
        :many
    ]
    turns = np.abs(turning).max() > SLOW
    if estimator.triad == "accel" and turns:
        # ω × (ω × r) = (ω ωᵀ − ω² E) r, of one r for the three elements.
        square = np.sum(turning**2, axis=1)[:, None, None] * np.eye(3)
        pull = turning[:, :, None] * turning[:, None, :] - square
        rows = np.stack([_biases(estimator, jacobian, p) for p in pull.transpose(2, 0, 1)])
        yield LEVER_ARMS, rows.sum(axis=2).T
    if estimator.triad == "accel":
        yield "the square of the force", scaled(np.square(np.asarray(dwells.accel)[:many]))
        return
    if turns:
        yield "the square of the rate", scaled(np.square(turning))
    felt = dwells.accel if dwells.accel is not None else dwells.reference_accel
    if felt is not None and not any("g_sensitivity" in name for name in estimator.names):
        force = np.asarray(felt)[:many]
        yield FORCE, np.concatenate([scaled(force[:, j, None]) for j in range(3)], axis=1)


def _of_positionings(
    estimator: AbstractEstimator,
    problem: Problem,
    jacobian: Float[np.ndarray, "dwell row parameter"],
) -> Float[np.ndarray, "rows angle"] | None:
    """Whitened columns of small angles, rad, by which the case is turned at each positioning of several dwells; `None`
    where there are none, or the rig states them."""
    reference = getattr(problem.dwells, f"reference_{estimator.triad}")
    if reference is None or problem.shared is not None or isinstance(estimator, Invariant):
        return None
    count = problem.num_dwells
    dwells = jax.tree.map(lambda x: np.asarray(x)[:count], problem.dwells)
    number = positionings(dwells)
    if not np.any(number >= 0):
        return None
    turned = turned_by(np.asarray(reference, float)[:count])
    made = []
    for own in np.unique(number[number >= 0]):
        mine = np.where(number == own, 1.0, 0.0)[:, None]
        for j in range(3):
            # A reference that is changed by δ leaves the misfit that a bias of −δ does, but for the matrix' percents.
            made.append(_biases(estimator, jacobian, -mine * turned[:, :, j]).sum(axis=1))
    return np.stack(made, axis=1)


def typical_size(
    model: Float[np.ndarray, "row unknown"],
    residual: Float[np.ndarray, " row"],
    columns: Float[np.ndarray, "row column"],
) -> float:
    r"""Standard deviation of independent coefficients of whitened columns that a residual shows beside a model.

    With $B$ the columns off the model's span, of rank $q$, and $s^2$ what is left for each degree of freedom, the
    residual's square is expected to drop by $\alpha^2 \lVert B \rVert_F^2 + q s^2$: by moments.
    """
    frame = _span(model)
    off = columns - frame @ (frame.T @ columns)
    residual = residual - frame @ (frame.T @ residual)
    own = _span(off)
    drop = float(np.square(own.T @ residual).sum())
    left = len(residual) - frame.shape[1] - own.shape[1]
    noise = (float(residual @ residual) - drop) / max(left, 1)
    square = (drop - own.shape[1] * noise) / max(float(np.square(off).sum()), 1e-300)
    return float(np.sqrt(max(square, 0.0)))


def _holds_earth_rate(dwells: Dwells) -> bool:
    """Whether a reference of rates has one part along the vertical at all rests, as the Earth's rate is."""
    reference, force = dwells.reference_gyro, dwells.accel
    if reference is None or force is None:
        return False
    rest = np.linalg.norm(reference, axis=1) < 2.0 * EARTH_RATE
    if not rest.any():
        return False
    up = np.asarray(force)[rest] / np.linalg.norm(np.asarray(force)[rest], axis=1, keepdims=True)
    vertical = np.sum(np.asarray(reference)[rest] * up, axis=1)
    level = float(np.median(vertical))
    return abs(level) > _TOLD * EARTH_RATE and bool(
        np.median(np.abs(vertical - level)) < _TOLD * abs(level)
    )


def _beyond_earth(
    model: Float[np.ndarray, "row unknown"],
    residual: Float[np.ndarray, " row"],
    columns: Float[np.ndarray, "row column"],
) -> bool:
    """Whether a bias in proportion to the force is more than a reference without the Earth's rate would leave: the part
    of that along the vertical goes with the force."""
    both = np.concatenate([model, columns], axis=1)
    size = np.linalg.norm(both, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    each = np.linalg.lstsq(both / size, residual)[0] / size
    return not is_no_more(9.8 * each[model.shape[1] :])


def _biases(
    estimator: AbstractEstimator,
    jacobian: Float[np.ndarray, "dwell row parameter"],
    driver: Float[np.ndarray, "dwell one_or_three"],
) -> Float[np.ndarray, "rows 3"]:
    """Whitened columns of biases in proportion to a driver, of each axis or (dwell, 1) of all."""
    places = [estimator.names.index(f"{estimator.triad}.bias[{i}]") for i in range(3)]
    return (jacobian[:, :, places] * driver[:, None, :]).reshape(-1, 3)


def _of_rests(estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells) -> str:
    """The same of the gyros' means at rest, whose covariance holds their scatter already."""
    if any("g_sensitivity" in name for name in estimator.names) or dwells.accel is None:
        return ""
    phi = basis.rows(np.asarray(dwells.temperature))
    force = np.asarray(dwells.accel) / 9.8
    weight = 1.0 / np.sqrt(np.diagonal(np.asarray(dwells.gyro_covariance), axis1=1, axis2=2))
    rows = list(zip(np.asarray(dwells.gyro).T, weight.T, strict=True))
    chance, share = min(_f_test(phi * w[:, None], y * w, force * w[:, None]) for y, w in rows)
    if not (chance < RARE / 3.0 and share > MOST):
        return ""
    if not no_reference_tells(dwells.reference_gyro):
        return FORCE
    both = np.concatenate([phi, force], axis=1)
    each = [np.linalg.lstsq(both * w[:, None], y * w)[0][phi.shape[1] :] for y, w in rows]
    return FORCE_OR_HEADING if is_no_more(np.concatenate(each)) else FORCE


def _span(columns: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row direction"]:
    """Orthonormal basis of what the columns span, each counted in its own unit."""
    size = np.linalg.norm(columns, axis=0)
    return scipy.linalg.orth(columns[:, size > 0.0] / size[size > 0.0], rcond=1e-9)
