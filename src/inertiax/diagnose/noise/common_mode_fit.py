"""Fit of what the chains of a triad share: the rig's errors, beside each channel's own errors of positioning."""

from collections.abc import Sequence

import numpy as np
import scipy.linalg

from ...numerics.quasi_newton import minimise
from ..candidates.columns import unit
from ..candidates.signatures import Term
from .grouped_filter import whiten
from .observation_series import BOUNDS, NoiseFit, System
from .search_places import log_variances, places
from .state_space import stated_price


DWELL, RIG = 3, 6  # places of their log variances
STEP = 1e-3  # of differences for the slope: the likelihood's second ones are below a hundred
TOLERANCE = 0.02  # of log likelihoods; a model is chosen by differences of several
MOST_STEPS = 15
KEPT = 3  # whitened chains each: where a step began, where it ends, and beside it
LEAST_START = -4.0  # of a dwell variance, so that the search can tell which way to go


def recoupled(
    theta: Sequence[np.ndarray], coupled: Sequence[np.ndarray] | None
) -> tuple[np.ndarray, ...] | None:
    """Other log variances with the dwells' and the rig's of a coupled fit; `None` where there is none."""
    if coupled is None:
        return None
    made = []
    for own, other in zip(theta, coupled):
        own = own.copy()
        own[[DWELL, RIG]] = other[[DWELL, RIG]]
        made.append(own)
    return tuple(made)


def couple(
    system: System, theta: Sequence[np.ndarray], chosen: Sequence[Term], lean: float = 0.0
) -> tuple[np.ndarray, ...]:
    """Dwell variances of each chain and the rig's by the restricted likelihood of all chains together.

    One chain cannot tell its own dwell errors from those that the rig gives to all; what the chains have in
    common can. The other log variances are kept. `lean` is added to the log likelihood for each e-fold of a dwell
    variance of which other units tell nothing.
    """
    slant = np.array([0.0 if k.precision.any() else lean for k in system.known])
    value = JointLikelihood(system, chosen)
    first = [max(t[DWELL], LEAST_START) for t in theta]
    start = np.array([*places(np.array(first)), np.mean([t[RIG] for t in theta])])
    box = [*3 * [tuple(places(np.array(BOUNDS[DWELL])))], BOUNDS[RIG]]

    def at(place: np.ndarray) -> float:
        logs, _ = log_variances(place[:-1])
        return value(_with(theta, np.r_[logs, place[-1]])) - float(slant @ logs)

    def objective(place: np.ndarray) -> tuple[float, np.ndarray]:
        here, slope = at(place), np.zeros(len(place))
        for k in range(len(place)):
            aside = place.copy()
            aside[k] += STEP if place[k] + STEP <= box[k][1] else -STEP
            slope[k] = (at(aside) - here) / (aside[k] - place[k])
        return here, slope

    found = minimise(objective, start, box, tolerance=TOLERANCE, max_steps=MOST_STEPS).x
    return _with(theta, np.r_[log_variances(found[:-1])[0], found[-1]])


def _with(theta: Sequence[np.ndarray], values: np.ndarray) -> tuple[np.ndarray, ...]:
    """The log variances with three dwell variances and the rig's replaced."""
    made = []
    for own, dwell in zip(theta, values[:-1]):
        own = own.copy()
        own[DWELL], own[RIG] = dwell, values[-1]
        made.append(own)
    return tuple(made)


class JointLikelihood:
    """Minus the restricted log likelihood of all chains with the errors that they share, up to a constant.

    Whitening a chain takes most of the time, and of what a search varies it depends on the chain's own dwell variance
    alone: it is kept for the last ones that were asked for, which a step and its differences are.
    """

    def __init__(self, system: System, chosen: Sequence[Term]):
        assert system.shared is not None
        self._system = system
        self._shared = system.shared
        self._fixed: list[int] = []
        self._stacks: list[np.ndarray] = []
        self._known: dict[tuple[int, bytes], tuple[np.ndarray, float]] = {}
        for c, _ in enumerate(system.chains):
            size = system.scales[c][1] ** 0.5
            mine = [t.columns[t.chains.index(c)] for t in chosen if c in t.chains]
            base = np.concatenate([system.frames[c], *map(unit, mine)], axis=1)
            observed = system.base.observed[c][:, None]
            parts = [observed / size, base, self._shared.columns[c] / size]
            self._stacks.append(np.concatenate(parts, axis=1))
            self._fixed.append(base.shape[1])

    def __call__(self, theta: Sequence[np.ndarray]) -> float:
        system = self._system
        part = float(np.exp(0.5 * theta[0][RIG]) * system.scales[0][RIG] ** 0.5)
        total, grams, fixed = float(stated_price(float(theta[0][RIG]))), [], []
        for c, own in enumerate(theta):
            products, logdet = self._products(c, own)
            total += logdet + float(system.known[c].price(own))
            grams.append(products * system.scales[c][1])
            fixed.append(slice(1, 1 + self._fixed[c]))
        if not self._shared.num:
            return 0.5 * (total + _restricted(grams, fixed))
        shared = [slice(here.stop, None) for here in fixed]
        gram = np.eye(self._shared.num) + part**2 * sum(g[u, u] for g, u in zip(grams, shared))
        factor = np.linalg.cholesky(gram)
        total += 2.0 * float(np.log(np.diag(factor)).sum())
        solve = lambda x: scipy.linalg.solve_triangular(factor, part * x, lower=True)
        seen = solve(sum(g[u, 0] for g, u in zip(grams, shared)))
        square = sum(g[0, 0] for g in grams) - seen @ seen
        wide = solve(np.concatenate([g[u, x] for g, u, x in zip(grams, shared, fixed)], axis=1))
        inner = scipy.linalg.block_diag(*(g[x, x] for g, x in zip(grams, fixed))) - wide.T @ wide
        cross = np.concatenate([g[x, 0] for g, x in zip(grams, fixed)]) - wide.T @ seen
        value, vector = np.linalg.eigh(inner)
        good = value > 1e-11 * value[-1]
        part_of = vector[:, good].T @ cross
        square -= float(part_of @ (part_of / value[good]))
        return 0.5 * (total + float(square) + float(np.log(value[good]).sum()))

    def _products(self, c: int, own: np.ndarray) -> tuple[np.ndarray, float]:
        """Products of a chain's whitened columns, observed first, then fixed, then shared; and log determinant."""
        # Where the chain stands without any part of the rig's, its variance does not matter here.
        chain = self._shared.chains[c]
        matters = np.any(chain.rig) or np.any(chain.rig_of_dwell)
        key = c, (own if matters else np.delete(own, RIG)).tobytes()
        if key not in self._known:
            mine = [k for k in self._known if k[0] == c]
            for old in mine[: 1 - KEPT]:
                del self._known[old]
            variances = np.exp(own) * self._system.scales[c]
            white, logdet = whiten(self._shared.chains[c], variances, self._stacks[c])
            self._known[key] = white.T @ white, logdet
        self._known[key] = self._known.pop(key)  # the latest one stands last
        return self._known[key]


def _restricted(grams: Sequence[np.ndarray], fixed: Sequence[slice]) -> float:
    """The residual's square and the logarithm of the information's determinant, chain by chain."""
    total = 0.0
    for gram, here in zip(grams, fixed):
        value, vector = np.linalg.eigh(gram[here, here])
        good = value > 1e-11 * value[-1]
        part = vector[:, good].T @ gram[here, 0]
        total += float(gram[0, 0] - part @ (part / value[good]) + np.log(value[good]).sum())
    return total


def coupled_theta(noise: NoiseFit) -> tuple[np.ndarray, ...]:
    """Log variances where the rig's errors are kept apart; the chains' own where they were not fitted together."""
    return noise.theta if noise.coupled is None else noise.coupled
