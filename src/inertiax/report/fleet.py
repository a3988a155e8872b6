"""The page over a fleet run: yield, quarantine, distributions, devices unlike the others, drift."""

from collections.abc import Callable, Sequence
from pathlib import Path

import equinox as eqx
import numpy as np
import polars as pl

from ..calibrate.fit_quality import TRIAD_NAMES
from ..calibration.quantities import label, rms_text, with_sigma
from ..fleet.effects.population_effects import LineMismatch
from ..fleet.magnetometers import LEFT_OUT
from ..fleet.overview.explain import read_line_file
from ..fleet.overview.odd_recordings import odd_recordings, OddRecording
from ..fleet.overview.recalibration import Drift, drift_between
from ..fleet.overview.view import triad_view, TriadView, Unlike, unlike_devices
from ..fleet.population.population import Population, read_population
from ..fleet.population.unit_covariance import FEWEST
from ..fleet.results import kinds_of_reasons
from ..fleet.store import Manifest, read_manifest, read_parts
from ..fleet.verdicts import graded_devices, Reserved, reserved_kinds, verdicts_of
from ..plots import fleet as plots
from ..plots.style import drawing
from . import fleet_mismatch
from .fleet_device import line_units, report_device, signed
from .fleet_drift import beyond_chance, drift_section, drift_sentence
from .fleet_fits import fit_sentence, NAMED, reserved_lines
from .fleet_lever_arms import line_lever_arms
from .fleet_mismatch import LISTED
from .page import Key, Link, Picture, picture, Section, Table, Verdict, write_page


PAGES = 20  # of single devices, of each kind
DRAWN = 5  # of them with figures, which take most of the time
_UNITS = {"accel": "m/s^2", "gyro": "rad/s"}

FileNames = Callable[[tuple[str, ...]], dict[str, str]]


class FleetPage(eqx.Module):
    """What a page tells of a run, before it is written out."""

    manifest: Manifest = eqx.field(static=True)
    population: Population | None = eqx.field(static=True)
    states: pl.DataFrame = eqx.field(static=True)  # device, reason
    views: dict[str, TriadView]
    unlike: dict[str, tuple[Unlike, ...]] = eqx.field(static=True)
    drifts: dict[str, Drift]
    line: tuple[LineMismatch, ...] = eqx.field(static=True)
    fits: dict[str, int] = eqx.field(static=True)  # devices by the verdict on their fit
    reserved: tuple[str, ...] = eqx.field(
        static=True
    )  # devices whose fit is not good, doubtful first
    why: tuple[Reserved, ...] = eqx.field(static=True)  # what the devices above are reserved for
    odd: tuple[OddRecording, ...] = eqx.field(static=True)

    @property
    def units(self) -> dict[str, plots.Units]:
        """By triad, factor and unit in which all pages show each parameter."""
        return {t: line_units(v.model, v.mean[v.reference]) for t, v in self.views.items()}

    @property
    def aside(self) -> pl.DataFrame:
        """Devices in quarantine."""
        return self.states.filter(pl.col("reason") != "")

    @property
    def unlike_names(self) -> tuple[str, ...]:
        """Devices unlike the others in any triad, the farthest first."""
        found = sorted((u for us in self.unlike.values() for u in us), key=lambda u: -abs(u.sigmas))
        return tuple(dict.fromkeys(u.device for u in found))

    @property
    def paged(self) -> tuple[str, ...]:
        """Devices that get a page of their own."""
        return (*self.unlike_names[:PAGES], *self.aside.get_column("device").head(PAGES).to_list())


def fleet_page(
    folder: Path | str,
    *,
    earlier: Path | str | None = None,
    temperatures: Sequence[float] | None = None,
) -> FleetPage:
    """Gather what the page tells from a run's output folder.

    **Arguments:** `earlier` is the output folder of an earlier run over the same devices; `temperatures`
    (°C) are where the two are compared.
    """
    folder = Path(folder)
    manifest = read_manifest(folder)
    states = read_parts(folder).select("device", "reason").collect()
    assert manifest is not None  # `read_parts` has looked
    known = (folder / "population.json").exists()
    population = read_population(folder) if known else None
    views = {
        triad: view
        for triad in ("accel", "gyro")
        if (view := triad_view(folder, triad, manifest, population)) is not None
    }
    drifts: dict[str, Drift] = {}
    if earlier is not None:
        for triad in views:
            found = drift_between(folder, earlier, triad, temperatures=temperatures)
            drifts |= {} if found is None else {triad: found}
        if not drifts:
            raise ValueError(f"{earlier} and {folder} have no calibrated device in common.")
    unlike = {triad: unlike_devices(view) for triad, view in views.items()}
    line = read_line_file(folder) or ()
    graded = graded_devices(folder, manifest)
    fits = verdicts_of(graded)
    reserved = graded.filter(pl.col("verdict") != "good")
    # Of many the one that the model explains the worst stands first.
    reserved = reserved.sort("verdict", pl.col("ratio").fill_nan(0.0), descending=[False, True])
    names = tuple(reserved.get_column("device").to_list())
    why = reserved_kinds(reserved)
    odd = odd_recordings(folder, manifest)
    return FleetPage(
        manifest, population, states, views, unlike, drifts, line, fits, names, why, odd
    )


def report_fleet(
    folder: Path | str,
    command: str,
    names: FileNames,
    *,
    earlier: Path | str | None = None,
    temperatures: Sequence[float] | None = None,
) -> FleetPage:
    """Write `report.html`, `figures/` and the pages of single devices into a run's output folder.

    **Arguments:** `command` is what to type to get it again; `names` gives each of some devices a harmless
    file name; for `earlier` and `temperatures` see `fleet_page`.
    """
    folder = Path(folder)
    page = fleet_page(folder, earlier=earlier, temperatures=temperatures)
    files, informed = names(page.paged), page.manifest.prior is not None
    drawn = page.unlike_names[:DRAWN]
    for device in page.paged:
        known = (page.manifest, page.population)
        report_device(
            folder, device, files[device], *known, page.unlike, command, page.units,
            figures=device in drawn,
        )  # fmt: skip
    write_page(
        folder / "report.html",
        title="Calibration of a fleet",
        under=_under(page),
        verdict=_verdict(page),
        keys=_keys(page),
        sections=[
            *_reasons_section(page),
            *(_triad_section(t, v, page.units[t], folder) for t, v in page.views.items()),
            *line_lever_arms(folder, page.manifest),
            *_mismatch_section(page),
            *_unlike_section(page, files),
            *_aside_section(page, files),
            *(
                drift_section(triad, d, page.views[triad], folder, informed=informed)
                for triad, d in page.drifts.items()
            ),
            _files_section(page),
        ],
        command=command,
    )
    return page


def _under(page: FleetPage) -> str:
    parts = []
    for triad, view in page.views.items():
        model = view.model
        over = f"degree {model.degree} in temperature" if model.degree else "constant"
        parts.append(f"{TRIAD_NAMES[triad].lower()} ('{model.estimator}', {over})")
    said = f"Estimated: {', '.join(parts)}." if parts else "Nothing was estimated."
    return f"{said} Every device with the prior of its line." if page.manifest.prior else said


def _verdict(page: FleetPage) -> Verdict:
    total, aside = page.states.height, page.aside.height
    lines = []
    if aside:
        kinds = kinds_of_reasons(page.aside.get_column("reason"))
        lines.append(
            f"Most frequent reason for setting aside: {kinds[0][0]} ({kinds[0][1]} of {aside})."
        )
    unlike = len(page.unlike_names)
    if unlike:
        subject = "1 calibrated device is" if unlike == 1 else f"{unlike} calibrated devices are"
        lines.append(
            f"{subject} unlike the others. The calibration stands, but look before shipping."
        )
    lines += [fit_sentence(page.fits, page.reserved)] if total > aside else []
    lines += reserved_lines(page.why)
    lines += [LEFT_OUT] if page.manifest.magnetometers else []
    lines += [odd_sentence(page.odd)] if page.odd else []
    for triad, drift in page.drifts.items():
        lines.append(drift_sentence(triad, drift))
    good = total - aside
    headline = f"{good} of {total} devices calibrated: a yield of {_percent(good, total)}."
    if not good:
        return Verdict("bad", "No device could be calibrated.", tuple(lines))
    if 2 * aside > total:
        return Verdict("bad", headline, tuple(lines))
    drifted = any(beyond_chance(drift) for drift in page.drifts.values())
    reserved = page.fits["good"] < good
    calm = not (aside or unlike or drifted or reserved or page.odd)
    return Verdict("good" if calm else "attention", headline, tuple(lines))


def odd_sentence(odd: Sequence[OddRecording]) -> str:
    """Devices recorded unlike the others, each with what is unusual."""
    each = "; ".join(f"{o.device}: {o.words}" for o in odd[:NAMED])
    return f"Recorded unlike the others: {each}{'; …' if len(odd) > NAMED else ''}."


def _percent(part: int, whole: int) -> str:
    # 19 999 of 20 000 must not read as all of them.
    value = 100.0 * part / whole
    return f"{value:.0f} %" if value in (0.0, 100.0) else f"{min(value, 99.99):.2f} %"


def _keys(page: FleetPage) -> list[Key]:
    total, aside = page.states.height, page.aside.height
    keys = [
        Key("Devices", f"{total}"),
        Key("Calibrated", f"{total - aside}", f"yield {_percent(total - aside, total)}"),
        Key("Set aside", f"{aside}", "see quarantine.parquet" if aside else ""),
        Key("Unlike the others", f"{len(page.unlike_names)}"),
        Key("Good fits", f"{page.fits['good']}", "by the rule of `calibrate`"),
    ]
    for triad, view in page.views.items():
        low, middle, high = (
            rms_text(_UNITS[triad], v) for v in np.quantile(view.rms, [0.05, 0.5, 0.95])
        )
        keys.append(Key(f"{TRIAD_NAMES[triad]}: rms misfit", middle, f"90 % from {low} to {high}"))
    return keys


def _reasons_section(page: FleetPage) -> list[Section]:
    if not page.aside.height:
        return []
    kinds = kinds_of_reasons(page.aside.get_column("reason"))[:LISTED]
    table = Table(("devices", "reason"), tuple((str(n), k) for k, n in kinds), numeric=(0,))
    return [Section("Set aside: why", tables=(table,))]


def _aside_section(page: FleetPage, files: dict[str, str]) -> list[Section]:
    if not page.aside.height:
        return []
    rows = tuple((_link(d, files), reason) for d, reason in page.aside.head(PAGES).iter_rows())
    more = page.aside.height - len(rows)
    lines = (f"The first {PAGES}; {more} more are in quarantine.parquet.",) if more else ()
    return [Section("Set aside: which", lines=lines, tables=(Table(("device", "reason"), rows),))]


def _link(device: str, files: dict[str, str]) -> str | Link:
    return Link(device, f"devices/{files[device]}.html") if device in files else device


def _triad_section(triad: str, view: TriadView, units: plots.Units, folder: Path) -> Section:
    title, where = TRIAD_NAMES[triad], _where(view)
    figures = []
    lines = "the line's mean and one standard deviation between devices (dashed)"
    caption = (
        f"{title}: every parameter over {len(view.devices)} devices{where}; "
        f"{lines if view.line is not None else 'their mean'}. Numbers with arrows: devices beyond the axis."
    )
    with drawing():
        figure = plots.distributions(view, units)
        figures.append(picture(figure, folder, f"fleet-{triad}", caption, caption))
    figures += _curve_pictures(triad, view, units, folder)
    table = _parameter_table(view, units)
    return Section(
        f"{title}: the line", lines=_line_sentences(view), tables=(table,), figures=tuple(figures)
    )


def _where(view: TriadView) -> str:
    return f" at {view.temperatures[view.reference]:.0f} °C" if view.model.degree else ""


def _curve_pictures(triad: str, view: TriadView, units: plots.Units, folder: Path) -> list[Picture]:
    if view.line is None or not view.model.degree:
        return []
    caption = (
        f"{TRIAD_NAMES[triad]}: the line's mean over temperature, with one and two standard deviations "
        "between devices."
    )
    with drawing():
        figure = plots.line_curves(view.line, units)
        return [picture(figure, folder, f"fleet-{triad}-curves", caption, caption)]


def _line_sentences(view: TriadView) -> tuple[str, ...]:
    if view.line is None:
        return (
            f"Fewer than {FEWEST} devices: too few for the spread between devices, and for population.json.",
        )
    if view.informed:
        return (
            "Mean and spread are the prior's. Devices were drawn towards its mean where their own dwells "
            "tell little, so the histograms are narrower than the line.",
        )
    return (
        f"Mean and spread from {view.line.devices} devices, free of the devices' own uncertainties and of "
        f"{len(view.line.outliers)} unlike the others. '--prior' takes them from this folder.",
    )


def _parameter_table(view: TriadView, units: plots.Units) -> Table:
    at, rows = view.reference, []
    for k, (name, (factor, unit)) in enumerate(zip(view.model.names, units, strict=True)):
        values = factor * view.values[:, at, k]
        own = float(np.median(factor * view.sigmas[:, at, k]))
        spread = 0.0 if view.line is None else float(factor * view.spread[at, k])
        # Digits by what parts the devices, or by what each is known to where that is more.
        digits = max(spread, own)
        mean, least, greatest = (
            with_sigma(float(v), digits)[0]
            for v in (factor * view.mean[at, k], values.min(), values.max())
        )
        shown = "–" if view.line is None else _spread_text(spread, own)
        rows.append((label(name), unit, mean, shown, with_sigma(own, own)[1], least, greatest))
    head = ("parameter", "unit", "mean", "spread", "own 1 sigma", "least", "greatest")
    return Table(
        head,
        tuple(rows),
        numeric=(2, 3, 4, 5, 6),
        caption=f"Spread: standard deviation between devices; own: of one device, median{_where(view)}.",
    )


def _spread_text(spread: float, own: float) -> str:
    """The spread; below a hundredth of the devices' own uncertainty, which no data show, that bound."""
    least = 0.01 * own
    return with_sigma(spread, spread)[1] if spread > least else f"< {least:.1g}"


def _unlike_section(page: FleetPage, files: dict[str, str]) -> list[Section]:
    rows = []
    for triad, found in page.unlike.items():
        degree = page.views[triad].model.degree
        for u in found:
            at = f"{u.temperature:.0f} °C" if degree else ""
            what = f"{TRIAD_NAMES[triad]}: {label(u.parameter)}"
            rows.append((abs(u.sigmas), (_link(u.device, files), what, at, signed(u.sigmas))))
    if not rows:
        return []
    rows.sort(key=lambda row: -row[0])
    more = len(rows) - LISTED
    lines = [
        "So far from the line's mean, in one parameter, in all of a kind or in all together, that it would happen to "
        "any device of this fleet by a chance of 1 %. Shown is the parameter that is farthest out."
    ]
    lines += [f"The first {LISTED}; {more} more are in population.json."] if more > 0 else []
    head = ("device", "parameter", "at", "sigmas of the fleet")
    table = Table(head, tuple(row for _, row in rows[:LISTED]), numeric=(3,))
    return [Section("Devices unlike the others", lines=tuple(lines), tables=(table,))]


def _mismatch_section(page: FleetPage) -> list[Section]:
    """Where the run was asked to tell."""
    if not page.line and page.manifest.forms is None:
        return []
    return [fleet_mismatch.section(page.line, page.states.height - page.aside.height)]


_POPULATION = (
    "population.json: mean and spread of the line, the prior for devices of short programmes"
)


def _files_section(page: FleetPage) -> Section:
    items = [
        "parts/*.parquet: a row for each device with parameters, sigmas, covariance, misfit",
        "quarantine.parquet: the devices set aside, each with the reason",
        *([] if page.population is None else [_POPULATION]),
        f"devices/*.html: the first {PAGES} devices unlike the others and set aside; "
        "'inertiax fleet … --device SERIAL' writes any device's page and calibration",
    ]
    return Section("Files and choices", items=(*items, *page.manifest.reasons))
