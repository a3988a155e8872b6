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
from ..simulate.programme import programme_from_angles
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
    """Steps of a run: each position in words, with what the chamber does meanwhile."""
    plan = run.plan
    poses = np.array(plan.positions, float)
    directions = programme_from_angles(run.name, poses).directions() + 0.0
    changes = (
        plan.change if isinstance(plan.change, tuple) else (plan.change,) * len(plan.temperatures)
    )
    steps: list[Step] = []
    for k, (start, change) in enumerate(zip(plan.temperatures, changes)):
        for n, up in enumerate(directions):
            x, y, z = (float(c) for c in np.round(up, 6))
            words = [in_words(up), f"leave it alone for {plan.dwell_time:.0f} s"]
            if n == 0 and any(changes):
                words.insert(
                    0, _chamber(start, change, len(poses) * (plan.dwell_time + plan.slew_time))
                )
            afresh = bool(n == 0 and k and plan.soak_time)
            if afresh:
                words.insert(0, f"power off, wait {plan.soak_time / 60.0:.0f} min, power on")
            aim = start + change if any(changes) else None
            steps.append(Step((x, y, z), "; ".join(words), plan.dwell_time, aim, afresh))
    rates = plan.turn_rate if isinstance(plan.turn_rate, tuple) else (plan.turn_rate,)
    turns = tuple(
        (
            f"turn the table once each way about x, y and z at {rate:g} deg/s",
            float(np.radians(rate)),
        )
        for rate in rates
        if rate
    )
    return Itinerary(tuple(steps), turns)


def _chamber(start: float, change: float, seconds: float) -> str:
    minutes = seconds / 60.0
    if not change:
        return f"hold {start:.0f} °C for {minutes:.0f} min"
    way = "heat" if change > 0.0 else "cool"
    return f"{way} from {start:.0f} to {start + change:.0f} °C in {minutes:.0f} min"


def diagnosed_together(
    first: Campaign, folder: Path, progress: Callable[[str], None]
) -> tuple[Diagnosis, Campaign]:
    """The diagnosis of a campaign with what was recorded into a folder, and both as one campaign.

    Raises `ValueError` where they have different columns.
    """
    both = together(first, load_campaign(folder).recordings)
    return diagnose_campaign(both, progress=progress)[0], both
