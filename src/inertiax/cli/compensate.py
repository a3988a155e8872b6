"""`inertiax compensate`: a calibration applied to a recording."""

from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from . import console, environment, inputs_kept, outputs
from .options import AsJson, given_file, Quiet, written


if TYPE_CHECKING:
    from ..exports.compensated_stream import Written


_SUFFIXES = (".csv", ".parquet", ".pq")


def compensate(
    calibration: Annotated[
        Path,
        typer.Argument(
            metavar="CALIBRATION", exists=True, dir_okay=False, help="A calibration.json."
        ),
    ],
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            exists=True,
            help="Recording in any format that a campaign reads; a bag's or EuRoC's folder.",
        ),
    ],
    output: Annotated[
        Path,
        written("FILE", "Result, .parquet or .csv; replaced if it exists."),
    ],
    campaign: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            metavar="FILE",
            help="campaign.toml whose [columns] and [recordings] say names, units and layout; default: the one in "
            "the recording's folder, if it names the recording.",
        ),
    ] = None,
    gyro_file: Annotated[
        Path | None,
        given_file("The gyros' file, where RECORDING holds the accelerometers alone.", "--gyro"),
    ] = None,
    any_device: Annotated[
        bool, typer.Option("--any-device", help="Apply it to another device's recording, too.")
    ] = False,
    at_table: Annotated[
        bool,
        typer.Option(
            "--at-table",
            help="With lever arms: the force at the table's axes, not at the device's own place.",
        ),
    ] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Compensate a recording: specific force in m/s², angular rate in rad/s, magnetic field in T.

    The result is the recording's table with accel_x/y/z, gyro_x/y/z and mag_x/y/z compensated, time in s and
    temperature in °C, every other column kept (of CSV and Parquet; other formats give canonical columns), and a
    column `extrapolated`: true where the temperature is outside what the calibration covered.
    """
    if output.suffix.lower() not in _SUFFIXES:
        raise typer.BadParameter(
            f"'{output.name}' must end in one of {', '.join(_SUFFIXES)}.", param_hint="'-o'"
        )
    outputs.require_file(output)
    if campaign is not None:
        outputs.require_campaign(campaign)
    with console.Stages(quiet=quiet) as stages, outputs.owned_results(output):
        stages("starting")
        environment.prepare_without_jax()
        from ..calibration.calibration import read_calibration
        from ..data.campaign import campaign_beside
        from ..exports.compensated_stream import write_compensated
        from ..protocol.record import doubt_about

        campaign = campaign or campaign_beside(recording)
        inputs_kept.require_other_than(output, (calibration, recording, gyro_file))
        inputs_kept.require_no_recording(output, calibration, campaign)
        stages("compensating")
        result = write_compensated(
            read_calibration(calibration),
            recording,
            output,
            gyro_file=gyro_file,
            campaign=campaign,
            any_device=any_device,
            at_table=at_table,
        )
    doubt = doubt_about(calibration)
    result = result._replace(notes=(*([doubt] if doubt else []), *result.notes))
    _tell(result, output, as_json=as_json, quiet=quiet)


def _tell(result: "Written", output: Path, *, as_json: bool, quiet: bool) -> None:
    for note in result.notes:
        console.warn(note)
    if as_json:
        outputs.print_json(
            {
                "schema": "inertiax.compensate/1",
                "output": str(output),
                "rows": result.rows,
                "extrapolated": result.num_extrapolated,
                "units": result.units,
                "at_rest": None if result.at_rest is None else result.at_rest._asdict(),
                "notes": list(result.notes),
            }
        )
    elif not quiet:
        axes = {name: name if name == "pressure" else f"{name}_x/y/z" for name in result.units}
        units = ", ".join(f"{axes[name]} in {unit}" for name, unit in result.units.items())
        console.say(f"{result.rows} rows compensated: {output} ({units})")
        if result.at_rest is not None:
            console.say(result.at_rest.sentence)
