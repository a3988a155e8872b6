"""The run that parts what a diagnosis left together, as steps that are followed live, and the diagnosis of both."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..data.campaign import load_campaign
from ..data.recording import Campaign
from ..diagnose.pipeline import diagnose_campaign
from ..diagnose.plan.run_menu import Run
from ..diagnose.plan.separate import separate, Separation, together
from ..diagnose.result import Diagnosis
from ..diagnose.wording.separation import read_sets
from .itinerary import Itinerary, Step
from .next_position import in_words


def proposed(diagnosis: Path, progress: Callable[[str], None]) -> Separation:
    """The run for the first set of a diagnosis, whose campaign is where it says.

    Raises `ValueError`, one line, where there is no set or no campaign.
    """
    said = read_sets(diagnosis)
    if said.campaign is None or not said.campaign.exists():
        raise ValueError(f"{diagnosis}: its campaign is not at {said.campaign}.")
    campaign = load_campaign(said.campaign)
    if said.device in campaign.devices:
        campaign = campaign.of_device(said.device)
    return separate(campaign, said.sets[0], said.beside(said.sets[0]), progress)


def itinerary(run: Run) -> Itinerary:
    """Steps of a run: each position in words, with what the chamber or the power is to do."""
    seconds = run.plan.dwell_time
    steps: list[Step] = []
    for stage in run.stages():
        for n, up in enumerate(stage.ups):
            words = [in_words(np.array(up)), f"leave it alone for {seconds:.0f} s"]
            before = [x for x in (stage.power, stage.chamber) if x] if n == 0 else []
            afresh = stage.afresh and n == 0
            steps.append(Step(up, "; ".join(before + words), seconds, stage.aim, afresh))
    turns = tuple((words, float(np.radians(rate))) for words, rate in run.turns())
    return Itinerary(tuple(steps), turns)


def diagnosed_together(
    first: Campaign, folder: Path, progress: Callable[[str], None]
) -> tuple[Diagnosis, Campaign]:
    """The diagnosis of a campaign with what was recorded into a folder, and both as one campaign.

    Raises `ValueError` where they have different columns.
    """
    both = together(first, load_campaign(folder).recordings)
    return diagnose_campaign(both, progress=progress)[0], both
