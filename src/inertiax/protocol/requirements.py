"""Limits that a device has to keep, from a TOML file, and whether it keeps them.

    [requirements]
    "accel.bias" = "0.3 mg"
    "accel.scale" = "200 ppm"

A requirement concerns the absolute value of every parameter that its name covers, over the whole calibrated range.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import msgspec

from ..calibration.quantities import si_unit
from ..live.target import covers, parse_limit, written_unit
from .effect_results import EffectResult
from .guard_band import allowance, decide, Decision, RISK
from .results import Result
from .tables import read_tables


class Limit(NamedTuple):
    """One line of the table."""

    name: str
    limit: float  # SI
    text: str  # as written

    @property
    def shown_in(self) -> tuple[float, str]:
        """Factor from SI and the unit in which the limit was written; SI where it is no text of a file."""
        found = written_unit(self.name, self.text)
        return (1.0, "SI") if found is None else (1.0 / found[0], found[1])


class Outside(NamedTuple):
    """A value that keeps a requirement from passing."""

    result: Result
    decision: Decision  # on this value among the others: fail or undecided


class Requirement(NamedTuple):
    """A limit with the decision on it."""

    name: str
    limit: float  # SI
    unit: str
    text: str  # the limit as written
    decision: Decision
    worst: Result  # the value that comes nearest to the limit or is farthest beyond it, guard band included
    shown_in: tuple[float, str] = (1.0, "")  # factor from SI and unit of the limit as written
    outside: tuple[Outside, ...] = ()  # stated results that do not pass, the farthest out first
    without: tuple[str, ...] = ()  # named effects on this triad, which the values do not contain
    reason: str = ""  # why it is not decided, whatever the values are


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    requirements: dict[str, Any]


def read_requirements(path: Path) -> tuple[Limit, ...]:
    """The limits of a TOML file, in its order.

    Raises `ValueError`, one line that names file and entry, for an unknown name or unit, a limit that is not above
    zero, or a table without entries.
    """
    said = read_tables(path, _File, '[requirements] with lines such as "accel.bias" = "0.3 mg"')
    if not said.requirements:
        raise ValueError(
            f'{path}: [requirements] is empty; write lines such as "accel.bias" = "0.3 mg".'
        )
    for name, amount in said.requirements.items():
        if not isinstance(amount, str):
            raise ValueError(
                f'{path}: "{name}" = {amount}: a limit is text with a unit, such as "0.3 mg".'
            )
    return tuple(
        Limit(name, parse_limit(name, amount.strip(), f'{path}: "{name}" = "{amount}"'), amount)
        for name, amount in said.requirements.items()
    )


def judge_requirements(
    limits: Sequence[Limit],
    stated: Sequence[Result],
    everywhere: Sequence[Result],
    effects: Sequence[EffectResult] = (),
    undecidable: Mapping[str, str] = MappingProxyType({}),
) -> tuple[Requirement, ...]:
    """The decision on every limit.

    **Arguments:** `stated` are the results at the reference temperatures, `everywhere` those over the whole range. A
    pass holds everywhere; a fail is found among those stated, see `guard_band`. `effects` are the named ones, which
    no decision contains. `undecidable` says by triad why nothing is decided on it: an uncertainty that does not hold
    decides nothing.

    Raises `ValueError` for a limit of parameters that the calibration does not have.
    """
    made = []
    for one in limits:
        name, limit, text = one
        shown = [r for r in stated if covers(name, r.name)]
        if not shown:
            fitted = ", ".join(dict.fromkeys(r.name for r in stated))
            raise ValueError(
                f'requirement "{name}": the calibration does not tell it; it has {fitted}.'
            )
        full = [r for r in everywhere if covers(name, r.name)]
        decision = decide([r.measured for r in full], [r.measured for r in shown], limit)
        worst = max(full, key=lambda r: abs(r.value) + allowance(r.measured))
        triad = name.partition(".")[0]
        reason = undecidable.get(triad, "")
        decision = "undecided" if reason else decision
        beside = [e.effect for e in effects if e.channels[0].startswith(f"{triad}_")]
        made.append(
            Requirement(
                name, limit, si_unit(shown[0].name), text, decision, worst, one.shown_in,
                () if reason else _outside(shown, worst, limit), tuple(dict.fromkeys(beside)), reason,
            )
        )  # fmt: skip
    return tuple(made)


def _outside(shown: Sequence[Result], worst: Result, limit: float) -> tuple[Outside, ...]:
    """The stated results that fail or are undecided; that of another temperature where only it is out."""
    found = []
    for r in shown:
        beyond = abs(r.value) - allowance(r.measured, RISK / len(shown)) > limit
        if beyond or abs(r.value) + allowance(r.measured) > limit:
            found.append(Outside(r, "fail" if beyond else "undecided"))
    if not found and abs(worst.value) + allowance(worst.measured) > limit:
        return (Outside(worst, "undecided"),)
    return tuple(sorted(found, key=lambda o: -abs(o.result.value)))
