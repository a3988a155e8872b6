"""`inertiax learn-noise`: the noise of a type of device, from several of its units."""

from pathlib import Path
from typing import Annotated

import typer

from . import console, environment, inputs_kept, outputs
from .options import AsJson, Quiet, written


def learn_noise(
    campaigns: Annotated[
        list[Path],
        typer.Argument(
            metavar="CAMPAIGN...",
            exists=True,
            help="Campaigns of units of one type on one station; a campaign may hold several devices.",
        ),
    ],
    output: Annotated[
        Path,
        written("FILE", "File for the noise, such as type-noise.json."),
    ],
    consistent: Annotated[
        bool,
        typer.Option(
            "--consistent",
            help="The units were diagnosed before and lack nothing: do not diagnose them again.",
        ),
    ] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Learn the noise of a type of device from units that lack nothing, for `diagnose --noise`.

    Each unit is diagnosed first; those with physics missing are left out and named. A dozen units are
    better than two. With the noise known, effects show that are too small to be told from it in one recording.
    """
    for campaign in campaigns:
        outputs.require_campaign(campaign)
    outputs.require_file(output)
    with console.Stages(quiet=quiet) as stages, outputs.owned_results(output):
        stages("starting")
        environment.prepare()
        for campaign in campaigns:
            inputs_kept.require_other_than(output, inputs_kept.files_of(campaign))
        from ..data.campaign import load_campaign
        from ..diagnose.learn_type_noise import learn_noise as learn
        from ..diagnose.noise.type_noise_file import write_noise

        stages("reading recordings")
        units = []
        for path in campaigns:
            loaded = load_campaign(path)
            folder = path.parent if path.is_file() else path
            several = len(loaded.devices) > 1
            for device in loaded.devices:
                name = f"{folder.resolve().name}, {device}" if several else folder.resolve().name
                units.append((name, loaded.of_device(device)))
        found = learn(units, consistent=consistent, progress=stages)
        write_noise(found, output)
    if as_json:
        outputs.print_document(output.read_text("utf-8"))
    elif not quiet:
        from ..report.text import print_type_noise

        print_type_noise(found, output)
