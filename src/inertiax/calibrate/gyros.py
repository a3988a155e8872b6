"""The gyros' estimate: by a reference, by gravity's rotation between rests, or at rest."""

import dataclasses

import numpy as np
from jaxtyping import Float

from .._jax import Array, eqx, jax
from .._typing import AnyArray
from ..data.recording import Campaign, Recording
from ..estimators import AbstractEstimator
from ..model_selection.select_model import (
    at_rest_alone,
    build_estimators,
    ChosenModel,
    settle_gyro,
)
from ..physics.error_model import compensate_accel
from ..physics.temperature import Curve
from ..reduction.dwells import Dwells
from ..reduction.known_moves import num_axes
from ..reduction.rotations_between_rests import Turns, with_motions
from .accelerometers_in_gyros import with_accelerometers
from .between_dwell_variance import num_judged
from .noise_of_motions import with_noise_shown
from .one_triad import (
    estimate_triad,
    Progress,
    rests_of,
    rows_for,
    TooHighDegree,
)
from .results import TriadResult


def calibrate_gyros(
    campaign: Campaign,
    chosen: ChosenModel,
    accel: TriadResult | None,
    dwells: Dwells,
    method: str,
    robust: float | None,
    progress: Progress,
    choices: list[str],
    warnings: list[str],
) -> tuple[TriadResult | None, ChosenModel, Float[np.ndarray, "accel gyro"] | None]:
    """The gyros' estimate, the model with the estimator that was used in the end, and the covariance of the
    accelerometers' coefficients with the gyros', where gravity by those is what the gyros are calibrated against.

    Where the choice was left open and the rotation of gravity does not determine the model, the rests
    still tell the bias; a warning says so.
    """

    def estimate(
        model: ChosenModel, used: Dwells, chosen: list[str] = choices, doubts: list[str] = warnings
    ) -> TriadResult:
        _, gyro = build_estimators(model, campaign.site.gravity, dwells, robust=robust)
        assert gyro is not None
        return estimate_triad(gyro, used, model, method, progress, chosen, doubts, rig=campaign.rig)

    def by_gravity(used: Dwells) -> tuple[TriadResult, Dwells]:
        said, doubts = [], []
        found = estimate(chosen, used, said, doubts)
        own = np.sqrt(np.maximum(np.square(found.sigma) - found.scatter**2, 0.0))
        size = found.solution.curve.basis.size
        shown = with_noise_shown(
            used, np.asarray(found.misfit), own, size * num_judged(found.estimator, used)
        )
        if shown is not used:
            return estimate(chosen, shown), shown
        choices.extend(said)
        warnings.extend(doubts)
        return found, used

    if chosen.gyro_estimator is None:
        return None, chosen, None
    if chosen.gyro_estimator == "gravity":
        assert accel is not None  # `choose_model` saw accelerometers
        turns = _turns(campaign, accel, dwells, g_sensitivity=chosen.g_sensitivity)
        name, reason = ("gravity", None) if chosen.fixed else settle_gyro(campaign, turns)
        choices.extend([] if reason is None else [reason])
        try:
            if name == "gravity":
                found, used = by_gravity(turns.dwells)
                whole = with_accelerometers(found, accel, used)
                return whole.result, chosen, whole.cross_covariance
        except ValueError as error:
            if chosen.fixed or campaign.model.gyro_estimator == "gravity":
                raise
            if turns.contradicted is None:
                warnings.append(f"gyros: 'static' instead of 'gravity', which failed: {error}")
            else:  # which is why it failed
                choices[:] = [c for c in choices if c != reason]
                choices.append(at_rest_alone(turns.contradicted.statement))
        chosen = dataclasses.replace(chosen, gyro_estimator="static")
        if not chosen.fixed and turns.contradicted is not None:
            alone = estimate(chosen, rows_for("gyro", chosen, dwells))
            return dataclasses.replace(alone, contradicted=turns.contradicted), chosen, None
    lacking = missing_axes(dwells) if chosen.gyro_estimator == "reference" else ""
    if lacking:
        try:
            return estimate(chosen, rows_for("gyro", chosen, dwells)), chosen, None
        except TooHighDegree:
            raise
        except ValueError as error:
            raise ValueError(f"gyro: {lacking}") from error
    return estimate(chosen, rows_for("gyro", chosen, dwells)), chosen, None


def missing_axes(dwells: Dwells) -> str:
    """In words, that known rates turn about one axis alone, or two, and what would be right; else empty."""
    if dwells.reference_gyro is None:
        return ""
    turning = np.asarray(dwells.position) < 0
    axes = num_axes(np.asarray(dwells.reference_gyro)[turning])
    if axes not in (1, 2):
        return ""
    which = "one axis" if axes == 1 else "axes in one plane"
    gravity = (
        '; or write gyro_estimator = "gravity" under [model], by which turns between rests tell the matrix'
        if dwells.accel is not None
        else ""
    )
    return (
        f"the known rates are about {which}, and Earth's rate, which is all that tells the rest of the matrix, is too "
        f"small for this noise; add rates about other axes, or rates that are known while the table moves{gravity}."
    )


def _turns(campaign: Campaign, accel: TriadResult, dwells: Dwells, *, g_sensitivity: bool) -> Turns:
    """The rests with the motions between them, as the calibrated accelerometers saw both."""
    rests_of(dwells, "gyro")
    # What the accelerometers' model leaves at a rest is an error of that rest's direction too.
    left = accel.scatter**2 * np.eye(3)
    dwells = eqx.tree_at(
        lambda d: d.accel_covariance, dwells, np.asarray(dwells.accel_covariance) + left
    )
    force = (lambda recording: _force(accel, recording)) if g_sensitivity else None
    return with_motions(campaign.recordings, dwells, force=force)


def _force(accel: TriadResult, recording: Recording) -> Float[np.ndarray, "time 3"]:
    """Compensated specific force of every sample, m/s²."""
    assert recording.accel is not None
    probe = recording.temperature
    temperature = np.zeros(recording.num_samples) if probe is None else probe[:, 0]
    curve = accel.solution.curve
    return np.asarray(_compensated_force(accel.estimator, curve, temperature, recording.accel))


@eqx.filter_jit
def _compensated_force(
    estimator: AbstractEstimator, curve: Curve, temperature: AnyArray, accel: AnyArray
) -> Float[Array, "time 3"]:
    one = lambda t, a: compensate_accel(estimator.unpack(curve(t)), a)
    return jax.vmap(one)(temperature, accel)
