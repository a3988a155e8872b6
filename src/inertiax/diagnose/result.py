"""The diagnosis: what a campaign says about the physics that its model left out."""

import json
from dataclasses import replace
from pathlib import Path

from .._jax import eqx
from ..calibrate.results import DeviceResult
from ..model_selection.model_spec import ModelSpec
from ..plausibility import Finding, statements
from ..plausibility.settled_rests import without_settled_rests
from ..reduction.handling import Disturbance
from ..storage.whole_files import write_atomically
from .plan.limits import Audit, Detectable as Detectable
from .residuals import Residuals


SCHEMA = "inertiax.diagnosis/1"


class Where(eqx.Module):
    """A stretch of the campaign where a channel departs from the model."""

    channel: str = eqx.field(static=True)  # such as accel_y
    experiment: int = eqx.field(static=True)  # its number
    start: float = eqx.field(static=True)  # s, on the recording's clock
    end: float = eqx.field(static=True)  # s
    driver: str = eqx.field(static=True)  # the variable that it follows
    excess_rms: float = eqx.field(static=True)  # m/s² or rad/s
    p_value: float = eqx.field(static=True)  # under noise alone


class Parameter(eqx.Module):
    """An estimated parameter of an effect."""

    value: float = eqx.field(static=True)  # in `unit`
    std: float | None = eqx.field(static=True)  # None where the data does not tell it
    unit: str = eqx.field(static=True)  # SI


class Evidence(eqx.Module):
    """How well an effect is supported."""

    delta_bic: float = eqx.field(static=True)  # drop of the criterion, positive for the effect
    p_value: float = eqx.field(static=True)  # under noise alone
    # 1 − rms with it / rms without, on left-out data of its channels.
    held_out_gain: float = eqx.field(static=True)


class Explanation(eqx.Module):
    """One effect that was left out, with the names that the data cannot tell from it."""

    name: str = eqx.field(static=True)  # of the catalogue
    channels: tuple[str, ...] = eqx.field(static=True)  # such as accel_y
    form: str = eqx.field(static=True)  # such as a time constant
    # Names that the data cannot tell from it.
    alternatives: tuple[str, ...] = eqx.field(static=True)
    odds: tuple[tuple[str, float], ...] = eqx.field(static=True)  # posterior shares of the set
    parameters: tuple[tuple[str, Parameter], ...]  # by name
    evidence: Evidence  # how well it is supported
    statement: str = eqx.field(static=True)  # what it does, in words
    # What would decide between the alternatives.
    separating_experiment: str = eqx.field(static=True)
    # The statement without sizes where they are many; of texts that stand beside a table of them.
    in_short: str = eqx.field(static=True, default="")
    # Posterior shares of the channels that may have it, `channels` first, where the data do not tell which one has.
    channel_odds: tuple[tuple[str, float], ...] = eqx.field(static=True, default=())


class Quality(eqx.Module):
    """How well a model fits."""

    rms: float = eqx.field(static=True)  # of the rows, m/s², rad/s, or rad after motions
    chi2_per_dof: float = eqx.field(static=True)  # under the fitted noise
    held_out_rms: float = eqx.field(static=True)  # on left-out stretches, in the same unit


class Moved(eqx.Module):
    """A parameter of the calibration that the omission had pulled."""

    name: str = eqx.field(static=True)  # such as accel.bias[1]
    before: float = eqx.field(static=True)  # SI
    after: float = eqx.field(static=True)  # SI
    std: float = eqx.field(static=True)  # SI, of `after`


class Diagnosis(eqx.Module):
    """Where a campaign departs from its model, what was left out, and how sure that is."""

    verdict: str = eqx.field(static=True)  # consistent | missing-physics | unexplained
    summary: str = eqx.field(static=True)  # one paragraph for a test engineer
    where: tuple[Where, ...] = ()  # stretches that depart from the model, most evidence first
    effects: tuple[Explanation, ...] = ()  # what was left out, most evidence first
    baseline: Quality | None = None  # the model as meant
    augmented: Quality | None = None  # with the effects
    # Names of effects that this campaign cannot show.
    not_testable: tuple[str, ...] = eqx.field(static=True, default=())
    parameters_moved: tuple[Moved, ...] = ()  # by the effects
    detectable: tuple[Detectable, ...] = ()  # smallest sizes that would have shown
    # A formula, where no catalogued effect explains it.
    empirical: str | None = eqx.field(static=True, default=None)
    # Named effects that the calibration was made without, and why.
    not_applied: tuple[str, ...] = eqx.field(static=True, default=())
    notes: tuple[str, ...] = eqx.field(static=True, default=())  # what a reader should know
    handling: tuple[Disturbance, ...] = ()  # stretches of rests that were not judged
    # Where it was known from, and the fitted noise beside Allan deviations
    noise: tuple[str, ...] = eqx.field(static=True, default=())
    # Channels whose fitted noise is not that within the longest rest, so that probabilities do not hold.
    noise_doubted: tuple[str, ...] = eqx.field(static=True, default=())
    plausibility: tuple[Finding, ...] = eqx.field(static=True, default=())  # errors only if forced
    audit: Audit | None = None  # of the campaign as a plan
    model: ModelSpec | None = eqx.field(static=True, default=None)  # that was judged
    residuals: tuple[Residuals, ...] = ()  # for figures; not part of the file
    estimate: DeviceResult | None = (
        None  # behind the calibration, for records; not part of the file
    )
    first: float = eqx.field(static=True, default=0.0)  # s, the recordings' clock at its first row
    # Where the campaign lies, seen from the file's folder, and its device; where both are files.
    campaign: tuple[str, str] | None = eqx.field(static=True, default=None)

    def as_dict(self) -> dict:
        """The fields of `diagnosis.json`."""
        made = {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "summary": self.summary,
            "model": None if self.model is None else self.model.document(),
            "where": [_fields(w) for w in self.where],
            "effects": [_explanation(e) for e in self.effects],
            "fit": {
                "baseline": None if self.baseline is None else _fields(self.baseline),
                "augmented": None if self.augmented is None else _fields(self.augmented),
            },
            "not_testable": list(self.not_testable),
            "parameters_moved": [_fields(m) for m in self.parameters_moved],
            "detectable": [d.as_dict() for d in self.detectable],
            "handling": [d.as_dict() for d in self.handling],
            "not_applied": list(self.not_applied),
            "notes": list(self.notes),
            "noise": list(self.noise),
            "noise_doubted": list(self.noise_doubted),
            "plausibility": [f.as_dict() for f in self.plausibility],
        }
        if self.audit is not None:
            made["audit"] = self.audit.as_dict()
        if self.empirical is not None:
            made["empirical"] = self.empirical
        if self.campaign is not None:
            made["campaign"], made["device"] = self.campaign
        return made

    def to_json(self) -> str:
        """The text of `diagnosis.json`."""
        return json.dumps(self.as_dict(), indent=2, ensure_ascii=False, allow_nan=False)

    def save(self, path: str | Path) -> None:
        """Write `diagnosis.json`, whole or not at all."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, (self.to_json() + "\n").encode())


def with_findings(found: Diagnosis, findings: tuple[Finding, ...]) -> Diagnosis:
    """The diagnosis with what is implausible in its data; the summary says so of warnings."""
    findings = without_settled_rests(findings, found.handling)
    said = statements(findings)
    summary = found.summary
    if said:
        more = f" (and {len(said) - 1} more, see notes)" if len(said) > 1 else ""
        summary = f"{summary} The data themselves are doubtful: {said[0]}{more}"
    return replace(found, summary=summary, notes=(*found.notes, *said), plausibility=findings)


def _fields(module: eqx.Module) -> dict:
    made = {k: getattr(module, k) for k in module.__dataclass_fields__}
    return {k: list(v) if isinstance(v, tuple) else v for k, v in made.items()}


def _explanation(effect: Explanation) -> dict:
    made = _fields(effect)
    del made["in_short"]
    made["parameters"] = {name: _fields(value) for name, value in effect.parameters}
    made["odds"] = dict(effect.odds)
    made["channel_odds"] = dict(effect.channel_odds)
    made["evidence"] = _fields(effect.evidence)
    return made
