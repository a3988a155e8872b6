"""Figures of a diagnosis: where, how much better, and what the omission had pulled."""

from collections.abc import Sequence

import numpy as np

from ..data.recording import Recording
from ..diagnose import Diagnosis
from .style import COLOURS, DASHES, Figure, INK, legend_above, MARKERS, new_figure, QUIET


def places(found: Diagnosis, recordings: Sequence[Recording]) -> Figure:
    """When and on which channel the recordings depart from the model, by what drives it.

    Recorded stretches are shaded, so that a soak between experiments is not taken for agreement.
    """
    channels = sorted({w.channel for w in found.where}, reverse=True)
    drivers = list(dict.fromkeys(w.driver for w in found.where))
    figure, (ax,) = new_figure(1, 1, height=1.25 + 0.32 * len(channels))
    start = min(float(r.time[0]) for r in recordings)
    end = max(float(r.time[-1]) for r in recordings)
    divisor, unit = (3600.0, "h") if end - start > 3 * 3600.0 else (60.0, "min")
    for recording in recordings:
        span = (np.array([recording.time[0], recording.time[-1]]) - start) / divisor
        ax.axvspan(float(span[0]), float(span[1]), color=QUIET, alpha=0.13, lw=0)
    shown: set[str] = set()
    for place in found.where:
        k = drivers.index(place.driver)
        ax.barh(
            channels.index(place.channel),
            max(place.end - place.start, 2e-3 * (end - start)) / divisor,
            left=(place.start - start) / divisor,
            height=0.5,
            color=COLOURS[k % len(COLOURS)],
            label="_" if place.driver in shown else place.driver,
        )
        shown.add(place.driver)
    ax.set_yticks(range(len(channels)), channels)
    ax.set_ylim(-0.6, len(channels) - 0.4)
    ax.set_xlim(0.0, (end - start) / divisor)
    ax.set_xlabel(f"time, {unit}")
    ax.grid(axis="y", visible=False)
    return _with_legend(figure)


def _with_legend(figure: Figure) -> Figure:
    legend_above(figure.axes[0], columns=4)
    return figure


def pulled(found: Diagnosis, *, most: int = 20) -> Figure:
    """Shift of each calibrated parameter, in its own standard deviations, once the omitted effect is
    in the model; the largest ones."""
    shift = [(m.after - m.before) / m.std for m in found.parameters_moved if m.std > 0]
    names = [m.name for m in found.parameters_moved if m.std > 0]
    order = np.argsort(np.abs(shift))[::-1][:most][::-1]
    figure, (ax,) = new_figure(1, 1, height=0.9 + 0.24 * len(order))
    at = np.arange(len(order))
    values = np.asarray(shift)[order]
    ax.axvspan(-2.0, 2.0, color=QUIET, alpha=0.18, lw=0)
    ax.axvline(0.0, color=INK, lw=0.8)
    ax.hlines(at, 0.0, values, color=COLOURS[0], lw=1.2)
    ax.plot(values, at, MARKERS[0], color=COLOURS[0], ms=5)
    ax.set_yticks(at, [names[k] for k in order])
    ax.set_ylim(-0.7, len(order) - 0.3)
    ax.set_xlabel("shift, standard deviations (shaded: within 2)")
    return figure


def improvement(found: Diagnosis) -> Figure:
    """Misfit relative to the baseline's, in the fit and on data left out of it."""
    assert found.baseline is not None and found.augmented is not None
    rows = (
        ("in the fit", found.augmented.rms / found.baseline.rms),
        ("on data left out", found.augmented.held_out_rms / found.baseline.held_out_rms),
    )
    figure, (ax,) = new_figure(1, 1, width=5.6, height=1.5)
    ax.axvline(1.0, color=INK, ls=DASHES[1], lw=1)
    for k, (_, ratio) in enumerate(rows):
        ax.barh(1 - k, ratio, height=0.5, color=COLOURS[k])
        # Inside the bar, away from the dashed line, where the bar has room for it.
        inside = ratio > 0.15
        ax.text(
            ratio,
            1 - k,
            f" {ratio:.2f} ",
            va="center",
            ha="right" if inside else "left",
            color="white" if inside else INK,
        )
    ax.set_yticks([1, 0], [name for name, _ in rows])
    ax.set_xlim(0.0, 1.15 * max(1.0, *(ratio for _, ratio in rows)))
    ax.set_xlabel("rms misfit with the effect / without it (dashed: no better)")
    ax.grid(axis="y", visible=False)
    return figure
