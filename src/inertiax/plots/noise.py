"""Figure of a log's noise: Allan deviations with their limits, and the terms that explain them."""

import numpy as np

from ..allan import ChannelNoise, LogNoise
from .style import COLOURS, Figure, legend_above, new_figure


_LABELS = {"accel": "Allan deviation, m/s²", "gyro": "Allan deviation, rad/s"}


def allan(noise: LogNoise) -> Figure:
    """One panel a triad: measured deviations with 68 % limits (bands), the fitted model (lines, from where
    no filter bends the curve to where a drift takes over)."""
    triads = [t for t in _LABELS if any(c.channel.startswith(t) for c in noise.channels)]
    figure, axes = new_figure(1, len(triads), height=3.4)
    for ax, triad in zip(axes, triads, strict=True):
        shown = [c for c in noise.channels if c.channel.startswith(triad)]
        for found, colour in zip(shown, COLOURS, strict=False):
            tau = found.curve.tau
            ax.fill_between(tau, found.lower, found.upper, color=colour, alpha=0.25, lw=0)
            ax.plot(tau, found.curve.deviation, ".", ms=2.5, color=colour, label=found.channel)
            first, last = _described(found)
            fine = np.geomspace(max(tau[0], first), min(tau[-1], last), 200)
            ax.plot(fine, found.model.deviation(fine), "-", lw=0.9, color=colour)
        ax.set_xscale("log")
        ax.set_yscale("log")
        # Plain labels and few ticks: mathematical text and minor ticks take most of the drawing's time.
        ax.minorticks_off()
        for axis in (ax.xaxis, ax.yaxis):
            from matplotlib.ticker import FuncFormatter

            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.set_xlabel("averaging time τ, s")
        ax.set_ylabel(_LABELS[triad])
        legend_above(ax)
    return figure


def _described(found: ChannelNoise) -> tuple[float, float]:
    """The averaging times from where the sensor's filter no longer bends the curve, s, to where a drift that none of
    the terms describes is as strong as they are."""
    model, curve, last = found.model, found.curve, np.inf
    if model.band[0] > 0.0:
        drifts = np.square(curve.deviation) > 2.0 * np.square(model.deviation(curve.tau))
        last = float(curve.tau[np.argmax(drifts)]) if drifts.any() else np.inf
    if model.corner is not None:
        return 1.0 / model.corner, last
    return (0.5 / model.band[1] if model.band[1] < 0.49 * model.rate else 0.0), last
