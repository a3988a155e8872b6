"""The calibration beside the named effects: the same model, estimated in the same way, on outputs without them.

What a named effect adds to the outputs, with the coefficients of the joint fit, is taken away from every sample, and
the campaign is calibrated again as it was before. The coefficients' own uncertainty passes into the parameters by

    C ← C + S Σ Sᵀ,    S = −(XᵀWX)⁻¹ XᵀW E,

with the model's columns X and the effects' columns E on the blocks, weighted by the white noise, and the covariance
Σ of the effects' coefficients. So does that of their settings (`unknown_settings`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..._jax import eqx
from ...calibrate.pipeline import calibrate_device, DeviceResult
from ...calibrate.results import TriadResult
from ...calibration.calibration import Calibration, TriadCalibration
from ...calibration.fitted_effects import FittedEffect
from ...effects import addition
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit
from ..observations.blocks import Log
from ..observations.log_outputs import with_outputs
from ..problem import Prepared, Problem
from ..selection.evidence import Candidate
from ..selection.verdict import Named
from .applied_effects import fitted_effects
from .at_elements import extrapolated, left_to_the_probe, taken_up
from .unknown_settings import Unknown, unknown_settings


@dataclass(frozen=True, eq=False)
class Beside:
    """The effects that were named on one triad, with what is stored of each."""

    prepared: Prepared
    terms: tuple[Term, ...]
    stored: tuple[FittedEffect, ...]
    # With the rivals that the data do not exclude: those of `terms` in their order, then such as no size is told of.
    named: tuple[Named, ...] = ()
    unknown: Unknown | None = None  # of their settings
    withheld: tuple[Named, ...] = ()  # found, and not applied (`withheld_effects`)

    @classmethod
    def of(
        cls,
        prepared: Prepared,
        noise: NoiseFit,
        named: Sequence[tuple[Named, Term, float | None]],
    ) -> "Beside":
        """The names with their refined terms, and the standard deviations of their settings, that have coefficients and
        whose channels are told.

        |f| is the same with an effect on any of the channels that may have it, and on a wrong one f is further off
        than without it.
        """
        pairs = fitted_effects(prepared, noise, [t for _, t, _ in named])
        told = {id(t): n for n, t, _ in named if not n.elsewhere}
        spread = {id(t): std for _, t, std in named}
        pairs = [(t, s) for t, s in pairs if id(t) in told]
        terms, stored = tuple(t for t, _ in pairs), tuple(s for _, s in pairs)
        unknown = unknown_settings(prepared, noise, terms, [spread[id(t)] for t in terms])
        own = {id(t): told[id(t)] for t in terms}
        every = (*own.values(), *(n for key, n in told.items() if key not in own))
        return cls(prepared, terms, stored, every, unknown)


def augmented_calibration(
    problem: Problem, named: Sequence[Beside], further: Sequence[FittedEffect], notes: Sequence[str]
) -> tuple[Calibration, DeviceResult]:
    """The calibration of the campaign beside the named effects, and the estimate behind it, which is without their
    uncertainty.

    **Arguments:** `further` are effects that the problem's campaign was freed from before, such as a delay.
    Raises `ValueError` where the campaign without the effects cannot be calibrated.
    """
    log = problem.log
    for one in named:
        log = without_effects(log, one)
    campaign = with_outputs(problem.campaign, log)
    estimate = calibrate_device(
        campaign, model=problem.plain.model, checked=True, segments=problem.plain.segments
    )
    estimate = replace(estimate, choices=problem.plain.choices)  # of a given model it has none
    found = estimate.calibration
    found = _rounded(found, estimate, problem.plain)
    for one in named:
        triad = one.prepared.form.triad
        if getattr(found, triad) is None:
            continue  # one pose at one temperature: the effects are all that is told of the accelerometers
        widened = _widened(_extrapolated(getattr(found, triad), getattr(estimate, triad), one), one)
        found = eqx.tree_at(lambda c, t=triad: getattr(c, t), found, widened)
    stored = (effect for one in named for effect in one.stored)
    named_beside = replace(
        found,
        notes=(*problem.plain.calibration.notes, *notes),
        effects=(*found.effects, *stored, *further),
    )
    return named_beside, estimate


def _rounded(found: Calibration, estimate: DeviceResult, plain: DeviceResult) -> Calibration:
    """The calibration with what the gyros' rests err alike: outputs without an effect show no steps any more."""
    before, now = plain.gyro, estimate.gyro
    if before is None or now is None or before.rounding is None or now.rounding is not None:
        return found
    added = np.asarray(before.rounding)
    if found.gyro is None or np.shape(found.gyro.covariance) != added.shape:
        return found
    whole = np.asarray(found.gyro.covariance) + added
    return eqx.tree_at(lambda c: c.gyro.covariance, found, whole)


def without_effects(log: Log, one: Beside) -> Log:
    """The log with the outputs that the triad would have had without its named effects."""
    triad = one.prepared.form.triad
    added = np.zeros((len(log.time), 3))
    for term, stored in zip(one.terms, one.stored):
        count = len(np.asarray(stored.coefficients))
        coefficients = np.zeros((3, count))
        coefficients[list(term.channels)] = np.asarray(stored.coefficients)
        shape = addition(term.known, coefficients, term.variant, one.prepared.signal)
        added += np.asarray(shape)
    # Where the device moves without a reference, an effect of the input may be no number; no row is made of it.
    output = getattr(log, triad) - np.where(np.isfinite(added), added, 0.0)
    return eqx.tree_at(lambda x: getattr(x, triad), log, output)


def _extrapolated(
    triad: TriadCalibration, fitted: TriadResult | None, one: Beside
) -> TriadCalibration:
    """The triad's calibration with what elements that were at other temperatures than the probe's take from it."""
    fit = None if fitted is None else np.asarray(fitted.solution.covariance, float)
    whole = np.asarray(triad.covariance, float)
    if fit is None or fit.shape != whole.shape or not one.terms:
        return triad
    more = extrapolated(one.prepared, one.terms, fit, len(triad.names))
    return eqx.tree_at(lambda t: t.covariance, triad, whole + more)


def _widened(triad: TriadCalibration, one: Beside) -> TriadCalibration:
    r"""The triad's calibration with the uncertainty of the effects beside it.

    The effects' covariance is carried to the parameters, and what their settings may be off by (`unknown_settings`).
    Where names are left that the data do not tell apart, the parameters would be others under another name: with the
    odds $p_k$ of a rival and the difference $d_k$ that its estimate makes, $\sum p_k d_k d_k^T$ is added, the mean
    square about the calibration that is written. A withheld effect is one of the names by which that one is off.
    """
    size, count = np.asarray(triad.curve.coefficients).shape
    covariance = np.array(triad.covariance, float)
    for term, stored in zip(one.terms, one.stored):
        slope = _slope(one.prepared, term, count, size)
        covariance += slope @ np.asarray(stored.covariance) @ slope.T
    if one.unknown is not None:
        seen, term = one.unknown.prepared, one.unknown.term
        slope = _slope(seen, term, count, size)
        if seen is not one.prepared:
            slope = slope + _slope(one.prepared, left_to_the_probe(seen, term), count, size)
        covariance += slope @ one.unknown.covariance @ slope.T
    for named in one.named:
        lead = shift_by(one.prepared, named.candidate, triad)
        for part, rival in zip(named.odds[1:], named.rivals, strict=True):
            if rival.score.term is not rival.term:
                continue  # kept for what it predicts, without a size of its own
            apart = shift_by(one.prepared, rival, triad) - lead
            covariance += part * np.outer(apart, apart)
    for named in one.withheld:
        names = (named.candidate, *named.rivals)
        for part, name in zip(named.odds, names, strict=True):
            if name.score.term is name.term:
                apart = shift_by(one.prepared, name, triad)
                covariance += part * np.outer(apart, apart)
    return eqx.tree_at(lambda t: t.covariance, triad, covariance)


def shift_by(
    prepared: Prepared, candidate: Candidate, triad: TriadCalibration
) -> Float[np.ndarray, " unknowns"]:
    """Change of the calibration's coefficients, row-major, by an effect of the size that it was found with."""
    size, count = np.shape(triad.curve.coefficients)
    return _slope(prepared, candidate.term, count, size) @ candidate.score.coefficients


def _slope(
    prepared: Prepared, term: Term, count: int, size: int
) -> Float[np.ndarray, "unknowns coefficients"]:
    """Change of the calibration's coefficients, row-major (size, parameters), by the term's."""
    system = prepared.system
    slope = np.zeros((size * count, term.size))
    for c, columns in zip(term.chains, term.columns):
        step = taken_up(prepared, c, columns)
        number, power = np.divmod(system.base.index[c], size)
        # Lever arms are effects of the calibration, not parameters of the triad
        own = number < count
        slope[power[own] * count + number[own]] = -step[own]
    return slope
