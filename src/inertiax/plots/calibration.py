"""Figures of one device's calibration: what they show, for `calibration_panels` to draw."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ..calibrate.pipeline import TriadResult
from ..calibration.calibrated_triads import calibrated_triads
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.quantities import customary_units, family, SHOWN_AS
from ..data.recording import Recording
from ..reduction.dwells import Dwells
from ..reduction.segments import Segments
from . import calibration_panels as panels
from .calibration_panels import Misfits, ParameterPanel, RestsPanel
from .style import AXIS_NAMES, drawing, Figure


NORMAL_95 = 1.959964  # half-width of the 95 % interval of a normal distribution, in sigmas


def parameter_curves(triad: TriadCalibration, temperature_range: tuple[float, float]) -> Figure:
    """Every parameter over temperature with its 95 % band, a panel per family.

    The curves go 5 % of the range beyond it on both sides; what is beyond is shaded.
    """
    return panels.parameters(curve_panels(triad, temperature_range))


def curve_panels(
    triad: TriadCalibration, temperature_range: tuple[float, float]
) -> tuple[ParameterPanel, ...]:
    """What `parameter_curves` shows."""
    low, high = (float(t) for t in temperature_range)
    margin = 0.05 * (high - low)
    grid = np.linspace(low - margin, high + margin, 161)
    return _panels(triad, grid, (low, high))


def constant_parameters(triad: TriadCalibration) -> Figure:
    """Parameters without temperature dependence: values with 95 % intervals, a panel per family."""
    return panels.parameters(constant_panels(triad))


def constant_panels(triad: TriadCalibration) -> tuple[ParameterPanel, ...]:
    """What `constant_parameters` shows."""
    return _panels(triad, None, None)


def _panels(
    triad: TriadCalibration,
    grid: Float[np.ndarray, " temperature"] | None,
    ends: tuple[float, float] | None,
) -> tuple[ParameterPanel, ...]:
    """A panel for each family of parameters."""
    values, sigmas = triad.over(np.zeros(1) if grid is None else grid)
    made = []
    for title, members in _families(triad.names).items():
        factor, unit = customary_units(triad)[members[0]]
        labels = tuple(_axes_of(triad.names[m]) for m in members)
        widths = NORMAL_95 * factor * sigmas[:, members]
        made.append(
            ParameterPanel(title, unit, labels, factor * values[:, members], widths, grid, ends)
        )
    return tuple(made)


def both_triads(calibration: Calibration) -> Figure:
    """Every parameter of a calibration, a panel per triad and family: over its temperature range with 95 % bands, or
    where a triad knows no temperature with 95 % intervals."""
    shown = []
    for name, triad in calibrated_triads(calibration).items():
        constant = triad.curve.basis.size == 1
        own = (
            constant_panels(triad) if constant else curve_panels(triad, _range(calibration, triad))
        )
        shown += [panel._replace(title=f"{name}: {panel.title}") for panel in own]
    if not shown:
        raise ValueError("`calibration.plot()`: no triad is calibrated.")
    with drawing():
        figure, axes = panels.panel_axes(len(shown), height=2.9)
        for ax, panel in zip(axes, shown, strict=False):
            panels.draw_parameters(ax, panel)
        for ax in axes[len(shown) :]:
            ax.set_visible(False)
        figure.suptitle("bands and bars hold 95 %", fontsize="small", x=0.01, ha="left")
    return figure


def _range(calibration: Calibration, triad: TriadCalibration) -> tuple[float, float]:
    """Temperatures (°C) that the data covered; where nothing says so, those between the basis' nodes."""
    ends = [float(t) for t in calibration.temperature_range or triad.curve.basis.nodes]
    return min(ends), max(ends)


def misfits_of(result: TriadResult) -> Misfits:
    """What is left after the fit, by dwell: in order of time, and over temperature and position where they say more."""
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
    experiment = np.asarray(dwells.experiment)[np.argsort(order)]
    return Misfits(
        unit,
        factor * np.asarray(result.misfit),
        factor * np.asarray(result.sigma),
        order,
        tuple(against),
        np.flatnonzero(np.diff(experiment)) + 0.5,
    )


def misfits(result: TriadResult) -> Figure:
    """What is left after the fit, per dwell with error bars of 1 sigma."""
    return panels.misfits(misfits_of(result))


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


def rests(recordings: Sequence[Recording], found: Sequence[Segments]) -> Figure:
    """The raw signal with the rests that were found in it, a panel per recording."""
    return panels.rests(rest_panels(recordings, found))


def rest_panels(
    recordings: Sequence[Recording], found: Sequence[Segments]
) -> tuple[RestsPanel, ...]:
    """What `rests` shows; of a long log the range of each short stretch, which shows every spike."""
    return tuple(map(_rests_panel, recordings, found))


def _rests_panel(recording: Recording, segments: Segments) -> RestsPanel:
    outputs = recording.accel if recording.accel is not None else recording.gyro
    assert outputs is not None  # a Recording has one triad at least
    unit = "m/s²" if recording.accel is not None else "rad/s"
    time, time_unit = _readable_time(recording.time)
    shown = [_envelope(time, outputs[:, k]) for k in range(3)]
    rests = list(zip(segments.start, segments.stop, strict=True))
    return RestsPanel(
        recording.name,
        unit,
        time_unit,
        shown[0][0],
        np.stack([low for _, low, _ in shown]),
        np.stack([high for _, _, high in shown]),
        np.array([time[a] for a, _ in rests]),
        np.array([time[b - 1] for _, b in rests]),
        (float(time[0]), float(time[-1])),
    )


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
