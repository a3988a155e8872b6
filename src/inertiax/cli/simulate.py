"""`inertiax simulate`: a campaign with known truth."""

from pathlib import Path
from typing import Annotated

import typer

from ..storage.whole_files import MARK
from . import console, environment, outputs
from .options import AsJson, OutputFolder, Quiet


def simulate(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="Scenario file (TOML), or a name: paper-set-1, paper-set-2, paper-set-3, "
            "paper-check, gyro-table.",
        ),
    ],
    output: OutputFolder,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Write a campaign that a simulated station would record, and what was really there.

    The folder gets campaign.toml, the recordings, and truth.json beside them.
    """
    outputs.require_folder(output)
    if output.exists() and any(not p.name.startswith(MARK) for p in output.iterdir()):
        raise typer.BadParameter(
            f"'{output}' is not empty, and other recordings there would become part of the campaign.",
            param_hint="'-o'",
        )
    with console.Stages(quiet=quiet) as stages, outputs.owned_results(output):
        stages("starting")
        environment.prepare()
        from ..simulate import load_scenario, SCENARIOS, write_campaign

        if not Path(scenario).exists() and scenario not in SCENARIOS:
            raise typer.BadParameter(
                f"'{scenario}' does not exist; give a file or one of {', '.join(SCENARIOS)}.",
                param_hint="'SCENARIO'",
            )
        loaded = load_scenario(scenario)
        with outputs.staged_folder(output) as staging:
            write_campaign(loaded, staging, progress=lambda text: stages(f"simulating {text}"))
    files = sorted(p.name for p in output.iterdir())
    if as_json:
        outputs.print_json({"schema": "inertiax.simulate/1", "folder": str(output), "files": files})
    elif not quiet:
        console.say(f"{len(files)} files written: {output}")
