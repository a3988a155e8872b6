"""The figure of a log's noise from plain numbers, so that a process can draw it that knows nothing of their origin."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .style import Axes, COLOURS, Figure, legend_above, new_figure


class AllanCurve(NamedTuple):
    """Allan deviations of a channel, and the model's."""

    name: str
    tau: Float[np.ndarray, " time"]  # s
    deviation: Float[np.ndarray, " time"]
    lower: Float[np.ndarray, " time"]  # 68 % limits
    upper: Float[np.ndarray, " time"]
    described: Float[np.ndarray, " fine"]  # s, where the model describes them
    model: Float[np.ndarray, " fine"]  # its deviation there


class AllanPanel(NamedTuple):
    """A triad."""

    label: str
    curves: tuple[AllanCurve, ...]


def allan(panels: Sequence[AllanPanel]) -> Figure:
    """One panel a triad: measured deviations with 68 % limits (bands), the fitted model (lines)."""
    from matplotlib.ticker import FuncFormatter

    figure, axes = new_figure(1, len(panels), height=3.4)
    for ax, panel in zip(axes, panels, strict=True):
        for c, colour in zip(panel.curves, COLOURS, strict=False):
            ax.fill_between(c.tau, c.lower, c.upper, color=colour, alpha=0.25, lw=0)
            ax.plot(c.tau, c.deviation, ".", ms=2.5, color=colour, label=c.name)
            ax.plot(c.described, c.model, "-", lw=0.9, color=colour)
        ax.set_xscale("log")
        ax.set_yscale("log")
        # Plain labels and few ticks: mathematical text and minor ticks take most of the drawing's time.
        ax.minorticks_off()
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        _label_twice(ax)
        ax.set_xlabel("averaging time τ, s")
        ax.set_ylabel(panel.label)
        legend_above(ax)
    return figure


def _label_twice(ax: Axes) -> None:
    """Ticks between the decades where fewer than two lie in what an axis shows: one number tells no scale."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    between = (
        LogLocator(subs=(1.0, 2.0, 5.0)),
        LogLocator(subs=(*range(1, 10),)),
        MaxNLocator(4, min_n_ticks=2),
    )
    for axis in (ax.xaxis, ax.yaxis):
        low, high = sorted(axis.get_view_interval())
        for locator in (axis.get_major_locator(), *between):
            ticks = np.asarray(locator.tick_values(low, high))
            if np.count_nonzero((ticks >= low) & (ticks <= high)) >= 2:
                axis.set_major_locator(locator)
                break
