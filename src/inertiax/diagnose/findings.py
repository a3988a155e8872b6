"""What the rows of each triad say: named effects, short disturbances, and single rests that are left out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from ..numerics.forked_work import can_fork, ForkedWork
from ..reduction.handling import Disturbance
from .candidates.empirical import PREFIX
from .candidates.signatures import Term
from .estimates import single_rests
from .estimates.like_components import one_of_like_components
from .estimates.persistence import lowers_rms, persists, predicts
from .estimates.predicted_rivals import led_by, named_instead, with_predicted_rivals
from .estimates.separable import renewed
from .estimates.transients import Burst, find_bursts, swallows
from .noise.reml import fit_noise
from .observations.delay_ramps import Delay
from .problem import between_all, finer, Prepared
from .selection.forward import STILL
from .selection.score_test import Score, whiten_system
from .selection.verdict import Answer, identify, Named
from .wording.explain import formula


Progress = Callable[[str], None]
MOST_PASSES = 4  # over a triad's rows, each without more of the rests that stood out alone


def silent(text: str) -> None:
    """No progress wanted."""


@dataclass(frozen=True, eq=False)
class Finding:
    """One triad with its answer."""

    prepared: Prepared
    answer: Answer
    scores: tuple[Score, ...]  # of the catalogue under the null noise
    bursts: tuple[Burst, ...]  # where nothing smooth explains the triad's rows
    left_out: tuple[Disturbance, ...] = ()  # rests that stood out alone
    remarks: tuple[str, ...] = ()  # on the noise that the rows were judged with

    @property
    def verdict(self) -> str:
        """Of the triad: a short disturbance alone is something that no catalogued effect explains."""
        consistent = self.answer.verdict == "consistent"
        if consistent and self.bursts:
            return "unexplained"
        further = self.delay is not None or self.prepared.lines
        return "missing-physics" if consistent and further else self.answer.verdict

    @property
    def delay(self) -> Delay | None:
        """The delay that the ramps between plateaus show, if there is one."""
        delay = self.prepared.delay
        return delay if delay is not None and delay.found else None


def find_all(
    triads: Sequence[Prepared],
    grade: str | None,
    progress: Progress,
    kept: Mapping[str, Finding] = MappingProxyType({}),
) -> list[Finding]:
    """Every triad's finding; what one remembers of temperature is looked for on the next.

    A hand that disturbs a rest holds both triads: what one finds beside rests that the other left out, it is asked
    again without them. `kept` are findings of triads that are known already.
    """
    made: list[Finding] = []
    aside = _begun_aside(triads, grade, kept)
    try:
        for prepared in triads:
            hint = made[-1].answer.remembered if made else None
            found = kept.get(prepared.form.triad)
            if found is None and prepared is triads[-1] and aside is not None and hint is None:
                found = aside.result(progress)
            made.append(find(prepared, grade, progress, hint) if found is None else found)
    finally:
        if aside is not None:
            aside.end()
    for k, (prepared, found) in enumerate(zip(triads, made, strict=True)):
        others = [d for j, other in enumerate(made) if j != k for d in other.left_out]
        touched = single_rests.within(prepared, others)
        if (
            prepared.form.triad in kept
            or found.verdict == "consistent"
            or prepared.only is None
            or not single_rests.few(touched)
        ):
            continue
        progress(
            f"{prepared.form.triad}: again without the rests that stand out in the other triad"
        )
        again = find(prepared.only(~touched), grade, progress, found.answer.remembered)
        made[k] = replace(again, left_out=(*others, *again.left_out))
    return made


def _begun_aside(
    triads: Sequence[Prepared], grade: str | None, kept: Mapping[str, Finding]
) -> ForkedWork[Finding] | None:
    """The last triad's finding, looked for by a twin of this process while it looks for the first one's.

    Not in a log whose rests were searched: rests that are left out make rows anew, which no message holds.
    """
    last = triads[-1]
    alone = len(triads) < 2 or any(p.form.triad in kept for p in triads)
    if alone or single_rests.searched(last) or not can_fork():
        return None
    known = [last, last.system, *last.candidates, *last.flexible]
    known += dict.fromkeys(t.effect for t in known[2:] if t.effect is not None)
    return ForkedWork(lambda say: find(last, grade, say), known)


def find(
    prepared: Prepared, grade: str | None, progress: Progress, hint: str | None = None
) -> Finding:
    """Gate, locate and name for one triad; `hint` is a thermal effect that another triad has shown.

    In a log whose rests were searched, no name stays that raises the rms of data left out. What was left out beside it
    stays so: a name that goes earlier would decide which rests the others are asked with.
    """
    made = _without_single_rests(prepared, grade, progress, hint)
    return _as_stated(made) if single_rests.searched(prepared) else made


def _as_stated(made: Finding) -> Finding:
    """The finding without names that raise the rms of data left out, one after another from the last.

    A rival that the rows do not exclude either takes such a name's place where it lowers that rms. What was named
    beside one that goes must be rare without it, too.
    """
    prepared, kept = made.prepared, list(made.answer.named)
    if made.answer.verdict != "missing-physics":
        return made

    def stands(named: Named, others: list[Term]) -> bool:
        lowers = lowers_rms(prepared, named.candidate.term, others)
        return lowers and (len(kept) == len(made.answer.named) or _rare(made, named, others))

    came: list[Named] = []  # in another's place; not left for a third, so that this comes to an end

    def instead(named: Named, others: list[Term]) -> list[Named]:
        tests = made.answer.tests
        rare = (r for r in named.rivals if tests.p_value(r) < STILL)
        again = (led_by(r, named, tests.p_value(r)) for r in rare if named not in came)
        return [n for n in again if stands(n, others)][:1]

    place = len(kept) - 1
    while place >= 0:
        others = [n.candidate.term for k, n in enumerate(kept) if k != place]
        if stands(kept[place], others):
            place -= 1
            continue
        found = instead(kept[place], others)
        came += found
        kept[place : place + 1] = found
        place = len(kept) - 1
    return _with_names(made, kept)


def _as_at_first(made: Finding, first: Finding) -> Finding:
    """The finding with the names that it had before rests were left out, where those that stay are no cleaner."""
    if made is first:
        return made
    if first.answer.verdict == "consistent":
        return first
    before = {n.candidate.key for n in first.answer.named}
    return _with_names(made, [n for n in made.answer.named if n.candidate.key in before])


def _with_names(made: Finding, kept: list[Named]) -> Finding:
    """The finding with some of its names, under the noise that is fitted beside those."""
    terms = [n.candidate.term for n in kept]
    same = terms == [n.candidate.term for n in made.answer.named]
    if same or made.answer.verdict != "missing-physics":
        return made
    noise = fit_noise(made.prepared.system, terms) if kept else made.answer.null_noise
    verdict = "missing-physics" if kept else "consistent"
    return replace(
        made, answer=replace(made.answer, named=tuple(kept), noise=noise, verdict=verdict)
    )


def _rare(made: Finding, named: Named, others: list[Term]) -> bool:
    """Whether a name is no chance beside others, under the noise that is fitted without it."""
    noise = fit_noise(made.prepared.system, others)
    scores = whiten_system(made.prepared.system, noise, [named.candidate.term], others).scores
    again = [replace(named.candidate, score=s, ratio=s.gain) for s in scores]
    return bool(again) and made.answer.tests.p_value(again[0]) < STILL


def _without_single_rests(
    prepared: Prepared, grade: str | None, progress: Progress, hint: str | None
) -> Finding:
    """The finding without what single rests show alone.

    What single rests of a searched log show alone is left out, and the others are asked again. That something shook
    in one of them is never a reason to call it unexplained.
    """
    made, bursts = find_once(prepared, grade, progress, hint)
    if not single_rests.searched(prepared):
        return made
    if prepared.only is None:
        return replace(made, bursts=())
    first, kept = made, np.ones(prepared.blocks.num_blocks, bool)
    for _ in range(MOST_PASSES):
        now, before = made.prepared, kept.copy()
        marked = single_rests.alone_in_one_rest(now, made.answer.noise, _asked(made.answer))
        marked |= single_rests.disturbed(now, bursts)
        kept[np.flatnonzero(kept)[marked]] = False
        if not marked.any():
            break
        if not single_rests.few(~kept):
            kept = before  # further ones are no exceptions any more
            made = _as_at_first(made, first)
            break
        progress(f"{now.form.triad}: again without what single rests show alone")
        made, bursts = find_once(prepared.only(kept), grade, progress, hint)
    return replace(made, bursts=(), left_out=single_rests.left_out(prepared, ~kept))


def _asked(answer: Answer) -> list[Term]:
    """What was named, and the unlisted dependence where there is one."""
    unlisted = [] if answer.unlisted is None else [answer.unlisted.term]
    return [*(n.candidate.term for n in answer.named), *unlisted]


def find_in_motions(prepared: Prepared, grade: str | None, progress: Progress) -> Finding:
    """What the gyros' motions between rests show.

    Nobody vouches for a hand's motion: what no catalogued effect explains is scatter, as the calibration has it, and a
    motion that stands out alone is left out. Both are said.
    """
    found = find(prepared, grade, progress)
    remarks = []
    if found.left_out:
        number = len(found.left_out)
        remarks.append(
            f"gyros: {number} of the motions between rests left out: what they show, no other one does."
        )
    answer = found.answer
    if answer.verdict == "unexplained":
        assert answer.unlisted is not None  # which is why
        remarks.append(
            "gyros: what the motions between rests show beyond the model goes best with "
            f"{formula(answer.unlisted)}, which is no catalogued effect; it counts as their scatter."
        )
        answer = replace(answer, verdict="consistent", named=(), unlisted=None)
        answer = replace(answer, noise=answer.null_noise)
    return replace(found, answer=answer, bursts=(), left_out=(), remarks=tuple(remarks))


def find_once(
    prepared: Prepared, grade: str | None, progress: Progress, hint: str | None = None
) -> tuple[Finding, list[Burst]]:
    """The finding of all rows as they are, and every short disturbance that is no named jump's."""
    triad = prepared.form.triad
    listed = [t for t in prepared.candidates if not t.name.startswith(PREFIX)]
    unlisted = [t for t in prepared.candidates if t.name.startswith(PREFIX)]
    answer = identify(
        prepared.system,
        listed,
        unlisted,
        prepared.flexible,
        grade=grade,
        hint=hint,
        finer=lambda term: finer(prepared, term),
        between_all=lambda term: between_all(prepared, term),
        renew=lambda noise, terms: renewed(prepared, noise, terms),
        say=lambda text: progress(f"{triad}: {text}"),
    )
    outputs = np.asarray(prepared.signal.output)
    chosen = [n.candidate.term for n in answer.named]
    every: list[Burst] = []
    if answer.verdict != "unexplained":
        every = find_bursts(prepared, outputs, answer.noise, chosen)
    bursts = every
    if answer.verdict == "missing-physics":
        bursts = [b for b in bursts if any(swallows(prepared, b, t) for t in chosen)]
        kept = tuple(
            n
            for n in answer.named
            if not any(swallows(prepared, b, n.candidate.term) for b in bursts)
        )
        answer = replace(answer, named=kept, verdict=answer.verdict if kept else "consistent")
    answer = one_of_like_components(prepared, answer)
    searched = single_rests.searched(prepared)
    answer = _persistent(prepared, _catalogued(prepared, answer) if searched else answer)
    if searched:
        answer = replace(answer, named=_with_rivals(prepared, answer.named))
    return Finding(prepared, answer, answer.listed_scores, tuple(bursts[:1])), every


def _catalogued(prepared: Prepared, answer: Answer) -> Answer:
    """The answer with a name in place of an unlisted dependence that predicts rests left out no better."""
    if answer.verdict != "unexplained" or answer.unlisted is None:
        return answer
    chosen = [n.candidate.term for n in answer.named]
    found = named_instead(prepared, answer.unlisted, answer.instead, chosen)
    if found is None:
        return answer
    noise = fit_noise(prepared.system, [*chosen, found.candidate.term])
    named = (*answer.named, found)
    return replace(answer, named=named, unlisted=None, noise=noise, verdict="missing-physics")


def _with_rivals(prepared: Prepared, named: Sequence[Named]) -> tuple[Named, ...]:
    """Each name with what rests left out do not exclude, beside the other names."""
    terms = [n.candidate.term for n in named]
    return tuple(
        with_predicted_rivals(prepared, n, terms[:k] + terms[k + 1 :]) for k, n in enumerate(named)
    )


def _persistent(prepared: Prepared, answer: Answer) -> Answer:
    """The answer without what does not persist: jumps, and in searched logs whatever predicts no rest left out.

    A dependence with many coefficients fits the levels of few rests, which nobody vouches for; on those that it was not
    fitted to it is worse than none.
    """
    searched = single_rests.searched(prepared)

    def lasts(term: Term, others: list[Term]) -> bool:
        return persists(prepared, term, others) and (
            not searched or predicts(prepared, term, others)
        )

    terms = [n.candidate.term for n in answer.named]
    kept = tuple(
        n for k, n in enumerate(answer.named) if lasts(terms[k], terms[:k] + terms[k + 1 :])
    )
    unlisted = answer.unlisted
    if unlisted is not None and not lasts(unlisted.term, [n.candidate.term for n in kept]):
        unlisted = None
    if len(kept) == len(answer.named) and unlisted is answer.unlisted:
        return answer
    if unlisted is not None and answer.verdict == "unexplained":
        return replace(answer, named=kept)
    verdict = "missing-physics" if kept else "consistent"
    return replace(answer, named=kept, unlisted=unlisted, verdict=verdict)
