"""`inertiax noise`: what the noise of a log at rest is made of."""

from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from . import console, environment, outputs
from .options import AsJson, Force, OutputFolder, Quiet


if TYPE_CHECKING:
    from ..data.recording import Campaign


def noise(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING|CAMPAIGN",
            exists=True,
            help="A recording with canonical columns in SI units, or a campaign (which says names and "
            "units; `inertiax init LOG -o DIR` writes one).",
        ),
    ],
    output: OutputFolder,
    force: Force = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Allan deviations and noise coefficients (N, B, K, R, Q) of a log at rest, with their limits.

    Writes noise.json and a figure. Of each recording the longest rest is used.
    """
    outputs.require_folder(output)
    with (
        console.Stages(quiet=quiet) as stages,
        outputs.owned_results(output),
        environment.prepared_to_draw("inertiax.plots.noise_panels"),
    ):
        from ..allan import logs_of, name_of, noise_of, noise_of_triads
        from ..data.campaign import load_triads_apart
        from ..plausibility import require_plausible, statements
        from ..report.noise import noise_document, print_noise, write_figures

        stages("reading recordings")
        campaign = _campaign(log)
        odd = require_plausible(campaign, force=force)
        compensated = _compensated(campaign, log)
        apart = () if campaign.path is None else load_triads_apart(campaign.path)
        found = [noise_of_triads(*triads, progress=stages) for triads in apart] or [
            noise_of(parts, compensated=name_of(parts).startswith(compensated), progress=stages)
            for parts in logs_of(campaign.recordings)
        ]
        stages("drawing")
        document = {
            **noise_document(found, _topic(log, campaign)),
            "plausibility": [f.as_dict() for f in odd],
        }
        with outputs.staged_folder(output, replaces=("noise.png",)) as staging:
            outputs.write_json(staging / "noise.json", document)
            figures = write_figures(found, staging)
    if as_json:
        outputs.print_json(document)
    elif not quiet:
        print_noise(found)
        for said in statements(odd):
            console.say(f"warning: {console.one_line(said)}")
        console.say(f"written: {', '.join(str(output / n) for n in ('noise.json', *figures))}")


def _campaign(path: Path) -> "Campaign":
    """The campaign, or a recording as one at a place of standard gravity."""
    from ..data.campaign import load_campaign
    from ..data.formats.long_logs import read_long
    from ..data.recording import Campaign

    if path.suffix == ".toml" or (path / "campaign.toml").is_file():
        return load_campaign(path, in_parts=True)
    try:
        return Campaign(read_long(path))
    except ValueError as error:
        if "[columns]" not in str(error):
            raise
        raise ValueError(
            f"{error} `inertiax init {path.name} -o DIR` writes a campaign.toml with [columns]; then "
            "`inertiax noise DIR`."
        ) from None


def _topic(log: Path, campaign: "Campaign") -> str | None:
    """The IMU's topic where the recordings are ROS bags."""
    from ..data.inputs import imu_topic, topic_of_bags

    return topic_of_bags([log]) if campaign.path is None else imu_topic(campaign.path)


def _compensated(campaign: "Campaign", path: Path) -> tuple[str, ...]:
    """Names of the files that are read as `inertiax compensate` wrote them; recordings' names begin with them."""
    from ..data.campaign import find_files, load_settings
    from ..data.compensated import reads_compensated

    files, named = (path,), []
    if campaign.path is not None:
        _, table = load_settings(campaign.path)
        files = find_files(campaign.path.parent, table.recordings.files)
        triads = (table.columns.accel, table.columns.gyro)
        named = [name for triad in triads if triad is not None for name in triad.names or ()]
    return tuple(file.name for file in files if reads_compensated(file, named))
