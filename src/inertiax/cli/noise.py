"""`inertiax noise`: what the noise of a log at rest is made of."""

from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from . import console, environment, outputs
from .calibrate import AsJson, OutputFolder, Quiet


if TYPE_CHECKING:
    from ..data.recording import Recording


def noise(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING|CAMPAIGN",
            exists=True,
            help="A recording with canonical columns in SI units, or a campaign (which says names and "
            "units).",
        ),
    ],
    output: OutputFolder,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Allan deviations and noise coefficients (N, B, K, R, Q) of a log at rest, with their limits.

    Writes noise.json and a figure. Of each recording the longest rest is used.
    """
    outputs.require_folder(output)
    with console.Stages(quiet=quiet) as stages, outputs.owned_results(output):
        stages("starting")
        environment.prepare()
        from ..allan import noise_of
        from ..report.noise import noise_document, print_noise, write_figures

        stages("reading recordings")
        found = [noise_of(r, progress=stages) for r in _recordings(log)]
        stages("drawing")
        document = noise_document(found)
        with outputs.staged_folder(output, replaces=("noise.png",)) as staging:
            outputs.write_json(staging / "noise.json", document)
            figures = write_figures(found, staging)
    if as_json:
        outputs.print_json(document)
    elif not quiet:
        print_noise(found)
        console.say(f"written: {', '.join(str(output / n) for n in ('noise.json', *figures))}")


def _recordings(path: Path) -> "tuple[Recording, ...]":
    from ..data.campaign import load_campaign
    from ..data.formats.detect import read_recordings

    if path.suffix == ".toml" or (path / "campaign.toml").is_file():
        return load_campaign(path).recordings
    return read_recordings(path)
