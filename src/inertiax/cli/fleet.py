"""`inertiax fleet`: every device of a line, resumable, with a page over all of them."""

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import msgspec
import typer

from . import console, environment, inputs_kept, next_step, outputs
from .calibrate import command_line
from .options import AsJson, CampaignPath, Force, OutputFolder, Quiet


if TYPE_CHECKING:
    from ..fleet import FleetSummary
    from ..report.fleet import FleetPage


class Precision(StrEnum):
    """Choices of `--precision`."""

    FLOAT64 = "float64"
    FLOAT32 = "float32"


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
            help="A running Dask scheduler, tls://host:port or tcp://host:port, or `local` for worker processes "
            "here, which open no port.",
        ),
    ] = None,
    prior: Annotated[
        Path | None,
        typer.Option(
            metavar="POPULATION",
            exists=True,
            help="What is known of the line: an earlier run's folder or its population.json. Devices of "
            "short programmes get from it what their own positions do not tell.",
        ),
    ] = None,
    earlier: Annotated[
        Path | None,
        typer.Option(
            metavar="RESULTS",
            exists=True,
            file_okay=False,
            help="Folder of an earlier run: the report tells what changed for the same serial numbers.",
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="T,T,...",
            help="Temperatures, °C, at which --earlier is compared; default: the lowest, middle and highest "
            "that both runs cover.",
        ),
    ] = None,
    explain: Annotated[
        bool,
        typer.Option(
            "--explain",
            help="Also say what the model leaves out: effects common to the line (rig, reference, the sensors' "
            "make) and effects of single devices. At least eight devices.",
        ),
    ] = False,
    precision: Annotated[
        Precision,
        typer.Option(
            help="Arithmetic of the accelerometers' invariant problem. float32 is for accelerators that are slow "
            "with more; it costs up to 0.3 µg and 0.3 ppm.",
        ),
    ] = Precision.FLOAT64,
    force: Force = False,
    device: Annotated[
        str | None,
        typer.Option(
            metavar="SERIAL",
            help="Only write calibration-SERIAL.json and devices/SERIAL.html of one device of a run that is "
            "done.",
        ),
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate many devices, and set bad ones aside with the reason.

    CAMPAIGN names Parquet files of many devices. The folder gets parts/*.parquet with a row for each device,
    quarantine.parquet with those set aside, population.json with the line's mean and spread, summary.json
    and report.html. A run that was broken off, at any moment, goes on with the same command. Exit status 1 if no
    device was calibrated.
    """
    outputs.require_folder(output)
    temperatures = _temperatures(at)
    environment.prepare()
    _require_inputs_kept(campaign, output, prior, earlier)
    from ..fleet import read_population, run_fleet
    from ..report.fleet import report_fleet

    if device is not None:
        with outputs.owned_results(output):
            _one_device(output, device, as_json=as_json)
        return
    known = None if prior is None else read_population(prior)
    with outputs.owned_results(output):
        with console.Counter("devices' tasks", quiet=quiet) as counter:
            summary = run_fleet(
                campaign, output, workers=workers, scheduler=scheduler, prior=known, explain=explain,
                precision=precision.value, force=force, progress=counter,
            )  # fmt: skip
        with console.Stages(quiet=quiet) as stages:
            stages("writing the report")
            page = report_fleet(
                output,
                command_line(),
                outputs.folder_names,
                earlier=earlier,
                temperatures=temperatures,
            )
    _tell(summary, page, campaign, output, explain=explain, as_json=as_json, quiet=quiet)
    if not summary.calibrated:
        why = "; ".join(f"{count} × {reason}" for reason, count in summary.reasons[:3])
        console.warn(f"none of {summary.devices} devices was calibrated: {why}")
        raise typer.Exit(1)


def _require_inputs_kept(
    campaign: Path, output: Path, prior: Path | None, earlier: Path | None
) -> None:
    """No results go where the population, the earlier results or recordings are read; status 2."""
    if earlier is not None and earlier.resolve() == output.resolve():
        raise typer.BadParameter(
            f"'{output}' is --earlier itself, whose results would be replaced; name another folder.",
            param_hint="'-o'",
        )
    known = prior / "population.json" if prior is not None and prior.is_dir() else prior
    recordings = inputs_kept.files_of(campaign)
    own = ("population.json", "quarantine.parquet", "summary.json", "manifest.json")
    inputs_kept.require_kept(output, own, (known, *(f for f in recordings if f.name in own)))
    for file in recordings:
        if file.parent.name == "parts":
            inputs_kept.require_other_than(output / "parts" / file.name, (file,))


def _done_before(summary: "FleetSummary") -> str:
    if summary.devices_before:
        return (
            f" (results of {summary.devices_before} kept, whose files and settings are unchanged)"
        )
    return f" ({summary.tasks_before} tasks were done before)" if summary.tasks_before else ""


def _temperatures(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        asked = tuple(float(part) for part in text.split(","))
        if not all(math.isfinite(t) for t in asked):
            raise ValueError
        return asked
    except ValueError:
        raise typer.BadParameter(
            f"'{text}' is not a list of temperatures such as -20,25,60.", param_hint="'--at'"
        ) from None


def _one_device(output: Path, device: str, *, as_json: bool) -> None:
    """The page first: a device that was set aside has one, but no calibration."""
    from ..calibration.calibration import write_calibration
    from ..fleet import fleet_calibration
    from ..report.fleet import fleet_page
    from ..report.fleet_device import report_device

    page = fleet_page(output)
    # The same names as in the report, so that two serial numbers never share a page.
    names = outputs.folder_names(tuple(dict.fromkeys((*page.paged, device))))
    known = (page.manifest, page.population, page.unlike)
    shown = report_device(output, device, names[device], *known, command_line(), page.units)
    console.say(f"wrote {shown}", aside=as_json)
    file = output / f"calibration-{names[device]}.json"
    write_calibration(fleet_calibration(output, device), file)
    console.say(f"wrote {file}", aside=as_json)


def _tell(
    summary: "FleetSummary",
    page: "FleetPage",
    campaign: Path,
    output: Path,
    *,
    explain: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    from ..fleet import read_line_file
    from ..fleet.magnetometers import LEFT_OUT
    from ..fleet.population.unit_covariance import FEWEST
    from ..report.fleet import odd_sentence
    from ..report.fleet_drift import drift_sentence
    from ..report.fleet_fits import fit_sentence, reserved_lines
    from ..report.fleet_mismatch import too_few_to_explain

    line, unlike = (read_line_file(output) or ()) if explain else (), page.unlike_names
    if as_json:
        said: dict[str, object] = {"line": msgspec.to_builtins(line)} if explain else {}
        said["unlike"] = list(unlike)
        said["reserved"] = list(page.reserved)
        said["reserved_for"] = {r.words: list(r.devices) for r in page.why}
        said["odd_recordings"] = {o.device: o.words for o in page.odd}
        outputs.print_json({**summary.as_dict(), **said, "output": str(output)})
    elif not quiet:
        console.say(
            f"{summary.devices} devices: {summary.calibrated} calibrated, {summary.set_aside} set aside"
            + _done_before(summary)
        )
        for reason, count in summary.reasons:
            console.say(f"  {count} × {reason}")
        if summary.calibrated:
            console.say(fit_sentence(dict(summary.fits), page.reserved))
        for words in reserved_lines(page.why):
            console.say(f"  {words}")
        if 0 < summary.calibrated < FEWEST and page.manifest.prior is None:
            console.say(
                f"no population.json: the spread between devices needs {FEWEST} that were calibrated"
            )
        if page.manifest.magnetometers:
            console.say(LEFT_OUT)
        if unlike:
            more = ", …" if len(unlike) > 5 else ""
            console.say(f"unlike the others: {len(unlike)} ({', '.join(unlike[:5])}{more})")
        if page.odd:
            console.say(odd_sentence(page.odd))
        for triad, drift in page.drifts.items():
            console.say(drift_sentence(triad, drift))
        if explain and not line:
            console.say(too_few_to_explain(summary.calibrated))
        for sentence in (s for found in line for s in found.sentences):
            console.say(f"  {sentence}")
        console.say(f"results in {output}, see {output / 'report.html'}")
        following = next_step.after_fleet(campaign, page.reserved)
        if following:
            console.say(following)
