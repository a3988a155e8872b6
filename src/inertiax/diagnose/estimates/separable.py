"""Effects whose signature holds the model's own parameters, which are fitted beside them.

A lag shows as the difference of the model's outputs at two temperatures, $s(\\theta, \\tau) = h(T_s; \\theta) -
h(T_p; \\theta)$. The model was fitted without the lag, so that a strong one has bent the very parameters that its
signature is made of. Setting and parameters are therefore fitted together, by Gauss-Newton steps of

$$y - h(T_p; \\theta) - s(\\theta, \\tau) = \\Bigl(\\frac{\\partial h}{\\partial \\theta} +
\\frac{\\partial s}{\\partial \\theta}\\Bigr) \\, \\delta\\theta,$$

in which the columns of the parameters are those at the element's temperature and $\\tau$ is the minimum of the
sum of squares over $\\delta\\theta$ (variable projection). Columns at the probe's temperature would
leave the estimate unbiased and throw away what the parameters' own columns tell of the lag.

**Reference:** Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, for models with separable variables.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np
from jaxtyping import Float, Int

from ..._jax import eqx
from ...effects import Variant
from ..candidates.columns import span
from ..candidates.signatures import Term
from ..element_temperature import about, bilinear, warmer_by
from ..noise.observation_series import NoiseFit, System
from ..problem import Prepared, rebuilt
from ..selection.score_test import whiten_system
from .moments import tuned_moments
from .parameters import corrected, tune


ROUNDS = 8
STEADY = 0.1  # change of a setting, in its standard deviations, at which it stays
ALMOST = 0.01  # the same in parts of the setting where the data do not tell it
LAG = "thermal_lag"  # the elements' own, which goes on in pauses
PAUSES = "pauses"
STEP = 1e-3  # of a parameter, by which its change is found


def refined(
    prepared: Prepared, noise: NoiseFit, chosen: Sequence[Term]
) -> tuple[Prepared, list[Term], list[float | None]]:
    """The chosen terms with their settings refined one after the other, and the settings' standard deviations.

    Where a signature holds the model's parameters, it is made anew from those that are fitted beside the chosen terms;
    of all rounds the one with the least sum of squares is kept, for the iteration need not converge.
    **Returns** the prepared triad that such signatures belong to as well.
    """
    if not any(map(bilinear, chosen)):
        terms, spread = _tuned(prepared, noise, chosen)
        return prepared, terms, spread
    values, ahead = prepared.system.base.coefficients, _nothing_ahead(prepared)
    now, terms = _about(prepared, values, ahead, chosen)
    spread: list[float | None] = [None] * len(terms)
    best = np.inf, now, terms, spread
    for _ in range(ROUNDS):
        before = [_setting(t) for t in terms]
        pauses = after_pauses(now, terms)
        terms, spread = _tuned_beside_parameters(now, noise, terms, values, pauses)
        beside = at_element(now, terms, terms, values)
        others = [*_parted(terms)[1], *pauses]
        misfit = whiten_system(beside, noise, [], others).chi2
        values, _ = corrected(beside, noise, others)
        ahead = _further_ahead(now, beside, noise, pauses, _parted(terms)[1])
        now, terms = _about(prepared, values, ahead, terms)
        best = min(best, (misfit, now, terms, spread), key=lambda b: b[0])
        moved = [abs(_setting(t) - b) for t, b in zip(terms, before)]
        room = [STEADY * s if s else ALMOST * b for s, b in zip(spread, before)]
        if all(m <= r for m, r in zip(moved, room)):
            break
    return best[1], best[2], best[3]


def renewed(prepared: Prepared, noise: NoiseFit, chosen: Sequence[Term]) -> list[Term]:
    """Chosen terms as they are but for those whose signature holds the model's parameters: these refined and anew."""
    if not any(map(bilinear, chosen)):
        return list(chosen)
    _, terms, _ = refined(prepared, noise, chosen)
    return [new if bilinear(old) else old for old, new in zip(chosen, terms)]


def _tuned(
    prepared: Prepared, noise: NoiseFit, chosen: Sequence[Term]
) -> tuple[list[Term], list[float | None]]:
    terms: list[Term] = list(chosen)
    spread: list[float | None] = [None] * len(terms)
    for k, term in enumerate(chosen):
        terms[k], spread[k] = tune(prepared, noise, term, terms[:k] + terms[k + 1 :])
    for name in dict.fromkeys(t.name for t in terms if t.effect is not None and t.effect.jump):
        event = [k for k, t in enumerate(terms) if t.name == name]
        if len(event) > 1:
            others = [t for k, t in enumerate(terms) if k not in event]
            found = tuned_moments(prepared, noise, [terms[k] for k in event], others)
            for k, (tuned, std) in zip(event, found):
                terms[k], spread[k] = tuned, std
    return terms, spread


def _about(
    prepared: Prepared, values: np.ndarray, ahead: np.ndarray | None, terms: Sequence[Term]
) -> tuple[Prepared, list[Term]]:
    """The triad and the terms with signatures from these parameters."""
    now = about(prepared, values, ahead)
    return now, [rebuilt(now, t) if bilinear(t) else t for t in terms]


def _tuned_beside_parameters(
    now: Prepared,
    noise: NoiseFit,
    terms: Sequence[Term],
    values: np.ndarray,
    pauses: Sequence[Term],
) -> tuple[list[Term], list[float | None]]:
    """Each setting tuned with the model's parameters at the element's temperature beside it, and what pauses did."""
    apart, others = _parted(terms)
    plain = replace(now, system=at_element(now, apart, apart, values))
    made, widths = _tuned(plain, noise, others)
    tuned = dict(zip(map(id, others), zip(made, widths)))
    for term in apart:
        rest = [t for t in apart if t is not term]
        without = replace(now, system=at_element(now, apart, rest, values))
        tuned[id(term)] = tune(without, noise, term, [*made, *pauses])
    return [tuned[id(t)][0] for t in terms], [tuned[id(t)][1] for t in terms]


def _cycles(prepared: Prepared) -> Int[np.ndarray, " time"]:
    """Number of the stretch without a pause at each sample."""
    return np.cumsum(np.r_[False, np.diff(np.asarray(prepared.signal.rows_for)) < 0.0])


def _nothing_ahead(prepared: Prepared) -> Float[np.ndarray, " time"] | None:
    """Elements that no pause moved; `None` where there is none."""
    cycle = _cycles(prepared)
    return np.zeros(len(cycle)) if cycle[-1] > 0 else None


def after_pauses(now: Prepared, terms: Sequence[Term]) -> list[Term]:
    """What elements one degree warmer at the end of each pause do to the rows, on each chain by itself.

    Every channel may have its own: it is the same element's temperature for all, but a channel that hardly depends on
    temperature must not be told so by the others.
    """
    ahead = now.signal.ahead
    if ahead is None:
        return []
    base, made = now.system.base, []
    cycle = _cycles(now)[now.blocks.start]
    numbers = np.unique(cycle)[1:]
    for term in terms:
        if term.name != LAG:
            continue
        warmer = rebuilt(warmer_by(now, 1.0), term)
        for chain, new, old in zip(term.chains, warmer.columns, term.columns):
            change = (new - old) * (cycle[:, None] == numbers)
            shown = np.any(change != 0.0, axis=0)
            if shown.any():
                channel = chain if len(base.observed) == 3 else term.channels[0]
                label = Variant("after pauses", {})
                columns = (change[:, shown],)
                made.append(Term(PAUSES, term.triad, (channel,), label, (chain,), columns))
    return made


def numbers_of_pauses(now: Prepared, term: Term) -> list[int]:
    """Numbers of the pauses that the columns of such a term stand for."""
    block = _cycles(now)[now.blocks.start]
    return [int(block[np.flatnonzero(x)[0]]) for x in term.columns[0].T]


def _further_ahead(
    now: Prepared,
    beside: System,
    noise: NoiseFit,
    pauses: Sequence[Term],
    others: Sequence[Term],
) -> Float[np.ndarray, " time"] | None:
    """By how much the elements were ahead after each pause: the mean over the chains by their information, with as
    much before as the probe's whole range."""
    ahead = now.signal.ahead
    if ahead is None or not pauses:
        return None if ahead is None else np.asarray(ahead)
    cycle = _cycles(now)
    probe = np.asarray(now.signal.temperature)
    now_ahead = np.array([ahead[cycle == n][0] for n in range(cycle[-1] + 1)])
    known = np.full(len(now_ahead), 1.0 / float(np.ptp(probe)) ** 2)
    total = -known * now_ahead
    for k, term in enumerate(pauses):
        rest = [*others, *pauses[:k], *pauses[k + 1 :]]
        (score,) = whiten_system(beside, noise, [term], rest).scores or (None,)
        if score is None:
            continue
        for place, number in enumerate(numbers_of_pauses(now, term)):
            if score.told[place]:
                weight = 1.0 / score.covariance[place, place]
                known[number] += weight
                total[number] += weight * score.coefficients[place]
    return (now_ahead + total / known)[cycle]


def _parted(terms: Sequence[Term]) -> tuple[list[Term], list[Term]]:
    """Terms whose signature holds the model's parameters, and the others."""
    return [t for t in terms if bilinear(t)], [t for t in terms if not bilinear(t)]


def at_element(
    now: Prepared, terms: Sequence[Term], taken: Sequence[Term], values: np.ndarray
) -> System:
    """The triad's rows with the parameters' columns at the elements' temperature, and signatures `taken` away.

    Rows are about the calibration's parameters, signatures about `values`.
    """
    base = now.system.base
    observed, columns = list(base.observed), list(base.columns)
    for term in taken:
        for chain, made in zip(term.chains, term.columns):
            observed[chain] = observed[chain] - made[:, 0]
    moved = (values - base.coefficients).reshape(-1)
    for term in terms:
        for chain, change in _by_parameters(now, term, values).items():
            observed[chain] = observed[chain] + change @ moved[base.index[chain]]
            columns[chain] = columns[chain] + change
    frames = tuple(span(x / np.linalg.norm(x, axis=0)) for x in columns)
    return eqx.tree_at(
        lambda s: (s.base.observed, s.base.columns, s.frames),
        now.system,
        (tuple(observed), tuple(columns), frames),
    )


def _by_parameters(
    now: Prepared, term: Term, values: np.ndarray
) -> dict[int, Float[np.ndarray, "row parameter"]]:
    """Change of a term's rows by each parameter of the chain's own, chain by chain.

    Chains without a common parameter are changed side by side. A model of the user's own need not be linear: a step
    is a thousandth of the parameter.
    """
    base = now.system.base
    made = {
        chain: np.zeros((len(rows), len(base.index[chain])))
        for chain, rows in zip(term.chains, term.columns)
    }
    flat = values.reshape(-1)
    ahead = None if now.signal.ahead is None else np.asarray(now.signal.ahead)
    for places in _places([base.index[c] for c in made]):
        step = np.maximum(STEP * np.abs(flat[places]), STEP * STEP)
        other = flat.copy()
        other[places] += step
        changed = rebuilt(about(now, other.reshape(values.shape), ahead), term)
        for chain, new, old in zip(term.chains, changed.columns, term.columns):
            index = list(base.index[chain])
            for place, size in zip(places, step):
                if place in index:
                    made[chain][:, index.index(place)] = (new - old)[:, 0] / size
    return made


def _places(index: Sequence[np.ndarray]) -> list[list[int]]:
    """Parameters that are changed together: one of each chain, or one of all where chains share any."""
    every = [int(p) for one in index for p in one]
    if len(set(every)) < len(every):
        return [[p] for p in dict.fromkeys(every)]
    return [[int(p) for p in row if p is not None] for row in zip_longest(*index)]


def _setting(term: Term) -> float:
    return term.setting if term.known.nuisance else 0.0
