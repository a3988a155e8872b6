"""Naming: which few terms explain the rows, under noise that is estimated anew beside each of them.

A candidate is judged by the profile likelihood: the drop of minus twice the log likelihood when its
columns enter the mean *and* the variance components are free. That way neither a slow effect is
swallowed by a random walk nor a random walk taken for an effect without a fair contest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .alternatives import PREFIX
from .system import fit_noise, likelihood, NoiseFit, Score, System, whiten_system
from .terms import Term


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


def plausibility(score: Score, grade: str | None) -> float:
    """Log prior of the coefficients' size: flat over ten times the usual range, falling beyond it."""
    effect = score.term.effect
    if effect is None:
        return 0.0
    sizes = np.abs(score.coefficients)
    spread = np.sqrt(np.diag(score.covariance))
    if effect.unit_amplitude:
        # The coefficient is 1 by theory; the grid of the setting and its shape leave some room.
        value = score.coefficients[0]
        return float(-0.5 * ((value - 1.0) / np.hypot(0.35, spread[0])) ** 2)
    usual = effect.usual(score.term.triad, grade)
    if usual is None:
        return 0.0
    size = float(sizes.max())
    excess = max(0.0, np.log10(max(size, 1e-300) / usual[1]) - 1.0)
    return float(-4.0 * excess**2)


@dataclass(frozen=True, eq=False)
class Bank:
    """Variances tried, each with minus the log likelihood of the chosen terms."""

    fits: tuple[NoiseFit, ...]
    values: tuple[float, ...]

    @property
    def best(self) -> float:
        return min(self.values)


def bank(system: System, fits: Sequence[NoiseFit], chosen: Sequence[Term]) -> Bank:
    """Evaluate the chosen terms under each set of variances."""
    return Bank(tuple(fits), tuple(likelihood(system, f, chosen) for f in fits))


def judge(
    system: System,
    bank: Bank,
    candidates: Sequence[Term],
    chosen: Sequence[Term],
    forms: dict,
    grade: str | None,
) -> list[Candidate]:
    """Candidates with their profile likelihood ratios over the bank, best evidence first."""
    best: dict[int, tuple[float, Score]] = {}
    for fit, value in zip(bank.fits, bank.values):
        for score in whiten_system(system, fit, candidates, chosen).scores:
            ratio = score.gain - 2.0 * (value - bank.best)
            if id(score.term) not in best or ratio > best[id(score.term)][0]:
                best[id(score.term)] = (ratio, score)
    made = []
    for ratio, score in best.values():
        n = system.num_rows / len(system.chains) * len(score.term.chains)
        cost = score.size * 0.5 * np.log(n) + np.log(
            forms.get((score.term.name, score.term.channels), 1)
        )
        if score.term.name.startswith(PREFIX):
            cost += 2.0  # an unlisted dependence is less likely beforehand than a listed one
        evidence = 0.5 * ratio - cost + plausibility(score, grade)
        made.append(Candidate(score.term, score, float(ratio), float(evidence)))
    return sorted(made, key=lambda c: -c.evidence)


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
    """Add to the bank the variances refitted beside each of the leading candidates."""
    fits, done = list(start.fits), set()
    leader = min(range(len(start.values)), key=lambda k: start.values[k])
    for candidate in ranked:
        if candidate.key in done or candidate.evidence < ranked[0].evidence - 25.0:
            continue
        done.add(candidate.key)
        fits.append(
            fit_noise(system, [*chosen, candidate.term], start.fits[leader], candidate.term.chains)
        )
        if len(done) >= most:
            break
    return bank(system, fits, chosen)
