"""From candidates to an answer for one triad: gate, name, open-set check."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..candidates.empirical import PREFIX
from ..candidates.repeated_inputs import NAME as LEVELS
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit, System
from ..noise.pooled_channels import alike
from ..noise.reml import fit_noise
from .candidate_screening import finer_forms, leaders, rank, screen, sharpen
from .constraints import barred, holds
from .evidence import bank, Candidate, count_forms, judge
from .forward import Asked, Found, STILL
from .lack_of_fit import left_over, LeftOver
from .multiple_testing import Family, family, Key
from .score_test import Score
from .thermal import remember, Remembered


SAME = 6.0  # difference of BIC within which names stay in the set
NEAR = 60.0  # the same within which they may be asked what they predict, where the noise's form is not to be trusted
OWN = 8  # forms of a chosen effect among which the likeliest rare one is sought at the end


@dataclass(frozen=True, eq=False)
class Named:
    """A chosen term, its significance, and the rivals that the data cannot exclude."""

    candidate: Candidate
    p_value: float
    rivals: tuple[Candidate, ...]
    near: tuple[
        Candidate, ...
    ] = ()  # and further names, by falling evidence, that a Gaussian noise excludes
    # The same name on other channels, best first, where rows of |f| do not tell which one has it.
    elsewhere: tuple[Candidate, ...] = ()

    @property
    def odds_of_channels(self) -> Float[np.ndarray, " reading"]:
        """The chance that the name's own channels have it, and of each of the others that are left."""
        evidence = np.array([c.evidence for c in (self.candidate, *self.elsewhere)])
        weights = np.exp(evidence - evidence.max())
        return weights / weights.sum()

    @property
    def odds(self) -> Float[np.ndarray, " name"]:
        """The chance of this name and of each rival, with those that are left out as if all names were known.

        They add up to less than 1 where further names are unlikely and not impossible.
        """
        evidence = np.array([c.evidence for c in (self.candidate, *self.rivals, *self.near)])
        weights = np.exp(evidence - evidence.max())
        return (weights / weights.sum())[: 1 + len(self.rivals)]


@dataclass(frozen=True, eq=False)
class Answer:
    """What the rows of one triad say."""

    verdict: str
    named: tuple[Named, ...]
    unlisted: Candidate | None
    unlisted_p: float
    noise: NoiseFit  # with the chosen terms in the mean
    null_noise: NoiseFit
    p_value: float  # of the gate
    tests: Family  # effective numbers of independent tests
    candidates: tuple[Term, ...]  # a short list
    ranked: tuple[Candidate, ...]  # of the first step
    listed_scores: tuple[Score, ...]  # of the catalogue under the null noise
    remembered: str | None  # effect chosen by prediction, to be looked for on the other triad
    alike: bool  # whether the channels told each other's noise when the last effect was looked for
    # Names of the catalogue on the rows of the unlisted dependence that are no chance either, by falling evidence.
    instead: tuple[Named, ...] = ()


def identify(
    system: System,
    catalogue: Sequence[Term],
    alternatives: Sequence[Term],
    flexible: Sequence[Term] = (),
    *,
    grade: str | None,
    hint: str | None = None,
    finer: Callable[[Term], list[Term]] = lambda term: [],
    between_all: Callable[[Term], list[Term]] = lambda term: [],
    renew: Callable[[NoiseFit, list[Term]], list[Term]] = lambda noise, chosen: chosen,
    say: Callable[[str], None] = lambda text: None,
) -> Answer:
    """Gate, name and check one triad's rows.

    **Arguments:** `finer` gives the forms beside one that was taken from a grid, `between_all` those between all points
    of that grid. `renew` makes signatures of chosen terms anew where they hold the model's own parameters.
    """
    everything = [*catalogue, *alternatives]
    forms = count_forms(everything)
    alone, own = system, fit_noise(system)
    system = alike(alone, own)
    null = own if system is alone else fit_noise(system)
    say("noise fitted")
    start, ranked, slow, short = screen(system, null, everything, forms, grade)
    short = [*short, *finer_forms(ranked, slow, finer)]
    scores = [c.score for c in ranked]
    tests = family(scores, [len(y) for y in system.base.observed])
    say(f"{len(everything)} candidates screened, {tests.total:.0f} independent tests")
    hidden = leaders(slow, 3, 1)
    scores = [s for s in scores if s.term.effect is not None]
    fuller, ranked = rank(system, [null], short, [], forms, grade, hidden)
    nearer = sharpen(system, fuller, ranked, everything, finer, forms, grade)
    if nearer:
        short = [*short, *nearer]
        fuller, ranked = rank(system, fuller.fits, short, [], forms, grade)
    first = ranked
    ask = Asked(
        alone,
        system,
        tuple(everything),
        list(short),
        forms,
        grade,
        tests,
        null,
        between_all,
        renew,
        say,
    )
    gate = ask.chance(min(ranked[:10], key=tests.p_value))
    found = ask.search([], fuller, ranked, None)
    # What all channels of a package do together is no noise that they tell each other of.
    memory = remember(alone, own, catalogue, [c.term for c in found.chosen], hint)
    if memory is not None:
        say(f"{memory.chosen[0].term.name} predicts stretches left out")
        terms = [c.term for c in memory.chosen]
        noise = fit_noise(system, terms)
        noise = ask.relearn(noise, terms)
        ask.look_again(noise, terms)
        fuller, ranked = ask.rank_on(fuller, noise, terms, memory.chosen)
        found = ask.search(list(memory.chosen), fuller, ranked, memory)
    if memory is not None or found.unlisted is not None:
        flexible = [t for t in flexible if t.name == LEVELS]
    noise = null if found.noise is None else found.noise
    left = left_over(ask.system, found.chosen, noise, flexible, grade=grade, say=say)
    return _conclude(ask, found, left, memory, null, gate, first, scores)


def _conclude(
    ask: Asked,
    found: Found,
    left: LeftOver | None,
    memory: Remembered | None,
    null: NoiseFit,
    gate: float,
    first: Sequence[Candidate],
    scores: Sequence[Score],
) -> Answer:
    chosen, noise = found.chosen, found.noise
    named = []
    if memory is not None:
        for mine, others in zip(memory.chosen, memory.rivals):
            named.append(Named(mine, memory.p_value, tuple(replace(mine, term=t) for t in others)))
    for k, mine in enumerate(chosen[len(named) :], start=len(named)):
        assert noise is not None  # fitted beside each effect chosen
        others = [c.term for j, c in enumerate(chosen) if j != k]
        # Under the variances that its presence left alone every effect would be certain. Where these leave no room
        # for slow noise, a fit that starts from them finds none either.
        chains = mine.term.chains
        starts = (noise, null) if others else ()
        without = [fit_noise(ask.system, others, start, chains) for start in starts] or [null]
        again = _again(ask, mine, others, [noise, *without])
        if again.p_value < STILL:
            named.append(again)
    beside = [null] if noise is None else [noise, null]
    named = once(ask, named, beside)
    if noise is not None and [n.candidate.term for n in named] != [c.term for c in chosen]:
        # What is named is not all that was chosen: beside it the noise is another one.
        noise = fit_noise(ask.system, [n.candidate.term for n in named], noise) if named else None
    best_open, open_p = found.unlisted, found.unlisted_p
    wins = best_open is not None and (
        not named or best_open.ratio > 0.3 * sum(n.candidate.ratio for n in named)
    )
    if left is not None and not wins:
        best_open, open_p = left.candidate, left.p_value
    if wins or left is not None:
        verdict = "unexplained"
    elif named:
        verdict = "missing-physics"
    else:
        verdict = "consistent"
    instead: tuple[Named, ...] = ()
    if verdict == "unexplained":
        assert best_open is not None  # which is why
        instead = _listed(ask, best_open, [n.candidate.term for n in named], beside)
    return Answer(
        verdict,
        tuple(named),
        best_open,
        open_p,
        null if noise is None else noise,
        null,
        gate,
        ask.tests,
        tuple(ask.short),
        tuple(first[:40]),
        tuple(scores),
        None if memory is None else memory.chosen[0].term.name,
        ask.system is not ask.alone,
        instead,
    )


def once(ask: Asked, named: list[Named], noises: list[NoiseFit]) -> list[Named]:
    """The names without forms that another form of the same effect holds; that one compared once more without them.

    An effect that came in two parts, each of which is compared beside the other, may be named twice in its full form.
    """
    terms = [n.candidate.term for n in named]
    kept, wider = [], set()
    for k, term in enumerate(terms):
        by = [
            j
            for j, other in enumerate(terms)
            if j != k and holds(other, term) and (j < k or not holds(term, other))
        ]
        wider.update(by)
        if not by:
            kept.append(k)
    made = [named[k] for k in kept]
    for place, k in enumerate(kept):
        if k in wider:
            others = [n.candidate.term for j, n in enumerate(made) if j != place]
            made[place] = _again(ask, named[k].candidate, others, noises)
    return made


def _listed(
    ask: Asked, unlisted: Candidate, chosen: list[Term], noises: list[NoiseFit]
) -> tuple[Named, ...]:
    """The catalogue on the rows of an unlisted dependence, each name in its best form, where it is no chance."""
    rows = set(unlisted.term.chains)
    asked = [t for t in ask.short if not t.name.startswith(PREFIX) and rows.intersection(t.chains)]
    ranked = judge(
        ask.system, bank(ask.system, noises, chosen), asked, chosen, ask.forms, ask.grade
    )
    best: dict[tuple[str, tuple[int, ...]], Candidate] = {}
    for c in ranked:
        best.setdefault(c.key, c)
    return tuple(Named(c, ask.chance(c), ()) for c in best.values() if ask.tests.p_value(c) < STILL)


def _again(ask: Asked, mine: Candidate, others: list[Term], noises: list[NoiseFit]) -> Named:
    """A chosen effect compared once more with all rivals beside the other chosen ones."""
    mine_only = set(mine.term.chains)
    catalogue = [
        t
        for t in ask.short
        if not t.name.startswith(PREFIX)
        and not mine_only.isdisjoint(t.chains)
        and not barred(others, t)
    ]
    shared = bank(ask.system, noises, others)
    ranked = judge(ask.system, shared, catalogue, others, ask.forms, ask.grade)
    names: dict[str, Candidate] = {}
    for c in ranked:
        names.setdefault(c.term.name, c)
    # What noise makes often is a rival and no name, as at the gate.
    named = [c for c in ranked if c.term.name == mine.term.name]
    own = next((c for c in named[:OWN] if ask.chance(c) < STILL), (named or [mine])[0])
    rare = [c for c in names.values() if c.evidence > own.evidence and ask.chance(c) < STILL]
    top: Candidate = max([own, *rare], key=lambda c: c.evidence)
    lead = own if own.evidence > top.evidence - 1e-9 else top
    # One cause instead of two, where the data cannot tell: a further form of an effect found already.
    known = {(t.name, t.channels) for t in others}
    same = [c for c in ranked if c.key in known and 2.0 * (lead.evidence - c.evidence) < SAME]
    lead = same[0] if same else lead
    others_named = sorted(
        (c for c in names.values() if c.term.name != lead.term.name), key=lambda c: -c.evidence
    )

    def within(distance: float) -> tuple[Candidate, ...]:
        return tuple(c for c in others_named if 2.0 * (lead.evidence - c.evidence) < distance)

    rivals = within(SAME)
    near = within(NEAR)[len(rivals) :]
    return Named(lead, ask.chance(lead), rivals, near, _elsewhere(lead, ranked, known))


def _elsewhere(
    lead: Candidate, ranked: Sequence[Candidate], known: Collection[Key]
) -> tuple[Candidate, ...]:
    """The lead's effect on other channels, in the best form on each, within the bound of the set.

    Channels have rows of their own where outputs are compared with references. Where |f| is all that is known, they
    share them: an addition to channel i changes |f| by its product with f_i, and f_p f_o on i is f_x f_y f_z on all.
    """
    best: dict[Key, Candidate] = {}
    for c in ranked:
        best.setdefault(c.key, c)
    return tuple(
        c
        for key, c in best.items()
        if key[0] == lead.term.name
        and key != lead.key
        and key not in known
        and 2.0 * (lead.evidence - c.evidence) < SAME
    )
