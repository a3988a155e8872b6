"""`inertiax check`: whether units, signs, axes, clock, temperature and rests of a campaign can be right."""

from typing import TYPE_CHECKING

from . import console, environment, outputs
from .options import AsJson, CampaignPath, Quiet


if TYPE_CHECKING:
    from ..plausibility import Plausibility


def check(campaign: CampaignPath, as_json: AsJson = False, quiet: Quiet = False) -> None:
    """Look for what cannot be right before any fit: units, signs, axes, clock, temperature, rests.

    The verdict is plausible, doubtful (a warning) or implausible (an error, with which calibrate, diagnose, noise and
    fleet refuse to run). Exit status 0 whatever the verdict: the check was done.
    """
    outputs.require_campaign(campaign)
    with console.Stages(quiet=quiet) as stages:
        stages("starting")
        environment.prepare_without_jax()
        from ..data.campaign import load_campaign
        from ..plausibility import check_campaign

        stages("reading recordings")
        loaded = load_campaign(campaign, in_parts=True)
        stages("checking")
        seen = check_campaign(loaded)
    if as_json:
        outputs.print_json(seen.as_dict())
    elif not quiet:
        _print(seen)
        for note in loaded.notes:
            console.say(f"note: {console.one_line(note)}")


def _print(seen: "Plausibility") -> None:
    console.say(f"verdict: {seen.verdict}")
    for found in seen.findings:
        console.say(f"{found.severity}: {console.one_line(found.statement)} [{found.kind}]")
        if found.remedy is not None:
            console.say("  into campaign.toml:")
            for line in found.remedy.splitlines():
                console.say(f"    {console.one_line(line)}")
