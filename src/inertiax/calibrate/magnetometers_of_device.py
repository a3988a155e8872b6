"""From a device's recordings to its magnetometers' calibration, where the columns are there."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from .._jax import eqx
from ..calibration.magnetometers import MagnetometerCalibration
from ..calibration.probe_error import probe_covariance
from ..calibration.triad import TriadCalibration
from ..data.recording import Campaign, NOT_CALIBRATED, Rig
from ..estimators.magnetic_field import VERTICAL
from ..model_selection.select_model import ChosenModel, require_known
from ..physics.temperature import Curve
from ..reduction.dwells import Dwells, without_held
from ..reduction.field_rows import field_rows
from ..reduction.segments import Segments
from .magnetometers import calibrate_magnetometers
from .one_triad import Progress
from .results import MagnetometerResult, TriadResult


def has_magnetometers(campaign: Campaign) -> bool:
    """Whether a device's magnetometers were recorded and are to be calibrated.

    Raises `ValueError` where `[model]` asks for them and there are no columns, or for an unknown estimator.
    """
    asked = campaign.model.mag_estimator
    where = "[model]" if campaign.path is None else f"{campaign.path}: [model]"
    if asked is not None:
        require_known("mag", asked, where)
    there = any(r.mag is not None for r in campaign.recordings)
    if asked not in (None, NOT_CALIBRATED) and not there:
        raise ValueError(
            f"{where} mag_estimator = {asked!r}, but no columns mag_x/y/z were recorded."
        )
    return there and asked != NOT_CALIBRATED


def calibrate_mag(
    campaign: Campaign,
    chosen: ChosenModel,
    accel: TriadResult | None,
    dwells: Dwells | None,
    segments: Sequence[Segments],
    robust: float | None,
    progress: Progress,
) -> tuple[MagnetometerResult | None, tuple[str, ...]]:
    """The magnetometers' estimate of one device, `None` without any, and warnings.

    **Arguments:** `dwells` hold the compensated specific force where `accel` was estimated. Where the campaign did not
    ask for the magnetometers, a failure is a warning.
    """
    if not has_magnetometers(campaign):
        return None, ()
    progress("estimating mag")
    known = all(r.temperature is not None for r in campaign.recordings)
    degree = campaign.model.temperature_degree if known else None
    try:
        # A hand that holds a device moves its field.
        shown = _with_vertical(chosen, accel, None if dwells is None else without_held(dwells))
        rows = field_rows(
            campaign.recordings, shown, _at_rest([s.without_held() for s in segments])
        )
        found = calibrate_magnetometers(
            rows,
            field=campaign.site.magnetic_field,
            latitude=campaign.site.latitude,
            degree=degree,
            robust=robust,
            unsteady=_left_out(campaign, shown, rows),
        )
    except ValueError as error:
        if campaign.model.mag_estimator is not None:
            raise
        return None, (f"magnetometers are not calibrated: {str(error).rstrip('.')}",)
    return found, found.warnings


def _with_vertical(
    chosen: ChosenModel, accel: TriadResult | None, dwells: Dwells | None
) -> Dwells | None:
    """The dwells with a specific force that shows the vertical, or without any.

    That of accelerometers whose scale factors are known, with what their model leaves at a rest; and that of
    accelerometers that the campaign takes as they are.
    """
    if dwells is None or dwells.accel is None:
        return dwells
    spread = np.asarray(dwells.accel_covariance)
    if accel is not None and chosen.accel_estimator != "static":
        spread = spread + accel.scatter**2 * np.eye(3)
        return eqx.tree_at(lambda d: d.accel_covariance, dwells, spread)
    if accel is None and chosen.accel_estimator is None and chosen.accel_as_recorded:
        return dwells
    none = lambda x: x is None
    return eqx.tree_at(lambda d: (d.accel, d.accel_covariance), dwells, (None, None), is_leaf=none)


def _left_out(campaign: Campaign, dwells: Dwells | None, rows: Dwells) -> int:
    """Rests of recordings with magnetometers that are none of theirs: the field moves in them."""
    if dwells is None or dwells.rows is None:
        return 0
    read = np.array([r.mag is not None for r in campaign.recordings])
    resting = np.asarray(dwells.position) >= 0
    theirs = read[np.asarray(dwells.rows)[:, 0].astype(int)] & resting
    return int(theirs.sum()) - int(np.sum(np.asarray(rows.position) >= 0))


def _at_rest(segments: Sequence[Segments]) -> list[Bool[np.ndarray, " time"]] | None:
    """Which rows of each recording belong to a rest that nothing disturbs."""
    if not segments:
        return None
    result = []
    for part in segments:
        turning = np.zeros(len(part.used), bool)
        for start, stop in zip(part.start[~part.resting], part.stop[~part.resting], strict=True):
            turning[start:stop] = True
        result.append(part.used & ~turning)
    return result


def magnetometer_calibration(result: MagnetometerResult, rig: Rig) -> MagnetometerCalibration:
    """What of an estimate a calibration holds: the parameters that were free, the field, its dip."""
    names, basis = result.estimator.names, result.curve.basis
    kept = [k for k, n in enumerate(names) if result.free[:, k].any() and n != VERTICAL]
    coefficients = np.asarray(result.curve.coefficients)[:, kept]
    covariance = _of(result, kept)
    covariance = covariance + probe_covariance(
        coefficients, basis, rig.temperature_uncertainty or 0.0
    )
    triad = TriadCalibration(
        Curve(basis, coefficients), covariance, tuple(names[k] for k in kept), "field"
    )
    field = float(np.asarray(result.estimator.field))
    if result.frame != "accel":
        return MagnetometerCalibration(triad, field, field_given=result.field_given)
    last = len(names) - 1
    upward = float(np.asarray(result.curve.coefficients)[0, last]) / field
    sigma = float(np.sqrt(_of(result, [last])[0, 0])) / field
    upward = float(np.clip(upward, -1.0, 1.0))
    level = max(np.sqrt(1.0 - upward**2), sigma)  # straight down the angle is known to √sigma alone
    return MagnetometerCalibration(
        triad, field, -np.arcsin(upward), sigma / level, result.field_given, "accel"
    )


def _of(result: MagnetometerResult, kept: list[int]) -> Float[np.ndarray, "unknowns unknowns"]:
    """The covariance of some parameters' coefficients, row-major (size, parameters)."""
    size, count = result.curve.basis.size, len(result.estimator.names)
    rows = (np.arange(size)[:, None] * count + np.array(kept)[None, :]).ravel()
    return np.asarray(result.covariance)[np.ix_(rows, rows)]
