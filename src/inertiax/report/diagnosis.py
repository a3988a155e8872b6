"""The report of `inertiax diagnose`."""

import math
from pathlib import Path

from ..diagnose import Diagnosis
from ..plots import diagnosis as plots
from ..plots.style import drawing
from ..quantities import with_sigma
from ..recordings import Campaign
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
    names = [" or ".join((e.name, *e.alternatives)) for e in found.effects]
    if names:
        headline = f"{headline[:-1]}: {'; '.join(names)}."
    device = "" if campaign is None else campaign.devices[0]
    sections = [
        *_effect_section(found),
        *_fit_section(found, folder),
        *_place_section(found, folder, campaign),
        *_moved_section(found, folder),
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


def _effect_section(found: Diagnosis) -> list[Section]:
    sections = []
    for effect in found.effects:
        rows = tuple((name, *_value(p.value, p.std), p.unit) for name, p in effect.parameters)
        evidence = effect.evidence
        lines = [
            effect.statement,
            f"Evidence: ΔBIC {evidence.delta_bic:.0f}, p = {evidence.p_value:.1e}, misfit on left-out "
            f"data lower by {100 * evidence.held_out_gain:.0f} %.",
        ]
        if effect.separating_experiment:
            lines.append(f"Experiment that would tell more: {effect.separating_experiment}")
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
        title = f"{effect.name} on {', '.join(effect.channels)}"
        sections.append(Section(title, lines=tuple(lines), tables=tuple(tables)))
    if found.empirical is not None:
        lines = ("The best-found dependence; it describes the data and explains nothing.",)
        sections.append(Section("What was found", lines=lines, items=(found.empirical,)))
    return sections


def _value(value: float, std: float | None) -> tuple[str, str]:
    if std is None or not math.isfinite(std):
        return f"{value:.6g}", "not determined"
    return with_sigma(value, std)


def _fit_section(found: Diagnosis, folder: Path) -> list[Section]:
    if found.baseline is None or found.augmented is None:
        return []
    rows = tuple(
        (name, f"{q.rms:.3g}", f"{q.chi2_per_dof:.3g}", f"{q.held_out_rms:.3g}")
        for name, q in (("baseline", found.baseline), ("augmented", found.augmented))
    )
    head = ("model", "rms misfit, SI", "χ² per dof", "rms on left-out data, SI")
    figures: tuple[Picture, ...] = ()
    if found.verdict != "consistent" and found.baseline.rms > 0:
        caption = (
            "How much smaller the misfit is with the effects, also on data left out of the fit."
        )
        with drawing():
            figures = (picture(plots.improvement(found), folder, "improvement", caption, caption),)
    return [Section("Fit", tables=(Table(head, rows, numeric=(1, 2, 3)),), figures=figures)]


def _place_section(found: Diagnosis, folder: Path, campaign: Campaign | None) -> list[Section]:
    if not found.where:
        return []
    rows = tuple(
        (
            w.channel,
            str(w.experiment),
            f"{w.start:.1f}",
            f"{w.end:.1f}",
            w.driver,
            f"{w.excess_rms:.2e}",
            f"{w.p_value:.1e}",
        )
        for w in found.where
    )
    head = ("channel", "experiment", "start, s", "end, s", "driver", "excess rms, SI", "p")
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
    rows = tuple(
        (
            m.name,
            f"{m.before:.6g}",
            f"{m.after:.6g}",
            f"{m.std:.2g}",
            f"{(m.after - m.before) / m.std:+.1f}",
        )
        for m in moved
    )
    head = ("parameter", "before, SI", "after, SI", "± 1 sigma", "shift, sigmas")
    caption = "How far the omission had pulled the calibrated parameters, the largest shifts."
    with drawing():
        figure = picture(plots.pulled(found), folder, "pulled", caption, caption)
    table = Table(head, rows, numeric=(1, 2, 3, 4))
    return [Section("What the omission had pulled", tables=(table,), figures=(figure,))]


def _limits_section(found: Diagnosis) -> list[Section]:
    sections = []
    if found.detectable:
        rows = tuple(
            (d.name, ", ".join(d.channels), f"{d.size:.2e}", d.unit) for d in found.detectable
        )
        table = Table(
            ("effect", "channels", "smallest size", "unit"),
            rows,
            numeric=(2,),
            caption="The smallest size that this campaign would have shown",
        )
        sections.append(Section("What could not have been missed", tables=(table,)))
    if found.not_testable:
        lines = ("This campaign says nothing about these effects.",)
        items = found.notes or found.not_testable
        sections.append(Section("Not testable", lines=lines, items=items))
    return sections
