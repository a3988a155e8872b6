"""The figure of a barometer's calibration: averages over temperature, and the curve through them."""

import numpy as np

from ..calibrate.barometer import BarometerResult
from .style import COLOURS, Figure, INK, legend_above, new_figure, QUIET


_NORMAL_95 = 1.959964


def offset_over_temperature(result: BarometerResult) -> Figure:
    """Averages less the pressure of the place and the drift, Pa, with the fitted curve and its 95 % band; below, what
    is left of them."""
    figure, axes = new_figure(2, 1, height=4.6)
    temperature, offset = np.asarray(result.temperature), np.asarray(result.offset)
    grid = np.linspace(temperature.min(), temperature.max(), 161)
    curve, sigma = result.calibration.over(grid)
    axes[0].plot(temperature, offset, ".", color=QUIET, ms=4, label="averages as recorded")
    band = _NORMAL_95 * sigma
    axes[0].fill_between(grid, curve - band, curve + band, color=COLOURS[0], alpha=0.25, lw=0)
    axes[0].plot(grid, curve, color=COLOURS[0], label="fitted, with its 95 % band")
    axes[0].set(ylabel="offset, Pa", xlabel="temperature, °C")
    legend_above(axes[0], columns=2)
    left = offset - result.calibration.over(temperature)[0]
    axes[1].axhline(0.0, color=INK, lw=0.8)
    axes[1].plot(temperature, left, ".", color=COLOURS[0], ms=4)
    axes[1].set(ylabel="left, Pa", xlabel="temperature, °C")
    return figure
