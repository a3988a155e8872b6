"""`inertiax calibrate`: a campaign to calibrations, with a report."""

import shlex
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from . import console, environment, outputs
from .next_step import after_calibrate, say_what_is_open
from .options import AsJson, CampaignPath, Force, OutputFolder, Quiet


if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ..calibrate.pipeline import DeviceFailure, DeviceResult, TriadResult
    from ..data.inputs import InputFile
    from ..data.recording import Campaign
    from ..reduction.segments import Segments


_METHODS = ("gauss-newton", "joint", "paper")  # as in ..calibrate, which needs JAX to import


def calibrate(
    campaign: CampaignPath,
    output: OutputFolder,
    method: Annotated[
        str,
        typer.Option(
            help="gauss-newton (default): the iterative procedure as a Gauss-Newton method; joint: one "
            "least squares over all experiments; paper: the founding paper's iteration, for comparison.",
            metavar="|".join(_METHODS),
        ),
    ] = "gauss-newton",
    robust: Annotated[
        float | None,
        typer.Option(
            metavar="SIGMAS", help="Let misfits beyond so many sigmas count less (pseudo-Huber)."
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Estimate the error parameters of every device; write calibration.json, report.html and figures.

    With several devices each gets a folder, and summary.json lists them. Exit status 1 if any device
    failed; the others are written all the same.
    """
    _check_options(method, robust)
    outputs.require_campaign(campaign)
    outputs.require_folder(output)
    if method != "gauss-newton":  # the others are compiled
        environment.prepare()
    with (
        console.Stages(quiet=quiet) as stages,
        outputs.owned_results(output),
        environment.prepared_to_draw("inertiax.plots.calibration_panels", several=True),
        ThreadPoolExecutor(1) as meanwhile,
    ):
        from ..calibrate.pipeline import calibrate as run
        from ..data.campaign import load_campaign
        from ..data.inputs import campaign_inputs
        from ..plausibility.aside import spare_processor

        stages("reading recordings")
        loaded = load_campaign(campaign, in_parts=True)
        # SHA-256 of a long log takes half a second, and leaves the interpreter to the estimation.
        inputs = meanwhile.submit(campaign_inputs, loaded.path)
        with spare_processor():
            results = run(
                loaded,
                method=method,
                robust=robust,
                force=force,
                progress=stages,
                seen=_figures_ahead(loaded),
            )
        folders = write_results(results, loaded, output, stages, inputs.result)
    _tell(results, folders, campaign, output, as_json=as_json, quiet=quiet)


def _figures_ahead(
    campaign: "Campaign",
) -> "Callable[[Sequence[Segments] | TriadResult], None] | None":
    """What begins figures while the estimation goes on; of several devices, or of long logs, which take long to be
    looked through, none."""
    from ..data.stored_recording import StoredRecording
    from ..report.calibration import figures_ahead

    if len(tuple(campaign.devices)) > 1 or any(
        isinstance(r, StoredRecording) for r in campaign.recordings
    ):
        return None
    return figures_ahead(campaign)


def _check_options(method: str, robust: float | None) -> None:
    if method not in _METHODS:
        raise typer.BadParameter(
            f"'{method}' is not one of {', '.join(_METHODS)}.", param_hint="'--method'"
        )
    if robust is not None and not robust > 0:
        raise typer.BadParameter(
            f"{robust:g} must be a positive number of sigmas.", param_hint="'--robust'"
        )


def write_results(
    results: "tuple[DeviceResult | DeviceFailure, ...]",
    campaign: "Campaign",
    output: Path,
    stages: console.Stages,
    inputs: "Callable[[], tuple[InputFile, ...]]",
) -> dict[str, str]:
    """Write everything; the folder of each device, relative to `output` ("" = itself)."""
    from ..calibrate.pipeline import DeviceResult
    from ..calibration.calibration import write_calibration
    from ..protocol.make_record import record_of
    from ..protocol.record import write_record
    from ..report.calibration import (
        FIGURES,
        parameters_ahead,
        report_calibration,
        report_summary,
    )

    done = [r for r in results if isinstance(r, DeviceResult)]
    if not done:
        return {}
    if len(done) == 1:
        parameters_ahead(done[0])
    devices = tuple(campaign.devices)
    folders = outputs.folder_names(devices) if len(devices) > 1 else dict.fromkeys(devices, "")
    command = command_line()
    replaces = tuple(str(Path(f) / n) for f in folders.values() for n in FIGURES)
    with outputs.staged_folder(output, replaces=replaces) as staging:
        for result in done:
            device = result.calibration.device
            stages(f"writing the report{f' of device {device}' if device else ''}")
            folder = staging / folders[device]
            own = campaign.of_device(device)
            write_calibration(result.calibration, folder / "calibration.json")
            write_record(record_of(result, own, folder, command, inputs()), folder)
            report_calibration(result, folder, command, campaign=own)
        if len(devices) > 1:
            from ..report.document import calibration_document

            report_summary(results, staging, command, folders)
            document = calibration_document(results, folders, Path())
            outputs.write_json(staging / "summary.json", document)
    return folders


def tell_results(
    results: "tuple[DeviceResult | DeviceFailure, ...]",
    folders: dict[str, str],
    output: Path,
    campaign: Path | None = None,
) -> None:
    """Table, choices and verdict of every device that was calibrated, and where its files are; of a
    `campaign` the command to run next, too."""
    from ..calibrate.pipeline import DeviceFailure
    from ..report.text import print_result

    done = [r for r in results if not isinstance(r, DeviceFailure)]
    for result in done:
        own = output / folders[result.calibration.device]
        quality = print_result(result, own)
        if campaign is not None:
            table = result.accel is not None and result.accel.estimator.by_reference
            if result is done[-1]:
                say_what_is_open(campaign)
            triads = result.accel is not None or result.gyro is not None
            console.say(after_calibrate(quality, campaign, own, table=table, triads=triads))


def command_line() -> str:
    """The command as typed, to stand in a report."""
    return shlex.join(["inertiax", *sys.argv[1:]])


def _tell(
    results: "tuple[DeviceResult | DeviceFailure, ...]",
    folders: dict[str, str],
    campaign: Path,
    output: Path,
    *,
    as_json: bool,
    quiet: bool,
) -> None:
    """Result on standard output, failures on standard error; exits with status 1 after a failure."""
    from ..calibrate.pipeline import DeviceFailure

    failed = [r for r in results if isinstance(r, DeviceFailure)]
    if as_json:
        from ..report.document import calibration_document

        outputs.print_json(calibration_document(results, folders, output))
    elif not quiet:
        tell_results(results, folders, output, campaign)
    if not failed:
        return
    if len(results) == 1:
        console.warn(failed[0].reason)
    else:
        reasons = "; ".join(f"{f.device}: {f.reason}" for f in failed[:3])
        more = "; …" if len(failed) > 3 else ""
        console.warn(f"{len(failed)} of {len(results)} devices failed: {reasons}{more}")
    raise typer.Exit(1)
