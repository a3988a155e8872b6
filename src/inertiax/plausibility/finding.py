"""A finding about a campaign, and the verdict on all of them."""

import dataclasses
from typing import Literal

import numpy as np


SCHEMA = "inertiax.check/1"

Severity = Literal["error", "warning", "note"]
Verdict = Literal["plausible", "doubtful", "implausible"]
Value = str | int | float | bool | tuple[float, ...] | tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Finding:
    """One thing that looks wrong.

    An `error` is certain and makes every later number wrong. A `warning` makes results doubtful. A `note` is worth
    knowing and harmless. `remedy` is TOML for `campaign.toml`.
    """

    kind: str  # as listed in docs/reference/plausibility.md
    severity: Severity  # error, warning or note
    what: str  # triad, channel or column: accel, gyro_x, time, temperature, position, …
    statement: str  # one or two sentences, beginning with the recording's name where it is one's
    evidence: tuple[tuple[str, Value], ...] = ()  # numbers by name
    remedy: str | None = None  # TOML for campaign.toml, where there is one

    def as_dict(self) -> dict:
        """The finding as `check --json` prints it."""
        return {
            "kind": self.kind,
            "severity": self.severity,
            "what": self.what,
            "statement": self.statement,
            "evidence": {k: list(v) if isinstance(v, tuple) else v for k, v in self.evidence},
            "remedy": self.remedy,
        }

    @property
    def with_remedy(self) -> str:
        """The statement, and what to write into campaign.toml, in one line."""
        if self.remedy is None:
            return self.statement
        return f"{self.statement} Write {' '.join(self.remedy.split())} into campaign.toml."


def finding(
    kind: str,
    severity: Severity,
    what: str,
    statement: str,
    *,
    remedy: str | None = None,
    **evidence: object,
) -> Finding:
    """A `Finding` with its evidence as keywords; NumPy's numbers become Python's."""
    plain = tuple((name, _plain(value)) for name, value in evidence.items())
    return Finding(kind, severity, what, statement, plain, remedy)


def _plain(value: object) -> Value:
    if isinstance(value, list | tuple):
        return tuple(_plain(v) for v in value)  # pyright: ignore[reportReturnType]
    if isinstance(value, np.generic):
        return value.item()
    assert isinstance(value, str | int | float)
    return value


@dataclasses.dataclass(frozen=True)
class Plausibility:
    """All findings about a campaign, errors first."""

    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> Verdict:
        """`implausible` with an error, `doubtful` with a warning, else `plausible`."""
        severities = {f.severity for f in self.findings}
        if "error" in severities:
            return "implausible"
        return "doubtful" if "warning" in severities else "plausible"

    def of(self, severity: Severity) -> tuple[Finding, ...]:
        """The findings of one severity."""
        return tuple(f for f in self.findings if f.severity == severity)

    def as_dict(self) -> dict:
        """The document of `check --json`, schema `inertiax.check/1`."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "findings": [f.as_dict() for f in self.findings],
        }
