"""Which model to fit, from what the user asked for and which columns there are; said in words."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._records import field, Module
from ..data.formats.columns import nearest
from ..data.recording import Campaign, ModelChoice, NOT_CALIBRATED, Recording
from ..estimators import AbstractEstimator, ESTIMATORS
from ..physics.directions import FEWEST_DIRECTIONS
from ..physics.temperature import AbstractBasis, Constant, Polynomial
from ..reduction.dwells import Dwells
from ..reduction.rotations_between_rests import shortfall, Turns
from .model_spec import LEAST_SPAN, ModelSpec
from .poses import directions, directions_in_brief, directions_without_gyros


class ChosenModel(Module):
    """What is fitted, and why. `None` for a triad that is not recorded or not calibrated."""

    accel_estimator: str | None = field(static=True)
    gyro_estimator: str | None = field(static=True)
    g_sensitivity: bool = field(static=True)
    # Of the accelerometers' and the gyros' polynomials; None: chosen from the data, see `choose_degree`.
    degrees: tuple[int | None, int | None] = field(static=True)
    reasons: tuple[str, ...] = field(static=True)
    together: bool = field(static=True, default=False)  # both triads in one least squares
    lever_arms: bool = field(static=True, default=False)
    misalignment: bool = field(static=True, default=True)  # of the triads; False holds it at zero
    accel_misalignments: bool = field(static=True, default=True)  # of 'invariant'
    fixed: bool = field(static=True, default=False)  # was fitted before; nothing is left to choose
    # Accelerometers that the user does not want to be calibrated count as calibrated before.
    accel_as_recorded: bool = field(static=True, default=False)

    def degree(self, triad: str) -> int | None:
        """Degree over temperature of one triad's polynomials; `None` where the data are to decide."""
        return self.degrees[triad == "gyro"]


def fixed_model(spec: ModelSpec) -> ChosenModel:
    """A model that was fitted before, asked for again: nothing is left to choose."""
    of = lambda triad, key: None if triad is None else getattr(triad, key)
    return ChosenModel(
        of(spec.accel, "estimator"),
        of(spec.gyro, "estimator"),
        bool(spec.gyro is not None and spec.gyro.g_sensitivity),
        (of(spec.accel, "temperature_degree"), of(spec.gyro, "temperature_degree")),
        (),
        spec.together,
        spec.lever_arms,
        spec.misalignment,
        spec.accel is None or "accel.matrix[1,0]" in spec.accel.parameters,
        fixed=True,
    )


def choose_model(campaign: Campaign, recordings: Sequence[Recording]) -> ChosenModel:
    """Estimators for one device's recordings.

    Raises `ValueError` where the campaign asks for a model that its columns cannot support.
    """
    has = lambda column: all(getattr(r, column) is not None for r in recordings)
    where = "[model]" if campaign.path is None else f"{campaign.path}: [model]"
    reasons: list[str] = []
    accel = _accel_estimator(campaign, has, where, reasons)
    gyro = _gyro_estimator(campaign, has, accel, where, reasons)
    g_sensitivity = bool(campaign.model.g_sensitivity)
    if g_sensitivity and gyro is None:
        raise ValueError(f"{where} g_sensitivity = true, but no gyro columns were recorded.")
    if g_sensitivity and not (has("accel") or has("reference_accel")):
        raise ValueError(
            f"{where} g_sensitivity = true needs the specific force, but there are neither accel "
            f"nor reference_accel columns."
        )
    degree = campaign.model.temperature_degree
    if not has("temperature"):
        if degree:
            raise ValueError(
                f"{where} temperature_degree = {degree}, but no temperature column was recorded; "
                f"use 0 or add the column."
            )
        if degree is None:
            reasons.append("no temperature was recorded, so the parameters are constants")
        degree = 0
    together = _together(campaign, accel, gyro, where)
    return ChosenModel(
        accel,
        gyro,
        g_sensitivity,
        (degree, degree),
        tuple(reasons),
        together,
        bool(campaign.model.lever_arms),
        campaign.model.misalignment is not False,
        accel_as_recorded=campaign.model.accel_estimator == NOT_CALIBRATED,
    )


def asks_together(model: ModelChoice) -> tuple[str, ...]:
    """The keys of `[model]`, with their values, by which both triads go into one least squares; empty where none."""
    asks = {
        "together = true": model.together,
        "lever_arms = true": model.lever_arms,
        "misalignment = false": model.misalignment is False,
    }
    return tuple(key for key, value in asks.items() if value)


def _together(campaign: Campaign, accel: str | None, gyro: str | None, where: str) -> bool:
    """Whether both triads go into one least squares, which lever arms and aligned triads ask for too."""
    model = campaign.model
    asked = asks_together(model)
    if not asked:
        return False
    if model.together is False:
        raise ValueError(f"{where} {asked[0]} means both triads together, but together = false.")
    if accel not in ("invariant", "reference") or gyro not in ("reference", "gravity"):
        raise ValueError(
            f"{where} {asked[0]} needs accel_estimator 'invariant' or 'reference' and gyro_estimator "
            f"'reference' or 'gravity'; here they are {accel!r} and {gyro!r}."
        )
    if model.lever_arms and (accel, gyro) != ("reference", "reference"):
        raise ValueError(
            f"{where} lever_arms = true needs the columns reference_accel_x/y/z and "
            f"reference_gyro_x/y/z, and the estimators 'reference' for both triads."
        )
    return True


def _accel_estimator(campaign, has, where: str, reasons: list[str]) -> str | None:
    asked = campaign.model.accel_estimator
    if asked == NOT_CALIBRATED:
        return None
    if not has("accel"):
        if asked is not None:
            raise ValueError(
                f"{where} accel_estimator = {asked!r}, but no accelerometer columns were recorded."
            )
        return None
    if asked is None:
        asked = "reference" if has("reference_accel") else "invariant"
        because = "there is" if asked == "reference" else "there is no"
        reasons.append(f"accelerometers: '{asked}' because {because} reference_accel")
    require_known("accel", asked, where)
    if ESTIMATORS["accel"][asked].by_reference and not has("reference_accel"):
        raise ValueError(
            f"{where} accel_estimator = {asked!r} needs the columns reference_accel_x/y/z; "
            f"without them use 'invariant'."
        )
    return asked


def _gyro_estimator(campaign, has, accel: str | None, where: str, reasons: list[str]) -> str | None:
    asked = campaign.model.gyro_estimator
    if asked == NOT_CALIBRATED:
        return None
    if not has("gyro"):
        if asked is not None:
            raise ValueError(
                f"{where} gyro_estimator = {asked!r}, but no gyro columns were recorded."
            )
        return None
    if asked is None:
        if has("reference_gyro"):
            reasons.append("gyros: 'reference' because there is reference_gyro")
            return "reference"
        if accel in ("invariant", "reference"):
            return "gravity"  # if the motions allow it: `settle_gyro` decides and gives the reason
        reasons.append(
            "gyros: 'static' because there are neither reference_gyro nor calibrated accel"
        )
        return "static"
    require_known("gyro", asked, where)
    if ESTIMATORS["gyro"][asked].by_reference and not has("reference_gyro"):
        raise ValueError(
            f"{where} gyro_estimator = {asked!r} needs the columns reference_gyro_x/y/z; "
            f"without them use 'gravity' or 'static'."
        )
    if asked == "gravity" and accel is None:
        raise ValueError(
            f"{where} gyro_estimator = 'gravity' needs accelerometer columns; without them use "
            f"'static'."
        )
    return asked


def require_known(triad: str, asked: str, where: str) -> None:
    """Raise `ValueError` where `[model]` names no estimator of the triad."""
    names = [*ESTIMATORS[triad], NOT_CALIBRATED]
    if asked not in names:
        raise ValueError(
            f"{where} {triad}_estimator = {asked!r}: {nearest(asked, names)}it must be one of {', '.join(names)}."
        )


def settle_accel(
    campaign: Campaign, chosen: ChosenModel, dwells: Dwells
) -> tuple[ChosenModel, str | None]:
    """The model now that the rests are known, and what the reader should be warned of.

    Where the choice was left open, one pose tells how the accelerometers' outputs change, with temperature and in time
    ('static'), and from two to five directions of gravity without a reference they are not calibrated at all if there
    are gyros or magnetometers to calibrate.
    """
    if chosen.fixed or campaign.model.accel_estimator is not None:
        return chosen, None
    if chosen.accel_estimator != "invariant" or chosen.together:
        return chosen, None
    found = directions(dwells, campaign.recordings)
    warms = bool(np.ptp(np.asarray(dwells.temperature)) >= LEAST_SPAN)
    if found == 1 and warms:
        reason = (
            "accelerometers: 'static' because all rests are in one pose, which tells how the bias changes "
            "with temperature"
        )
        return _with_accel(campaign, chosen, "static", reason), None
    if found == 1 and chosen.gyro_estimator is not None:
        reason = "accelerometers: 'static' because all rests are in one pose, which tells how outputs change in time"
        quiet, brief = (
            count(campaign.recordings) for count in (directions_without_gyros, directions_in_brief)
        )
        if quiet > 1:
            reason += (
                f"; the accelerometers alone are quiet in {quiet} directions, but the gyros turn there: a rest takes "
                "2 s or longer on a table"
            )
        elif brief > 1:
            reason += (
                f"; for half a second at a time it is quiet in {brief} directions, too short to count: let it lie for "
                "2 s or longer in each"
            )
        return _with_accel(campaign, chosen, "static", reason), None
    others = chosen.gyro_estimator is not None or any(
        r.mag is not None for r in campaign.recordings
    )
    if found >= FEWEST_DIRECTIONS or not others:
        return chosen, None
    warning = (
        f"accelerometers are not calibrated: the rests show {found} directions of gravity and 'invariant' needs "
        f"{FEWEST_DIRECTIONS}; record more positions, at rest for 4 s in each, or give reference_accel_x/y/z"
    )
    if warms:
        warning += "; if it was one pose that warmed up, [model] accel_estimator = 'static'"
    return _with_accel(campaign, chosen, None, None), warning


def _with_accel(
    campaign: Campaign, chosen: ChosenModel, estimator: str | None, reason: str | None
) -> ChosenModel:
    """The model with another accelerometer estimator, which cannot carry gyros by gravity."""
    if campaign.model.gyro_estimator == "gravity":
        raise ValueError(
            "[model] gyro_estimator = 'gravity' needs accelerometers calibrated in six directions of gravity or "
            "more; record more positions, or use 'static'."
        )
    reasons = [r for r in chosen.reasons if not r.startswith("accelerometers:")]
    reasons += [] if reason is None else [reason]
    gyro = chosen.gyro_estimator
    if gyro == "gravity":
        gyro = "static"
        reasons.append("gyros: 'static' because there are no calibrated accelerometers to turn by")
    return dataclasses.replace(
        chosen, accel_estimator=estimator, gyro_estimator=gyro, reasons=tuple(reasons)
    )


def settle_gyro(campaign: Campaign, turns: Turns) -> tuple[str, str | None]:
    """ "gravity" or "static" for gyros without a reference, now that the motions are known, and the
    reason in words (none where the campaign asked for it).

    Raises `ValueError` where the campaign asks for "gravity" and its motions cannot support it.
    """
    lacking = shortfall(turns)
    if lacking is not None and turns.contradicted is not None:
        lacking = turns.contradicted.statement  # which left too few for the rest
    if campaign.model.gyro_estimator == "gravity":
        if lacking is not None:
            where = "[model]" if campaign.path is None else f"{campaign.path}: [model]"
            raise ValueError(
                f"{where} gyro_estimator = 'gravity', but {lacking} ({turns.statement}); use 'static' "
                f"or record more motions."
            )
        return "gravity", None
    if lacking is not None:
        return "static", at_rest_alone(lacking)
    return "gravity", (
        f"gyros: 'gravity' because there is no reference_gyro but the device was tilted between "
        f"rests ({turns.statement})"
    )


def at_rest_alone(why: str) -> str:
    """The reason why gyros are calibrated by their rests alone, in words."""
    return f"gyros: 'static' because there is no reference_gyro and {why}"


def polynomial_basis(degree: int, dwells: Dwells) -> AbstractBasis:
    """The basis of that degree over the temperatures that the dwells cover."""
    if degree == 0:
        return Constant()
    temperature = np.asarray(dwells.temperature)[np.asarray(dwells.valid)]
    low, high = float(temperature.min()), float(temperature.max())
    if not low < high:
        raise ValueError(
            f"temperature_degree = {degree}, but the temperature is {low:g} °C in every dwell; "
            f"use 0."
        )
    return Polynomial(degree, low, high)


def build_estimators(
    chosen: ChosenModel, gravity: float, dwells: Dwells, *, robust: float | None
) -> tuple[AbstractEstimator | None, AbstractEstimator | None]:
    """The estimators of the chosen model, for accelerometers and gyros."""
    mean = None if dwells.accel is None else np.mean(np.asarray(dwells.accel), axis=0)
    settings = {
        "gravity": gravity,
        "robust": robust,
        "misalignments": chosen.accel_misalignments,
        "nominal": None if mean is None else mean,
        "g_sensitivity": chosen.g_sensitivity,
    }
    return (
        _built("accel", chosen.accel_estimator, settings),
        _built("gyro", chosen.gyro_estimator, settings),
    )


def _built(triad: str, name: str | None, settings: Mapping[str, Any]) -> AbstractEstimator | None:
    """An estimator of a triad from those of the settings that it has fields for."""
    if name is None:
        return None
    cls = ESTIMATORS[triad][name]
    fields = {field.name for field in dataclasses.fields(cls)}
    return cls(**{key: value for key, value in settings.items() if key in fields})
