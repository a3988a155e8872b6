"""The magnetometers' estimate: hard and soft iron over temperature, in the frame of the accelerometers.

The ellipsoid comes first, in the triad's own frame, from rests and samples in motion alike. Where rests with a known
vertical determine it, the rotation to the accelerometers follows in closed form, and one least squares over both
residuals ends it. Hard iron has its own degree over temperature and soft iron a lower one or the same, both by the
Bayesian information criterion.
"""

import dataclasses

import numpy as np

from .._jax import eqx
from ..data.plausible_units import (
    field_unit_guess,
    GREATEST_EARTH_FIELD,
    GREATEST_FIELD,
    LEAST_EARTH_FIELD,
)
from ..estimators.magnetic_field import MagneticField
from ..model_selection.select_model import polynomial_basis
from ..physics.temperature import Constant, Curve
from ..reduction.dwells import Dwells
from .between_dwell_variance import chi2_per_dof
from .magnetic_degrees import choose_degrees
from .magnetic_directions import how_to_turn, missing_directions
from .magnetic_fit import Fit, free_coefficients, solved
from .magnetic_frame import in_frame
from .results import MagnetometerResult


LEAST_TURN = 10.0  # variance out of the plane over that of the misfit: less shortens an axis by a tenth and more
_TURNED = 0.3  # of the magnitude: a device that moves its outputs by less has hardly been turned
_UNKNOWN_NOISE = 1e-7  # T: equal weights where no sample says how noisy it is
LEAST_CURRENT = (
    0.1  # A, span: over less no wire of a drone makes a field that shows (50 nT at 0.4 m)
)


def calibrate_magnetometers(
    rows: Dwells,
    *,
    field: float | None = None,
    latitude: float | None = None,
    degree: int | None = None,
    robust: float | None = None,
    unsteady: int = 0,
) -> MagnetometerResult:
    """The magnetometers' estimate from rests and samples in motion.

    **Arguments:** `rows` as `reduction.field_rows` makes them, with the compensated specific force of the rests in
    `accel` where the accelerometers' frame is wanted; `field` is the local magnitude, T, else the scale is set so that
    det(E + S) = 1 in the middle of the temperatures; `latitude` (rad) tells which way the field points; `degree` of
    the hard iron over temperature, else chosen; `robust` a pseudo-Huber threshold in standard deviations; `unsteady`
    how many further rests were left out because the field moves in them, to be told where the frame is not known.

    Raises `ValueError` where the rows do not determine the model, or are no field of the Earth in T.
    """
    first = _first_field(rows, field)
    with_current = rows.current is not None and float(np.ptp(np.asarray(rows.current))) > (
        LEAST_CURRENT
    )
    names = MagneticField(field=first, at=np.zeros(0), with_current=with_current).names
    estimator = MagneticField(
        field=first, at=np.zeros(len(names)), with_current=with_current, robust=robust
    )
    rows = _with_noise(rows)
    own = solved(
        estimator, Constant(), rows, free_coefficients(names, (0, 0), turned=False), None, field
    )
    _require_turned_about_two_axes(own, first)
    warnings: list[str] = []
    fit = in_frame(own, latitude, field, warnings, unsteady=unsteady)
    degrees, reason = choose_degrees(fit, degree)
    if degrees != (0, 0):
        basis = polynomial_basis(max(degrees), rows)
        start = np.zeros((basis.size, len(names)))
        start[0] = fit.coefficients[0]
        free = free_coefficients(names, degrees, turned=fit.turned)
        fit = solved(fit.estimator, basis, rows, free, start, field)
    if not fit.converged:
        lacking = missing_directions(np.asarray(rows.mag))
        cause = "look for a wrong unit, exchanged columns or iron that moved"
        raise ValueError(
            f"mag: the estimation did not converge{f'; {cause}' if lacking is None else f': {lacking}'}."
        )
    return _result(fit, field is not None, reason, warnings)


def _require_turned_about_two_axes(fit: Fit, size: float) -> None:
    """Raise where what moves the field out of one plane is hardly more than the misfit, or where that is more than the
    field's `size`, T.

    Noise in the regressor draws an ellipsoid towards the plane by the ratio of the two variances, and its standard
    deviations do not know of it (Fuller, Measurement Error Models, 1987, section 1.1).
    """
    if not np.all(np.isfinite(fit.coefficients)):
        return
    misfit = float(np.sqrt(np.mean(np.square(fit.judged()[0]))))
    if misfit > size:
        raise ValueError(
            "mag: no ellipsoid fits, for the outputs keep no magnitude as the device turns: look for a wrong unit, "
            "columns of another sensor, or iron that moved."
        )
    out_of_plane = float(np.sqrt(np.linalg.eigvalsh(np.cov(np.asarray(fit.rows.mag).T))[0]))
    if out_of_plane**2 < LEAST_TURN * misfit**2:
        raise ValueError(
            f"mag: it was turned about one axis only: the field leaves a plane by {1e6 * out_of_plane:.2g} µT where "
            f"the misfit is {1e6 * misfit:.2g} µT; {how_to_turn(np.asarray(fit.rows.mag))}."
        )


def _first_field(rows: Dwells, field: float | None) -> float:
    """A start for the magnitude, T, from the outputs' half span; the given one where there is one.

    Raises `ValueError` where the outputs are no field of the Earth in T.
    """
    outputs = np.asarray(rows.mag)
    about = outputs - 0.5 * (outputs.min(axis=0) + outputs.max(axis=0))
    size = float(np.median(np.linalg.norm(about, axis=1)))
    largest = float(np.median(np.linalg.norm(outputs, axis=1)))
    if largest > GREATEST_FIELD or not LEAST_EARTH_FIELD / 4.0 < size < 4.0 * GREATEST_EARTH_FIELD:
        cure = "turn the device all ways"
        if largest > GREATEST_FIELD:  # as outputs in no unit of [columns] are, which are read in T
            likely = field_unit_guess(size if size > _TURNED * largest else largest)
            cure += f', or say the unit: [columns] mag = {{ unit = "{likely}" }}'
        elif not LEAST_EARTH_FIELD / 4.0 < largest < 4.0 * GREATEST_EARTH_FIELD:
            cure += ", or mend the unit of [columns] mag"
        raise ValueError(
            f"mag: the outputs move by {1e6 * size:.3g} uT about their middle, and the Earth's field is "
            f"{1e6 * LEAST_EARTH_FIELD:g} to {1e6 * GREATEST_EARTH_FIELD:g} uT; {cure}."
        )
    return size if field is None else field


def _with_noise(rows: Dwells) -> Dwells:
    """Equal weights where a row has no noise figure of its own."""
    spread = np.asarray(rows.mag_covariance)
    silent = np.trace(spread, axis1=1, axis2=2) <= 0.0
    if not silent.any():
        return rows
    filled = np.where(silent[:, None, None], _UNKNOWN_NOISE**2 * np.eye(3), spread)
    return eqx.tree_at(lambda d: d.mag_covariance, rows, filled)


def _result(fit: Fit, given: bool, reason: str, warnings: list[str]) -> MagnetometerResult:
    misfit, sigma = fit.judged()
    now = fit.problem.at(fit.coefficients)
    spread = fit.covariance()
    if not np.all(np.isfinite(spread)):
        raise ValueError(
            "mag: the rows do not determine the dependence on temperature; give [model] temperature_degree = 0."
        )
    scatter = float(np.asarray(fit.estimator.scatter))
    result = MagnetometerResult(
        estimator=fit.estimator,
        curve=Curve(fit.problem.basis, fit.coefficients),
        covariance=spread,
        free=fit.free,
        dwells=fit.rows,
        misfit=now.misfit * np.column_stack([np.ones(len(now.misfit)), fit.resting & fit.turned]),
        sigma=np.sqrt(np.square(now.sigma) + scatter**2),
        scatter=scatter,
        chi2_per_dof=chi2_per_dof(misfit, sigma, int(fit.free.sum())),
        frame="accel" if fit.turned else "own",
        field_given=given,
        statements=(),
        warnings=tuple(warnings),
    )
    return dataclasses.replace(result, statements=(reason, *_told(result)))


def _told(result: MagnetometerResult) -> tuple[str, ...]:
    """The estimate in two sentences."""
    hard, soft = result.worst_sigmas
    moving = result.dwells.num_dwells - result.num_rests
    where = "the accelerometers" if result.frame == "accel" else "the triad itself"
    field = 1e6 * float(np.asarray(result.estimator.field))
    scale = (
        f"scale by the given field of {field:.2f} µT"
        if result.field_given
        else f"scale by convention (a field of {field:.2f} µT makes it 1 in the mean; [site] magnetic_field gives it)"
    )
    return (
        f"magnetometers: hard iron ± {1e6 * hard:.2g} µT, soft iron ± {100 * soft:.2g} % (1 sigma, the worst), in the "
        f"frame of {where}, from {result.num_rests} rests and {moving} samples in motion; rms misfit "
        f"{1e6 * result.rms:.2g} µT",
        f"magnetometers: {scale}",
    )
