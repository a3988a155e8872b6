"""The figure of a log's noise from plain numbers, so that a process can draw it that knows nothing of their origin."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .style import COLOURS, Figure, legend_above, new_figure


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
        ax.set_xlabel("averaging time τ, s")
        ax.set_ylabel(panel.label)
        legend_above(ax)
    return figure
