"""`inertiax design`: what a plan can tell, before any of its recordings is explained."""

import tempfile
import tomllib
from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from . import console, environment, outputs
from .calibrate import AsJson, Quiet


if TYPE_CHECKING:
    from ..recordings import Campaign


def design(
    plan: Annotated[
        str,
        typer.Argument(
            metavar="PLAN",
            help="Campaign folder or campaign.toml, or a scenario of `inertiax simulate`: file or name.",
        ),
    ],
    audit: Annotated[
        bool,
        typer.Option(
            "--audit",
            help="Say what the plan cannot observe, what it cannot tell apart, and from which size on it "
            "shows each effect.",
        ),
    ] = False,
    assumed_noise: Annotated[
        bool,
        typer.Option(
            "--assumed-noise",
            help="Beside the white noise inside rests take a flicker of the same size instead of fitting "
            "slow noise to the recordings.",
        ),
    ] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Judge a test plan: which effects it shows from which size on, hides, or cannot tell apart."""
    # Further questions to a plan become further options; each does something only when asked.
    if not audit:
        raise typer.BadParameter("say what to do with the plan: --audit.", param_hint="'--audit'")
    with console.Stages(quiet=quiet) as stages:
        stages("starting")
        environment.prepare()
        from ..diagnose import audit as run

        campaign = _campaign(plan, stages)
        device = campaign.devices[0]
        if len(campaign.devices) > 1:
            console.warn(f"the plan of device '{device}' stands for those of the other devices")
        stages("auditing the plan")
        found = run(campaign.of_device(device), estimate_noise=not assumed_noise)
    if as_json:
        outputs.print_json(found.as_dict())
    elif not quiet:
        from ..report.text import print_audit

        print_audit(found)


def _campaign(plan: str, stages: console.Stages) -> "Campaign":
    """The campaign at a path, or one simulated by a scenario."""
    from ..campaign import load_campaign
    from ..simulate import load_scenario, SCENARIOS, write_campaign

    path = Path(plan)
    if path.exists() and not _is_scenario(path):
        outputs.require_campaign(path)
        stages("reading recordings")
        return load_campaign(path)
    if not path.exists() and plan not in SCENARIOS:
        raise typer.BadParameter(
            f"'{plan}' does not exist; give a campaign, a scenario file or one of "
            f"{', '.join(SCENARIOS)}.",
            param_hint="'PLAN'",
        )
    with tempfile.TemporaryDirectory() as folder:
        simulated = Path(folder) / "campaign"
        write_campaign(
            load_scenario(plan), simulated, progress=lambda text: stages(f"simulating {text}")
        )
        stages("reading the simulated recordings")
        return load_campaign(simulated)


def _is_scenario(path: Path) -> bool:
    """Whether a file is a scenario: a campaign names its recordings' files."""
    if path.is_dir():
        return False
    try:
        content = tomllib.loads(path.read_text("utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError):
        return False
    return "recordings" not in content
