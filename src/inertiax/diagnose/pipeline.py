"""The whole diagnosis of a campaign: gate, locate, name, check, quantify, prove, say."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from jaxtyping import Float

from .._jax import Array, jax
from .._typing import AnyArray
from ..calibrate.results import DeviceResult
from ..calibration.calibration import Calibration, read_calibration, write_calibration
from ..data.campaign import load_campaign
from ..data.recording import Campaign, Recording, Site
from ..effects import CATALOGUE, Effect, Signal
from ..numerics.blas_threads import one_blas_thread
from ..plausibility import require_plausible
from ..reduction.handling import (
    Disturbance,
    held_sentence,
    kept_sentence,
    left_out_sentence,
    with_force_counted,
)
from ..reduction.rounded_temperature import with_courses, with_rounding
from .candidates.empirical import PREFIX
from .candidates.signatures import Term
from .contradicted_gyros import contradicted, unnamed, with_contradiction
from .custom_model import Parameters, prepare_model
from .degree_beside import beside_late_elements, borne_out, chosen_again
from .estimates.allan_check import allan_checks
from .estimates.augmented_calibration import augmented_calibration, Beside
from .estimates.calibration_chain import succeeding, taken_away
from .estimates.channels_by_motions import told_by_motions
from .estimates.cross_validation import held_out_rms, in_sample
from .estimates.localisation import locate, tidy
from .estimates.moved_parameters import moved_between
from .estimates.parameters import moved
from .estimates.transients import burst_places
from .estimates.tuned_names import tuned
from .estimates.withheld_effects import with_likely_applied, withheld_sentence
from .findings import find, find_all, find_in_motions, Finding, Progress, silent
from .noise.pooled_channels import TOLD
from .noise.reml import interval_noise
from .noise.type_noise import TypeNoise
from .partial_lag import with_part_late
from .plan.detectability import Audited, conclude
from .plan.limits import smallest
from .problem import prepare, Prepared, Problem
from .problem_of_motions import prepared_motions
from .residuals import residuals
from .result import Diagnosis, Quality, with_findings
from .selection.score_test import whiten_system
from .selection.verdict import Answer, Named
from .turned_mount import turned, with_turn, with_unheld, without_turned
from .wording.delay_report import explain_delay, ramp_places, stored, with_delays
from .wording.explain import explain, formula
from .wording.line_report import (
    explain_lines,
    line_places,
    stored_lines,
    untouched_sentences,
    with_lines,
)
from .wording.noise_doubt import doubted, noise_sentence
from .wording.scatter import model_scatter_sentence, scatter_sentence
from .wording.sentences import summary, untested_sentence
from .wording.untold_channels import not_applied


DEFAULT_SITE = Site()


@one_blas_thread()
def diagnose_campaign(
    campaign: Campaign,
    *,
    calibration: Calibration | None = None,
    effects: Sequence[Effect] = CATALOGUE,
    noise: TypeNoise | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> tuple[Diagnosis, Calibration]:
    """`diagnose` together with the calibration of the augmented model.

    `force` goes on where a plausibility check finds an error; else that raises `ValueError`.
    """
    found_odd = require_plausible(campaign, force=force)
    rig = with_rounding(campaign.rig, campaign.recordings)
    campaign = replace(campaign, recordings=with_courses(campaign.recordings), rig=rig)
    # Restricted likelihoods differ in the tenth digit; the precision is local to this call.
    with jax.enable_x64(True):
        seen = campaign if calibration is None else taken_away(campaign, calibration, effects)
        problem = prepare(seen, effects, noise=noise)
        progress("calibration, blocks and signatures made")
        again, findings = beside_late_elements(problem), None
        if again is not None:
            late = again.prepared(seen, effects, noise)
            findings = _find(late, effects, campaign.grade, progress)
            if borne_out(again, findings):
                problem = late
            else:
                again, findings = None, None
        findings = findings or _find(problem, effects, campaign.grade, progress)
        further = chosen_again(problem, findings)
        if further is not None:
            progress(" ".join(further.sentences))
            problem = further.prepared(seen, effects, noise)
            kept = further.kept(findings)
            findings = _find(problem, effects, campaign.grade, progress, kept)
        findings = [
            replace(f, answer=told_by_motions(problem, f.prepared, f.answer)) for f in findings
        ]
        sentences = tuple(s for a in (again, further) if a is not None for s in a.sentences)
        against = contradicted(problem.plain)
        slipped = turned(found_odd)
        findings = without_turned(unnamed(findings, against), slipped)
        found, named = conclude_findings(findings, effects, progress)
        found = with_contradiction(found, against, seen)
        found = with_turn(found, slipped, findings, seen)
        if sentences:
            said = " ".join((found.summary, *sentences))
            found = replace(found, summary=said, notes=(*found.notes, *sentences))
        if noise is not None:
            found = replace(found, noise=(noise.origin(), *found.noise))
        found = with_findings(replace(found, model=problem.plain.model), found_odd)
        found, second = _calibrated(problem, found, findings, named)
        return found, second if calibration is None else succeeding(calibration, second)


def _find(
    problem: Problem,
    effects: Sequence[Effect],
    grade: str | None,
    progress: Progress,
    kept: Mapping[str, Finding] = MappingProxyType({}),
) -> list[Finding]:
    """What the rows of each triad say, those of the gyros' motions between rests included."""
    findings = find_all(problem.triads, grade, progress, kept)
    motions = prepared_motions(problem, effects)
    if motions is not None:
        progress("gyro: motions between rests")
        findings.append(find_in_motions(motions, grade, progress))
    return findings


def _calibrated(
    problem: Problem, found: Diagnosis, findings: Sequence[Finding], named: Sequence[Beside]
) -> tuple[Diagnosis, Calibration]:
    """The diagnosis with the calibration that belongs to it: of the augmented model where effects were named and
    nothing is left unexplained, else as it was before."""
    plain = problem.plain.calibration
    found = replace(found, estimate=problem.plain)
    if found.verdict == "consistent":
        unheld = with_unheld(found, problem.plain, findings, problem.campaign)
        return (_with_scatter(found, problem.plain) if unheld is found else unheld), plain
    if found.verdict != "missing-physics":
        return with_part_late(found, problem), plain
    found = with_part_late(found, problem, named)
    named = [with_likely_applied(one, plain) for one in named]
    log = problem.log
    delays = [f.delay for f in findings if f.delay is not None]
    forms = {f.prepared.form.triad: f.prepared.form for f in findings}
    further = [e for d in delays for e in stored(d, log, forms[d.triad])]
    further += [e for p in problem.triads for e in stored_lines(p.lines, log, p.form)]
    left = [text for text in map(not_applied, found.effects) if text]
    left += [withheld_sentence(n) for one in named for n in one.withheld]
    found = replace(found, not_applied=tuple(left))
    fitted = {(s.name, c) for one in named for s in one.stored for c in s.channel_names}
    for e in found.effects:
        channels = [c for c in e.channels if (e.name, c) in fitted]
        if channels:
            left.append(f"Fitted beside {e.name} on {', '.join(channels)}: {e.in_short}")
    try:
        beside, estimate = augmented_calibration(problem, named, further, left)
    except ValueError as error:
        why = f"calibration.json is that of the plain model, since beside the named effects {error}"
        return replace(found, notes=(*found.notes, why)), plain
    pulled = moved_between(plain, beside)
    found = replace(found, estimate=estimate, parameters_moved=pulled)
    return _with_scatter(found, estimate), beside


def _with_scatter(found: Diagnosis, result: DeviceResult) -> Diagnosis:
    """The diagnosis with what dwells still differ by, where that is far more than their noise."""
    return replace(
        found, summary=" ".join(s for s in (found.summary, scatter_sentence(result)) if s)
    )


def diagnose(
    campaign: Campaign,
    *,
    calibration: Calibration | None = None,
    effects: Sequence[Effect] = CATALOGUE,
    noise: TypeNoise | None = None,
    progress: Progress = silent,
) -> Diagnosis:
    """Say what a one-device campaign holds beyond its model, or that nothing is missing.

    **Arguments:** `campaign` with `[model]` (or the tool's choice) as the model meant; `calibration` takes
    known parameters away first, so that only what it leaves is judged; `effects` is the catalogue; `noise` is
    what other units of the type told of the noise (`learn_noise`).
    **Returns** a `Diagnosis`. Raises `ValueError` for several devices, for a campaign without rests
    and plateaus, or for a noise of other rows or another rig.
    """
    return diagnose_campaign(
        campaign, calibration=calibration, effects=effects, noise=noise, progress=progress
    )[0]


@one_blas_thread()
def diagnose_model(
    predict: Callable[[Parameters, Signal], Float[Array, "time 3"]],
    parameters: Parameters,
    recording: Recording,
    catalogue: Sequence[Effect] = CATALOGUE,
    *,
    triad: str,
    inputs: Float[AnyArray, "time 3"] | None = None,
    site: Site = DEFAULT_SITE,
    grade: str | None = None,
    progress: Progress = silent,
) -> Diagnosis:
    """Diagnose any differentiable model of one triad's outputs.

    **Arguments:** `predict(parameters, signal)` gives the expected outputs, `(time, 3)` in m/s² or rad/s, from a
    `Signal` (times, temperature, inputs...); `parameters` is a pytree fitted beforehand, and what its Jacobian
    spans counts as absorbed by a refit; `inputs` (time, 3) is what an ideal triad reads, m/s² or rad/s, where
    the recording has no reference columns; plateaus of constant rate need one of both.
    **Returns** a `Diagnosis`; its `parameters_moved` lists flat parameters by number. Its `verdict` is `unexplained`,
    too, where dwells differ alike each time an input comes again, in a way that nothing in the catalogue follows;
    where they differ by far more than their noise and no such thing shows, its `summary` says so.
    Raises `ValueError` where the recording lacks the triad.
    """
    with jax.enable_x64(True):
        campaign = Campaign((recording,), site, grade=grade)
        prepared = prepare_model(
            predict, parameters, campaign, catalogue, triad=triad, inputs=inputs
        )
        finding = find(prepared, grade, progress)
        found = conclude_findings([finding], catalogue, progress)[0]
        if found.verdict == "unexplained":  # its formula describes what dwells differ by
            return found
        judged = finding.prepared
        scatter = model_scatter_sentence(judged.system, judged.blocks, finding.answer.noise)
        return replace(found, summary=" ".join(s for s in (found.summary, scatter) if s))


def run_diagnosis(
    campaign_path: str | Path,
    output_folder: str | Path,
    calibration_path: str | Path | None = None,
    progress: Progress = silent,
) -> Diagnosis:
    """Diagnose the campaign at a path and write `diagnosis.json` and the augmented `calibration.json`."""
    campaign = load_campaign(Path(campaign_path))
    known = None if calibration_path is None else read_calibration(Path(calibration_path))
    progress("campaign read")
    diagnosis, augmented = diagnose_campaign(campaign, calibration=known, progress=progress)
    folder = Path(output_folder)
    diagnosis.save(folder / "diagnosis.json")
    write_calibration(augmented, folder / "calibration.json")
    return diagnosis


def conclude_findings(
    findings: Sequence[Finding], effects: Sequence[Effect], progress: Progress
) -> tuple[Diagnosis, list[Beside]]:
    """Quantify, prove and say: the diagnosis of all triads, and what is named on each."""
    verdicts = [f.verdict for f in findings]
    verdict = next((v for v in ("unexplained", "missing-physics") if v in verdicts), "consistent")
    explanations, where, shifted, empirical = [], [], [], []
    beside, qualities, rows, noise, every_check = [], [], [], [], []
    notes: list[str] = []
    for finding in findings:
        prepared, answer = finding.prepared, finding.answer
        found = [n.candidate.term for n in answer.named]
        stated = interval_noise(prepared.system, answer.noise, _everything(answer, found))
        prepared, named_terms = tuned(prepared, answer, stated)
        terms = [t for _, t, _ in named_terms]
        explained = _apart_from_unlisted(answer, named_terms)
        if explained:
            explanations.extend(explain(prepared, answer, explained, stated))
        if answer.named and answer.verdict != "unexplained":
            shifted.extend(moved(prepared.system, stated, terms))
        if finding.delay is not None and finding.verdict != "unexplained":
            assert prepared.log is not None
            explanations.append(explain_delay(finding.delay))
            where.extend(ramp_places(finding.delay, prepared.log))
        if prepared.lines and finding.verdict != "unexplained":
            assert prepared.log is not None
            explanations.append(explain_lines(prepared.lines, float(prepared.clock[0])))
            where.extend(line_places(prepared.lines, prepared.log))
        notes.extend(untouched_sentences(prepared.sought))
        for named, _, _ in named_terms:
            where.extend(locate(prepared, named.candidate, 0.0, named.p_value))
        if answer.unlisted is not None and answer.verdict == "unexplained":
            where.extend(locate(prepared, answer.unlisted, 0.0, answer.unlisted_p))
            empirical.append(formula(answer.unlisted))
        for burst in finding.bursts:
            places = burst_places(prepared, burst)
            where.extend(places)
            empirical.append(burst.formula(places[0].start, places[-1].end, prepared.clock[0]))
        qualities.append((finding, *_quality(prepared, answer, terms)))
        if answer.verdict != "unexplained":
            beside.append(Beside.of(prepared, stated, named_terms))
        rows.append(residuals(prepared, _everything(answer, terms), stated))
        if answer.alike:
            noise.append(TOLD.format(triad=prepared.form.triad))
        noise.extend(finding.remarks)
        checks = allan_checks(prepared, answer.noise, _everything(answer, terms))
        noise.extend(check.line() for check in checks)
        every_check.extend(checks)
        progress(f"{prepared.form.triad}: proved on held-out data")
    explanations.sort(key=lambda e: -e.evidence.delta_bic)
    chosen = max(qualities, key=lambda q: q[1].chi2_per_dof)
    plan = conclude([_audited(f) for f in findings], effects)
    plan = with_delays(plan, [f.prepared.delay for f in findings if f.prepared.delay is not None])
    plan = with_lines(plan, [f.prepared.sought for f in findings if f.prepared.sought is not None])
    forms = [f.prepared.form for f in findings if not f.prepared.motions]
    said = summary(verdict, explanations, where, empirical, forms)
    handling = _handling(findings)
    doubtful = doubted(every_check)
    sentences = (
        said,
        untested_sentence([(f.prepared.form, f.prepared.blocks) for f in findings]),
        noise_sentence(doubtful),
        left_out_sentence(handling),
        kept_sentence(handling),
        held_sentence(handling),
    )
    diagnosis = Diagnosis(
        verdict=verdict,
        summary=" ".join(s for s in sentences if s),
        where=tidy(where),
        effects=tuple(explanations),
        baseline=chosen[1],
        augmented=chosen[2],
        not_testable=tuple(name for name, _ in plan.not_testable),
        parameters_moved=tuple(shifted),
        detectable=smallest(plan.detectable) if verdict == "consistent" else (),
        empirical="; ".join(empirical) or None,
        notes=(*(f"{name}: {why}" for name, why in plan.not_testable), *notes),
        handling=handling,
        noise=tuple(noise),
        noise_doubted=tuple(c.channel for c in doubtful),
        audit=plan,
        residuals=tuple(rows),
        first=float(findings[0].prepared.clock[0]),
    )
    return diagnosis, beside


def _apart_from_unlisted(
    answer: Answer, named: list[tuple[Named, Term, float | None]]
) -> list[tuple[Named, Term, float | None]]:
    """The names on channels that no unlisted dependence acts on: what is not known of one channel takes no name from
    another."""
    if answer.verdict != "unexplained" or answer.unlisted is None:
        return named
    unlisted = set(answer.unlisted.term.chains)
    return [one for one in named if unlisted.isdisjoint(one[1].chains)]


def _quality(prepared: Prepared, answer: Answer, terms: list) -> tuple[Quality, Quality]:
    extra = _everything(answer, terms)
    made = []
    for chosen in ([], extra):
        rms, chi2 = in_sample(prepared, answer.noise, chosen)
        made.append(Quality(rms, chi2, held_out_rms(prepared, chosen)))
    return made[0], made[1]


def _handling(findings: Sequence[Finding]) -> tuple[Disturbance, ...]:
    """What was left out of the rests: of all triads alike, and the rests that stood out alone in one."""
    logs = [f.prepared.log for f in findings if f.prepared.log is not None]
    common = logs[0].segments.disturbances if logs else ()
    common = with_force_counted(common, any(f.prepared.form.by_magnitude for f in findings))
    return (*common, *dict.fromkeys(d for f in findings for d in f.left_out))


def _everything(answer: Answer, terms: list) -> list:
    """The named terms, and the best unlisted one where something is unexplained."""
    if answer.verdict == "unexplained" and answer.unlisted is not None:
        return [*terms, answer.unlisted.term]
    return list(terms)


def _audited(finding: Finding) -> Audited:
    """The catalogue under the noise that is left beside what was found."""
    prepared, answer = finding.prepared, finding.answer
    scores = finding.scores
    if answer.named:
        listed = [t for t in prepared.candidates if not t.name.startswith(PREFIX)]
        scores = whiten_system(prepared.system, answer.noise, listed).scores
    return Audited(prepared, scores, answer.tests, answer.noise)
