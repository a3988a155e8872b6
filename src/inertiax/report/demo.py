"""The report of `inertiax demo`: the founding paper's table and figures."""

from pathlib import Path

from ..analysis.paper_experiment import DemoResult, METHODS
from ..plots import demo as plots
from ..plots.style import drawing
from .page import Key, Picture, picture, Section, Table, Verdict, write_page
from .values import Value


_DEFAULT = METHODS[2]
PAPER_BIAS, PAPER_SCALE, PAPER_CHECK = 2e-4, 25e-6, 16.0  # m/s², 1, arcsec: the paper's results


def report_demo(result: DemoResult, folder: Path, command: str) -> None:
    """Write `report.html` and `figures/`."""
    with drawing():
        pictures = _pictures(result, folder)
    write_page(
        folder / "report.html",
        title="Calibration while the temperature changes",
        under="The founding paper's experiment, simulated: three sets of 13 experiments in 18 positions "
        "from −55 to +60 °C, and a check in 8 positions.",
        verdict=_verdict(result),
        keys=_keys(result),
        sections=[
            Section("Differences", lines=_reading(), tables=(_table(result),)),
            Section("The experiment", figures=(pictures["temperatures"], pictures["curves"])),
            Section(
                "Does the drift matter?",
                figures=(pictures["set1"], pictures["set2"], pictures["methods"]),
            ),
            Section("Check", figures=(pictures["check"],)),
        ],
        command=command,
    )


def _worst(result: DemoResult, method: str) -> tuple[float, float, float]:
    rows = [r for r in result.table if r.method == method and r.change > 1.0]
    return (
        max(r.bias_from_set3 for r in rows),
        max(r.scale_from_set3 for r in rows),
        max(r.check_arcsec for r in result.table if r.method == method),
    )


def _verdict(result: DemoResult) -> Verdict:
    bias, scale, check = _worst(result, _DEFAULT)
    reached = bias <= PAPER_BIAS and scale <= PAPER_SCALE and check <= PAPER_CHECK
    headline = (
        "A drift of 15 °C inside an experiment costs no accuracy."
        if reached
        else "A drift inside an experiment costs accuracy on this simulation."
    )
    traditional = _worst(result, METHODS[0])
    lines = [
        f"The default method's curves from sets 1 and 2 differ from those of set 3 by at most "
        f"{_micro(bias)} m/s² and {1e6 * scale:.2f} ppm; the paper reports 200·10⁻⁶ m/s² and 25 ppm on "
        f"its real sensors.",
        f"The traditional calibration, which gives each experiment one temperature, differs by "
        f"{_micro(traditional[0])} m/s² and {1e6 * traditional[1]:.1f} ppm.",
        f"On the check the specific force is off by at most {check:.2f}″ of g; the paper reports 16″. "
        f"The simulation has only white noise, so its figures are smaller than a real station's.",
    ]
    lines += [f"Set {n}: {s.warning}." for n, s in enumerate(result.sets, 1) if s.warning]
    return Verdict("good" if reached else "attention", headline, tuple(lines))


def _micro(value: float) -> str:
    """In millionths, without an exponent that a line could break at."""
    return f"{1e6 * value:.0f}·10⁻⁶"


def _keys(result: DemoResult) -> list[Key]:
    bias, scale, check = _worst(result, _DEFAULT)
    radius = result.sets[0].paper_radius
    return [
        Key("Bias, drift against none", f"{_micro(bias)} m/s²", "paper: 200·10⁻⁶ m/s²"),
        Key("Scale factor, likewise", f"{1e6 * scale:.2f} ppm", "paper: 25 ppm"),
        Key("Check, greatest", f"{check:.2f}″ of g", "paper: 16″"),
        Key("Paper's iteration, set 1", f"{radius:.2f}", "its error shrinks by this each pass"),
    ]


def _reading() -> tuple[str, ...]:
    return (
        "Greatest differences of the fitted curves over the temperature range, of the three axes; the "
        "check is the greatest ||a| − g|.",
    )


def _table(result: DemoResult) -> Table:
    head = (
        "drift, °C",
        "method",
        "bias − truth, 10⁻⁶ m/s²",
        "scale − truth, ppm",
        "bias − set 3, 10⁻⁶ m/s²",
        "scale − set 3, ppm",
        "check, arcsec of g",
    )
    rows = tuple(
        (
            f"{r.change:g}",
            r.method,
            f"{1e6 * r.bias_from_truth:.1f}",
            f"{1e6 * r.scale_from_truth:.2f}",
            f"{1e6 * r.bias_from_set3:.1f}" if r.change > 1.0 else "",
            f"{1e6 * r.scale_from_set3:.2f}" if r.change > 1.0 else "",
            f"{r.check_arcsec:.2f}",
        )
        for r in result.table
    )
    return Table(head, rows, numeric=(0, 2, 3, 4, 5, 6))


def _pictures(result: DemoResult, folder: Path) -> dict[str, Picture]:
    drawn = {
        "temperatures": (
            plots.temperatures(result),
            "As the paper's figure 2: the temperature within each of the 13 experiments.",
        ),
        "curves": (
            plots.curves(result),
            "As figure 3: bias and scale-factor error of set 3 over temperature; lines by the default "
            "method, points by each experiment alone.",
        ),
        "set1": (
            plots.signed_differences(result, 1),
            "As figure 4: curves of set 1 (15 °C) less set 3 (0.5 °C) by the default method; shaded, "
            "the 95 % band of the noise.",
        ),
        "set2": (
            plots.signed_differences(result, 2),
            "As figure 5: curves of set 2 (4 °C) less set 3 by the default method.",
        ),
        "methods": (
            plots.differences(result, 1),
            "Set 1 less set 3 by three ways of calibration: greatest difference of the three axes, on "
            "a logarithmic scale.",
        ),
        "check": (
            plots.check(result),
            "As figure 6: |a| − g over the check, by the models of the three sets.",
        ),
    }
    return {
        name: picture(figure, folder, f"demo-{name}", caption, caption)
        for name, (figure, caption) in drawn.items()
    }


def demo_document(result: DemoResult) -> dict[str, Value]:
    """The demo's table, schema `inertiax.demo/1`."""
    return {
        "schema": "inertiax.demo/1",
        "units": {"bias": "m/s^2", "scale": "1", "check": "m/s^2", "change": "degC"},
        "rows": [
            {
                "change": float(row.change),
                "method": row.method,
                "bias_from_truth": float(row.bias_from_truth),
                "scale_from_truth": float(row.scale_from_truth),
                "bias_from_set3": float(row.bias_from_set3),
                "scale_from_set3": float(row.scale_from_set3),
                "check": float(row.check),
                "check_arcsec": float(row.check_arcsec),
            }
            for row in result.table
        ],
        "paper_iteration_spectral_radius": [float(s.paper_radius) for s in result.sets],
    }
