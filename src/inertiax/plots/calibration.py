"""Figures of one device's calibration: curves, misfit, orientations, rests."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ..calibrate.pipeline import TriadResult
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.quantities import customary_units, family, SHOWN_AS
from ..data.recording import Recording
from ..reduction.dwells import Dwells
from ..reduction.segments import Segments
from .style import (
    Axes,
    AXIS_NAMES,
    COLOURS,
    DASHES,
    drawing,
    Figure,
    INK,
    legend_above,
    MARKERS,
    new_figure,
    QUIET,
)


NORMAL_95 = 1.959964  # half-width of the 95 % interval of a normal distribution, in sigmas


def parameter_curves(triad: TriadCalibration, temperature_range: tuple[float, float]) -> Figure:
    """Every parameter over temperature with its 95 % band, a panel per family.

    The curves go 5 % of the range beyond it on both sides; what is beyond is shaded.
    """
    families = _families(triad.names)
    figure, axes = _panels(len(families), height=2.9)
    for ax, (title, members) in zip(axes, families.items(), strict=False):
        _curve_panel(ax, triad, members, temperature_range)
        ax.set_title(title)
    return figure


def _curve_panel(
    ax: Axes, triad: TriadCalibration, members: list[int], temperature_range: tuple[float, float]
) -> None:
    low, high = temperature_range
    margin = 0.05 * (high - low)
    grid = np.linspace(low - margin, high + margin, 161)
    values, sigmas = triad.over(grid)
    factor, unit = customary_units(triad)[members[0]]
    for k, member in enumerate(members):
        curve, band = factor * values[:, member], NORMAL_95 * factor * sigmas[:, member]
        colour = COLOURS[k % len(COLOURS)]
        ax.fill_between(grid, curve - band, curve + band, color=colour, alpha=0.25, lw=0)
        ax.plot(
            grid,
            curve,
            DASHES[k // len(COLOURS)],
            color=colour,
            label=_axes_of(triad.names[member]),
        )
    for a, b in ((low - margin, low), (high, high + margin)):
        ax.axvspan(a, b, color=QUIET, alpha=0.18, lw=0)
    ax.set_xlim(grid[0], grid[-1])
    ax.set(xlabel="temperature, °C", ylabel=unit)
    _legend_right(ax, len(members))


def constant_parameters(triad: TriadCalibration) -> Figure:
    """Parameters without temperature dependence: values with 95 % intervals, a panel per family."""
    families = _families(triad.names)
    figure, axes = _panels(len(families), height=2.5)
    for ax, (title, members) in zip(axes, families.items(), strict=False):
        _constant_panel(ax, triad, members)
        ax.set_title(title)
    return figure


def _constant_panel(ax: Axes, triad: TriadCalibration, members: list[int]) -> None:
    (values,), (sigmas,) = triad.over(np.zeros(1))
    factor, unit = customary_units(triad)[members[0]]
    place = np.arange(len(members))
    ax.axhline(0.0, color=QUIET, lw=0.8)
    ax.errorbar(
        place,
        factor * values[members],
        NORMAL_95 * factor * sigmas[members],
        fmt="o",
        color=COLOURS[0],
        capsize=4,
    )
    ax.set_xticks(place, [_axes_of(triad.names[m]) for m in members])
    ax.set_xlim(-0.5, len(members) - 0.5)
    ax.grid(axis="x", visible=False)
    ax.set(xlabel="axis", ylabel=unit)


def both_triads(calibration: Calibration) -> Figure:
    """Every parameter of a calibration, a panel per triad and family: over its temperature range with 95 % bands, or
    where a triad knows no temperature with 95 % intervals."""
    panels = [(t, *f) for t in calibration.triads for f in _families(t.names).items()]
    if not panels:
        raise ValueError("`calibration.plot()`: no triad is calibrated.")
    with drawing():
        figure, axes = _panels(len(panels), height=2.9)
        for ax, (triad, title, members) in zip(axes, panels, strict=False):
            if triad.curve.basis.size == 1:
                _constant_panel(ax, triad, members)
            else:
                _curve_panel(ax, triad, members, _range(calibration, triad))
            ax.set_title(f"{triad.names[0].partition('.')[0]}: {title}")
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        figure.suptitle("bands and bars hold 95 %", fontsize="small", x=0.01, ha="left")
    return figure


def _range(calibration: Calibration, triad: TriadCalibration) -> tuple[float, float]:
    """Temperatures (°C) that the data covered; where nothing says so, those between the basis' nodes."""
    ends = [float(t) for t in calibration.temperature_range or triad.curve.basis.nodes]
    return min(ends), max(ends)


# What the rows of a misfit are, by how many there are.
_ROW_NAMES = {
    1: ("|compensated| − g",),
    2: ("tilt about one axis across gravity", "about the other"),
    3: AXIS_NAMES,
}


def misfits(result: TriadResult) -> Figure:
    """What is left after the fit, per dwell with error bars of 1 sigma, in order of time and
    against temperature and position; the panels share one scale."""
    factor, unit = SHOWN_AS[result.misfit_unit]
    dwells = result.dwells
    # By order and not by the clock: hours of soaking between experiments would squeeze the dwells.
    order = np.argsort(_in_order(dwells))
    motions = dwells.motion is not None
    against = [(order, f"{'motion' if motions else 'dwell'}, in order of time")]
    if np.ptp(np.asarray(dwells.temperature)) > 0.0:
        against.append((np.asarray(dwells.temperature), "temperature, °C"))
    position = np.asarray(dwells.position)
    # Rests that were found are numbered by time.
    if np.ptp(position) > 0 and not np.all(np.diff(position[np.argsort(order)]) == 1):
        against.append((position, "position"))
    figure, axes = new_figure(len(against), 1, height=0.5 + 1.85 * len(against), sharey=True)
    misfit, sigma = factor * np.asarray(result.misfit), factor * np.asarray(result.sigma)
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
        ax.set(xlabel=name, ylabel=f"misfit, {unit}")
    legend_above(axes[0])
    # A dwell with a far greater sigma than the others must not hide what the others show.
    usual = np.minimum(sigma, 3.0 * np.median(sigma))
    reach = 1.08 * float(np.max(np.abs(misfit) + usual))
    if reach > 0.0:
        axes[0].set_ylim(-reach, reach)
    _mark_experiments(axes[0], order, np.asarray(dwells.experiment))
    from matplotlib.ticker import MaxNLocator

    axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def _in_order(dwells: Dwells) -> Int[np.ndarray, " dwell"]:
    """Numbers of the dwells in order of time, recording after recording where their clocks overlap."""
    time, rows = np.asarray(dwells.time), dwells.rows
    if rows is None:
        return np.argsort(time, kind="stable")
    recording = np.asarray(rows)[:, 0]
    first = [time[recording == k].min() for k in np.unique(recording)]
    last = [time[recording == k].max() for k in np.unique(recording)]
    order = np.argsort(first)
    apart = np.all(np.array(first)[order][1:] >= np.array(last)[order][:-1])
    return np.argsort(time, kind="stable") if apart else np.lexsort((time, recording))


def _mark_experiments(ax: Axes, order: np.ndarray, experiment: np.ndarray) -> None:
    """A line where an experiment ends and the next begins."""
    edges = np.flatnonzero(np.diff(experiment[np.argsort(order)])) + 0.5
    # One artist for all: a campaign may have hundreds of recordings.
    ax.vlines(edges, 0.0, 1.0, QUIET, ":", lw=0.8, transform=ax.get_xaxis_transform())


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
        if len(
            rows
        ):  # an empty line that is not clipped reaches to nowhere, and the layout with it
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


def rests(recordings: Sequence[Recording], found: Sequence[Segments]) -> Figure:
    """The raw signal with the rests that were found in it, a panel per recording."""
    figure, axes = new_figure(len(recordings), 1, height=0.4 + 1.9 * len(recordings))
    for ax, recording, segments in zip(axes, recordings, found, strict=True):
        rests_in(ax, recording, segments)
        ax.set_title(recording.name)
    legend_above(axes[0], columns=4)
    return figure


def rests_in(ax: Axes, recording: Recording, segments: Segments) -> Axes:
    """One recording's raw outputs with its rests shaded.

    A long log is drawn as the range of each short stretch, which shows every spike.
    """
    outputs = recording.accel if recording.accel is not None else recording.gyro
    assert outputs is not None  # a Recording has one triad at least
    unit = "m/s²" if recording.accel is not None else "rad/s"
    time, time_unit = _readable_time(recording.time)
    for k in range(3):
        x, low, high = _envelope(time, outputs[:, k])
        ax.fill_between(x, low, high, color=COLOURS[k], lw=0.6, alpha=0.85, label=AXIS_NAMES[k])
    for number, (a, b) in enumerate(zip(segments.start, segments.stop, strict=True)):
        span = ax.axvspan(float(time[a]), float(time[b - 1]), color=QUIET, alpha=0.28, lw=0)
        span.set_label("rest" if number == 0 else "_")
    ax.set_xlim(time[0], time[-1])
    ax.set(xlabel=f"time, {time_unit}", ylabel=f"output, {unit}")
    return ax


def _envelope(
    time: np.ndarray, values: np.ndarray, bins: int = 1000
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if len(time) <= 2 * bins:
        return time, values, values
    edges = np.linspace(0, len(time), bins + 1).astype(int)[:-1]
    return (
        time[edges],
        np.minimum.reduceat(values, edges),
        np.maximum.reduceat(values, edges),
    )


def _panels(count: int, *, height: float) -> tuple[Figure, list[Axes]]:
    """Up to three panels in a row, four in two rows."""
    columns = 2 if count == 4 else min(3, count)
    rows = math.ceil(count / columns)
    return new_figure(rows, columns, width=0.6 + 2.9 * columns, height=height * rows)


def _families(names: Sequence[str]) -> dict[str, list[int]]:
    """Columns of each family of parameters, in order."""
    groups: dict[str, list[int]] = {}
    for column, name in enumerate(names):
        groups.setdefault(family(name), []).append(column)
    return groups


def _axes_of(name: str) -> str:
    indices = name[name.index("[") + 1 : -1].split(",")
    letters = [AXIS_NAMES[int(i)] for i in indices]
    return letters[0] if "matrix" in name and len(set(letters)) == 1 else "".join(letters)


def _legend_right(ax: Axes, count: int) -> None:
    columns = 3 if count <= 6 else 5
    ax.legend(
        loc="upper left",
        bbox_to_anchor=(0.0, -0.22),
        ncols=columns,
        handlelength=1.3,
        columnspacing=1.0,
        borderaxespad=0.0,
    )


def _readable_time(time: np.ndarray) -> tuple[np.ndarray, str]:
    """Time from its start in a unit that fits its length."""
    elapsed = time - time[0]
    length = float(elapsed[-1]) if len(elapsed) else 0.0
    if length > 3 * 3600.0:
        return elapsed / 3600.0, "h"
    return (elapsed / 60.0, "min") if length > 300.0 else (elapsed, "s")


def force_directions(dwells: Dwells) -> Float[np.ndarray, "dwells 3"] | None:
    """Directions of the specific force, as the accelerometers tell; `None` without them."""
    if dwells.accel is None:
        return None
    rests = np.asarray(dwells.position) >= 0
    return np.asarray(dwells.accel)[rests]
