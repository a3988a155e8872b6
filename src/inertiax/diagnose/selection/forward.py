"""Which effects explain one triad's rows: taken one after the other, each at its gate, until none passes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from ..candidates.empirical import PREFIX
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit, System
from ..noise.pooled_channels import alike
from ..noise.reml import fit_noise
from .candidate_screening import carried, FAINT, first_of_both, is_open, leaders, quiet_bank, rank
from .constraints import among, causes, explained_beside, full, MOST_EFFECTS, twice
from .evidence import Bank, bank, Candidate, judge, shortlist
from .multiple_testing import Family, Key
from .pairs import best_pair
from .score_test import parts_by_chain
from .thermal import Remembered
from .trials_factor import recounted


GATE = 0.015  # family-wise false alarms of the first effect of one triad
NEXT = 0.01  # and of each further one
FURTHER = 2.0  # least log odds of one that acts on the same rows as another
PAIR = 0.005  # family-wise false alarms of two slow effects that show together only
STILL = 0.025  # chance above which an effect is dropped when it is compared again at the end
OPEN = 0.5  # part of those levels from which an unlisted dependence keeps the catalogue from being named
ALONE = 5e-4  # chance below which it is said itself, its settings being sought between the grid's
MARGIN = 4.0  # log odds by which an unlisted dependence must beat the catalogue
MOST_OF = 0.5  # of an effect's gain: what one of two has alone to be tried in its place
TRACE = 0.03  # of a strong effect's gain: what its form and setting on a grid may leave behind
MORE = 60  # forms that the short list may grow by beside each choice
TRIED = 40  # leading candidates that are asked whether they predict


@dataclass(frozen=True, eq=False)
class Found:
    """Effects taken one after the other, and what ended the search."""

    chosen: tuple[Candidate, ...]
    noise: NoiseFit | None
    unlisted: Candidate | None
    unlisted_p: float


@dataclass(eq=False)
class Asked:
    """One triad's rows with what may explain them."""

    alone: System  # each chain's noise told by its own rows
    system: System  # and by the other chains, where they are alike
    everything: tuple[Term, ...]
    short: list[Term]  # worth a closer look; grows with what shows beside the chosen effects
    forms: dict
    grade: str | None
    tests: Family
    null: NoiseFit
    between_all: Callable[[Term], list[Term]]
    renew: Callable[[NoiseFit, list[Term]], list[Term]]
    say: Callable[[str], None]
    # Effects whose tests between the grid's points are counted
    counted: set[Key] = field(default_factory=set)

    def chance(self, candidate: Candidate) -> float:
        """Chance of the candidate by noise alone, the search between the points of its grid included."""
        p = self.tests.p_value(candidate)
        if p >= STILL or is_open(candidate) or candidate.key in self.counted:
            return p
        self.counted.add(candidate.key)
        fine = self.between_all(candidate.term)
        if not fine:
            return p
        grid = [t for t in self.everything if (t.name, t.channels) == candidate.key]
        self.tests = recounted(self.tests, self.system, self.null, grid, fine)
        return self.tests.p_value(candidate)

    def search(
        self,
        chosen: list[Candidate],
        fuller: Bank,
        ranked: list[Candidate],
        memory: Remembered | None,
    ) -> Found:
        """Take effects one after the other beside those given, until none passes."""
        noise = fuller.leader if chosen else None
        parts: dict[int, dict[int, float]] = {}
        while causes([c.key for c in chosen]) < 2 * MOST_EFFECTS and ranked:
            terms = [c.term for c in chosen]
            ranked = [c for c in ranked if is_open(c) or not full(chosen, c)]
            ranked = [c for c in ranked if not twice(chosen, c)]
            ranked = [
                c for c in ranked if c.score.gain > TRACE * explained_beside(chosen, c, parts)
            ]
            leading = ranked[:TRIED]
            if memory is not None:
                paying = first_of_both(c for c in leading if memory.pays(c.term, terms))
                leading = [c for c in paying if c is not None]
            listed, _ = first_of_both(leading)
            level = GATE if not chosen else NEXT
            unlisted = self._leading_open(fuller, leading, listed, terms)
            if unlisted is not None:
                p = self.tests.p_value(unlisted)
                if p < OPEN * level and unlisted.evidence > 0:
                    if listed is None or not self._pair_beats(fuller, listed, unlisted, terms):
                        if p >= ALONE:
                            break
                        return Found(tuple(chosen), noise, unlisted, p)
            if memory is None:
                listed = self._first_that_passes(leading, listed, unlisted, level, chosen)
            found = [listed] if listed is not None and self._passes(listed, level, chosen) else []
            found = (found and self._two_for_one(fuller, ranked, found[0], chosen)) or found
            if not found and memory is None:
                found = self._pair(fuller, ranked, chosen)
            if not found:
                break
            chosen.extend(found)
            noise = fit_noise(self.system, [c.term for c in chosen], noise)
            terms, noise = self._renewed(chosen, noise)
            noise = self.relearn(noise, terms)
            parts = {
                id(t): parts_by_chain(self.system, noise, t, [o for o in terms if o is not t])
                for t in terms
            }
            for new in found:
                self.say(f"{new.term.name} on {', '.join(new.term.channel_names)}")
            self.look_again(noise, terms)
            fuller, ranked = self.rank_on(fuller, noise, terms, found)
        return Found(tuple(chosen), noise, None, 1.0)

    def _renewed(self, chosen: list[Candidate], noise: NoiseFit) -> tuple[list[Term], NoiseFit]:
        """The chosen terms and their noise, after signatures that hold the model's parameters were made anew."""
        before = [c.term for c in chosen]
        terms = self.renew(noise, before)
        changed = [new for old, new in zip(before, terms) if new is not old]
        if not changed:
            return before, noise
        chosen[:] = [replace(c, term=t) for c, t in zip(chosen, terms)]
        self.short.extend(changed)
        return terms, fit_noise(self.system, terms, noise)

    def relearn(self, noise: NoiseFit, chosen: Sequence[Term]) -> NoiseFit:
        """Let the chains tell each other's noise anew beside the chosen effects; the noise fitted with that."""
        before, self.system = self.system, alike(self.alone, noise, chosen)
        untold = self.system is self.alone and before is self.alone
        return noise if untold else fit_noise(self.system, chosen, noise)

    def look_again(self, noise: NoiseFit, chosen: Sequence[Term]) -> None:
        """Lengthen the short list by the forms that lead beside the chosen effects: a strong effect hides them."""
        start = bank(self.system, [noise], chosen)
        ranked = judge(self.system, start, self.everything, chosen, self.forms, self.grade)
        leading = [c for c in ranked if c.ratio > FAINT]
        known = set(map(id, self.short))
        fresh = shortlist(leading, per_key=3, most=MORE)
        self.short.extend(t for t in fresh if id(t) not in known)

    def rank_on(
        self, before: Bank, noise: NoiseFit, chosen: Sequence[Term], new: Sequence[Candidate]
    ) -> tuple[Bank, list[Candidate]]:
        """Candidates beside one more chosen effect, best first.

        Its own channels are looked at under much less slow noise once more, for what that may have swallowed; what
        was fitted beside the candidates of the others still holds.
        """
        touched = {c for one in new for c in one.term.chains}
        mine = [t for t in self.short if touched.issuperset(t.chains)]
        slow = judge(self.system, quiet_bank(noise), mine, chosen, self.forms, self.grade)
        noises = [noise, *carried(before, noise, touched)]
        hidden = leaders(slow, 3, 1)
        return rank(self.system, noises, self.short, chosen, self.forms, self.grade, hidden)

    def _leading_open(
        self,
        fuller: Bank,
        leading: Sequence[Candidate],
        listed: Candidate | None,
        chosen: Sequence[Term],
    ) -> Candidate | None:
        """The best unlisted dependence that is clearly more likely than the best catalogued effect, or `None`.

        Where only one of the two is scored on all channels together, beside the rig's errors that they share, both
        are scored on their own channel: rivals must be judged under one noise.
        """
        ahead = [c for c in leading if is_open(c)]
        if listed is None:
            return ahead[0] if ahead else None
        ahead = [c for c in ahead if c.evidence > listed.evidence + MARGIN]
        if self.system.shared is None or not ahead:
            return ahead[0] if ahead else None
        apart = replace(self.system, shared=None)
        terms = [listed.term, *(c.term for c in ahead)]
        alone = judge(apart, fuller, terms, chosen, self.forms, self.grade)
        evidence = {id(c.term): c.evidence for c in alone}
        least = evidence.get(id(listed.term), listed.evidence) + MARGIN
        for c in ahead:
            alike = c.term.like_the_rig == listed.term.like_the_rig
            if alike or evidence.get(id(c.term), c.evidence) > least:
                return c
        return None

    def _first_that_passes(
        self,
        leading: Sequence[Candidate],
        listed: Candidate | None,
        unlisted: Candidate | None,
        level: float,
        chosen: Sequence[Candidate],
    ) -> Candidate | None:
        """The most likely catalogued effect that is rare enough for the gate; the most likely one where none is.

        A jump at one of hundreds of moments may be ahead of an effect that had one form to fit, and be common.
        Not where an unlisted dependence is clearly more likely than any.
        """
        if listed is None or unlisted is not None or self._passes(listed, level, chosen):
            return listed
        likely = [c for c in leading if not is_open(c) and c.evidence >= 0.0]
        return next((c for c in likely if self._passes(c, level, chosen)), listed)

    def _passes(self, listed: Candidate, level: float, chosen: Sequence[Candidate]) -> bool:
        """Whether a catalogued effect is rare and likely enough; more so beside others on the same rows."""
        likely = FURTHER if among(chosen, listed.term.chains) else 0.0
        return self.chance(listed) < level and listed.evidence >= likely

    def _two_for_one(
        self,
        fuller: Bank,
        ranked: Sequence[Candidate],
        one: Candidate,
        chosen: Sequence[Candidate],
    ) -> list[Candidate]:
        """Two effects that explain more than one of several coefficients does, with no more of them; mostly empty.

        Where the magnitude of the specific force is all that rows hold, the three products of one channel can stand
        for two simple effects of two channels.
        """
        if one.score.size < 2:
            return []
        terms, known = [c.term for c in chosen], {one.key}
        for first in ranked:
            fewer = first.score.size < one.score.size and not is_open(first)
            if not fewer or first.ratio < MOST_OF * one.ratio or first.key in known:
                continue
            known.add(first.key)
            beside = [*terms, first.term]
            noise = fit_noise(self.system, beside, fuller.leader)
            catalogue = [t for t in self.short if t.effect is not None]
            _, more = rank(self.system, [noise], catalogue, beside, self.forms, self.grade)
            with_first = [*chosen, first]
            second = next((c for c in more if not twice(with_first, c)), None)
            if (
                second is not None
                and second.key != first.key
                and first.score.size + second.score.size <= one.score.size
                and first.ratio + second.ratio > one.ratio
                and first.evidence + second.evidence > one.evidence + MARGIN
                and not full(with_first, second)
                and self._passes(second, NEXT, with_first)
            ):
                return [first, second]
            if len(known) > 2:
                break
        return []

    def _pair(
        self, fuller: Bank, ranked: list[Candidate], chosen: Sequence[Candidate]
    ) -> list[Candidate]:
        """Two slow effects that show together only; empty where there are none."""
        terms = [c.term for c in chosen]
        pair = best_pair(
            self.system, fuller, ranked, self.short, terms, self.forms, self.grade, self.tests
        )
        if pair is None or pair.p_value >= PAIR:
            return []
        chains = pair.first.term.chains
        unlisted = [c.evidence for c in ranked if is_open(c) and c.term.chains == chains]
        least = max(FURTHER if among(chosen, chains) else 0.0, max(unlisted, default=0.0) - MARGIN)
        both = [pair.first, pair.second]
        barred = full([*chosen, pair.first], pair.second)
        barred = barred or any(twice(chosen, new) for new in both)
        return [] if pair.evidence < least or barred else both

    def _pair_beats(
        self, fuller: Bank, listed: Candidate, unlisted: Candidate, chosen: list[Term]
    ) -> bool:
        """Whether two catalogued effects, the second rare by itself, explain more than the best unlisted one.

        Beside effects found already by as much as one would have to: what their forms leave behind has no name.
        """
        terms = [*chosen, listed.term]
        noise = fit_noise(self.system, terms, fuller.leader)
        catalogue = [t for t in self.short if not t.name.startswith(PREFIX)]
        _, more = rank(self.system, [noise], catalogue, terms, self.forms, self.grade)
        if not more or not self.tests.p_value(more[0]) < NEXT:
            return False
        needed = unlisted.evidence + (MARGIN if chosen else 0.0)
        return listed.evidence + more[0].evidence > needed
