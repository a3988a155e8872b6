"""Naming: which few terms explain the rows, under noise that is estimated anew beside each of them.

A candidate is judged by the profile likelihood: the drop of minus twice the log likelihood when its
columns enter the mean *and* the variance components are free. That way neither a slow effect is
swallowed by a random walk nor a random walk taken for an effect without a fair contest.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...effects import Effect
from ..candidates.empirical import PREFIX
from ..candidates.signatures import Term
from ..noise.common_mode_fit import coupled_theta, JointLikelihood, recoupled
from ..noise.observation_series import NoiseFit, System
from ..noise.reml import fit_noise, likelihood
from .column_products import ColumnProducts
from .score_test import parted, Score, scored_together, whiten_system


ROOM = 0.35  # standard deviation of the logarithm of a coefficient that theory fixes at 1
ROUNDING = 6  # decimals of a log odds beyond which rounding decides


@dataclass(frozen=True, eq=False)
class Candidate:
    """A term with what it gains over the terms chosen so far."""

    term: Term
    score: Score  # under the variances that suit it best
    ratio: float  # twice the gain of log likelihood
    evidence: float  # log odds after the price of its columns and forms

    @property
    def key(self) -> tuple[str, tuple[int, ...]]:
        """Name and channels."""
        return self.term.name, self.term.channels


@dataclass(frozen=True)
class Usual:
    """What theory and experience say of an effect's coefficient, by a triad and grade."""

    fixed: bool  # the coefficient is 1 by theory
    largest: float | None  # usual size, SI

    @classmethod
    def of(cls, effect: Effect, triad: str, grade: str | None, seconds: float = np.inf) -> "Usual":
        """Of a catalogued effect, in a log of so many seconds."""
        usual = effect.usual(triad, grade, seconds)
        return cls(effect.unit_amplitude, None if usual is None else float(usual[1]))


def plausibility(score: Score, usual: Usual | None) -> float:
    """Log prior of the coefficients' size: flat over ten times the usual range, falling beyond it."""
    if usual is None:
        return 0.0
    if usual.fixed:
        return _near_one(float(score.coefficients[0]), float(np.sqrt(score.covariance[0, 0])))
    if usual.largest is None:
        return 0.0
    size = max(map(abs, score.coefficients.tolist()))
    excess = max(0.0, math.log10(max(size, 1e-300) / usual.largest) - 1.0)
    return -4.0 * excess**2


def _near_one(value: float, spread: float) -> float:
    """Log prior of a coefficient that is 1 by theory: its logarithm is near 0.

    The grid of the setting and its shape leave some room; a negative coefficient has no meaning.
    """
    if value > 0.0:
        return -0.5 * (np.log(value) / np.hypot(ROOM, spread / value)) ** 2
    return -0.5 * (((value - 1.0) / np.hypot(ROOM, spread)) ** 2 + (value / spread) ** 2)


@dataclass(frozen=True, eq=False)
class Bank:
    """Variances tried, each with minus the log likelihood of the chosen terms on every chain."""

    fits: tuple[NoiseFit, ...]
    values: tuple[tuple[float, ...], ...]  # by fit, then by chain
    together: tuple[float, ...] = ()  # by fit, of all chains with the errors that they share

    @property
    def best(self) -> tuple[float, ...]:
        """The least value of each chain."""
        return tuple(min(column) for column in zip(*self.values))

    @property
    def leader(self) -> NoiseFit:
        """The best of each chain's variances together."""
        places = [int(np.argmin(column)) for column in zip(*self.values)]
        theta = tuple(self.fits[k].theta[c] for c, k in enumerate(places))
        values = tuple(self.values[k][c] for c, k in enumerate(places))
        curved = tuple(self.fits[k].curvature_of(c) for c, k in enumerate(places))
        return NoiseFit(theta, values, recoupled(theta, self.fits[0].coupled), curved)


def bank(system: System, fits: Sequence[NoiseFit], chosen: Sequence[Term]) -> Bank:
    """Evaluate the chosen terms under each set of variances."""
    known: dict[tuple[int, bytes], float] = {}
    values = []
    for fit in fits:
        for c, theta in enumerate(fit.theta):
            if (c, theta.tobytes()) not in known:
                known[c, theta.tobytes()] = likelihood(system, fit, chosen, c)
        values.append(tuple(known[c, theta.tobytes()] for c, theta in enumerate(fit.theta)))
    together = ()
    if system.shared is not None and len(fits) > 1:  # one alone is compared with nothing
        joint = JointLikelihood(system, chosen)
        together = tuple(joint(coupled_theta(fit)) for fit in fits)
    return Bank(tuple(fits), tuple(values), together)


def observations(system: System, term: Term) -> int:
    """Number of observations that tell a term's coefficients, of which each is priced with half its logarithm.

    What follows the input is one value a positioning, however many dwells it has and blocks they are cut into: flicker
    and positioning errors are shared by them.

    **Reference:** Berger, Bayarri and Pericchi, Econometric Reviews 33 (2014) 197, for effective sample sizes in the
    Bayesian information criterion.
    """
    several = [np.count_nonzero(system.chains[c].new_positioning) for c in term.chains]
    rows = [len(system.base.observed[c]) for c in term.chains]
    return max(int(sum(several if term.follows_input else rows)), 2)


def duration(system: System) -> float:
    """Seconds from a triad's first row to its last."""
    return max(float(np.sum(chain.gap)) for chain in system.chains)


def judge(
    system: System,
    bank: Bank,
    candidates: Sequence[Term],
    chosen: Sequence[Term],
    forms: dict,
    grade: str | None,
    *,
    columns: bool = False,
    products: ColumnProducts | None = None,
) -> list[Candidate]:
    """Candidates with their profile likelihood ratios over the bank, best evidence first.

    Chains are independent: a candidate is judged by the variances of its own chains. One that is scored on all chains
    together is judged by their likelihood together: what variances lose must be counted on the rows that the gain is
    counted on. Scores have their whitened columns where `columns` are asked for. `products` of these candidates beside
    the chosen terms serve several banks.
    """
    found = _best_scores(system, bank, candidates, chosen, columns, products)
    made, usual, seen = [], {}, {}
    seconds = duration(system)
    for ratio, score in found:
        alike = score.term.chains, score.term.follows_input
        if alike not in seen:
            seen[alike] = math.log(observations(system, score.term))
        effect, triad = score.term.effect, score.term.triad
        key = id(effect), triad, score.term.scales_input
        if effect is not None and key not in usual:
            usual[key] = Usual.of(effect, triad, grade, np.inf if key[2] else seconds)
        cost = 0.5 * score.size * seen[alike]
        cost += math.log(forms.get((score.term.name, score.term.channels), 1))
        if score.term.name.startswith(PREFIX):
            cost += 2.0  # an unlisted dependence is less likely beforehand than a listed one
        evidence = 0.5 * ratio - cost + plausibility(score, usual.get(key))
        made.append(Candidate(score.term, score, float(ratio), float(evidence)))
    # Forms that are one in these data, as a bias and a scale factor in one pose, keep the catalogue's order.
    return sorted(made, key=lambda c: -round(c.evidence, ROUNDING))


def _best_scores(
    system: System,
    bank: Bank,
    candidates: Sequence[Term],
    chosen: Sequence[Term],
    columns: bool,
    products: ColumnProducts | None,
) -> list[tuple[float, Score]]:
    """Of each candidate that shows the largest likelihood ratio over the bank, with its score there."""
    if columns:
        return _each_best(
            bank,
            candidates,
            parted(system, candidates)[1],
            lambda fit, some: whiten_system(system, fit, some, chosen).scores,
        )
    if products is None:
        products = ColumnProducts(system, candidates, chosen)
    ratios, found = [np.full(len(products.terms), -np.inf)], []
    for fit, value, fresh in _rounds(bank):
        sums = products.sums(fit)
        found.append((sums, products.gains(sums)))
        loss = products.touches @ np.subtract(value, bank.best)
        asked = products.touches[:, sorted(fresh)].any(axis=1)
        ratios.append(np.where(asked, found[-1][1].drop - 2.0 * loss, -np.inf))
    best = np.argmax(ratios, axis=0)
    made = [
        (float(ratios[n][k]), products.score(k, *found[n - 1])) for k, n in enumerate(best) if n > 0
    ]
    if products.together:
        made += _each_best(
            bank,
            products.together,
            products.together,
            lambda fit, some: [
                s for s in scored_together(system, fit, some, chosen) if s is not None
            ],
        )
        place = {id(t): k for k, t in enumerate(candidates)}
        made.sort(key=lambda one: place[id(one[1].term)])
    return made


def _each_best(
    bank: Bank,
    candidates: Sequence[Term],
    together: Sequence[Term],
    scored: Callable[[NoiseFit, Sequence[Term]], Sequence[Score]],
) -> list[tuple[float, Score]]:
    """As `_best_scores`, with what makes the scores of some candidates under one noise.

    `together` are those that are scored on all chains together.
    """
    joint = bank.together or (0.0,) * len(bank.fits)
    coupled = {id(t) for t in together}
    # Of the fits that terms of some chains were scored under.
    lowest: dict[tuple[int, ...], float] = {}
    best: dict[int, tuple[float, Score]] = {}
    for value_of_all, (fit, value, fresh) in zip(joint, _rounds(bank)):
        some = [t for t in candidates if not fresh.isdisjoint(t.chains)]
        for score in scored(fit, some) if some else ():
            chains = score.term.chains
            if id(score.term) in coupled:
                lowest[chains] = min(lowest.get(chains, np.inf), value_of_all)
                loss = value_of_all
            else:
                loss = sum(value[c] - bank.best[c] for c in chains)
            ratio = score.gain - 2.0 * loss
            if id(score.term) not in best or ratio > best[id(score.term)][0]:
                best[id(score.term)] = (ratio, score)
    return [
        (ratio + 2.0 * lowest[score.term.chains] if key in coupled else ratio, score)
        for key, (ratio, score) in best.items()
    ]


def _rounds(bank: Bank) -> Iterator[tuple[NoiseFit, tuple[float, ...], set[int]]]:
    """Each noise of a bank with its values, and the chains whose variances none before had."""
    done: set[tuple[int, bytes]] = set()
    for fit, value in zip(bank.fits, bank.values):
        keys = {(c, theta.tobytes()) for c, theta in enumerate(fit.theta)}
        yield fit, value, {c for c, _ in keys - done}
        done |= keys


def count_forms(candidates: Sequence[Term]) -> dict[tuple[str, tuple[int, ...]], int]:
    """Number of forms of each effect on each set of channels."""
    forms: dict[tuple[str, tuple[int, ...]], int] = {}
    for term in candidates:
        forms[term.name, term.channels] = forms.get((term.name, term.channels), 0) + 1
    return forms


def shortlist(ranked: Sequence[Candidate], *, per_key: int = 5, most: int = 260) -> list[Term]:
    """The best few forms of each effect and channel."""
    seen: dict = {}
    kept = []
    for candidate in ranked:
        if seen.get(candidate.key, 0) < per_key:
            seen[candidate.key] = seen.get(candidate.key, 0) + 1
            kept.append(candidate.term)
        if len(kept) >= most:
            break
    return kept


def refine(
    system: System,
    start: Bank,
    ranked: Sequence[Candidate],
    chosen: Sequence[Term],
    *,
    most: int = 6,
) -> Bank:
    """Add to the bank the variances refitted beside each chain's leading candidates."""
    fits, done = list(start.fits), set()
    count: dict[tuple[int, ...], int] = {}
    for candidate in ranked:
        chains = candidate.term.chains
        if id(candidate.term) in done or count.get(chains, 0) >= most:
            continue
        done.add(id(candidate.term))
        count[chains] = count.get(chains, 0) + 1
        fits.append(fit_noise(system, [*chosen, candidate.term], start.leader, chains))
    return bank(system, fits, chosen)
