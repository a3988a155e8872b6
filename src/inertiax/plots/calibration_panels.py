"""Figures of a calibration from plain numbers, so that a process can draw them that knows nothing of what made them."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .style import (
    Axes,
    AXIS_NAMES,
    COLOURS,
    DASHES,
    Figure,
    INK,
    legend_above,
    MARKERS,
    new_figure,
    QUIET,
)


class ParameterPanel(NamedTuple):
    """A family of parameters: at one place, or over temperatures."""

    title: str
    unit: str  # of values and half-widths
    labels: tuple[str, ...]  # axes of the parameters
    values: Float[np.ndarray, "temperature parameter"]
    half_widths: Float[np.ndarray, "temperature parameter"]  # of the 95 % intervals
    grid: Float[np.ndarray, " temperature"] | None = None  # °C; None: no temperature
    ends: tuple[float, float] | None = None  # °C, that the data covered


class Misfits(NamedTuple):
    """What is left of dwells after the fit."""

    unit: str  # of misfit and sigma
    misfit: Float[np.ndarray, "dwell row"]
    sigma: Float[np.ndarray, "dwell row"]
    order: Int[np.ndarray, " dwell"]  # place of each in time
    against: tuple[tuple[np.ndarray, str], ...]  # what they are drawn over, the order first
    edges: Float[np.ndarray, " edge"]  # between experiments, in that order


class RestsPanel(NamedTuple):
    """A recording's raw outputs, as the range of each short stretch, with its rests."""

    name: str
    unit: str  # of the outputs
    time_unit: str
    time: Float[np.ndarray, " stretch"]
    low: Float[np.ndarray, "3 stretch"]
    high: Float[np.ndarray, "3 stretch"]
    starts: Float[np.ndarray, " rest"]
    ends: Float[np.ndarray, " rest"]
    limits: tuple[float, float]


def parameters(panels: Sequence[ParameterPanel]) -> Figure:
    """Every parameter with its 95 % interval, a panel per family; over temperature what the data did not cover is
    shaded."""
    over = panels[0].grid is not None
    figure, axes = panel_axes(len(panels), height=2.9 if over else 2.5)
    for ax, panel in zip(axes, panels, strict=False):
        draw_parameters(ax, panel)
    return figure


def panel_axes(count: int, *, height: float) -> tuple[Figure, list[Axes]]:
    """Up to three panels in a row, four in two rows."""
    columns = 2 if count == 4 else min(3, count)
    rows = math.ceil(count / columns)
    return new_figure(rows, columns, width=0.6 + 2.9 * columns, height=height * rows)


def draw_parameters(ax: Axes, panel: ParameterPanel) -> None:
    """One panel of `parameters`."""
    if panel.grid is None:
        _constants(ax, panel)
    else:
        _curves(ax, panel, panel.grid)
    ax.set_title(panel.title)


def _curves(ax: Axes, panel: ParameterPanel, grid: Float[np.ndarray, " temperature"]) -> None:
    for k, label in enumerate(panel.labels):
        curve, band = panel.values[:, k], panel.half_widths[:, k]
        colour = COLOURS[k % len(COLOURS)]
        ax.fill_between(grid, curve - band, curve + band, color=colour, alpha=0.25, lw=0)
        ax.plot(grid, curve, DASHES[k // len(COLOURS)], color=colour, label=label)
    low, high = panel.ends or (grid[0], grid[-1])
    for a, b in ((grid[0], low), (high, grid[-1])):
        ax.axvspan(a, b, color=QUIET, alpha=0.18, lw=0)
    ax.set_xlim(grid[0], grid[-1])
    ax.set(xlabel="temperature, °C", ylabel=panel.unit)
    _legend_below(ax, len(panel.labels))


def _constants(ax: Axes, panel: ParameterPanel) -> None:
    place = np.arange(len(panel.labels))
    ax.axhline(0.0, color=QUIET, lw=0.8)
    ax.errorbar(place, panel.values[0], panel.half_widths[0], fmt="o", color=COLOURS[0], capsize=4)
    ax.set_xticks(place, panel.labels)
    ax.set_xlim(-0.5, len(panel.labels) - 0.5)
    ax.grid(axis="x", visible=False)
    ax.set(xlabel="axis", ylabel=panel.unit)


def _legend_below(ax: Axes, count: int) -> None:
    columns = 3 if count <= 6 else 5
    ax.legend(
        loc="upper left",
        bbox_to_anchor=(0.0, -0.22),
        ncols=columns,
        handlelength=1.3,
        columnspacing=1.0,
        borderaxespad=0.0,
    )


# What the rows of a misfit are, by how many there are.
_ROW_NAMES = {
    1: ("|compensated| − g",),
    2: ("tilt about one axis across gravity", "about the other"),
    3: AXIS_NAMES,
}


def misfits(given: Misfits) -> Figure:
    """Misfits with error bars of 1 sigma, in order of time and against temperature and position; the panels share one
    scale."""
    from matplotlib.ticker import MaxNLocator

    against, misfit, sigma = given.against, given.misfit, given.sigma
    figure, axes = new_figure(len(against), 1, height=0.5 + 1.85 * len(against), sharey=True)
    labels = _ROW_NAMES[misfit.shape[1]]
    for ax, (x, name) in zip(axes, against, strict=True):
        ax.axhline(0.0, color=INK, lw=0.8)
        for k in range(misfit.shape[1]):
            ax.errorbar(
                x,
                misfit[:, k],
                sigma[:, k],
                fmt=MARKERS[k],
                color=COLOURS[k],
                elinewidth=0.7,
                ms=2.8,
                alpha=0.75,
                label=labels[k],
            )
        ax.set(xlabel=name, ylabel=f"misfit, {given.unit}")
    legend_above(axes[0])
    # A dwell with a far greater sigma than the others must not hide what the others show.
    usual = np.minimum(sigma, 3.0 * np.median(sigma))
    reach = 1.08 * float(np.max(np.abs(misfit) + usual))
    if reach > 0.0:
        axes[0].set_ylim(-reach, reach)
    # One artist for all edges: a campaign may have hundreds of recordings.
    across = axes[0].get_xaxis_transform()
    axes[0].vlines(given.edges, 0.0, 1.0, QUIET, ":", lw=0.8, transform=across)
    axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def coverage(directions: Float[np.ndarray, "dwells 3"]) -> Figure:
    """Directions of the specific force in the case frame on two hemispheres, in Lambert's
    equal-area projection: empty regions are what the campaign did not look at."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    figure, axes = new_figure(1, 2, width=6.4, height=3.4)
    for ax, sign in zip(axes, (1.0, -1.0), strict=True):
        rows = unit[sign * unit[:, 2] >= 0.0 if sign > 0 else unit[:, 2] < 0.0]
        _hemisphere(ax)
        radius = np.sqrt(1.0 - np.abs(rows[:, 2]))
        across = np.maximum(np.hypot(rows[:, 0], rows[:, 1]), 1e-12)
        x, y = radius * rows[:, 0] / across, radius * rows[:, 1] / across
        # An empty line that is not clipped reaches to nowhere, and the layout with it.
        if len(rows):
            ax.plot(x, y, "o", color=COLOURS[0], alpha=0.6, ms=5, mew=0, clip_on=False)
        ax.set_title(f"z {'up' if sign > 0 else 'down'}: {len(rows)} dwells", loc="center", pad=2)
    return figure


def _hemisphere(ax: Axes) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    for tilt in (30.0, 60.0, 90.0):
        r = math.sqrt(1.0 - math.cos(math.radians(tilt)))
        ax.plot(r * np.cos(angle), r * np.sin(angle), color=QUIET, lw=0.9 if tilt == 90 else 0.5)
    for x, y, text in ((1, 0, "+x"), (0, 1, "+y"), (-1, 0, "−x"), (0, -1, "−y")):
        ax.plot([0, x], [0, y], color=QUIET, lw=0.4)
        ax.text(1.14 * x, 1.12 * y, text, ha="center", va="center", fontsize=8.5)
    ax.set(xlim=(-1.25, 1.25), ylim=(-1.2, 1.2), aspect="equal")
    ax.axis("off")


def rests(panels: Sequence[RestsPanel]) -> Figure:
    """The raw signal with the rests that were found in it, a panel per recording."""
    figure, axes = new_figure(len(panels), 1, height=0.4 + 1.9 * len(panels))
    for ax, panel in zip(axes, panels, strict=True):
        for k, (low, high) in enumerate(zip(panel.low, panel.high, strict=True)):
            label, colour = AXIS_NAMES[k], COLOURS[k]
            ax.fill_between(panel.time, low, high, color=colour, lw=0.6, alpha=0.85, label=label)
        for number, (a, b) in enumerate(zip(panel.starts, panel.ends, strict=True)):
            span = ax.axvspan(float(a), float(b), color=QUIET, alpha=0.28, lw=0)
            span.set_label("rest" if number == 0 else "_")
        ax.set_xlim(*panel.limits)
        ax.set(xlabel=f"time, {panel.time_unit}", ylabel=f"output, {panel.unit}")
        ax.set_title(panel.name)
    legend_above(axes[0], columns=4)
    return figure
