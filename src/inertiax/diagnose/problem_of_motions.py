"""The gyros' motions between rests as one system of rows, with the effects that act while a device turns."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from .._jax import eqx
from ..effects import Effect, Signal, Variant
from .candidates.empirical import input_dependences, PREFIX
from .candidates.signatures import channel_terms, coarsen, Term, terms
from .noise.observation_series import make
from .observations.model_rows import calibrated, CalibratedTriad
from .observations.motion_rows import motion_rows, MotionRows, rows_again
from .problem import Prepared, Problem


# What parts such effects where a diagnosis leaves a set; the runs of a station have no such motions.
PARTED_BY = (
    "more motions by hand, slow ones and fast ones, both ways about each axis and about skew axes; a rate table "
    "tells most"
)
DRIVERS = ("rate", "input")  # of effects that show while a device turns and not at rest


def prepared_motions(problem: Problem, catalogue: Sequence[Effect]) -> Prepared | None:
    """Rows and candidates of the motions by which the gyros were calibrated; `None` where there are no such, or few."""
    rows = motion_rows(problem.campaign, problem.log, problem.fitted)
    model = calibrated(problem.fitted, "gyro")
    if rows is None or model is None:
        return None
    rests = next(p for p in problem.triads if p.form.triad == "gyro")
    turning = [e for e in catalogue if e.driver in DRIVERS and not e.common and not e.slow]
    return _of_rows(rests, model, rows, turning)


def _of_rows(
    rests: Prepared, model: CalibratedTriad, rows: MotionRows, catalogue: Sequence[Effect]
) -> Prepared:
    blocks, base = rows.blocks, rows.base
    signal = eqx.tree_at(
        lambda s: (s.input, s.rate), rests.signal, (rows.rates, rows.rates), is_leaf=_none
    )
    listed, missing = terms(tuple(catalogue), signal, blocks, base)
    # Each row errs by itself, also the two of a motion.
    apart = eqx.tree_at(lambda b: b.dwell, blocks, np.arange(blocks.num_blocks))
    rig = [np.full(blocks.num_blocks, rows.scatter**2)]
    again = lambda kept: _of_rows(rests, model, rows_again(rows, model, kept), catalogue)
    return replace(
        rests,
        blocks=blocks,
        signal=signal,
        coarse=coarsen(signal, blocks),
        system=make(base, apart, rig, [np.zeros((blocks.num_blocks, 0))]),
        candidates=(*listed, *_unlisted(signal, rows)),
        flexible=(),
        missing=missing,
        delay=None,
        lines=(),
        sought=None,
        only=again,
        motions=True,
    )


def _unlisted(signal: Signal, rows: MotionRows) -> list[Term]:
    """Dependences on the rates that no catalogued effect stands for, which compete with the catalogue."""
    made: list[Term] = []
    for family, formula, addition in _dependences(signal):
        felt = rows.blocks.felt(addition)
        if np.any(felt):
            variant = Variant(formula, {})
            made += channel_terms(PREFIX + family, variant, rows.base, felt)
    return made


def _dependences(signal: Signal) -> Iterator[tuple[str, str, Float[np.ndarray, "time 3 column"]]]:
    yield from input_dependences(signal)
    rate = np.asarray(signal.input)[:, :, None]
    time = np.linspace(-0.5, 0.5, len(rate))[:, None, None]
    yield "input and time", "w t", rate * time


def _none(x: object) -> bool:
    return x is None
