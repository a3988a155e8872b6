"""Rests that crept, and that a result left out for it: worth knowing, and no reservation on what was fitted without."""

import dataclasses
from collections.abc import Sequence

from ..reduction.handling import Disturbance
from .finding import Finding
from .rests import CREEPING


_TAKES_THE_CREEP = frozenset({"slip", "slow tilt", "held"})  # kinds of disturbance


def without_settled_rests(
    findings: Sequence[Finding], handling: Sequence[Disturbance]
) -> tuple[Finding, ...]:
    """Findings of a campaign as recorded, with what was left out of its rests in mind.

    That gravity's direction creeps in some rests is a warning of the recording. Where each of them was left out as held
    by hand or slowly tilting, or stands without its slip, nothing that was fitted creeps, and the warning becomes a
    note. One rest that was fitted as it is keeps the warning.
    """
    return tuple(
        dataclasses.replace(f, severity="note") if _settled(f, handling) else f for f in findings
    )


def _settled(found: Finding, handling: Sequence[Disturbance]) -> bool:
    evidence = dict(found.evidence)
    starts, stops = evidence.get(CREEPING[0]), evidence.get(CREEPING[1])
    if found.severity != "warning" or not isinstance(starts, tuple) or not isinstance(stops, tuple):
        return False
    out = [
        d
        for d in handling
        if d.left_out and d.kind in _TAKES_THE_CREEP and d.recording == evidence["recording"]
    ]
    return all(
        any(d.start < float(b) and d.end > float(a) for d in out) for a, b in zip(starts, stops)
    )
