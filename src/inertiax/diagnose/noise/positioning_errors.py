"""Whether plateaus that follow each other about one axis share one positioning error, and rests that of an axis that
stands: the rows decide.

A table that is set once and runs a staircase of rates has one error for all of them. One that is moved in between,
whose bearing wobbles, or whose outer axis creeps, has another at each plateau, which grows with the rate and is no
effect of the sensor. An axis that stands while the other one moves keeps its error (`reduction.standing_axes`); one
that is set anew each time does not. All are tried beside everything that a sensor could add in the same rows, and the
likeliest is kept.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..._jax import eqx
from ...reduction.standing_axes import StandingErrors
from ..candidates.columns import span, unit
from ..candidates.signatures import Term
from ..observations.blocks import Blocks
from .common_mode import SharedErrors
from .common_mode_fit import couple, JointLikelihood
from .observation_series import positionings_of, share, START, System


def with_rig_errors(
    system: System,
    blocks: Blocks,
    reading: np.ndarray,
    angle: float,
    rate: float,
    listed: Sequence[Term],
    standing: StandingErrors | None = None,
) -> System:
    """The system with the rig's errors shared between channels, and between plateaus and rests where the rows are
    likelier so.

    **Arguments:** `reading` of an ideal triad, rad/s or m/s²; `angle` (rad) and `rate` (relative) are the rig's
    standard deviations; `listed` are the catalogue's terms, of which those that follow the input stand beside all;
    `standing` are the errors of axes that stand, if any do.
    """
    positioning = positionings_of(blocks)
    ways = [(positioning, standing)]
    if standing is not None:
        ways.append((positioning, None))
    if positioning is not None:
        ways.append((None, standing))
    systems = [share(system, blocks, reading, angle, rate, *way) for way in ways]
    if len(systems) == 1 or systems[0].shared is None:
        return systems[0]
    beside = _following_the_input(system, listed)
    first = tuple(START for _ in system.chains)
    values = [
        JointLikelihood(s, beside)(couple(s, first, beside)) for s in map(_comparable, systems)
    ]
    return systems[int(np.argmin(values))]


def _comparable(system: System) -> System:
    """A system whose errors were too many to be kept apart, each channel's on its own, as one that shares none."""
    if system.shared is not None:
        return system
    none = tuple(np.zeros((len(c.white), 0)) for c in system.chains)
    return eqx.tree_at(
        lambda s: s.shared, system, SharedErrors(none, system.longer), is_leaf=lambda x: x is None
    )


def _following_the_input(system: System, listed: Sequence[Term]) -> list[Term]:
    """One term a channel whose columns span those of all that follow the input on it."""
    made = []
    for c, _ in enumerate(system.chains):
        mine = [t for t in listed if t.follows_input and t.chains == (c,) and t.known.instant]
        if mine:
            columns = np.concatenate([unit(t.columns[0]) for t in mine], axis=1)
            made.append(replace(mine[0], columns=(span(columns),)))
    return made
