"""`inertiax diagnose`: what a campaign holds beyond its model."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from . import console, environment, inputs_kept, outputs
from .calibrate import command_line
from .next_step import after_diagnose, say_what_is_open
from .options import AsJson, CampaignPath, Force, given_file, OutputFolder, Quiet


if TYPE_CHECKING:
    from ..data.recording import Campaign
    from ..diagnose import Diagnosis


_FILES = ("diagnosis.json", "calibration.json", "record.json", "report.html", "explorer.html")


def _list(asked: bool | None) -> None:
    """Print the catalogue of effects and end."""
    if not asked:
        return
    environment.prepare()
    from ..effects import CATALOGUE

    for effect in CATALOGUE:
        console.say(f"{effect.name}: {effect.title} ({', '.join(effect.triads)})")
        console.say(f"  adds  {effect.equation}")
        console.say(f"  seen with  {effect.needs}")
        console.say(f"  told from its rivals by  {effect.separating}")
    raise typer.Exit()


def diagnose(
    campaign: CampaignPath,
    output: OutputFolder,
    calibration: Annotated[
        Path | None,
        given_file(
            "A known calibration: it is taken away first, and only what it leaves is judged."
        ),
    ] = None,
    noise: Annotated[
        Path | None,
        given_file(
            "What other units of the type told of its noise (`inertiax learn-noise`): smaller effects show."
        ),
    ] = None,
    explore: Annotated[
        bool,
        typer.Option(
            "--explore",
            help="Write explorer.html, too: residuals over any variable, to zoom and hover; needs "
            "pip install 'inertiax[explore]'.",
        ),
    ] = False,
    show_list: Annotated[
        bool | None,
        typer.Option(
            "--list",
            callback=_list,
            is_eager=True,
            help="Show the effects that are looked for, and what each is seen with.",
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Locate, name and model what the model left out; write diagnosis.json, report.html and the
    calibration.json of the augmented model.

    With several devices each gets a folder. Exit status 1 if any could not be diagnosed.
    """
    del show_list  # its callback ended the command
    outputs.require_campaign(campaign)
    outputs.require_folder(output)
    with console.Stages(quiet=quiet) as stages, outputs.owned_results(output):
        stages("starting")
        environment.prepare_without_jax()
        from ..data.campaign import load_campaign

        if explore:
            from ..report.explorer import require_bokeh

            require_bokeh()
        stages("reading recordings")
        loaded = load_campaign(campaign)
        devices = tuple(loaded.devices)
        if calibration is not None and len(devices) > 1:
            raise ValueError(
                f"--calibration {calibration} is of one device, but the campaign has {len(devices)}; "
                f"split the campaign."
            )
        folders = outputs.folder_names(devices) if len(devices) > 1 else dict.fromkeys(devices, "")
        for name in folders.values():
            inputs_kept.require_kept(output / name, _FILES, (calibration, noise))
        with outputs.staged_folder(output) as staging:
            seen_from = {
                d: os.path.relpath(campaign.resolve(), (output / name).resolve())
                for d, name in folders.items()
            }
            outcomes = _diagnose_all(
                loaded, calibration, noise, force, staging, folders, seen_from, stages, explore
            )
    _tell(outcomes, folders, campaign, output, as_json=as_json, quiet=quiet)


def _diagnose_all(
    campaign: "Campaign",
    calibration: Path | None,
    noise: Path | None,
    force: bool,
    staging: Path,
    folders: dict[str, str],
    seen_from: dict[str, str],
    stages: console.Stages,
    explore: bool,
) -> "dict[str, Diagnosis | str]":
    """Diagnosis of each device, or why there is none. A single device's failure is raised."""
    from ..calibration.calibration import read_calibration, write_calibration
    from ..data.inputs import campaign_inputs
    from ..diagnose import diagnose_campaign
    from ..diagnose.noise.type_noise_file import read_noise
    from ..protocol.diagnosis_record import diagnosis_record
    from ..protocol.record import write_record
    from ..report.diagnosis import report_diagnosis

    known = None if calibration is None else read_calibration(calibration)
    of_type = None if noise is None else read_noise(noise)
    inputs = campaign_inputs(campaign.path)
    outcomes: dict[str, Diagnosis | str] = {}
    for device, name in folders.items():
        one = campaign.of_device(device)
        try:
            found, augmented = diagnose_campaign(
                one, calibration=known, noise=of_type, force=force, progress=stages
            )
        except ValueError as error:
            if len(folders) == 1:
                raise
            outcomes[device] = str(error)
            continue
        found = replace(found, campaign=(seen_from[device], device))
        stages("writing the report")
        folder = staging / name
        found.save(folder / "diagnosis.json")
        write_calibration(augmented, folder / "calibration.json")
        write_record(
            diagnosis_record(
                found,
                augmented,
                one,
                folder,
                command_line(),
                inputs,
                precompensated=known is not None,
            ),
            folder,
        )
        report_diagnosis(found, folder, command_line(), campaign=one)
        if explore:
            from ..report.explorer import write_explorer

            title = f"Residuals of {device}" if device else "Residuals"
            write_explorer(found.residuals, folder / "explorer.html", title=title)
        outcomes[device] = found
    return outcomes


def _tell(
    outcomes: "dict[str, Diagnosis | str]",
    folders: dict[str, str],
    campaign: Path,
    output: Path,
    *,
    as_json: bool,
    quiet: bool,
) -> None:
    from ..report.text import print_diagnosis

    failed = {d: reason for d, reason in outcomes.items() if isinstance(reason, str)}
    found = {d: one for d, one in outcomes.items() if not isinstance(one, str)}
    if as_json:
        documents = [{"device": d, **one.as_dict()} for d, one in found.items()]
        several = len(outcomes) > 1
        outputs.print_json({"devices": documents} if several else documents[0])
    elif not quiet:
        for device, one in found.items():
            print_diagnosis(one, device, output / folders[device])
            if len(found) == 1:
                arms = any(e.name == "size_effect" for e in one.effects)
                fitted = one.model is not None and one.model.lever_arms
                say_what_is_open(campaign)
                console.say(
                    after_diagnose(one.verdict, campaign, output, lever_arms=arms and not fitted)
                )
    if failed:
        reasons = "; ".join(f"{d}: {reason}" for d, reason in list(failed.items())[:3])
        console.warn(f"{len(failed)} of {len(outcomes)} devices not diagnosed: {reasons}")
        raise typer.Exit(1)
