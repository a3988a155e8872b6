"""Figure of a log's noise: Allan deviations with their limits, and the terms that explain them."""

import numpy as np

from ..allan import ChannelNoise, LogNoise
from . import noise_panels as panels
from .noise_panels import AllanCurve, AllanPanel
from .style import Figure


_LABELS = {"accel": "Allan deviation, m/s²", "gyro": "Allan deviation, rad/s"}


def allan(noise: LogNoise) -> Figure:
    """One panel a triad: measured deviations with 68 % limits (bands), the fitted model (lines, from where
    no filter bends the curve to where a drift takes over)."""
    return panels.allan(allan_panels(noise))


def allan_panels(noise: LogNoise) -> tuple[AllanPanel, ...]:
    """What `allan` shows."""
    made = []
    for triad, label in _LABELS.items():
        curves = tuple(map(_curve, (c for c in noise.channels if c.channel.startswith(triad))))
        if curves:
            made.append(AllanPanel(label, curves))
    return tuple(made)


def _curve(found: ChannelNoise) -> AllanCurve:
    tau = found.curve.tau
    first, last = _described(found)
    fine = np.geomspace(max(tau[0], first), min(tau[-1], last), 200)
    model = found.model.deviation(fine)
    return AllanCurve(
        found.channel, tau, found.curve.deviation, found.lower, found.upper, fine, model
    )


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
