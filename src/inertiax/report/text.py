"""Results as compact text on standard output."""

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rich import box
from rich.table import Table

from ..calibrate.fit_quality import judge
from ..calibration.quantities import middle_temperature, quantities, rms_text, with_sigma
from ..physics.temperature import Constant
from .judge import further_warnings, TRIAD_NAMES, triads
from .terminal import Terminal


if TYPE_CHECKING:  # a command pays for what it uses alone
    from ..analysis.paper_experiment import DemoResult
    from ..calibrate.fit_quality import Quality
    from ..calibrate.pipeline import DeviceResult
    from ..diagnose import Audit, Diagnosis, TypeNoise


def print_result(result: "DeviceResult", folder: Path) -> "Quality":
    """Parameters at the middle temperature, misfit, choices, warnings, and where the files are; how good it is."""
    console = _console()
    calibration = result.calibration
    if calibration.device:
        console.print(f"Device {calibration.device}", style="bold")
    middle = middle_temperature(calibration)
    for name, (triad, estimate) in triads(result).items():
        constant = isinstance(triad.curve.basis, Constant)
        where = "constant" if constant else f"at {middle:.1f} °C"
        console.print(f"{TRIAD_NAMES[name]} ('{triad.estimator}'), {where}:")
        table = _plain_table("", "value", "± 1 sigma", "unit")
        for q in quantities(triad, middle):
            table.add_row(q.label, *with_sigma(q.value, q.sigma), q.unit)
        console.print(table)
        chi2 = estimate.chi2_per_dof
        noise = f", χ² per degree of freedom {chi2:.2f}" if math.isfinite(chi2) else ""
        console.print(f"  rms misfit {rms_text(estimate.misfit_unit, estimate.rms)}{noise}")
    if calibration.mag is not None and result.mag is not None:
        console.print("Magnetometers ('field'):")
        table = _plain_table("", "value", "± 1 sigma", "unit")
        for q in quantities(calibration.mag.triad, middle):
            table.add_row(q.label, *with_sigma(q.value, q.sigma), q.unit)
        console.print(table)
        console.print(f"  rms misfit {rms_text('T', result.mag.rms)}")
    for choice in result.choices:
        console.print(f"chosen: {choice}")
    quality = judge(result)
    for warning in further_warnings(result, quality):
        console.print(f"warning: {warning}")
    console.print(f"is it good? {quality.answer}", style="bold")
    for wanted in quality.next:
        console.print(f"would improve it most: {wanted}")
    console.print(f"written: {folder / 'calibration.json'}, {folder / 'report.html'}")
    return quality


def print_demo(result: "DemoResult", folder: Path) -> None:
    """The demo's table: how far each way of calibration is from the truth and from set 3."""
    console = _console()
    console.print("Greatest differences over -55…+60 °C, and the check; simulated accelerometers.")
    table = _plain_table(
        "drift\n°C",
        "method",
        "bias\nfrom truth\n10⁻⁶ m/s²",
        "scale\nfrom truth\nppm",
        "bias\nfrom set 3\n10⁻⁶ m/s²",
        "scale\nfrom set 3\nppm",
        "check\narcsec",
        text=("method",),
    )
    for row in result.table:
        table.add_row(
            f"{row.change:g}",
            row.method,
            f"{1e6 * row.bias_from_truth:.1f}",
            f"{1e6 * row.scale_from_truth:.2f}",
            f"{1e6 * row.bias_from_set3:.1f}" if row.change > 1.0 else "",
            f"{1e6 * row.scale_from_set3:.2f}" if row.change > 1.0 else "",
            f"{row.check_arcsec:.2f}",
        )
    console.print(table)
    console.print(
        "The paper reports, for sets 1 and 2 against set 3: 200e-6 m/s², 25 ppm; check 16 arcsec."
    )
    console.print(f"written: {folder / 'report.html'}, {folder / 'demo.json'}")


def print_diagnosis(found: "Diagnosis", device: str, folder: Path) -> None:
    """Verdict, what was left out with its evidence, and where the files are."""
    from ..calibration.effect_units import shown_parameters

    console = _console()
    if device:
        console.print(f"Device {device}", style="bold")
    console.print(f"verdict: {found.verdict}", style="bold")
    console.print(found.summary)
    for effect in found.effects:
        rivals = f" or {', '.join(effect.alternatives)}" if effect.alternatives else ""
        untold = (
            f" or {', '.join(c for c, _ in effect.channel_odds[1:])}" if effect.channel_odds else ""
        )
        console.print(f"  {effect.name}{rivals} on {', '.join(effect.channels)}{untold}")
        rows = shown_parameters(effect.name, effect.parameters, found.first)
        for (name, value, sigma, unit), (_, p) in zip(rows, effect.parameters, strict=True):
            known = f"± {sigma} {unit}" if p.std is not None else f"{unit} ({sigma})"
            console.print(f"    {name} = {value} {known}")
        if effect.separating_experiment:
            console.print(f"    to tell more: {effect.separating_experiment}")
    for line in found.not_applied:
        console.print(line)
    console.print(
        f"written: {folder / 'diagnosis.json'}, {folder / 'calibration.json'}, {folder / 'report.html'}"
    )


NOISE_HEADS = {
    "flicker": "flicker, each\nrelaxation",
    "walk": "random walk\nin 1 s",
    "dwell": "each\npositioning",
    "cycle": "each\npower-on",
}


def print_type_noise(noise: "TypeNoise", path: Path) -> None:
    """Standard deviations with their range of one sigma, the units that told them, and those left out."""
    from ..diagnose.noise.state_space import Variances

    console = _console()
    console.print(f"Noise of a type, from {len(noise.units)} units: {', '.join(noise.units)}")
    if noise.diagnosed is False:
        console.print("not diagnosed first: taken as consistent")
    for name, why in noise.left_out:
        console.print(f"left out: {name} ({why})")
    columns = list(Variances.__dataclass_fields__)
    table = _plain_table("", *NOISE_HEADS.values(), "unit")
    for chain in noise.chains:
        sigma = chain.covariance.diagonal() ** 0.5
        cells = []
        for k in map(columns.index, NOISE_HEADS):
            middle, factor = math.exp(chain.mean[k] / 2.0), math.exp(sigma[k] / 2.0)
            # A variance known to less than a factor of ten is bounded from above alone.
            cells.append(
                f"{middle:.2g} ×÷ {factor:.1f}" if factor < 3.2 else f"< {middle * factor**2:.1g}"
            )
        unit = "m/s²" if "accel" in chain.label else "rad/s"
        table.add_row(chain.label, *cells, unit)
    console.print(table)
    console.print(f"written: {path}")


def print_audit(audit: "Audit") -> None:
    """What a plan shows, cannot tell apart and hides."""
    from .audit import audit_sections

    console = _console()
    for section in audit_sections(audit):
        console.print(section.title, style="bold")
        for line in section.lines:
            console.print(line)
        for table in section.tables:
            shown = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
            for k, head in enumerate(table.head):
                shown.add_column(head, justify="right" if k in table.numeric else "left")
            for row in table.rows:
                shown.add_row(*map(str, row))
            console.print(shown)
        console.print()


def _console() -> Terminal:
    # A table squeezed into less than 96 columns loses letters; a terminal wraps it instead. Where there
    # is no terminal to ask, nothing is wrapped.
    asked = Terminal().width if sys.stdout.isatty() else 200
    return Terminal(soft_wrap=True, width=max(asked, 96))


def _plain_table(*heads: str, text: tuple[str, ...] = ("", "unit")) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for head in heads:
        words = head in text
        table.add_column(head, justify="left" if words else "right", no_wrap=words)
    return table
