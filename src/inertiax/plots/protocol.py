"""Figure of a protocol: measured values with their guard bands against their limits."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .style import COLOURS, Figure, INK, new_figure


class AgainstLimit(NamedTuple):
    """One value, as parts of its limit."""

    label: str
    value: float
    guard: float  # half-width of the guard band
    decision: str  # pass | fail | undecided


_FURTHEST = (
    3.0  # parts of the limit that are drawn; what is beyond stands at the edge, with its number
)

_MARKS = {"pass": ("o", COLOURS[2]), "undecided": ("D", COLOURS[4]), "fail": ("s", COLOURS[1])}


def against_limits(rows: Sequence[AgainstLimit]) -> Figure:
    """Absolute values over their limits, a line each; the decision by mark and colour."""
    figure, (ax,) = new_figure(1, 1, height=0.85 + 0.32 * len(rows))
    place = np.arange(len(rows))[::-1]
    for y, row in zip(place, rows, strict=True):
        mark, colour = _MARKS[row.decision]
        shown = min(abs(row.value), _FURTHEST)
        ax.errorbar(shown, y, xerr=row.guard, fmt=mark, color=colour, capsize=3, ms=5)
        if shown < abs(row.value):
            ax.annotate(f"{abs(row.value):.3g}", (shown, y), (0, 4), textcoords="offset points",
                        ha="center", va="bottom")  # fmt: skip
    ax.axvline(1.0, color=INK, lw=1.0)
    ax.set_yticks(place, [row.label for row in rows])
    ax.set_ylim(-0.6, len(rows) - 0.4)
    furthest = max(1.0, *(abs(r.value) + r.guard for r in rows))
    ax.set_xlim(0.0, 1.08 * min(furthest, _FURTHEST))
    ax.grid(axis="y", visible=False)
    ax.set(xlabel="|value| as part of its limit, with the guard band; limit at 1")
    return figure
