"""Effects whose signature holds the model's own parameters, which are fitted beside them.

A lag shows as the difference of the model's outputs at two temperatures. The model was fitted without the lag, so that
a strong one has bent the very slopes that its signature $s$ is made of. Parameters $\\theta$ and setting $\\tau$ are
therefore made from each other,

$$\\theta \\leftarrow \\hat\\theta(y; s(\\theta, \\tau)), \\qquad \\tau \\leftarrow \\hat\\tau(y; s(\\theta, \\cdot)),$$

until the setting stays: alternating least squares for a model that is bilinear in the two.

**Reference:** Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, for models with separable variables.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast, Protocol

import equinox as eqx
import numpy as np

from ..candidates.signatures import coarsen, Term
from ..noise.observation_series import NoiseFit
from ..observations.model_rows import Baseline
from ..problem import Prepared, rebuilt
from ..selection.score_test import whiten_system
from .moments import tuned_moments
from .parameters import corrected, tune


ROUNDS = 8
STEADY = 0.1  # change of a setting, in its standard deviations, at which it stays
ALMOST = 0.01  # the same in parts of the setting where the data do not tell it


class Fitted(Protocol):
    """A fitted model's outputs at other temperatures: what a signal's `at_temperature` is in a diagnosis."""

    def with_parameters(self, base: Baseline, coefficients: np.ndarray) -> "Fitted":
        """The same for other parameters."""
        ...


def bilinear(term: Term) -> bool:
    """Whether the term's signature is made of the model's outputs."""
    return term.effect is not None and "at_temperature" in term.effect.requires


def refined(
    prepared: Prepared, noise: NoiseFit, chosen: Sequence[Term]
) -> tuple[Prepared, list[Term], list[float | None]]:
    """The chosen terms with their settings refined one after the other, and the settings' standard deviations.

    Where a signature holds the model's parameters, it is made anew from those that are fitted beside the chosen terms;
    of all rounds the one with the least sum of squares is kept, for the iteration need not converge.
    **Returns** the prepared triad that such signatures belong to as well.
    """
    terms, spread = _tuned(prepared, noise, chosen)
    if not any(map(bilinear, terms)):
        return prepared, terms, spread
    best = _misfit(prepared, noise, terms), prepared, terms, spread
    for _ in range(ROUNDS):
        now = _about(prepared, noise, terms)
        before = [_setting(t) for t in terms]
        anew = [rebuilt(now, t) if bilinear(t) else t for t in terms]
        terms, spread = _tuned(now, noise, anew)
        best = min(best, (_misfit(now, noise, terms), now, terms, spread), key=lambda b: b[0])
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


def _misfit(prepared: Prepared, noise: NoiseFit, terms: Sequence[Term]) -> float:
    return whiten_system(prepared.system, noise, [], terms).chi2


def _setting(term: Term) -> float:
    return term.setting if term.known.nuisance else 0.0


def _about(prepared: Prepared, noise: NoiseFit, chosen: Sequence[Term]) -> Prepared:
    """The triad with the model's outputs at other temperatures from the parameters beside the chosen terms."""
    base = prepared.system.base
    values, _ = corrected(prepared.system, noise, chosen)
    model = cast(Fitted, prepared.signal.at_temperature)
    signal = eqx.tree_at(
        lambda s: s.at_temperature, prepared.signal, model.with_parameters(base, values)
    )
    return replace(prepared, signal=signal, coarse=coarsen(signal, prepared.blocks))
