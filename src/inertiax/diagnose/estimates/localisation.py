"""Where: channel, experiment, span and driver of a departure."""

from collections.abc import Sequence

import numpy as np

from ..candidates.signatures import Term
from ..problem import Prepared
from ..result import Where
from ..selection.evidence import Candidate


LEVEL = 0.12  # part of an effect's usual size from which it counts as present
DRIVERS = {  # of the structured alternatives, by the first word that occurs in their family
    "temperature rate": "temperature_rate",
    "temperature": "temperature",
    "time": "time",
    "move": "time_since_move",
    "position": "position",
    "input": "input",
}


def driver_of(term: Term) -> str:
    """The quantity that drives a term."""
    if term.effect is not None:
        return term.effect.driver
    return next((v for k, v in DRIVERS.items() if k in term.name), "position")


def spans(prepared: Prepared, envelope: np.ndarray) -> list[tuple[int, int]]:
    """Runs of blocks `[first, last]` where an effect is present.

    The envelope is first made steady against the position's pattern by its greatest value within 1 % of the
    campaign.
    """
    time = prepared.blocks.time
    reach = 0.01 * (time[-1] - time[0])
    left = np.searchsorted(time, time - reach)
    right = np.searchsorted(time, time + reach)
    high = np.array([envelope[a:b].max() for a, b in zip(left, np.maximum(right, left + 1))])
    present = high > LEVEL * high.max()
    edge = np.flatnonzero(np.diff(np.r_[False, present, False].astype(int)))
    runs = [(int(a), int(b) - 1) for a, b in zip(edge[::2], edge[1::2])]
    merged: list[tuple[int, int]] = []
    for run in runs:
        if merged and time[run[0]] - time[merged[-1][1]] < reach:
            merged[-1] = (merged[-1][0], run[1])
        else:
            merged.append(run)
    return merged


def locate(prepared: Prepared, candidate: Candidate, origin: float, p_value: float) -> list[Where]:
    """One entry for every span within every experiment, for each channel of the candidate."""
    term, blocks = candidate.term, prepared.blocks
    rows = np.stack([np.abs(c @ candidate.score.coefficients) for c in term.columns]).max(axis=0)
    made = []
    for first, last in spans(prepared, rows):
        for experiment in np.unique(blocks.experiment[first : last + 1]):
            mine = np.flatnonzero(blocks.experiment[first : last + 1] == experiment) + first
            a, b = blocks.start[mine[0]], blocks.stop[mine[-1]] - 1
            excess = float(np.sqrt(np.mean(rows[mine] ** 2)))
            begin, end = prepared.clock[a], prepared.clock[b]
            for name in term.channel_names:
                made.append(
                    Where(
                        name,
                        int(experiment),
                        float(begin),
                        float(end),
                        driver_of(term),
                        excess,
                        p_value,
                    )
                )
    return made


def tidy(places: Sequence[Where]) -> tuple[Where, ...]:
    """Rows of one channel, experiment and driver that overlap put together; most significant first."""
    made: list[Where] = []
    for new in sorted(places, key=lambda w: (w.channel, w.experiment, w.driver, w.start)):
        old = made[-1] if made else None
        same = old is not None and all(
            getattr(old, k) == getattr(new, k) for k in ("channel", "experiment", "driver")
        )
        if old is None or not same or new.start > old.end:
            made.append(new)
            continue
        made[-1] = Where(
            new.channel,
            new.experiment,
            old.start,
            max(old.end, new.end),
            new.driver,
            max(old.excess_rms, new.excess_rms),
            min(old.p_value, new.p_value),
        )
    return tuple(sorted(made, key=lambda w: (w.p_value, w.start)))
