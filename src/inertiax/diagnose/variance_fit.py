"""Variance components of one triad's rows by restricted maximum likelihood."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.optimize

from .columns import lengthen, span
from .coupling import couple, recoupled
from .system import BOUNDS, NoiseFit, STARTS, System
from .terms import Term
from .whiten import Known, value_and_gradient


COLUMNS = 10  # the baseline's columns are padded to a multiple
EXTRA = 16  # columns of effects that a fit of variances has room for


def likelihood_inputs(system: System, c: int, chosen: Sequence[Term]) -> tuple[np.ndarray, ...]:
    """Residual, scaled baseline columns and padded columns of the chosen terms of one chain."""
    y = system.base.observed[c]
    unit = float(np.sqrt(system.scales[c][1])) * np.sqrt(len(y))
    extra = np.zeros((len(y), EXTRA))
    mine = [t.columns[t.chains.index(c)] for t in chosen if c in t.chains]
    if mine:
        found = span(np.concatenate(mine, axis=1))[:, :EXTRA]
        extra[:, : found.shape[1]] = found * unit
    frame = system.frames[c] * unit
    wide = -(-frame.shape[1] // COLUMNS) * COLUMNS
    return lengthen(y), lengthen(frame, wide), lengthen(extra)


def likelihood(system: System, noise: NoiseFit, chosen: Sequence[Term], chain: int) -> float:
    """Minus the restricted log likelihood of the chosen terms on one chain under given variances."""
    inputs = likelihood_inputs(system, chain, chosen)
    theta, scale = noise.theta[chain], system.scales[chain]
    return float(
        value_and_gradient(theta, scale, system.longer[chain], *inputs, system.known[chain])[0]
    )


def fit_noise(
    system: System,
    chosen: Sequence[Term] = (),
    start: NoiseFit | None = None,
    only: Sequence[int] | None = None,
) -> NoiseFit:
    """Restricted maximum likelihood of the variance components with the chosen terms in the mean.

    `only` limits the fit to some chains; the others are taken over from `start`.
    """
    thetas, values = [], []
    for c in range(len(system.chains)):
        if start is not None and only is not None and c not in only:
            thetas.append(start.theta[c])
            values.append(start.value[c])
            continue
        first = _starts(system.known[c]) if start is None else (start.theta[c],)
        theta, value = _maximise(system, c, chosen, first)
        thetas.append(theta)
        values.append(value)
    made = NoiseFit(tuple(thetas), tuple(values))
    if system.shared is None:
        return made
    if only is not None and start is not None and start.coupled is not None:
        return replace(made, coupled=recoupled(made.theta, start.coupled))
    return replace(made, coupled=couple(system, made.theta, chosen))


def _starts(known: Known) -> tuple[np.ndarray, ...]:
    if not known.precision.any():
        return STARTS
    low, high = np.transpose(BOUNDS)
    return (*STARTS, np.clip(known.center, low, high))


def _maximise(
    system: System, c: int, chosen: Sequence[Term], starts: Sequence[np.ndarray]
) -> tuple[np.ndarray, float]:
    inputs = likelihood_inputs(system, c, chosen)

    def objective(theta: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = value_and_gradient(
            theta, system.scales[c], system.longer[c], *inputs, system.known[c]
        )
        value = float(value)
        return (value, np.asarray(slope)) if np.isfinite(value) else (1e12, np.zeros(len(theta)))

    options = {"ftol": 1e-7, "gtol": 5e-2, "maxiter": 40}
    found = [
        scipy.optimize.minimize(
            objective, s, jac=True, method="L-BFGS-B", bounds=BOUNDS, options=options
        )
        for s in starts
    ]
    best = min(found, key=lambda f: f.fun)
    return best.x, float(best.fun)
