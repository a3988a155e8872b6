"""Figure of a log's noise: Allan deviations with their limits, and the terms that explain them."""

import numpy as np
from matplotlib.figure import Figure

from ..allan import LogNoise
from .style import COLOURS, legend_above, new_figure


_LABELS = {"accel": "Allan deviation, m/s²", "gyro": "Allan deviation, rad/s"}


def allan(noise: LogNoise) -> Figure:
    """One panel a triad: measured deviations with 68 % limits (bands), the fitted model (lines)."""
    triads = [t for t in _LABELS if any(c.channel.startswith(t) for c in noise.channels)]
    figure, axes = new_figure(1, len(triads), height=3.4)
    for ax, triad in zip(axes, triads, strict=True):
        shown = [c for c in noise.channels if c.channel.startswith(triad)]
        for found, colour in zip(shown, COLOURS, strict=False):
            tau = found.curve.tau
            ax.fill_between(tau, found.lower, found.upper, color=colour, alpha=0.25, lw=0)
            ax.plot(tau, found.curve.deviation, ".", ms=2.5, color=colour, label=found.channel)
            fine = np.geomspace(tau[0], tau[-1], 200)
            ax.plot(fine, found.model.deviation(fine), "-", lw=0.9, color=colour)
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xlabel("averaging time τ, s")
        ax.set_ylabel(_LABELS[triad])
        legend_above(ax)
    return figure
