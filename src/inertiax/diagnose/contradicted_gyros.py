"""What a diagnosis says of gyros whose motions contradict gravity: their rests alone agree with anything.

Such gyros are calibrated at rest, where a wrong unit or exchanged columns leave nothing to see. No catalogued effect is
that large, so what is wrong is unexplained, and names that their rests gave are none.
"""

from collections.abc import Sequence
from dataclasses import replace

from ..calibrate.results import DeviceResult
from ..data.recording import Campaign
from ..reduction.contradicted_motions import Contradiction
from .findings import Finding
from .result import Diagnosis, Where


CHANNEL = "gyro"  # which of the three, gravity alone does not say


def contradicted(fitted: DeviceResult) -> Contradiction | None:
    """What the calibration says of the gyros' motions."""
    return None if fitted.gyro is None else fitted.gyro.contradicted


def unnamed(findings: Sequence[Finding], said: Contradiction | None) -> list[Finding]:
    """The findings without what rests tell of contradicted gyros."""
    if said is None:
        return list(findings)
    return [silenced(f) if f.prepared.form.triad == CHANNEL else f for f in findings]


def silenced(found: Finding) -> Finding:
    """A finding without anything that it names or leaves unexplained."""
    answer = replace(
        found.answer,
        verdict="consistent",
        named=(),
        unlisted=None,
        noise=found.answer.null_noise,
        remembered=None,
        instead=(),
    )
    return replace(found, answer=answer, bursts=())


def with_contradiction(
    found: Diagnosis, said: Contradiction | None, campaign: Campaign
) -> Diagnosis:
    """The diagnosis with the motions in which gravity turned otherwise than the gyros; as it is without such."""
    if said is None:
        return found
    places = tuple(
        Where(
            CHANNEL,
            experiment_at(campaign, began),
            began,
            ended,
            "rate",
            rad / (ended - began),
            0.0,
        )
        for began, ended, rad in said.where
    )
    text = f"Gyros: {said.statement}. Their rests alone were judged, which show none of that."
    formula = f"gravity's turn is missed by {said.mean:.2f} rad"
    return replace(
        found,
        verdict="unexplained",
        summary=f"{text} Beside that: {found.summary}",
        where=(*places, *found.where),
        empirical="; ".join(t for t in (formula, found.empirical) if t),
        notes=(*found.notes, text),
    )


def experiment_at(campaign: Campaign, moment: float) -> int:
    """The run's number at a moment; 0 where none is recorded."""
    for recording in campaign.recordings:
        time, run = recording.time, recording.experiment
        if run is not None and time[0] <= moment <= time[-1]:
            return int(run[min(int(time.searchsorted(moment)), len(run) - 1)])
    return 0
