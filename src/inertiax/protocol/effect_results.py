"""Named effects as results: every coefficient and setting that a diagnosis fitted, with its expanded uncertainty.

Their covariance is taken as known, so that the coverage factor is that of the normal distribution.
"""

import math
from typing import NamedTuple

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.fitted_effects import FittedEffect, known_effect
from ..effects.effect import Effect
from ..effects.form_units import acts_on
from .expanded_uncertainty import coverage_factor
from .record import Record


# What the columns of effects are whose settings do not say it.
_COLUMNS = {
    "size_effect": ("r along x", "r along y", "r along z"),
    "pier_tilt": ("first level axis", "second level axis"),
}


class EffectResult(NamedTuple):
    """One number of an effect, SI."""

    effect: str  # of the catalogue, such as g2_sensitivity
    channels: tuple[str, ...]  # such as gyro_y
    term: str  # what the coefficient multiplies, such as "f^T A f: yy"; empty for a setting
    parameter: str  # as a diagnosis names it: coefficient, coefficient[1], amplitude, time_constant
    value: float
    std: float | None  # None: not determined, or not kept
    unit: str

    @property
    def coverage_factor(self) -> float:
        """k of 95 %."""
        return coverage_factor(math.inf)

    @property
    def expanded(self) -> float | None:
        """Half-width of the 95 % interval."""
        return None if self.std is None else self.coverage_factor * self.std


def effect_results(calibration: Calibration, record: Record) -> tuple[EffectResult, ...]:
    """The numbers of all named effects, in the calibration's order."""
    return tuple(r for fitted in calibration.effects for r in _of_effect(fitted, record))


def _of_effect(fitted: FittedEffect, record: Record) -> list[EffectResult]:
    known = known_effect(fitted.name, f"calibration: effect {fitted.name!r}")
    channels, settings = fitted.channel_names, fitted.plain_settings
    made = []
    if known.nuisance in settings:
        value, std = float(settings[known.nuisance]), _kept(fitted, known.nuisance, record)
        made.append(
            EffectResult(fitted.name, channels, "", known.nuisance, value, std, known.nuisance_unit)
        )
    values = np.asarray(fitted.coefficients, float)
    stds = np.sqrt(np.maximum(np.diagonal(np.asarray(fitted.covariance, float)), 0.0))
    label = "amplitude" if known.unit_amplitude else "coefficient"
    for k, (value, std) in enumerate(zip(values.tolist(), stds.tolist(), strict=True)):
        name = label if len(values) == 1 else f"{label}[{k}]"
        term = _term(known, settings, k, len(values))
        told = std if math.isfinite(std) and std > 0.0 else None
        unit = known.unit(fitted.triad, settings, k)
        made.append(EffectResult(fitted.name, channels, term, name, value, told, unit))
    return made


def _term(known: Effect, settings: dict[str, float | int | str], k: int, count: int) -> str:
    """The effect's equation with the form that was fitted, of the coefficient's own column where that has a name."""
    said = []
    for name, value in settings.items():
        if name == known.nuisance:
            continue
        if name == "on":
            said.append(f"on {acts_on(settings)}")
            continue
        columns = str(value).split() if isinstance(value, str) else []
        if len(columns) == count:
            said.append(columns[k])
        elif len(columns) == 1 < count == len(columns[0]):  # letters of axes
            said.append(columns[0][k])
        else:
            said.append(f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}")
    own = _COLUMNS.get(known.name, ())
    said += [own[k]] if len(own) == count else []
    return f"{known.equation}: {', '.join(said)}" if said else known.equation


def _kept(fitted: FittedEffect, parameter: str, record: Record) -> float | None:
    """1 sigma of a setting, which the calibration does not hold."""
    for entry in record.effects:
        same = entry.name == fitted.name and set(fitted.channel_names) <= set(entry.channels)
        if same and entry.parameter == parameter:
            return entry.std
    return None
