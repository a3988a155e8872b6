"""Fit of what the chains of a triad share: the rig's errors, beside each channel's own errors of positioning."""

from collections.abc import Sequence

import numpy as np
import scipy.linalg
import scipy.optimize

from ..candidates.columns import lengthen, unit
from ..candidates.signatures import Term
from .observation_series import BOUNDS, NoiseFit, System
from .state_space import unpack, whiten_jit


DWELL, RIG = 3, 6  # places of their log variances
WIDE = 384  # columns are padded to a multiple, so that few programs are compiled
TRIES = 70  # evaluations of the likelihood
LEAST_START = -4.0  # of a dwell variance, so that the search can tell which way to go
_SIMPLEX = np.concatenate([np.zeros((1, 4)), np.diag([1.0, 1.0, 1.0, -0.7])])


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
    low, high = BOUNDS[DWELL][0], BOUNDS[DWELL][1]
    first = [max(t[DWELL], LEAST_START) for t in theta]
    start = np.array([*first, np.mean([t[RIG] for t in theta])])

    def objective(x: np.ndarray) -> float:
        inside = np.r_[np.clip(x[:-1], low, high), np.clip(x[-1], *BOUNDS[RIG])]
        value = joint_likelihood(system, _with(theta, inside), chosen)
        return value - float(slant @ inside[:-1]) + float(np.sum((x - inside) ** 2))

    options = {
        "maxfev": TRIES,
        "xatol": 0.1,
        "fatol": 0.05,
        "initial_simplex": start + _SIMPLEX,
    }
    found = scipy.optimize.minimize(objective, start, method="Nelder-Mead", options=options).x
    found = np.r_[np.clip(found[:-1], low, high), np.clip(found[-1], *BOUNDS[RIG])]
    return _with(theta, found)


def _with(theta: Sequence[np.ndarray], values: np.ndarray) -> tuple[np.ndarray, ...]:
    """The log variances with three dwell variances and the rig's replaced."""
    made = []
    for own, dwell in zip(theta, values[:-1]):
        own = own.copy()
        own[DWELL], own[RIG] = dwell, values[-1]
        made.append(own)
    return tuple(made)


def joint_likelihood(system: System, theta: Sequence[np.ndarray], chosen: Sequence[Term]) -> float:
    """Minus the restricted log likelihood of all chains with the errors that they share, up to a constant."""
    shared = system.shared
    assert shared is not None
    part = float(np.exp(theta[0][RIG]) * system.scales[0][RIG])
    total, signatures, fixed, observed = 0.0, [], [], []
    for c, own in enumerate(theta):
        size = system.scales[c][1] ** 0.5
        mine = [t.columns[t.chains.index(c)] for t in chosen if c in t.chains]
        base = np.concatenate([system.frames[c], *map(unit, mine)], axis=1)
        columns = shared.columns[c] * np.sqrt(part) / size
        stack = np.concatenate([system.base.observed[c][:, None] / size, base, columns], axis=1)
        v = unpack(own, system.scales[c])
        rows = lengthen(stack, -(-stack.shape[1] // WIDE) * WIDE)
        white, logdet = whiten_jit(v, shared.chains[c], rows)
        white = np.asarray(white)[: len(stack), : stack.shape[1]]
        total += float(logdet)
        observed.append(white[:, 0] * size)
        fixed.append(white[:, 1 : 1 + base.shape[1]] * size)
        signatures.append(white[:, 1 + base.shape[1] :] * size)
        total += float(system.known[c].price(own))
    gram = np.eye(shared.num) + sum(u.T @ u for u in signatures)
    factor = np.linalg.cholesky(gram)
    total += 2.0 * float(np.log(np.diag(factor)).sum())
    solve = lambda x: scipy.linalg.solve_triangular(factor, x, lower=True)
    seen = solve(sum(u.T @ y for u, y in zip(signatures, observed)))
    square = sum(y @ y for y in observed) - seen @ seen
    wide = solve(np.concatenate([u.T @ x for u, x in zip(signatures, fixed)], axis=1))
    inner = scipy.linalg.block_diag(*(x.T @ x for x in fixed)) - wide.T @ wide
    cross = np.concatenate([x.T @ y for x, y in zip(fixed, observed)]) - wide.T @ seen
    value, vector = np.linalg.eigh(inner)
    good = value > 1e-11 * value[-1]
    part_of = vector[:, good].T @ cross
    square -= float(part_of @ (part_of / value[good]))
    return 0.5 * (total + float(square) + float(np.log(value[good]).sum()))


def coupled_theta(noise: NoiseFit) -> tuple[np.ndarray, ...]:
    """Log variances where the rig's errors are kept apart; the chains' own where they were not fitted together."""
    return noise.theta if noise.coupled is None else noise.coupled
