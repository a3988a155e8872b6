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

    @property
    def opening(self) -> "Opening":
        """The channel and the variable that show most: of what was found, else of the residuals."""
        found = any(np.any(c.values) for c in self.effects)
        best = Opening(self.before[0].name, self._usual, 0.0)
        for before, effect in zip(self.before, self.effects, strict=True):
            shown = effect.values if found else before.values
            size = (
                np.linalg.norm(shown) / (np.linalg.norm(before.values) + 1e-300) if found else 1.0
            )
            for variable in self.variables:
                share = _told_by(variable.values, shown)
                # What chance tells of so many blocks is nothing to open with.
                if share * size**2 > max(best.share, 3.0 * BINS / len(shown)):
                    best = Opening(before.name, variable.name, float(share * size**2))
        return best

    @property
    def _usual(self) -> str:
        names = [v.name for v in self.variables]
        return "temperature" if "temperature" in names else names[0]


class Opening(NamedTuple):
    """What a page shows first."""

    channel: str
    over: str
    share: float  # of the sum of squares


BINS = 20


def _told_by(x: Float[np.ndarray, " block"], y: Float[np.ndarray, " block"]) -> float:
    """The share of a quantity's scatter that lies between equal numbers of neighbours in another.

    **Reference:** Pearson, Drapers' Company Research Memoirs, Biometric Series 2 (1905): the correlation ratio.
    """
    order = np.argsort(x, kind="stable")
    total = float(np.sum(np.square(y - y.mean())))
    if total == 0.0 or np.ptp(x) == 0.0:
        return 0.0
    # Equal values stay together.
    group = np.minimum(np.searchsorted(x[order], x) * BINS // len(x), BINS - 1)
    count = np.bincount(group, minlength=BINS)
    means = np.bincount(group, y, minlength=BINS) / np.maximum(count, 1)
    return float(np.sum(count * np.square(means - y.mean()))) / total


def table(rows: Residuals) -> Table:
    """All variables that the campaign tells, and the residuals, by block."""
    degrees = DEG_PER_HOUR / 3600.0
    found = [
        Column("time", "s", rows.time - rows.time[0]),
        Column("recording", "", rows.experiment.astype(float)),
        Column("time since the move", "s", rows.since_move),
    ]
    if rows.position is not None:
        found.append(Column("position", "", rows.position.astype(float)))
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
