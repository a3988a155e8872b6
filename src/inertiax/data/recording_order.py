"""The order in which recordings were made."""

from collections.abc import Sequence

from .recording import Recording


def in_order(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings by their first stamp, or as they are listed where their clocks overlap.

    Clocks that each start near zero say nothing of the order: one that starts at 0.003 s need not come after one that
    starts at 0. Whoever lists the files knows it.

    **Example:** `in_order(campaign.recordings)[0].time[0]`.
    """
    ordered = sorted(recordings, key=lambda r: float(r.time[0]))
    return list(recordings) if clocks_overlap(ordered) else ordered


def clocks_overlap(ordered: Sequence[Recording]) -> list[tuple[Recording, Recording]]:
    """Neighbours, of recordings sorted by their first stamp, of which the second starts before the first one ends."""
    pairs = zip(ordered, ordered[1:], strict=False)
    return [(a, b) for a, b in pairs if b.time[0] < a.time[-1]]
