"""`inertiax demo`: the founding paper's experiment, end to end."""

from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from . import console, environment, outputs
from .calibrate import command_line
from .options import AsJson, Quiet, written


if TYPE_CHECKING:
    from ..analysis.paper_experiment import DemoResult


def demo(
    output: Annotated[
        Path | None,
        written("DIR", "Folder for the report and the figures [default: inertiax-demo]."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Draws the device and the noise.")] = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Simulate and calibrate the three sets of the founding paper: a drift of 15, 4 and 0.5 °C.

    Prints how far each way of calibration is from the truth, and draws the paper's figures.
    """
    folder = outputs.require_folder(Path("inertiax-demo") if output is None else output)
    with console.Stages(quiet=quiet) as stages, outputs.owned_results(folder):
        stages("starting")
        environment.prepare()
        from ..analysis.paper_experiment import run_demo

        result = run_demo(seed=seed, progress=stages)
        stages("drawing figures")
        _write(result, folder)
    _tell(result, folder, as_json=as_json, quiet=quiet)


def _write(result: "DemoResult", folder: Path) -> None:
    from ..report.demo import demo_document, report_demo

    with outputs.staged_folder(folder) as staging:
        report_demo(result, staging, command_line())
        outputs.write_json(staging / "demo.json", demo_document(result))


def _tell(result: "DemoResult", folder: Path, *, as_json: bool, quiet: bool) -> None:
    from ..report.demo import demo_document
    from ..report.text import print_demo

    if as_json:
        outputs.print_json(demo_document(result))
    elif not quiet:
        print_demo(result, folder)
