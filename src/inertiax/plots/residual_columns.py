"""Residuals as columns to look through: what each may depend on, in the units people read."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..calibration.quantities import DEG_PER_HOUR
from ..diagnose.residuals import Residuals
from .residuals import scale


class Column(NamedTuple):
    """A quantity of every block."""

    name: str
    unit: str  # empty for a number
    values: Float[np.ndarray, " block"]


class Table(NamedTuple):
    """One triad's blocks."""

    name: str  # of the rows
    variables: tuple[Column, ...]
    before: tuple[Column, ...]  # residuals of each channel, of the model as meant
    effects: tuple[Column, ...]  # what was found takes from them: before less after


def table(rows: Residuals) -> Table:
    """All variables that the campaign tells, and the residuals, by block."""
    degrees = DEG_PER_HOUR / 3600.0
    found = [
        Column("time", "s", rows.time - rows.time[0]),
        Column("recording", "", rows.experiment.astype(float)),
        Column("time since the move", "s", rows.since_move),
    ]
    if rows.temperature is not None:
        found.append(Column("temperature", "°C", rows.temperature))
    if rows.temperature_rate is not None:
        found.append(Column("rate of temperature", "°C/min", 60.0 * rows.temperature_rate))
    for name, unit, factor, vectors in (
        ("specific force", "g", 1.0, rows.force),
        ("rate", "°/s", degrees, rows.rate),
    ):
        if vectors is not None and np.any(vectors):
            found += [
                Column(f"{name} {a}", unit, factor * vectors[:, k]) for k, a in enumerate("xyz")
            ]
    factor, unit = scale(rows)
    before, taken = factor * rows.before, factor * (rows.before - rows.after)
    return Table(
        rows.name,
        tuple(found),
        tuple(Column(c, unit, before[:, k]) for k, c in enumerate(rows.channels)),
        tuple(Column(c, unit, taken[:, k]) for k, c in enumerate(rows.channels)),
    )
