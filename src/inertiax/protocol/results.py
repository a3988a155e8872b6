"""The results of a protocol: every parameter at every reference temperature, with its uncertainty and budget."""

import math
from typing import NamedTuple

import numpy as np

from ..calibration.calibrated_triads import calibrated_triads
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.quantities import si_unit
from ..exports.extrapolation import margin
from ..physics.temperature import Constant
from ..storage.wrong_value import WrongValue
from .expanded_uncertainty import coverage_factor, effective_degrees
from .guard_band import Measured
from .record import Record
from .sources_at import contributions


_GRID = 33  # temperatures at which a requirement is looked at, over the calibrated range


class Result(NamedTuple):
    """One parameter at one temperature, SI."""

    name: str
    at: float | None  # °C; None where no temperature was recorded
    value: float
    std: float
    expanded: float  # half-width of the 95 % interval
    coverage_factor: float
    degrees: float  # effective, of freedom; inf where all sources are stated
    unit: str
    budget: tuple[tuple[str, float], ...]  # source and its standard uncertainty, most first

    @property
    def measured(self) -> Measured:
        """What a decision needs of it."""
        return Measured(self.value, self.std, self.degrees)


def reference_temperatures(
    calibration: Calibration, asked: tuple[float, ...] | None = None
) -> tuple[float, ...]:
    """°C: those asked for, else both ends and the middle of the calibrated range, or its middle for constants.

    None where no temperature was recorded. A little outside the calibrated range counts as inside, by the rule of
    compensation (`exports.extrapolation`). Raises `WrongValue` farther out, where a polynomial has no uncertainty that
    could be stated.
    """
    known = calibration.temperature_range
    if known is None:
        if asked:
            raise WrongValue(
                "--at: no temperature was recorded, so there is none to state results at."
            )
        return ()
    low, high = float(known[0]), float(known[1])
    if asked:
        beyond = margin(calibration)
        for t in asked:
            if not low - beyond <= t <= high + beyond:
                raise WrongValue(
                    f"--at {t:g}: outside the calibrated range, {low:.2f} to {high:.2f} °C, by more than {beyond:.2g} "
                    "°C; the calibration says nothing there."
                )
        return asked
    middle = 0.5 * (low + high)
    triads = calibrated_triads(calibration).values()
    if all(isinstance(t.curve.basis, Constant) for t in triads):
        return (middle,)
    return (low, middle, high)


def results_at(
    calibration: Calibration,
    record: Record,
    temperatures: tuple[float, ...],
    gravity_uncertainty: float | None = None,
) -> tuple[Result, ...]:
    """All parameters at all temperatures, by parameter and then temperature; without temperature once."""
    found: list[Result] = []
    for name, triad in calibrated_triads(calibration).items():
        found += _of_triad(name, triad, record, temperatures, gravity_uncertainty)
    return tuple(found)


def range_grid(calibration: Calibration, temperatures: tuple[float, ...]) -> tuple[float, ...]:
    """The reference temperatures and a grid over the calibrated range, on which a requirement must be met."""
    known = calibration.temperature_range
    if known is None:
        return ()
    grid = np.linspace(float(known[0]), float(known[1]), _GRID).tolist()
    return tuple(sorted({*grid, *temperatures}))


def _of_triad(
    name: str,
    triad: TriadCalibration,
    record: Record,
    temperatures: tuple[float, ...],
    gravity_uncertainty: float | None,
) -> list[Result]:
    own = getattr(record, name)
    if own is None:  # of a version that had none of magnetometers
        return []
    grid = np.array(temperatures or (0.0,), float)
    parts = contributions(triad, own, record.station, gravity_uncertainty, grid)
    values, _ = triad.over(grid)
    made = []
    for k, parameter in enumerate(triad.names):
        for row, at in enumerate(temperatures or (None,)):
            stds = [float(p.std[row, k]) for p in parts]
            degrees = effective_degrees(stds, [p.degrees for p in parts])
            factor, std = coverage_factor(degrees), math.hypot(*stds)
            budget = sorted(
                ((p.source, s) for p, s in zip(parts, stds, strict=True) if s > 0.0),
                key=lambda pair: -pair[1],
            )
            made.append(
                Result(parameter, at, float(values[row, k]), std, factor * std, factor, degrees,
                       si_unit(parameter), tuple(budget))
            )  # fmt: skip
    return made
