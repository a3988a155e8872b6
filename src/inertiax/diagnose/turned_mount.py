"""What a diagnosis says of rests that stand otherwise than their references say.

Where the device turned in its mount, no parameter of the sensor follows: names that the accelerometers' rests gave are
none. Where rests differ from their references by far more than noise and the rig's stated uncertainty, without a moment
that parts them, something is there all the same: no scatter that an uncertainty could stand for.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from ..calibrate.goodness_of_fit import LIMITS
from ..calibrate.results import DeviceResult
from ..calibration.quantities import rms_text
from ..data.moments import moment
from ..data.recording import Campaign, Recording
from ..plausibility import Finding as Odd
from .contradicted_gyros import experiment_at, silenced
from .findings import Finding
from .result import Diagnosis, Where
from .wording.sentences import agreement


TRIAD = "accel"


def turned(found_odd: Sequence[Odd]) -> Odd | None:
    """What the checks say of a moment from which on the references stand turned."""
    return next(
        (f for f in found_odd if f.kind == "remounted" and "began" in dict(f.evidence)), None
    )


def without_turned(findings: Sequence[Finding], said: Odd | None) -> list[Finding]:
    """The findings without what rests in two mountings tell; the gyros' stay unless these turned, too."""
    if said is None:
        return list(findings)
    both = bool(dict(said.evidence)["gyros_too"])
    return [
        silenced(f)
        if f.prepared.form.by_reference and (both or f.prepared.form.triad == TRIAD)
        else f
        for f in findings
    ]


def with_turn(
    found: Diagnosis, said: Odd | None, findings: Sequence[Finding], campaign: Campaign
) -> Diagnosis:
    """The diagnosis with the moment and the angle; as it is without such."""
    if said is None:
        return found
    evidence = dict(said.evidence)
    began, angle = (_number(evidence[name]) for name in ("began", "angle"))
    first = next((float(r.time[0]) for r in campaign.recordings if _holds(r, began)), 0.0)
    text = (
        f"The accelerometers' rests do not agree with one mounting of the device: from {moment(began, first)} on they "
        f"stand turned by {math.degrees(angle):.2g}° against the references. No parameter of the sensor follows that, "
        "and errors told from both parts are those of neither."
    )
    return _unexplained(
        found,
        findings,
        campaign,
        text,
        began,
        angle * campaign.site.gravity,
        f"turned by {angle:.3g} rad",
    )


def with_unheld(
    found: Diagnosis, result: DeviceResult, findings: Sequence[Finding], campaign: Campaign
) -> Diagnosis:
    """A diagnosis that names nothing, `unexplained` where the accelerometers' rests differ from their references by
    `FitLimits.undecided_ratio` times noise and rig, which states how well it stands; else as it is."""
    estimate = result.accel
    told = any(f.prepared.form.by_reference and f.prepared.form.triad == TRIAD for f in findings)
    if estimate is None or not told or not campaign.rig.position_uncertainty:
        return found
    ratio = math.sqrt(estimate.chi2_per_dof)
    if not ratio >= LIMITS.undecided_ratio:  # not where the noise is unknown
        return found
    left = rms_text(estimate.misfit_unit, estimate.rms)
    text = (
        f"The accelerometers' dwells do not agree with their references: they differ by {left} rms, {ratio:.1f} times "
        "their noise and the rig's stated uncertainty together, which no catalogued effect and no dependence explains. "
        "The device may have stood otherwise than the references say, or its outputs do not repeat."
    )
    began = float(campaign.recordings[0].time[0])
    return _unexplained(
        found, findings, campaign, text, began, estimate.rms, f"dwells differ by {left} rms"
    )


def _number(value: object) -> float:
    assert isinstance(value, int | float)  # as `plausibility.turned_mount` writes it
    return float(value)


def _holds(recording: Recording, seconds: float) -> bool:
    return bool(recording.time[0] <= seconds <= recording.time[-1])


def _unexplained(
    found: Diagnosis,
    findings: Sequence[Finding],
    campaign: Campaign,
    text: str,
    began: float,
    size: float,
    formula: str,
) -> Diagnosis:
    """The diagnosis with `text` before what else it says, but not that the accelerometers agree."""
    forms = [f.prepared.form for f in findings if not f.prepared.motions]
    others = [f for f in forms if f.triad != TRIAD]
    further = found.summary.replace(agreement(forms), agreement(others) if others else "").strip()
    holding = next((r for r in campaign.recordings if _holds(r, began)), None)
    ended = float((campaign.recordings[-1] if holding is None else holding).time[-1])
    place = Where(TRIAD, experiment_at(campaign, began), began, ended, "position", size, 0.0)
    return replace(
        found,
        verdict="unexplained",
        summary=f"{text} Beside that: {further}" if further else text,
        where=(place, *found.where),
        detectable=tuple(d for d in found.detectable if not d.channels[0].startswith(TRIAD)),
        empirical="; ".join(t for t in (formula, found.empirical) if t),
        notes=(*found.notes, text),
    )
