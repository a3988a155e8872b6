"""The degree over temperature, chosen again beside what a diagnosis named.

An effect that the model lacks, such as lever arms of a centimetre on a rate table, is scatter to the criterion that
chose the degree, and curvature that is small beside it is not chosen. On outputs without the effect it is. A degree
that came out too high costs some variance and is kept; one too low leaves a bias that no uncertainty contains.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec

from .._jax import eqx
from ..calibrate.pipeline import calibrate_device
from ..data.recording import Campaign
from ..effects import Effect
from ..model_selection.model_spec import ModelSpec
from .candidates.signatures import Term
from .element_temperature import begun_at, Curves, curves_of
from .estimates.applied_effects import fitted_effects
from .estimates.augmented_calibration import Beside, without_effects
from .estimates.separable import refined
from .findings import Finding
from .late_elements import LAG, late_elements
from .noise.type_noise import TypeNoise
from .observations.log_outputs import with_outputs
from .observations.model_rows import calibrated
from .problem import prepare, Problem


# Drivers begin so of what a higher degree may explain instead, such as a loop that stands for curvature: it stays in
# the outputs. Not so a lag, which theory gives an amplitude: curvature has no reason to have that one.
BY_TEMPERATURE = "temperature"


@dataclass(frozen=True)
class Again:
    """A model with a higher degree for some triads, and the words for it."""

    problem: Problem  # whose model it replaces
    degrees: dict[str, int]  # by triad
    curves: dict[str, Curves]  # parameters that the effects have not bent, by triad
    sentences: tuple[str, ...]  # for the summary
    choices: tuple[str, ...]  # for the notes of a calibration

    def model(self) -> ModelSpec:
        """The model of the problem with these degrees."""
        changes = {
            triad: msgspec.structs.replace(
                getattr(self.problem.plain.model, triad), temperature_degree=degree
            )
            for triad, degree in self.degrees.items()
        }
        return msgspec.structs.replace(self.problem.plain.model, **changes)

    def prepared(
        self, campaign: Campaign, effects: Sequence[Effect], noise: TypeNoise | None
    ) -> Problem:
        """The campaign with these degrees and parameters to begin a search with."""
        problem = self.problem
        if self.degrees:
            problem = self.told(prepare(campaign, effects, noise=noise, model=self.model()))
        return begun_at(problem, self.curves)

    def told(self, problem: Problem) -> Problem:
        """A problem of this model, with the choices of the first one's calibration and the new ones."""
        old = tuple(f"{triad}: temperature degree" for triad in self.degrees)
        kept = (c for c in self.problem.plain.choices if not c.startswith(old))
        choices = (*kept, *self.choices)
        plain = replace(problem.plain, choices=choices)
        plain = eqx.tree_at(
            lambda p: p.calibration, plain, replace(plain.calibration, notes=choices)
        )
        return replace(problem, plain=plain)

    def kept(self, findings: Sequence[Finding]) -> dict[str, Finding]:
        """Findings that do not depend on the degrees that changed: of another triad, by its own reference."""
        return {
            f.prepared.form.triad: f
            for f in findings
            if f.prepared.form.triad not in self.degrees
            and f.prepared.form.by_reference
            and not f.prepared.motions
        }


def _leaves_the_degree(term: Term) -> bool:
    """Whether a named effect is taken away before the degree is chosen again."""
    effect = term.known
    return effect.unit_amplitude or not effect.driver.startswith(BY_TEMPERATURE)


def chosen_again(problem: Problem, findings: Sequence[Finding]) -> Again | None:
    """The higher degrees that BIC chooses on outputs without what was named; `None` where they stay.

    Only of triads whose degree the tool chose, and on which something was named that no curvature stands for.
    Where outputs without the effects cannot be calibrated, the degrees stay as well.
    """
    before, log = problem.plain.model, problem.log
    if log.temperature is None:
        return None
    chosen_by, names = dict(before.chosen_by), dict[str, str]()
    for finding in findings:
        prepared, triad = finding.prepared, finding.prepared.form.triad
        open_to = chosen_by.get(f"{triad}.temperature_degree") == "tool"
        if not open_to or finding.verdict != "missing-physics" or prepared.motions:
            continue
        noise = finding.answer.noise
        terms = [n.candidate.term for n in finding.answer.named]
        if not any(map(_leaves_the_degree, terms)):
            continue
        prepared, terms, _ = refined(prepared, noise, terms)
        pairs = fitted_effects(prepared, noise, terms)
        pairs = [(t, s) for t, s in pairs if _leaves_the_degree(t)]
        if pairs:
            taken = Beside(prepared, tuple(t for t, _ in pairs), tuple(s for _, s in pairs))
            log = without_effects(log, taken)
            names[triad] = ", ".join(dict.fromkeys(t.name for t, _ in pairs))
    if not names:
        return None
    try:
        found = calibrate_device(
            with_outputs(problem.campaign, log), checked=True, segments=problem.plain.segments
        )
    except ValueError:
        return None
    curves = dict[str, Curves]()
    for triad in names:
        model = calibrated(found, triad)
        if model is not None:
            curves[triad] = curves_of(model)
    return _raised(problem, curves, names)


def beside_late_elements(problem: Problem) -> Again | None:
    """The degrees and parameters beside a strong lag, where dwells tell one; `None` where they do not."""
    curves = late_elements(problem)
    if not curves:
        return None
    names = dict.fromkeys(curves, LAG.name)
    return _raised(problem, curves, names) or Again(problem, {}, curves, (), ())


def borne_out(again: Again, findings: Sequence[Finding]) -> bool:
    """Whether the search names the lag that it was begun at, on every triad that was begun so."""
    named = {
        f.prepared.form.triad
        for f in findings
        for n in f.answer.named
        if n.candidate.term.name == LAG.name
    }
    return named.issuperset(again.curves)


def _raised(problem: Problem, curves: dict[str, Curves], names: Mapping[str, str]) -> Again | None:
    """The model with the higher degrees among these; `None` where there are none."""
    degrees, sentences, choices = {}, [], []
    for triad, beside in names.items():
        if triad not in curves:
            continue
        old, new = getattr(problem.plain.model, triad).temperature_degree, curves[triad].degree
        if new <= old:
            continue
        degrees[triad] = new
        whose = "accelerometers" if triad == "accel" else "gyros"
        sentences.append(
            f"The temperature degree of the {whose} was chosen again beside {beside}: {new} instead of {old}."
        )
        choices.append(f"{triad}: temperature degree {new} by BIC beside {beside}, {old} without")
    if not degrees:
        return None
    return Again(problem, degrees, curves, tuple(sentences), tuple(choices))
