"""`inertiax fleet`: every device of a Parquet data set, resumable."""

from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from . import console, environment, outputs
from .calibrate import AsJson, CampaignPath, OutputFolder, Quiet


if TYPE_CHECKING:
    from ..fleet import FleetSummary


def fleet(
    campaign: CampaignPath,
    output: OutputFolder,
    workers: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Tasks side by side; default: one for each core."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="A running Dask scheduler, tcp://host:port, or `local` to start Dask workers here.",
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            metavar="SERIAL",
            help="Only write calibration-SERIAL.json of one device of a run that is done.",
        ),
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate many devices from Parquet files, and set bad ones aside with the reason.

    The folder gets parts/*.parquet with a row for each device, quarantine.parquet with those set
    aside, and summary.json. A run that was broken off, at any moment, goes on with the same command.
    """
    outputs.require_folder(output)
    environment.prepare()
    from ..fleet import fleet_calibration, run_fleet

    if device is not None:
        from ..calibration import write_calibration

        file = output / f"calibration-{outputs.folder_names((device,))[device]}.json"
        write_calibration(fleet_calibration(output, device), file)
        typer.echo(f"wrote {file}", err=as_json)
        return
    with console.Counter("devices' tasks", quiet=quiet) as counter:
        summary = run_fleet(
            campaign, output, workers=workers, scheduler=scheduler, progress=counter
        )
    _tell(summary, output, as_json=as_json, quiet=quiet)


def _tell(summary: "FleetSummary", output: Path, *, as_json: bool, quiet: bool) -> None:
    if as_json:
        outputs.print_json({**summary.as_dict(), "output": str(output)})
    elif not quiet:
        typer.echo(
            f"{summary.devices} devices: {summary.calibrated} calibrated, {summary.set_aside} set aside"
            + (f" ({summary.tasks_before} tasks were done before)" if summary.tasks_before else "")
        )
        for reason, count in summary.reasons:
            typer.echo(f"  {count} × {reason}")
        typer.echo(f"results in {output}")
