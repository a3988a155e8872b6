"""What is not known of named effects beside their coefficients, and how it changes the rows.

A coefficient's covariance is that at one setting. Where the setting k is off, such as a time constant, what is taken
away from the outputs changes by

    d = [s(k + σ/2) c(k + σ/2) − s(k − σ/2) c(k − σ/2)] / σ,

with the signatures s and the coefficients c that belong to each setting. A coefficient that theory gives stays: the
setting was told at that one, and beside it a free one would take back what the setting changes. How warm elements were
after a pause is an estimate, too, and one with the time constant: a longer lag beside warmer elements is much the same
on most rows. So all of these are taken jointly, by their information beside the model and the free coefficients.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...effects import Variant
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit
from ..problem import Prepared, retuned
from ..selection.score_test import whiten_system
from .at_elements import seen_by_elements
from .common_size import held_to_common_size
from .separable import after_pauses, numbers_of_pauses


Rows = dict[int, Float[np.ndarray, " row"]]  # by chain


class Unknown(NamedTuple):
    """Changes of the rows by a unit of each unknown, and the unknowns' covariance."""

    term: Term  # a column an unknown
    covariance: Float[np.ndarray, "unknown unknown"]
    prepared: Prepared  # with the parameters' columns where the elements were


def unknown_settings(
    prepared: Prepared, noise: NoiseFit, terms: Sequence[Term], spread: Sequence[float | None]
) -> Unknown | None:
    """Settings with these standard deviations and elements after pauses; `None` where there is none of both.

    The settings' variances are those of their profiles, which are lopsided; the information tells how the other
    unknowns go with them.
    """
    settings = [
        _by_setting(prepared, noise, terms, k, std)
        for k, std in enumerate(spread)
        if std is not None and std > 0.0 and terms[k].known.nuisance
    ]
    widths = [s for s, t in zip(spread, terms) if s is not None and s > 0.0 and t.known.nuisance]
    pauses = _by_pauses(prepared, terms)
    unknown = [*settings, *pauses]
    if not unknown:
        return None
    chains = tuple(sorted({c for rows in unknown for c in rows}))
    zero = {c: np.zeros(len(prepared.system.base.observed[c])) for c in chains}
    columns = tuple(np.stack([rows.get(c, zero[c]) for rows in unknown], axis=1) for c in chains)
    made = Term(
        "unknown",
        prepared.form.triad,
        tuple(c for c in chains if c < 3),
        Variant("", {}),
        chains,
        columns,
    )
    free = [t for t in terms if not t.known.unit_amplitude]
    # A lag's time constant moves the parameters as the elements' temperatures tell them: at the probe's, which reach
    # further, it would seem better known beside them, and they beside it.
    seen = seen_by_elements(prepared, terms)
    scores = whiten_system(seen.system, noise, [made], free).scores
    covariance = scores[0].covariance if scores else np.zeros((len(unknown), len(unknown)))
    if pauses:  # °C: an element was nowhere that the probe never was
        least = np.zeros(len(unknown))
        least[len(settings) :] = 1.0 / float(np.ptp(np.asarray(prepared.signal.temperature))) ** 2
        root = np.sqrt(least)
        inner = np.eye(len(unknown)) + root[:, None] * covariance * root
        covariance = covariance - (covariance * root) @ np.linalg.solve(
            inner, root[:, None] * covariance
        )
    for k, std in enumerate(widths):
        variance = covariance[k, k]
        beside = covariance[:, k] / variance if variance > 0.0 else np.eye(len(unknown))[k]
        covariance = covariance + (std**2 - variance) * np.outer(beside, beside)
    return Unknown(made, covariance, seen)


def _by_setting(
    prepared: Prepared, noise: NoiseFit, terms: Sequence[Term], k: int, std: float
) -> Rows:
    """Change of the rows by a unit of a term's setting, over half a standard deviation each way."""
    term, centre = terms[k], terms[k].setting
    # A setting is positive, and one that is hardly known is not followed to zero.
    low, high = max(centre - 0.5 * std, 0.5 * centre), centre + 0.5 * std
    beside = [[*terms[:k], one, *terms[k + 1 :]] for one in retuned(prepared, term, [low, high])]
    if term.known.unit_amplitude:
        held = _coefficients(prepared, noise, terms)
        first, last = (_added(one, held) for one in beside)
    else:
        first, last = (_added(one, _coefficients(prepared, noise, one)) for one in beside)
    return {c: (last[c] - first[c]) / (high - low) for c in first}


def _coefficients(
    prepared: Prepared, noise: NoiseFit, terms: Sequence[Term]
) -> list[Float[np.ndarray, " column"]]:
    """Joint coefficients of the terms; zero of those that the rows do not tell."""
    made = []
    for k, term in enumerate(terms):
        others = [*terms[:k], *terms[k + 1 :]]
        found = whiten_system(prepared.system, noise, [term], others).scores
        values = np.zeros(term.size)
        if found:
            values, _ = held_to_common_size(found[0].coefficients, found[0].covariance)
        made.append(values)
    return made


def _added(terms: Sequence[Term], coefficients: Sequence[Float[np.ndarray, " column"]]) -> Rows:
    """What the terms add to the rows of each chain."""
    made: Rows = {}
    for term, values in zip(terms, coefficients, strict=True):
        for chain, columns in zip(term.chains, term.columns):
            made[chain] = made.get(chain, 0.0) + columns @ values
    return made


def _by_pauses(prepared: Prepared, terms: Sequence[Term]) -> list[Rows]:
    """Change of the rows by a degree that elements were warmer after each pause, on all chains alike."""
    made: dict[int, Rows] = {}
    for term in after_pauses(prepared, terms):
        for number, column in zip(numbers_of_pauses(prepared, term), term.columns[0].T):
            rows = made.setdefault(number, {})
            rows[term.chains[0]] = rows.get(term.chains[0], 0.0) + column
    return list(made.values())
