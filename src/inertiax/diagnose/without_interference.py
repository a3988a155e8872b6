"""A campaign without the lines in its rests' samples that move the means of rests.

Mains, a fan or a motor are lines in many a real recording and average out. What counts is what a line does to the
means of rests. With its mean δ_k in rest k and the standard deviation σ_k of that rest's mean,

    |Δp| ≤ σ_p √S,    S = Σ_k (δ_k / σ_k)²

for every parameter p of a fit that weights the means with their own variances (Cauchy and Schwarz): where S is less
than one, none moves by its own standard deviation. Such a line is told in a note. Another one is taken from every
sample, and the campaign is calibrated and judged without it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..calibrate.pipeline import calibrate_device
from ..calibrate.results import DeviceResult, TriadResult
from ..data.recording import Campaign
from ..effects import Effect
from ..effects.interference import EFFECT
from ..model_selection.model_spec import ModelSpec
from ..reduction.device_segments import of_one_device
from ..reduction.known_moves import take_moves
from ..reduction.segments import segment_each
from .observations.blocks import join, Log
from .observations.log_outputs import with_outputs
from .observations.rest_lines import find_lines, Line, Sought, without_lines
from .observations.rest_spectrum import rows_of_rests


# Times that lines are taken away: without them rests are found anew, in whose further rows more of them may show.
MOST_PASSES = 3


@dataclass(frozen=True, eq=False)
class Freed:
    """A campaign without the lines that move the means of rests, with its rows and its calibration."""

    campaign: Campaign
    log: Log
    recorded: DeviceResult  # the calibration of the campaign as it was recorded
    fitted: DeviceResult  # and of the one here, by the same model
    lines: dict[str, tuple[Line, ...]]  # that were taken away, by triad
    sought: dict[
        str, Sought
    ]  # what is left: lines that move no mean, and where they were looked for


def without_interference(
    campaign: Campaign, catalogue: Sequence[Effect], model: ModelSpec | None
) -> Freed:
    """Calibrate a campaign, and once more without the lines that matter, where the catalogue has them."""
    asked = any(e.name == EFFECT.name for e in catalogue)
    log, fitted = _calibrated(campaign, model)
    recorded, sought = fitted, _sought(log, fitted) if asked else {}
    lines: dict[str, tuple[Line, ...]] = {}
    for _ in range(MOST_PASSES):
        moving = _moving(campaign, log, sought, fitted)
        if not moving:
            break
        for line in moving:
            lines[line.triad] = (*lines.get(line.triad, ()), line)
        campaign = with_outputs(campaign, without_lines(log, moving))
        log, fitted = _calibrated(campaign, recorded.model)
        recorded = replace(recorded, segments=fitted.segments)
        sought = _sought(log, fitted)
    return Freed(campaign, log, recorded, fitted, lines, sought)


def _calibrated(campaign: Campaign, model: ModelSpec | None) -> tuple[Log, DeviceResult]:
    """The campaign's rows, and its calibration from the same rests."""
    found = segment_each(campaign.recordings, held=True)
    log = join(campaign, found=found)
    numbered = of_one_device(campaign.recordings, found, moves=take_moves(campaign.model))
    return log, calibrate_device(campaign, checked=True, model=model, segments=numbered)


def _sought(log: Log, fitted: DeviceResult) -> dict[str, Sought]:
    """The lines of each triad that is calibrated."""
    made = {}
    for triad in ("accel", "gyro"):
        found = None if getattr(fitted, triad) is None else find_lines(log, triad)
        if found is not None:
            made[triad] = found
    return made


def _moving(
    campaign: Campaign, log: Log, sought: dict[str, Sought], fitted: DeviceResult
) -> list[Line]:
    """Lines that move means: by what those scatter without any, for a line in them passes for noise."""
    every = [line for one in sought.values() for line in one.lines]
    if not every:
        return []
    clean = with_outputs(campaign, without_lines(log, every))
    means = calibrate_device(clean, checked=True, model=fitted.model, segments=fitted.segments)
    return [
        line
        for one in sought.values()
        for line in one.lines
        # Of several, that those left together move no parameter by its standard deviation.
        if moved_by(log, line, getattr(means, one.triad)) * len(one.lines) >= 1.0
    ]


def moved_by(log: Log, line: Line, result: TriadResult) -> float:
    """√S of a line: by how many standard deviations at most it moves a parameter. `result` is without it."""
    rests = rows_of_rests(log)
    dwells = result.dwells if result.fitted is None else result.fitted
    covariance = getattr(dwells, f"{line.triad}_covariance")
    if rests is None or covariance is None:
        return np.inf
    variance = float(np.median(np.asarray(covariance)[:, line.channel, line.channel]))
    # What dwells differ by beyond their noise, of a fit of their outputs; after motions it is of the motions.
    scatter = result.scatter if result.misfit_unit != "rad" else 0.0
    moved = rests.mean(line.at(rests.time))
    return float(np.sqrt(np.sum(np.square(moved)) / (variance + scatter**2)))
