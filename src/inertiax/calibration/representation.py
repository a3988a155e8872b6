"""A calibration for people: a line, a text, a table in a notebook, a data frame."""

from collections.abc import Sequence
from html import escape
from typing import Protocol, runtime_checkable

import numpy as np
import polars as pl

from ..data.plausible_units import check_temperature
from ..physics.leaves import is_traced
from .calibrated_triads import calibrated_triads, OfTriads
from .fitted_effects import FittedEffect
from .quantities import middle_temperature, quantities, Quantity, with_sigma
from .triad import refuse_stacked, unit_of


@runtime_checkable
class Shown(OfTriads, Protocol):
    """What of a `Calibration` is shown."""

    @property
    def device(self) -> str:
        """Serial number."""
        ...

    @property
    def temperature_range(self) -> tuple[float, float] | None:
        """°C."""
        ...

    @property
    def effects(self) -> tuple[FittedEffect, ...]:
        """Named effects beside the parameters."""
        ...


def line(calibration: Shown) -> str:
    """What it is, in one line."""
    parts = [f"device={calibration.device!r}"] if calibration.device else []
    for name, triad in calibrated_triads(calibration).items():
        shape = tuple(np.shape(triad.curve.coefficients))
        parts.append(f"{name}={triad.estimator} {shape}")
    parts += [f"effects={[e.name for e in calibration.effects]}"] if calibration.effects else []
    return f"Calibration({', '.join(parts)})"


def single(calibration: Shown, call: str) -> None:
    """Raise `ValueError` for stacked devices or traced values, which have no numbers to show."""
    triads = tuple(calibrated_triads(calibration).values())
    if any(is_traced(t.curve.coefficients) for t in triads):
        raise ValueError(f"`calibration.{call}()`: its numbers are not known in traced code.")
    refuse_stacked(triads, f"calibration.{call}()")


def summary(calibration: Shown) -> str:
    """The parameters in customary units at the middle of the temperature range, with 1 sigma, as text."""
    single(calibration, "summary")
    lines = [f"{_title(calibration)}, ± 1 sigma"]
    for quantity in _all(calibration):
        value, sigma = with_sigma(quantity.value, quantity.sigma)
        triad = quantity.name.partition(".")[0]
        lines.append(f"{triad:<6}{quantity.label:<18}{value:>14} ± {sigma:<10} {quantity.unit}")
    return "\n".join([*lines, *_effect_lines(calibration)])


def _title(calibration: Shown) -> str:
    device = f"Calibration of {calibration.device}" if calibration.device else "Calibration"
    if calibration.temperature_range is None:
        return device
    low, high = calibration.temperature_range
    return f"{device} at {middle_temperature(calibration):.4g} °C (data from {low:.4g} to {high:.4g} °C)"


def _all(calibration: Shown) -> list[Quantity]:
    at = middle_temperature(calibration)
    return [q for triad in calibrated_triads(calibration).values() for q in quantities(triad, at)]


def _effect_lines(calibration: Shown) -> list[str]:
    return [f"effect {e.name} on {', '.join(e.channel_names)}" for e in calibration.effects]


def html(calibration: Shown) -> str:
    """`summary` as a table for a notebook; text from the calibration is escaped."""
    if any(np.ndim(t.curve.coefficients) > 2 for t in calibrated_triads(calibration).values()):
        return f"<p>{escape(line(calibration))}</p>"
    cells = []
    for quantity in _all(calibration):
        value, sigma = with_sigma(quantity.value, quantity.sigma)
        texts = (quantity.name.partition(".")[0], quantity.label, value, sigma, quantity.unit)
        cells.append("<tr>" + "".join(f"<td>{escape(t)}</td>" for t in texts) + "</tr>")
    head = "".join(f"<th>{t}</th>" for t in ("triad", "parameter", "value", "1 σ", "unit"))
    effects = "".join(f"<p>{escape(t)}</p>" for t in _effect_lines(calibration))
    caption = escape(_title(calibration))
    return f"<table><caption>{caption}</caption><tr>{head}</tr>{''.join(cells)}</table>{effects}"


COLUMNS = {
    "temperature": pl.Float64,
    "name": pl.String,
    "value": pl.Float64,
    "sigma": pl.Float64,
    "unit": pl.String,
}


def frame(calibration: Shown, temperatures: Sequence[float] | np.ndarray | None) -> pl.DataFrame:
    """One row per parameter and temperature (°C; the middle of the range where `None`), in SI units."""
    single(calibration, "to_frame")
    asked = [middle_temperature(calibration)] if temperatures is None else temperatures
    grid = np.atleast_1d(np.asarray(asked, float))
    check_temperature("calibration.to_frame", grid, np.ones(len(grid), bool), name="temperatures")
    rows = [
        (at, name, value, sigma, unit_of(name))
        for triad in calibrated_triads(calibration).values()
        for at, values, sigmas in zip(grid, *triad.over(grid))
        for name, value, sigma in zip(triad.names, values, sigmas)
    ]
    return pl.DataFrame(rows, schema=COLUMNS, orient="row")
