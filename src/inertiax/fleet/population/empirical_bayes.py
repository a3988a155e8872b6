"""Devices of short programmes: their dwells together with what is known of the line (empirical Bayes).

With the population N(μ, Σ) and Σ = L Lᵀ a device is θ = μ + L z, and its estimate minimises

    Σ_n ‖r_n(θ)‖² + ‖z‖²,   cov(θ̂) = L (JᵀJ + E)⁻¹ Lᵀ,   J = ∂r/∂z,

through the one least-squares entry. What the dwells tell follows them, what they do not tell stays with the
line's mean and its spread; every unknown is determined, from the first position on.

**Reference:** Lindley & Smith, *Bayes estimates for the linear model*, J. R. Stat. Soc. B 34 (1972) 1.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._typing import AnyArray
from ...estimators import AbstractEstimator, NOMINAL_SIGMA
from ...numerics.least_squares import least_squares
from ...physics.temperature import AbstractBasis
from ...procedure.shared_errors import shared_errors
from ...reduction.dwells import Dwells
from ..solve.batch import FleetFit
from .population import TriadPopulation


LANES = 64  # devices solved at once
UNLIKE = 1e-6  # chance below which a device is not one of the line


class InformedFit(eqx.Module):
    """Estimates with a prior, and how the devices agree with it."""

    fit: FleetFit
    told: Float[np.ndarray, " devices"]  # of the unknowns, how many the dwells tell
    away: Float[np.ndarray, " devices"]  # ‖z‖², about `told` for a device of the line


class _Solved(eqx.Module):
    parameters: Float[AnyArray, "*devices unknowns"]
    covariance: Float[AnyArray, "*devices unknowns unknowns"]
    misfit: Float[AnyArray, "*devices dwells rows"]
    own: Float[AnyArray, "*devices dwells rows"]
    told: Float[AnyArray, " *devices"]
    away: Float[AnyArray, " *devices"]
    converged: Bool[AnyArray, " *devices"]
    num_steps: Int[AnyArray, " *devices"]


def fit_informed(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells, prior: TriadPopulation
) -> InformedFit:
    """Calibrate one triad of many devices with a prior.

    `dwells` has a leading device axis, see `stack_dwells`. The scatter between a device's dwells is the
    line's typical one, or more where its own misfit shows more (Paule and Mandel 1982).
    """
    valid = np.asarray(dwells.valid)
    mean, lower = jnp.asarray(np.array(prior.mean)), jnp.asarray(_factor(prior.prior_covariance))
    known = prior.scatter
    solve = partial(_in_chunks, estimator, basis, dwells, mean, lower)
    own = np.asarray(_own_sigma(estimator, jax.tree.map(jnp.asarray, dwells)))
    noisy = np.all((own > 0) | ~valid[:, :, None], axis=(1, 2))
    scatter = np.where(noisy, known, known or NOMINAL_SIGMA)
    found = solve(scatter, np.arange(len(valid)))
    chi2 = _chi2_per_dof(found, valid, noisy)
    for _ in range(2):
        settled = np.maximum(_scatter(found, valid, scatter), np.where(noisy, known, scatter))
        changed = np.flatnonzero(np.abs(settled - scatter) > 1e-3 * settled)
        if not len(changed):
            break
        scatter = settled
        again = solve(scatter[changed], changed)
        found = jax.tree.map(partial(_put, rows=changed), found, again)
    fit = FleetFit(
        parameters=np.asarray(found.parameters),
        covariance=np.asarray(found.covariance),
        misfit=np.asarray(found.misfit),
        own_sigma=np.asarray(found.own),
        valid=valid,
        scatter=scatter,
        chi2_per_dof=chi2,
        converged=np.asarray(found.converged),
        num_steps=np.asarray(found.num_steps),
    )
    return InformedFit(fit, np.asarray(found.told), np.asarray(found.away))


def judge_informed(
    triad: str, found: InformedFit, prior: TriadPopulation
) -> tuple[str | None, ...]:
    """For each device `None`, or in words that it is not one of the line although only the line says what
    its dwells do not. Hotelling's T² in the directions that the dwells tell; the prior's own devices must
    be more than those directions."""
    from scipy.stats import f

    unknowns = found.fit.parameters.shape[1]
    told = np.maximum(found.told, 1.0)
    free = np.maximum(prior.devices - told, 1.0)
    ratio = found.away / told * free / (prior.devices - 1)
    unlike = (f.sf(ratio, told, free) < UNLIKE) & (prior.devices > told + 1)
    return tuple(
        f"{triad}: unlike the prior's devices: {np.sqrt(far / told):.1f} times as far from their "
        f"mean as they are, and the dwells tell only {told:.0f} of {unknowns} unknowns; record a full "
        "programme"
        if bad and told < unknowns - 1
        else None
        for bad, told, far in zip(unlike, told, found.away, strict=True)
    )


def _factor(covariance: np.ndarray) -> np.ndarray:
    scale = np.sqrt(np.diagonal(covariance))
    return scale[:, None] * np.linalg.cholesky(covariance / (scale[:, None] * scale[None, :]))


def _put(whole: np.ndarray, part: np.ndarray, *, rows: np.ndarray) -> np.ndarray:
    result = whole.copy()
    result[rows] = part
    return result


def _in_chunks(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    mean: Array,
    lower: Array,
    scatter: np.ndarray,
    rows: np.ndarray,
) -> _Solved:
    """`scatter` belongs to the devices `rows`; chunks share one compiled shape."""
    count = len(rows)
    size = min(LANES, 1 << max(count - 1, 0).bit_length())
    parts = []
    for start in range(0, count, size):
        mine = np.minimum(np.arange(start, start + size), count - 1)
        part = jax.tree.map(lambda x, r=rows[mine]: np.asarray(x)[r], dwells)
        solved = _solve(estimator, basis, part, mean, lower, jnp.asarray(scatter[mine]))
        parts.append(jax.tree.map(np.asarray, solved))
    return jax.tree.map(lambda *x: np.concatenate(x)[:count], *parts)


@eqx.filter_jit
def _own_sigma(estimator: AbstractEstimator, dwells: Dwells) -> Float[Array, "devices dwells rows"]:
    """Standard deviation of a misfit by the dwell's own noise; no estimator's depends on the parameters."""
    ideal = jnp.zeros(estimator.num_parameters)
    return jax.vmap(jax.vmap(lambda d: estimator.misfit(ideal, d)[1]))(dwells)


@eqx.filter_jit
def _solve(estimator, basis, dwells, mean, lower, scatter) -> _Solved:
    one = partial(_one, estimator, basis, mean, lower)
    return jax.vmap(one)(jax.tree.map(jnp.asarray, dwells), scatter)


def _one(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    mean: Float[Array, " unknowns"],
    lower: Float[Array, "unknowns unknowns"],
    device: Dwells,
    scatter: Float[Array, ""],
) -> _Solved:
    phi = jax.vmap(basis)(device.temperature)
    weighted = eqx.tree_at(lambda e: e.scatter, estimator, scatter)
    shared = shared_errors(weighted, device)

    def vectors(z: AnyArray) -> Array:
        return phi @ (mean + lower @ z).reshape(basis.size, -1)

    def residual(z: Array, args: None) -> Array:
        del args
        rows = jax.vmap(weighted.residual)(vectors(z), device)
        kept = jnp.where(device.valid[:, None], rows, jnp.zeros_like(rows))
        if shared is not None:
            kept = shared.decorrelated(kept[..., None])[..., 0]
        return jnp.concatenate([kept.reshape(-1), z])

    found = least_squares(residual, jnp.zeros_like(mean))
    misfit, own = jax.vmap(estimator.misfit)(vectors(found.parameters), device)
    if shared is not None:
        rows = jax.vmap(weighted.residual)(vectors(found.parameters), device)
        misfit = shared.of_misfit(misfit, jnp.where(device.valid[:, None], rows, 0.0))
    return _Solved(
        parameters=mean + lower @ found.parameters,
        covariance=lower @ found.covariance @ lower.T,
        misfit=jnp.where(device.valid[:, None], misfit, jnp.zeros_like(misfit)),
        own=own,
        told=mean.shape[0] - jnp.trace(found.covariance),
        away=jnp.sum(jnp.square(found.parameters)),
        converged=found.succeeded,
        num_steps=found.num_steps,
    )


def _freedom(found: _Solved, valid: np.ndarray) -> np.ndarray:
    """Mean of Σ r² where the model holds: rows less what the dwells tell."""
    return valid.sum(axis=1) * found.misfit.shape[2] - np.asarray(found.told)


def _chi2_per_dof(found: _Solved, valid: np.ndarray, noisy: np.ndarray) -> np.ndarray:
    kept = valid[:, :, None] & (np.asarray(found.own) > 0)
    ratio = np.divide(
        np.asarray(found.misfit), np.asarray(found.own), out=np.zeros(kept.shape), where=kept
    )
    total, dof = np.square(ratio).sum(axis=(1, 2)), _freedom(found, valid)
    return np.where(noisy & (dof > 0.5), total / np.maximum(dof, 0.5), np.nan)


def _scatter(found: _Solved, valid: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Extra sigma with which Σ r² is what it should be; `now` where that is within its 99 % point."""
    from scipy.stats import chi2

    kept = np.broadcast_to(valid[:, :, None], found.misfit.shape)
    r2 = np.where(kept, np.square(found.misfit), 0.0)
    s2 = np.where(kept, np.square(found.own), 1.0)
    dof = np.maximum(_freedom(found, valid), 0.5)

    def total(t2: np.ndarray) -> np.ndarray:
        return np.divide(r2, s2 + t2[:, None, None], out=np.zeros_like(r2), where=kept).sum(
            axis=(1, 2)
        )

    quiet = total(np.square(now)) <= chi2.isf(0.01, dof)
    low, high = np.square(now), np.maximum(np.square(now), r2.sum(axis=(1, 2)) / dof)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = total(middle) > dof
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.where(quiet | ~np.isfinite(high), now, np.sqrt(high))
