"""Variance components of one triad's rows by restricted maximum likelihood."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ...numerics.quasi_newton import minimise, Minimum
from ..candidates.columns import span
from ..candidates.repeated_inputs import NAME as LEVELS
from ..candidates.signatures import Term
from .common_mode_fit import couple, recoupled
from .grouped_filter import groups_of
from .observation_series import BOUNDS, NoiseFit, STARTS, System
from .restricted_likelihood import RestrictedLikelihood
from .search_places import log_variances, places
from .state_space import Known, NUM_VARIANCES


LEARNED = [1, 2, 3, 4]  # flicker, walk, dwells and power cycles, which nothing but the rows tells
LEAN = 0.5  # log density of a log variance whose standard deviation has a flat one, for each e-fold
TOLERANCE = 1e-3  # of log likelihoods; a model is chosen by differences of several
EXTRA = 16  # columns of effects that a fit of variances has room for, beside a level of each input


def likelihood_inputs(
    system: System, c: int, chosen: Sequence[Term]
) -> tuple[
    Float[np.ndarray, " row"], Float[np.ndarray, "row column"], Float[np.ndarray, "row extra"]
]:
    """Residual, scaled baseline columns and scaled columns of the chosen terms of one chain."""
    y = system.base.observed[c]
    unit = float(np.sqrt(system.scales[c][1])) * np.sqrt(len(y))
    mine = [t.columns[t.chains.index(c)] for t in chosen if c in t.chains]
    extra = np.zeros((len(y), 0))
    if mine:
        # Levels are a test all together: what some of them leave of the others counts as scatter.
        room = EXTRA + sum(t.size for t in chosen if t.name == LEVELS and c in t.chains)
        extra = span(np.concatenate(mine, axis=1))[:, :room] * unit
    return y, system.frames[c] * unit, extra


def restricted(system: System, chain: int, chosen: Sequence[Term]) -> RestrictedLikelihood:
    """The restricted likelihood of one chain's variances with the chosen terms in the mean."""
    inputs = likelihood_inputs(system, chain, chosen)
    groups = groups_of(system.chains[chain])
    return RestrictedLikelihood(groups, system.scales[chain], system.known[chain], *inputs)


def likelihood(system: System, noise: NoiseFit, chosen: Sequence[Term], chain: int) -> float:
    """Minus the restricted log likelihood of the chosen terms on one chain under given variances."""
    return restricted(system, chain, chosen).value(noise.theta[chain])


def fit_noise(
    system: System,
    chosen: Sequence[Term] = (),
    start: NoiseFit | None = None,
    only: Sequence[int] | None = None,
    lean: float = 0.0,
) -> NoiseFit:
    """Restricted maximum likelihood of the variance components with the chosen terms in the mean.

    `only` limits the fit to some chains; the others are taken over from `start`. `lean` is added to the log
    likelihood for each e-fold of a learned variance (`interval_noise` says why).
    """
    thetas, values, curvatures = [], [], []
    for c in range(len(system.chains)):
        curvature = None if start is None else start.curvature_of(c)
        if start is not None and only is not None and c not in only:
            thetas.append(start.theta[c])
            values.append(start.value[c])
            curvatures.append(curvature)
            continue
        first = _starts(system.known[c]) if start is None else (start.theta[c],)
        found = _maximise(system, c, chosen, first, lean, curvature)
        thetas.append(found.x)
        values.append(found.value)
        curvatures.append(found.curvature)
    made = NoiseFit(tuple(thetas), tuple(values), curvature=tuple(curvatures))
    if system.shared is None:
        return made
    if only is not None and start is not None and start.coupled is not None:
        return replace(made, coupled=recoupled(made.theta, start.coupled))
    return replace(made, coupled=couple(system, made.theta, chosen, lean))


def interval_noise(system: System, noise: NoiseFit, chosen: Sequence[Term]) -> NoiseFit:
    """Variances that standard deviations are stated with, from those of the search.

    A variance that the rows hardly tell has its restricted likelihood at a maximum near zero and a long tail above,
    and an interval made at the maximum is too short. Here the maximum is that of the density of the log variances
    where every standard deviation was as likely as any other beforehand: half is added to the log likelihood for
    each e-fold of the flicker's, walk's, dwells' and power cycles' variance. Where other units tell of a chain's
    noise, nothing is added.

    **Reference:** Gelman, Bayesian Analysis 1 (2006) 515, for the density flat in the standard deviation; Chung et
    al., Psychometrika 78 (2013) 685, for its maximum, which keeps off zero.
    """
    return fit_noise(system, chosen, noise, lean=LEAN)


def _starts(known: Known) -> tuple[np.ndarray, ...]:
    if not known.precision.any():
        return STARTS
    low, high = np.transpose(BOUNDS)
    return (*STARTS, np.clip(known.center, low, high))


def _maximise(
    system: System,
    c: int,
    chosen: Sequence[Term],
    starts: Sequence[np.ndarray],
    lean: float,
    curvature: np.ndarray | None,
) -> Minimum:
    """The likeliest variances of a chain; what was asked before is known.

    Beside each choice the leading candidates of all chains are fitted again, of which most chains have not changed.
    """
    known, mine = system.known[c], tuple(t for t in chosen if c in t.chains)
    asked = [known.center, known.precision, *starts, *([] if curvature is None else [curvature])]
    key = (mine, lean, curvature is None, *(np.asarray(a).tobytes() for a in asked))
    fitted = groups_of(system.chains[c]).fitted
    if key not in fitted:
        fitted[key] = _searched(system, c, chosen, starts, lean, curvature)
    return fitted[key]


def _searched(
    system: System,
    c: int,
    chosen: Sequence[Term],
    starts: Sequence[np.ndarray],
    lean: float,
    curvature: np.ndarray | None,
) -> Minimum:
    rows = restricted(system, c, chosen)
    slant = np.zeros(NUM_VARIANCES)
    if not system.known[c].precision.any():
        slant[LEARNED] = lean

    def objective(place: np.ndarray) -> tuple[float, np.ndarray]:
        theta, stretch = _from_search(place)
        value, slope = rows.value_and_slope(theta)
        value -= float(slant @ theta)
        if not np.isfinite(value):
            return 1e12, np.zeros(len(theta))
        return value, (slope - slant) * stretch

    box = np.transpose([_to_search(np.array(edge)) for edge in np.transpose(BOUNDS)])
    found = [
        minimise(
            objective, _to_search(s), box, curvature=curvature, tolerance=TOLERANCE, max_steps=40
        )
        for s in starts
    ]
    best = min(found, key=lambda f: f.value)
    rows.keep_best()
    return best._replace(x=_from_search(best.x)[0])


def _to_search(theta: np.ndarray) -> np.ndarray:
    """Log variances as the search has them: those that the rows alone tell at their places."""
    made = theta.copy()
    made[LEARNED] = places(theta[LEARNED])
    return made


def _from_search(place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    theta, stretch = place.copy(), np.ones(len(place))
    theta[LEARNED], stretch[LEARNED] = log_variances(place[LEARNED])
    return theta, stretch
