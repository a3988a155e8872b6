"""The report of `inertiax diagnose`."""

import math
from pathlib import Path

from ..calibration.effect_units import customary, in_words, shown_parameters
from ..calibration.quantities import label, with_sigma
from ..data.moments import since, unit_of_moments
from ..data.recording import Campaign
from ..diagnose import Diagnosis
from ..diagnose.residuals import Residuals, TURN
from ..diagnose.result import Moved
from ..diagnose.wording.sentences import gain_on_left_out
from ..effects import CATALOGUE
from ..plots import diagnosis as plots, residuals as residual_plots
from ..plots.partial_residuals import partial_residuals
from ..plots.style import drawing
from .audit import audit_sections, sizes_section, three_digits
from .page import Key, Picture, picture, Section, Table, Verdict, write_page


_HEADLINES = {
    "consistent": ("good", "Consistent: nothing beyond noise and the rig's stated uncertainty."),
    "missing-physics": ("attention", "The model leaves physics out."),
    "unexplained": ("bad", "Something is there that no catalogued effect explains."),
}


def report_diagnosis(
    found: Diagnosis, folder: Path, command: str, *, campaign: Campaign | None = None
) -> None:
    """Write `report.html` and `figures/` of one device's diagnosis.

    **Arguments:** `campaign` are the device's recordings; with them the places are drawn over time.
    """
    tone, headline = _HEADLINES[found.verdict]
    if found.verdict == "consistent" and found.noise_doubted:
        doubted = ", ".join(found.noise_doubted)
        tone, headline = (
            "attention",
            f"Nothing stands out, but the noise of {doubted} is not known.",
        )
    elif found.verdict == "unexplained" and found.effects:
        headline = "Beside what has a name, something is there that no catalogued effect explains."
    names = [" or ".join((e.name, *e.alternatives)) for e in found.effects]
    if names:
        named = "named are " if found.verdict == "unexplained" else ""
        headline = f"{headline[:-1]}: {named}{'; '.join(names)}."
    device = "" if campaign is None else campaign.devices[0]
    sections = [
        *_effect_section(found, folder),
        *_fit_section(found, folder),
        *_place_section(found, folder, campaign),
        *_moved_section(found, folder),
        *_left_out_section(found),
        *_noise_section(found),
        *_limits_section(found),
    ]
    write_page(
        folder / "report.html",
        title=f"Diagnosis of {device}" if device else "Diagnosis",
        under="What the recordings hold beyond the model that was meant to explain them.",
        verdict=Verdict(tone, headline, (found.summary,)),
        keys=_keys(found),
        sections=sections,
        command=command,
    )


def _keys(found: Diagnosis) -> list[Key]:
    keys = []
    if found.baseline is not None:
        keys.append(Key("χ² per degree of freedom", f"{found.baseline.chi2_per_dof:.2f}", "before"))
    if found.augmented is not None and found.verdict != "consistent":
        keys.append(Key("χ² per degree of freedom", f"{found.augmented.chi2_per_dof:.2f}", "after"))
        gain = 1.0 - _ratio(found)
        keys.append(Key("Misfit on left-out data", f"{-100 * gain:+.0f} %", "with the effects"))
    keys.append(Key("Effects named", str(len(found.effects)), found.verdict))
    return keys


def _ratio(found: Diagnosis) -> float:
    if found.baseline is None or found.augmented is None or not found.baseline.held_out_rms > 0:
        return 1.0
    return found.augmented.held_out_rms / found.baseline.held_out_rms


def _chance(p: float) -> str:
    """A chance in words; of one below what a number of 64 bits holds the bound."""
    return f"p = {p:.1e}" if p > 1e-300 else "p < 1e-300"


def _effect_section(found: Diagnosis, folder: Path) -> list[Section]:
    sections = []
    for number, effect in enumerate(found.effects, start=1):
        evidence = effect.evidence
        lines = [
            effect.in_short or effect.statement,  # the table below has the sizes
            f"Evidence: ΔBIC {evidence.delta_bic:.0f}, {_chance(evidence.p_value)}. On data left out of the fit "
            f"it {gain_on_left_out(evidence.held_out_gain, 'the misfit')}.",
        ]
        rows = tuple(shown_parameters(effect.name, effect.parameters, found.first))
        tables = [Table(("parameter", "value", "± 1 sigma", "unit"), rows, numeric=(1, 2))]
        if len(effect.odds) > 1:
            odds = tuple((name, f"{100 * share:.1f}") for name, share in effect.odds)
            tables.append(
                Table(
                    ("explanation", "share, %"),
                    odds,
                    numeric=(1,),
                    caption="This data cannot tell these apart",
                )
            )
        if effect.channel_odds:
            odds = tuple((channel, f"{100 * share:.1f}") for channel, share in effect.channel_odds)
            caption = "Which channel has it this data does not tell; it is not applied"
            tables.append(Table(("channel", "share, %"), odds, numeric=(1,), caption=caption))
        if effect.separating_experiment:
            several = len(effect.odds) > 1 or effect.channel_odds
            word = "separate them" if several else "confirm it"
            lines.append(f"Experiment that would {word}: {effect.separating_experiment}.")
        title = f"{effect.name} on {', '.join(effect.channels)}"
        driver = next((e.driver for e in CATALOGUE if e.name == effect.name), "time")
        figures = _driver_figures(
            found, driver, effect.channels, folder, f"effect-{number}", effect.name
        )
        sections.append(Section(title, lines=tuple(lines), tables=tuple(tables), figures=figures))
    if found.empirical is not None:
        lines = ("The best-found dependence; it describes the data and explains nothing.",)
        figures: tuple[Picture, ...] = ()
        if found.where:
            driver, channels = found.where[0].driver, {w.channel for w in found.where}
            figures = _driver_figures(found, driver, tuple(sorted(channels)), folder, "found")
        items = (found.empirical,)
        sections.append(Section("What was found", lines=lines, items=items, figures=figures))
    return sections


def _driver_figures(
    found: Diagnosis, driver: str, named: tuple[str, ...], folder: Path, name: str, effect: str = ""
) -> tuple[Picture, ...]:
    """An effect's part of the named channels over its driver, and what is left; without a fitted course of it the
    residuals before and after."""
    made = []
    # Rests and motions of one triad are rows of their own; an effect shows in those that it changes.
    changed = [r for r in found.residuals if r.changed]
    for rows in changed or found.residuals:
        channels = tuple(c for c in named if c.startswith(rows.triad))
        if not channels:
            continue
        dots = "motions" if rows.channels == (TURN,) else "blocks of a few seconds"
        caption = (
            f"Residuals of the {_rows_name(rows)} against {in_words(driver)}, before and after. Dots are "
            f"{dots}, the line is their mean."
        )
        if rows.loads is not None:
            caption += " The size of specific force is shown as the error of the channel that would make it."
        with drawing():
            figure = partial_residuals(rows, effect, driver, channels)
            if figure is None:
                figure = residual_plots.before_and_after(rows, driver, channels)
            else:
                caption = (
                    f"Left: what {effect} does to the {_rows_name(rows)} (residual with everything named, plus this "
                    f"effect); right: what is left of them. Dots are {dots}."
                )
            made.append(picture(figure, folder, f"{name}-{rows.name}", caption, caption))
    return tuple(made)


def _rows_name(rows: Residuals) -> str:
    name = "accelerometers" if rows.triad == "accel" else "gyros"
    if rows.channels == (TURN,):
        return f"{name} (gravity's direction after motions between rests)"
    return name if len(rows.channels) == 3 else f"{name} (size of specific force less gravity)"


def _fit_section(found: Diagnosis, folder: Path) -> list[Section]:
    if found.baseline is None or found.augmented is None:
        return []
    rows = _judged(found)
    factor, unit = (1.0, "SI") if rows is None else residual_plots.scale(rows)
    models = [("model as meant", found.baseline)]
    if found.verdict != "consistent":
        models.append(("with what was found", found.augmented))
    cells = tuple(
        (
            name,
            three_digits(factor * q.rms),
            f"{q.chi2_per_dof:.3g}",
            three_digits(factor * q.held_out_rms),
        )
        for name, q in models
    )
    head = ("model", f"rms misfit, {unit}", "χ² per dof", f"rms on left-out data, {unit}")
    figures = _time_figures(found, folder)
    if found.verdict != "consistent" and found.baseline.rms > 0:
        caption = (
            "How much smaller the misfit is with what was found, also on data left out of the fit."
        )
        with drawing():
            drawn = picture(plots.improvement(found), folder, "improvement", caption, caption)
            figures = (drawn, *figures)
    lines = () if rows is None else (f"Rows of the {_rows_name(rows)}.",)
    table = Table(head, cells, numeric=(1, 2, 3))
    return [Section("Fit", lines=lines, tables=(table,), figures=figures)]


def _judged(found: Diagnosis) -> Residuals | None:
    """The triad whose fit the diagnosis reports: that of the same rms."""
    if found.baseline is None or not found.residuals:
        return None
    rms = found.baseline.rms
    return min(found.residuals, key=lambda r: abs(math.sqrt(float((r.before**2).mean())) - rms))


def _time_figures(found: Diagnosis, folder: Path) -> tuple[Picture, ...]:
    made = []
    for rows in found.residuals:
        caption = f"Residuals of the {_rows_name(rows)} over the campaign."
        with drawing():
            figure = residual_plots.over_time(rows)
            made.append(picture(figure, folder, f"over-time-{rows.name}", caption, caption))
    return tuple(made)


def _place_section(found: Diagnosis, folder: Path, campaign: Campaign | None) -> list[Section]:
    if not found.where:
        return []
    rows = tuple(
        (
            w.channel,
            str(w.experiment),
            f"{since(w.start, found.first):.1f}",
            f"{since(w.end, found.first):.1f}",
            w.driver,
            f"{w.excess_rms:.2e}",
            _chance(w.p_value).removeprefix("p = ").removeprefix("p "),
        )
        for w in found.where
    )
    unit = unit_of_moments(found.first)
    head = (
        "channel",
        "experiment",
        f"start, {unit}",
        f"end, {unit}",
        "driver",
        "excess rms, SI",
        "p",
    )
    figures: tuple[Picture, ...] = ()
    if campaign is not None:
        caption = (
            "Where the recordings depart from the model, by what drives it (grey: times that were "
            "recorded)."
        )
        with drawing():
            figure = plots.places(found, campaign.recordings)
            figures = (picture(figure, folder, "places", caption, caption),)
    return [Section("Where", tables=(Table(head, rows, numeric=(1, 2, 3, 5, 6)),), figures=figures)]


def _moved_section(found: Diagnosis, folder: Path) -> list[Section]:
    moved = [m for m in found.parameters_moved if m.std > 0]
    if not moved:
        return []
    head = ("parameter", "before", "after", "± 1 sigma", "unit", "shift, sigmas")
    caption = "How far the omission had pulled the calibrated parameters, the largest shifts."
    with drawing():
        figure = picture(plots.pulled(found), folder, "pulled", caption, caption)
    table = Table(head, tuple(map(_moved_row, moved)), numeric=(1, 2, 3, 5))
    return [Section("What the omission had pulled", tables=(table,), figures=(figure,))]


def _moved_row(moved: Moved) -> tuple[str, ...]:
    name, factor, unit = moved.name, 1.0, "SI"
    if name.startswith(("accel.", "gyro.")):
        triad = "accelerometers" if name.startswith("accel") else "gyros"
        words = label(name)
        if ".matrix" in name:
            factor, unit = 1e6, "ppm" if words.startswith("scale") else "µrad"
        else:
            si = "m/s^2" if name.startswith("accel") else "rad/s"
            si += "/g" if "g_sensitivity" in name else ""
            factor, unit = customary(max(abs(moved.before), abs(moved.after)), si)
        name = f"{triad}: {words}"
    after, sigma = with_sigma(factor * moved.after, factor * moved.std)
    before, _ = with_sigma(factor * moved.before, factor * moved.std)
    return name, before, after, sigma, unit, f"{(moved.after - moved.before) / moved.std:+.1f}"


def _left_out_section(found: Diagnosis) -> list[Section]:
    """Stretches of rests that were not judged, and why."""
    if not found.handling:
        return []
    rows = tuple(
        (
            d.recording,
            f"{since(d.start, found.first):.2f}",
            f"{since(d.end, found.first):.2f}",
            d.kind,
            "left out" if d.left_out else "kept",
        )
        for d in found.handling
    )
    unit = unit_of_moments(found.first)
    head = ("recording", f"from, {unit}", f"to, {unit}", "what", "")
    table = Table(head, rows, numeric=(1, 2))
    return [Section("Rests that were disturbed", tables=(table,))]


def _noise_section(found: Diagnosis) -> list[Section]:
    """Where the noise was known from, and how it compares with the Allan deviation where a rest is long enough."""
    if not found.noise:
        return []
    lines = (
        "Every probability above rests on the noise that was fitted. Below: what was known of it beforehand, if "
        "anything was, and Allan deviations of the residual rows beside those of draws from it, where a rest is "
        "long enough.",
    )
    return [Section("Is the noise right?", lines=lines, items=found.noise)]


def _limits_section(found: Diagnosis) -> list[Section]:
    if found.audit is not None:
        sections = [sizes_section(found.audit)] if found.verdict == "consistent" else []
        beside = found.verdict != "consistent"
        return [*sections, *audit_sections(found.audit, sizes=beside)]
    sections = []
    if found.detectable:
        rows = tuple(
            (d.whole_name, ", ".join(d.channels), *_size(d.size, d.unit)) for d in found.detectable
        )
        table = Table(
            ("effect", "channels", "smallest size", "unit"),
            rows,
            numeric=(2,),
            caption="The smallest size that this campaign would have shown",
        )
        sections.append(Section("The smallest sizes that would have shown", tables=(table,)))
    if found.not_testable:
        lines = ("This campaign says nothing about these effects.",)
        items = found.notes or found.not_testable
        sections.append(Section("Not testable", lines=lines, items=items))
    return sections


def _size(size: float, unit: str) -> tuple[str, str]:
    factor, shown = customary(size, unit)
    return three_digits(factor * size), shown
