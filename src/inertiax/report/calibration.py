"""The report of `inertiax calibrate`: one page per device, and a page over several devices."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ..calibrate.fit_quality import judge, Quality
from ..calibrate.pipeline import DeviceFailure, DeviceResult, TriadResult
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.quantities import middle_temperature, quantities, rms_text, with_sigma
from ..data.recording import Campaign, Recording, Rig
from ..physics.temperature import Constant
from ..plots import calibration as plots, calibration_panels as panels
from ..plots.figure_workers import Drawing
from ..plots.style import both_forms, Forms
from ..reduction.dwells import Dwells
from ..reduction.rig_errors import rate_words
from ..reduction.segments import rests_are_searched, Segments
from .barometer import barometer_sections, FIGURE as BAROMETER_FIGURE
from .judge import coverage_sentence, further_warnings, TRIAD_NAMES, triads, weakest
from .magnetometers import (
    FIGURES as FIELD_FIGURES,
    magnetometer_keys,
    magnetometer_sections,
)
from .page import Key, Link, Picture, picture, Section, Table, Verdict, write_page


# All files that this module may write; an earlier run's are removed where they are not written again.
_NAMES = (
    "curves-accel",
    "curves-gyro",
    "misfit-accel",
    "misfit-gyro",
    "coverage",
    "rests",
    *FIELD_FIGURES,
    BAROMETER_FIGURE,
)
FIGURES = tuple(f"figures/{name}.{suffix}" for name in _NAMES for suffix in ("png", "svg"))


def report_calibration(
    result: DeviceResult, folder: Path, command: str, *, campaign: Campaign | None = None
) -> None:
    """Write `report.html` and `figures/` of one device.

    **Arguments:** `campaign` are the device's recordings; with them the rests that were found are
    drawn over the raw signal.
    """
    calibration = result.calibration
    device = calibration.device
    quality = judge(result)
    data = _data_section(result, folder, campaign)  # first, since its figures take longest to draw
    write_page(
        folder / "report.html",
        title=f"Calibration of {device}" if device else "Calibration",
        under=_under(result),
        verdict=_verdict(result, quality),
        keys=_keys(result),
        sections=[
            *_parameter_sections(result, folder, campaign),
            *_magnetometer_sections(result, folder),
            *barometer_sections(result, folder),
            *_misfit_sections(result, folder),
            data,
            _quality_section(quality),
            _choices_section(result),
        ],
        command=command,
    )


def figures_ahead(campaign: Campaign) -> Callable[[Sequence[Segments] | TriadResult], None]:
    """What begins figures of one device's report while `calibrate` goes on, from what it tells by `seen`."""

    def seen(found: Sequence[Segments] | TriadResult) -> None:
        figures: list[Drawing[Forms] | None]
        if not isinstance(found, TriadResult):
            figures = [_rests_figure(campaign.recordings, found)]
        else:
            figures = [Drawing(both_forms, panels.misfits, plots.misfits_of(found))]
            if found.estimator.triad == "accel":
                figures.append(_coverage_figure(found.dwells))
        for figure in figures:
            if figure is not None:
                figure.begin_ahead()

    return seen


def parameters_ahead(result: DeviceResult) -> None:
    """Begin the report's figures of parameters, before other files are written."""
    for triad, _ in triads(result).values():
        _curve_figure(triad, result.calibration).begin_ahead()


def _under(result: DeviceResult) -> str:
    names = [f"{TRIAD_NAMES[k].lower()} ('{c.estimator}')" for k, (c, _) in triads(result).items()]
    names += [] if result.mag is None else ["magnetometers ('field')"]
    return f"Estimated: {', '.join(names)}; {_temperature_words(result.calibration)}."


def _temperature_words(calibration: Calibration) -> str:
    if calibration.temperature_range is None:
        return "constant parameters, no temperature recorded"
    low, high = calibration.temperature_range
    return f"data from {low:.1f} to {high:.1f} °C"


_HEADLINES = {
    "good": ("good", "Calibrated: the fit is good."),
    "usable": ("attention", "Calibrated, with a reservation."),
    "doubtful": ("bad", "Calibrated, but do not use it yet."),
}


def _verdict(result: DeviceResult, quality: Quality) -> Verdict:
    tone, headline = _HEADLINES[quality.verdict]
    lines = [f"Is it good? {quality.answer}", *_beside(quality)]
    lines += [coverage_sentence(result.calibration, r) for _, r in triads(result).values()]
    lines += [f"Warning: {w}" for w in further_warnings(result, quality)]
    lines += [f"Would improve it most: {n}" for n in quality.next]
    return Verdict(tone, headline, tuple(lines))


def _beside(quality: Quality) -> list[str]:
    """What of each triad the answer does not say yet."""
    lines = []
    for triad in quality.triads:
        why = triad.text.partition("; ")[2]
        if not why or why not in quality.answer:
            lines.append(triad.text)
        elif f"{triad.name}: {why}".lower() not in quality.answer.lower():
            lines.append(f"{triad.name}: the same.")
    return lines


def _keys(result: DeviceResult) -> list[Key]:
    keys = []
    for name, (triad, estimate) in triads(result).items():
        title = TRIAD_NAMES[name]
        chi2 = estimate.chi2_per_dof
        noise = f"χ² per degree of freedom {chi2:.2f}" if math.isfinite(chi2) else "noise unknown"
        keys.append(
            Key(f"{title}: rms misfit", rms_text(estimate.misfit_unit, estimate.rms), noise)
        )
        found = weakest(triad, estimate, result.calibration.temperature_range)
        keys.append(Key(f"{title}: least certain", f"± {found.sigma}", found.label))
        keys.append(
            Key(
                f"{title}: dwells used",
                str(int(np.sum(np.asarray(estimate.dwells.valid)))),
                f"{triad.curve.basis.size * len(triad.names)} unknowns",
            )
        )
    keys += magnetometer_keys(result)
    if result.calibration.temperature_range is not None:
        low, high = result.calibration.temperature_range
        keys.append(Key("Temperature range", f"{low:.1f} … {high:.1f} °C", _degrees(result)))
    return keys


def _degrees(result: DeviceResult) -> str:
    sizes = {c.curve.basis.size - 1 for c, _ in triads(result).values()}
    mag = result.calibration.mag
    sizes |= set() if mag is None else {mag.triad.curve.basis.size - 1}
    return f"polynomial degree {', '.join(str(s) for s in sorted(sizes))}"


def _parameter_sections(
    result: DeviceResult, folder: Path, campaign: Campaign | None
) -> list[Section]:
    rig = Rig() if campaign is None else campaign.rig
    return [
        Section(
            f"{TRIAD_NAMES[name]}: parameters",
            lines=_common_errors(triad, rig),
            tables=(parameter_table(triad, result.calibration),),
            figures=(_curve_picture(name, triad, result.calibration, folder),),
        )
        for name, (triad, _) in triads(result).items()
    ]


def _common_errors(triad: TriadCalibration, rig: Rig) -> tuple[str, ...]:
    """What the station states, and ± does not hold as an error that all dwells share."""
    if not triad.names[0].startswith("gyro"):
        return ()
    return rate_words(triad.estimator, rig)


def parameter_table(triad: TriadCalibration, calibration: Calibration) -> Table:
    """Parameters at the middle of the temperature range, or the constant ones, with 1 sigma."""
    middle = middle_temperature(calibration)
    rows = [
        (q.label, *with_sigma(q.value, q.sigma), q.unit, q.name) for q in quantities(triad, middle)
    ]
    constant = isinstance(triad.curve.basis, Constant)
    caption = "Constant parameters" if constant else f"At {middle:.1f} °C, the middle of the range"
    return Table(
        ("parameter", "value", "± 1 sigma", "unit", "name in calibration.json"),
        tuple(rows),
        numeric=(1, 2),
        caption=caption,
    )


def _curve_picture(
    name: str, triad: TriadCalibration, calibration: Calibration, folder: Path
) -> Picture:
    caption = "Constant parameters with their 95 % intervals."
    if not _is_constant(triad, calibration):
        caption = (
            "Parameters over temperature with their 95 % bands (often thinner than the line). "
            "Shaded: outside the temperatures that the data covered."
        )
    figure = _curve_figure(triad, calibration)
    return picture(figure, folder, f"curves-{name}", caption, f"{TRIAD_NAMES[name]}: {caption}")


def _is_constant(triad: TriadCalibration, calibration: Calibration) -> bool:
    return isinstance(triad.curve.basis, Constant) or calibration.temperature_range is None


def _curve_figure(triad: TriadCalibration, calibration: Calibration) -> Drawing[Forms]:
    """The parameters with their intervals, over temperature where they depend on it."""
    if _is_constant(triad, calibration):
        return Drawing(both_forms, panels.parameters, plots.constant_panels(triad))
    assert calibration.temperature_range is not None
    over = plots.curve_panels(triad, calibration.temperature_range)
    return Drawing(both_forms, panels.parameters, over)


def _magnetometer_sections(result: DeviceResult, folder: Path) -> list[Section]:
    mag = result.calibration.mag
    table = None if mag is None else parameter_table(mag.triad, result.calibration)
    return magnetometer_sections(result, table, folder)


def _misfit_sections(result: DeviceResult, folder: Path) -> list[Section]:
    if not triads(result):
        return []
    figures = []
    for name, (_, estimate) in triads(result).items():
        caption = (
            f"{TRIAD_NAMES[name]}: what is left of each dwell after the fit, with 1 sigma (noise and "
            f"scatter between dwells together; far longer bars are cut; dotted lines part the "
            f"experiments). A trend is physics that the model leaves out."
        )
        figures.append(
            picture(
                Drawing(both_forms, panels.misfits, plots.misfits_of(estimate)),
                folder,
                f"misfit-{name}",
                caption,
                caption,
            )
        )
    rows = tuple(_misfit_row(name, r) for name, (_, r) in triads(result).items())
    head = (
        "triad",
        "rms misfit",
        "scatter between dwells",
        "χ² per dof",
        "iterations",
        "condition",
    )
    table = Table(head, rows, numeric=(1, 2, 3, 4, 5))
    return [Section("Misfit", tables=(table,), figures=tuple(figures))]


def _misfit_row(name: str, result: TriadResult) -> tuple[str, ...]:
    chi2 = result.chi2_per_dof
    return (
        TRIAD_NAMES[name].lower(),
        rms_text(result.misfit_unit, result.rms),
        rms_text(result.misfit_unit, result.scatter),
        f"{chi2:.3g}" if math.isfinite(chi2) else "unknown",
        str(int(result.solution.num_iterations)),
        f"{result.observability.condition:.3g}",
    )


def _data_section(result: DeviceResult, folder: Path, campaign: Campaign | None) -> Section:
    figures, lines = [], []
    for _, estimate in triads(result).values():
        figure = _coverage_figure(estimate.dwells)
        if figure is not None:
            caption = (
                "Directions of the specific force in the case frame at rest (equal-area projection, "
                "circles 30° apart). Large empty regions leave parameters uncertain."
            )
            figures.append(picture(figure, folder, "coverage", caption, caption))
            break
    recordings = () if campaign is None else campaign.recordings
    figure = _rests_figure(recordings, result.segments)
    if figure is not None:
        lines += [f"{r.name}: {s.statement}." for r, s in _searched(recordings, result.segments)]
        caption = "Raw outputs with the rests that were found (shaded)."
        figures.append(picture(figure, folder, "rests", caption, caption))
    return Section("Data", lines=tuple(lines), figures=tuple(figures))


def _coverage_figure(dwells: Dwells) -> Drawing[Forms] | None:
    """Directions of the specific force at rest; `None` without accelerometers."""
    directions = plots.force_directions(dwells)
    if directions is None or not len(directions):
        return None
    return Drawing(both_forms, panels.coverage, directions)


def _rests_figure(
    recordings: Sequence[Recording], segments: Sequence[Segments]
) -> Drawing[Forms] | None:
    """Raw outputs with the rests that were found in them; `None` where none were searched."""
    pairs = _searched(recordings, segments)[:3]
    if not pairs:
        return None
    searched, found = zip(*pairs)
    return Drawing(both_forms, panels.rests, plots.rest_panels(searched, found))


def _searched(
    recordings: Sequence[Recording], segments: Sequence[Segments]
) -> list[tuple[Recording, Segments]]:
    """Of recordings with accelerometers or gyros, those whose rests were found in their outputs."""
    return [
        (r, s)
        for r, s in zip(recordings, segments)
        if rests_are_searched(r) and (r.accel is not None or r.gyro is not None)
    ]


def _quality_section(quality: Quality) -> Section:
    rows = tuple(
        (f.topic, ("fine", "attention", "do not use")[f.grade], f.text) for f in quality.findings
    )
    return Section("Is it good?", tables=(Table(("looked at", "", "found"), rows),))


def _choices_section(result: DeviceResult) -> Section:
    given = "Everything was given by the campaign; nothing had to be chosen."
    items = tuple(result.choices)
    return Section("What was chosen, and why", lines=() if items else (given,), items=items)


# Several devices ------------------------------------------------------------------------------------


def report_summary(
    results: Sequence[DeviceResult | DeviceFailure],
    folder: Path,
    command: str,
    folders: dict[str, str],
) -> None:
    """Write the `report.html` that leads to the devices' own."""
    failed = sum(isinstance(r, DeviceFailure) for r in results)
    headline = (
        f"All {len(results)} devices calibrated."
        if not failed
        else f"{failed} of {len(results)} devices failed; the others are calibrated."
    )
    rows = tuple(_summary_row(r, folders) for r in results)
    head = ("device", "outcome", "accelerometers: rms misfit", "gyros: rms misfit", "remarks")
    write_page(
        folder / "report.html",
        title=f"Calibration of {len(results)} devices",
        under="One line per device; each leads to its own report.",
        verdict=Verdict("bad" if failed else "good", headline),
        sections=[Section("Devices", tables=(Table(head, rows, numeric=(2, 3)),))],
        command=command,
    )


def _summary_row(
    result: DeviceResult | DeviceFailure, folders: dict[str, str]
) -> tuple[str | Link, ...]:
    if isinstance(result, DeviceFailure):
        return (result.device, "failed", "", "", result.reason)
    device = result.calibration.device
    rms = {k: rms_text(r.misfit_unit, r.rms) for k, (_, r) in triads(result).items()}
    outcome = {"good": "calibrated", "usable": "with a reservation", "doubtful": "do not use yet"}
    return (
        Link(device, f"{folders[device]}/report.html"),
        outcome[judge(result).verdict],
        rms.get("accel", ""),
        rms.get("gyro", ""),
        "; ".join(result.warnings),
    )
