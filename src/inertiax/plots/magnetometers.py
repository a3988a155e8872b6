"""Figures of the magnetometers' calibration: the field's magnitude before and after, and its upward part."""

import numpy as np
from jaxtyping import Float, Int

from ..calibrate.results import MagnetometerResult
from .style import COLOURS, Figure, INK, legend_above, new_figure, QUIET


_MICRO = 1e6  # µT in a T


def field_before_and_after(result: MagnetometerResult) -> Figure:
    """The magnitude of every row as recorded and compensated, and the compensated one alone with 1 sigma, by the angle
    of turn in which rows follow each other; below, the upward part at the rests."""
    field = float(np.asarray(result.estimator.field))
    resting = np.asarray(result.dwells.position) >= 0
    turned = result.frame == "accel"
    figure, axes = new_figure(3 if turned else 2, 1, height=6.2 if turned else 4.4)
    raw = _MICRO * np.linalg.norm(np.asarray(result.dwells.mag), axis=1)
    misfit, sigma = _MICRO * np.asarray(result.misfit), _MICRO * np.asarray(result.sigma)
    order = np.arange(len(raw))
    axes[0].plot(order, raw, ".", color=COLOURS[1], ms=4, label="as recorded")
    axes[0].plot(
        order, _MICRO * field + misfit[:, 0], ".", color=COLOURS[0], ms=4, label="compensated"
    )
    axes[0].axhline(_MICRO * field, color=INK, lw=0.8)
    axes[0].set(ylabel="|field|, µT", xlabel="row: rests, then samples in motion")
    legend_above(axes[0], columns=2)
    _bars(axes[1], order, misfit[:, 0], sigma[:, 0], resting)
    axes[1].set(ylabel="|compensated| − F, µT", xlabel="row: rests, then samples in motion")
    if turned:
        rests = np.arange(int(resting.sum()))
        _bars(axes[2], rests, misfit[resting, 1], sigma[resting, 1], np.ones(len(rests), bool))
        axes[2].set(ylabel="upward part − mean, µT", xlabel="rest")
    return figure


def _bars(
    ax,
    place: Float[np.ndarray, " row"] | Int[np.ndarray, " row"],
    values: Float[np.ndarray, " row"],
    sigmas: Float[np.ndarray, " row"],
    resting: np.ndarray,
) -> None:
    """Values with 1 sigma, rests before samples in motion."""
    ax.axhline(0.0, color=INK, lw=0.8)
    for rows, colour in ((resting, COLOURS[0]), (~resting, QUIET)):
        ax.errorbar(
            place[rows], values[rows], sigmas[rows], fmt="o", color=colour, ms=2.8, elinewidth=0.7
        )
