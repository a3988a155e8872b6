"""Figures of a fleet: how every parameter is distributed, and the line's curves with their spread."""

import math

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import TriadCalibration
from ..calibration.quantities import label
from ..fleet.overview.recalibration import Drift, FAR
from ..fleet.overview.view import TriadView
from ..fleet.population.population import TriadPopulation
from .style import Axes, COLOURS, Figure, INK, new_figure, QUIET


MOST_BINS = 40
REACH = 5.0  # standard deviations between devices that a histogram shows

Units = tuple[tuple[float, str], ...]  # factor from SI and unit of each parameter


def distributions(view: TriadView, units: Units) -> Figure:
    """A histogram of every parameter over the devices, at the reference temperature.

    Lines: the line's mean (solid), one standard deviation between devices (dashed, where the line is known). Devices
    beyond the axis are counted at its ends.
    """
    at = view.reference
    figure, axes = _panels(len(view.model.names), height=1.55)
    for k, (name, (factor, unit)) in enumerate(zip(view.model.names, units, strict=True)):
        ax, x = axes[k], factor * view.values[:, at, k]
        mean, spread = factor * view.mean[at, k], factor * view.spread[at, k]
        # No axis is finer than what each device is known to.
        own = float(np.median(factor * view.sigmas[:, at, k]))
        low, high = _limits(x, mean, max(spread, own) if math.isfinite(own) else spread)
        edges = np.linspace(low, high, _bins(len(x)) + 1).tolist()
        ax.hist(np.clip(x, low, high), edges, histtype="stepfilled", color=COLOURS[0])
        ax.axvline(mean, color=COLOURS[1], lw=1.0)
        for place in () if view.line is None else (mean - spread, mean + spread):
            ax.axvline(place, color=COLOURS[1], ls="--", lw=1.0)
        for outside, side in ((x < low, "left"), (x > high, "right")):
            _count_beyond(ax, int(outside.sum()), side)
        ax.set_xlim(low, high)
        ax.set_xlabel(unit)
        ax.set_title(label(name))
        if k % 3 == 0:
            ax.set_ylabel("devices")
        ax.locator_params(axis="y", nbins=3, integer=True)
        ax.locator_params(axis="x", nbins=4)
    return figure


def _bins(devices: int) -> int:
    return int(np.clip(2.0 * math.sqrt(devices), 8, MOST_BINS))


def _limits(x: np.ndarray, mean: float, spread: float) -> tuple[float, float]:
    """The line's spread and all devices, or the middle of them where some are far out."""
    reach = REACH * spread
    low, high = max(float(x.min()), mean - reach), min(float(x.max()), mean + reach)
    # All beyond one side: a shift of the whole fleet against the prior.
    if not low < high:
        low, high = float(x.min()), float(x.max())
    low, high = min(low, mean - spread), max(high, mean + spread)
    pad = 0.04 * (high - low) or max(abs(high), 1e-12)
    return low - pad, high + pad


def _count_beyond(ax: Axes, count: int, side: str) -> None:
    if count:
        x = 0.02 if side == "left" else 0.98
        text = f"← {count}" if side == "left" else f"{count} →"
        ax.text(x, 0.92, text, transform=ax.transAxes, ha=side, va="top", fontsize=8)


def line_curves(
    line: TriadPopulation, units: Units, device: TriadCalibration | None = None
) -> Figure:
    """Mean of every parameter over temperature with one and two standard deviations between devices; one
    device's own curve over them."""
    grid = np.linspace(line.model.low, line.model.high, 61)
    mean, spread = line.mean_curves(grid), line.spread(grid)
    own = None if device is None else _own_curve(device, grid)
    figure, axes = _panels(len(line.model.names), height=1.7)
    for k, (name, (factor, unit)) in enumerate(zip(line.model.names, units, strict=True)):
        ax, middle, width = axes[k], factor * mean[:, k], factor * spread[:, k]
        for times, alpha in ((2.0, 0.18), (1.0, 0.25)):
            low, high = middle - times * width, middle + times * width
            ax.fill_between(grid, low, high, color=COLOURS[0], alpha=alpha, lw=0)
        ax.plot(grid, middle, color=COLOURS[0])
        if own is not None:
            ax.plot(grid, factor * own[:, k], color=COLOURS[1])
        ax.set_xlim(grid[0], grid[-1])
        ax.set(title=f"{label(name)}, {unit}")
        ax.locator_params(axis="y", nbins=4)
    for ax in axes[max(len(line.model.names) - 3, 0) : len(line.model.names)]:
        ax.set_xlabel("temperature, °C")
    return figure


def _own_curve(device: TriadCalibration, grid: np.ndarray) -> Float[np.ndarray, "grid parameters"]:
    return device.over(grid)[0]


def drift_sigmas(drift: Drift) -> Figure:
    """Histogram of all changes in standard deviations, beside what chance alone would give."""
    x = np.clip(drift.sigmas.reshape(-1), -8.0, 8.0)
    edges = np.linspace(-8.0, 8.0, 65)
    figure, axes = new_figure(1, 1, width=5.4, height=2.3)
    ax = axes[0]
    ax.hist(x, edges.tolist(), histtype="stepfilled", color=COLOURS[0])
    normal = np.exp(-0.5 * np.square(edges)) / math.sqrt(2.0 * math.pi)
    ax.plot(edges, len(x) * (edges[1] - edges[0]) * normal, color=COLOURS[1])
    for side in (-FAR, FAR):
        ax.axvline(side, color=INK, ls=":", lw=1.0)
    ax.set_xlim(-8.0, 8.0)
    ax.set(xlabel="change in standard deviations", ylabel="changes")
    return figure


def _panels(count: int, *, height: float) -> tuple[Figure, list[Axes]]:
    rows = math.ceil(count / 3)
    figure, axes = new_figure(rows, 3, width=8.4, height=0.4 + height * rows)
    for ax in axes[count:]:
        ax.axis("off")
    for ax in axes[:count]:
        ax.tick_params(labelsize=7.5)
        ax.title.set_color(INK)
        ax.spines["left"].set_color(QUIET)
    return figure, axes
