"""How devices of one line differ: mean and covariance between them, freed from their own uncertainty.

    θ̂_d ~ N(θ_d, C_d),   θ_d ~ N(μ, Σ)

with θ_d the coefficients of device d, θ̂_d their estimate and C_d its known covariance. Σ is found by the
EM iteration for the restricted likelihood (REML: as if μ had been integrated out),

    W_d = (Σ + C_d)⁻¹,   μ = V Σ_d W_d θ̂_d,   V = (Σ_d W_d)⁻¹,   u_d = W_d (θ̂_d − μ),
    Σ ← Σ + Σ · mean_d [u_d u_dᵀ − W_d + W_d V W_d] · Σ,

from the closed form that holds where all C_d are equal (Anderson 1946). Correlations are shrunk towards zero
by as much as their own sampling error says, which is what carries the estimate where there are fewer
devices than unknowns, and vanishes with many. Devices far out do not enter.

**References:** Laird & Ware, *Biometrics* 38 (1982) 963; Schäfer & Strimmer, *Stat. Appl. Genet. Mol. Biol.* 4
(2005) 32, target D (unequal variances); Anderson, *Ann. Math. Stat.* 17 (1946) 409.
"""

from collections.abc import Iterator, Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import chdtri, fdtri, ndtri, stdtrit  # scipy.stats takes a second to import


FEWEST = 5  # devices
ROUNDS = 10  # of looking for devices far out
CHANCE = 0.01  # of naming any device of a normal fleet
_AT_ONCE = 512  # matrices in memory


class Between(eqx.Module):
    """Mean and covariance between devices."""

    mean: Float[np.ndarray, " unknowns"]
    covariance: Float[np.ndarray, "unknowns unknowns"]  # Σ, between devices
    mean_covariance: Float[np.ndarray, "unknowns unknowns"]  # of `mean` itself
    kept: Bool[np.ndarray, " devices"]  # those that entered
    shrinkage: float = eqx.field(static=True)  # of correlations: 0 none, 1 to zero
    converged: bool = eqx.field(static=True)


class Deviation(eqx.Module):
    """How far each device is from the others, its own uncertainty counted."""

    distance: Float[np.ndarray, " devices"]  # Mahalanobis; its square is χ² of `unknowns` degrees
    sigmas: Float[np.ndarray, "devices unknowns"]  # of every coefficient
    outlying: Bool[np.ndarray, " devices"]


def between_devices(
    estimates: Float[np.ndarray, "devices unknowns"],
    covariances: Float[np.ndarray, "devices unknowns unknowns"],
    *,
    max_steps: int = 100,
    groups: Sequence[Int[np.ndarray, " _"]] = (),
) -> Between:
    """Mean and covariance between devices from their estimates; see the module.

    Units are the estimates' own. `groups` are those of `deviation`, by which devices far out do not enter.
    Raises `ValueError` for fewer than five devices.
    """
    count = len(estimates)
    if count < FEWEST:
        raise ValueError(
            f"`between_devices`: {count} devices; the spread between devices needs {FEWEST} or more."
        )
    centre, scale = _robust(estimates, covariances)
    x = (estimates - centre) / scale
    c = covariances / (scale[:, None] * scale[None, :])
    # Where many are far out in some coefficient it is the line's own heavy tail, and they stay.
    kept = np.abs(x).max(axis=1) < 6.0
    for group in groups:  # else a device that widens the spread itself hides in it
        chance = CHANCE / (3 * count * len(groups))
        kept &= np.square(x[:, group]).sum(axis=1) < _furthest(len(group), None, chance)
    kept = kept if kept.sum() >= max(FEWEST, 0.7 * count) else np.ones(count, bool)
    found = _restricted(x[kept], c[kept], max_steps)
    for _ in range(ROUNDS):
        near = ~deviation(x, c, *found[:3], told_by=int(kept.sum()), groups=groups).outlying
        if np.array_equal(near, kept) or near.sum() < FEWEST:
            break
        kept = near
        found = _restricted(x[kept], c[kept], max_steps)
    mean, covariance, of_mean, shrinkage, converged = found
    units = scale[:, None] * scale[None, :]
    return Between(
        mean * scale + centre, covariance * units, of_mean * units, kept, shrinkage, converged
    )


def deviation(
    estimates: Float[np.ndarray, "devices unknowns"],
    covariances: Float[np.ndarray, "devices unknowns unknowns"],
    mean: Float[np.ndarray, " unknowns"],
    covariance: Float[np.ndarray, "unknowns unknowns"],
    mean_covariance: Float[np.ndarray, "unknowns unknowns"],
    *,
    told_by: int | None = None,
    fleet: int | None = None,
    groups: Sequence[Int[np.ndarray, " _"]] = (),
) -> Deviation:
    """Distance of every device from N(μ, Σ).

    A device is outlying where its distance, that of a group of its coefficients, or one of them is so far out that it
    would happen to any device of a normal fleet with a chance of 1 %. All biases a few sigmas off, as of another batch,
    are far out as a group and neither alone nor among dozens of coefficients.

    **Arguments:** `told_by` so many devices were μ and Σ estimated (default: they are known); `fleet` is the
    number of devices judged (default: these); `groups` are the places of coefficients that are judged together.
    """
    count, unknowns = estimates.shape
    chance = CHANCE / ((3 if groups else 2) * max(fleet or count, 1))  # tests of each device
    furthest = _furthest(unknowns, told_by, chance)
    most = _most(unknowns, told_by, chance)
    prior = covariance + mean_covariance
    square, sigmas = np.empty(count), np.empty((count, unknowns))
    together = np.zeros(count, bool)
    for part in _parts(count):
        away = estimates[part] - mean
        total = prior + covariances[part]
        solved = np.linalg.solve(total, away[:, :, None])[:, :, 0]
        square[part] = np.einsum("di,di->d", away, solved)
        sigmas[part] = away / np.sqrt(np.diagonal(total, axis1=1, axis2=2))
        for group in groups:
            own, own_total = away[:, group], total[:, group[:, None], group]
            far = np.einsum("di,di->d", own, np.linalg.solve(own_total, own[:, :, None])[:, :, 0])
            together[part] |= far > _furthest(len(group), told_by, chance / len(groups))
    far = (square > furthest) | (np.abs(sigmas).max(axis=1) > most) | together
    return Deviation(np.sqrt(np.maximum(square, 0.0)), sigmas, far)


def _furthest(unknowns: int, told_by: int | None, chance: float) -> float:
    """Largest squared distance of devices like the others: χ², or Hotelling's T² where as few devices told Σ.

    A distance in more dimensions than there were devices is no test.
    """
    if told_by is None:
        return float(chdtri(unknowns, chance))
    if told_by <= unknowns + 1:
        return np.inf
    scale = unknowns * (told_by - 1) / (told_by - unknowns)
    # F's upper tail is the lower one of its reciprocal.
    return scale / float(fdtri(told_by - unknowns, unknowns, chance))


def _most(unknowns: int, told_by: int | None, chance: float) -> float:
    """Largest coefficient, in standard deviations: normal, or Student's t where as few devices told its spread."""
    each = chance / unknowns / 2
    return float(-ndtri(each) if told_by is None else -stdtrit(told_by - 1, each))


def _parts(count: int) -> Iterator[slice]:
    return (slice(k, k + _AT_ONCE) for k in range(0, count, _AT_ONCE))


def _robust(estimates: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Medians, and 1.4826 × median absolute deviations or the typical own sigma, the greater."""
    centre = np.median(estimates, axis=0)
    spread = 1.4826 * np.median(np.abs(estimates - centre), axis=0)
    own = np.sqrt(np.median(np.diagonal(covariances, axis1=1, axis2=2), axis=0))
    scale = np.maximum(spread, own)
    return centre, np.where(scale > 0, scale, 1.0)


def _restricted(
    x: np.ndarray, c: np.ndarray, max_steps: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, bool]:
    """μ, Σ, cov(μ), the shrinkage of correlations, and whether the iteration settled."""
    sigma, converged = _iterated(x, c, _closed_form(x, c.mean(axis=0)), 0.0, max_steps)
    shrinkage = _shrinkage(sigma, c)
    if shrinkage > 1e-3:
        sigma, converged = _iterated(x, c, sigma, shrinkage, max_steps)
    mean, of_mean, _ = _gradient(x, c, sigma)
    return mean, sigma, of_mean, shrinkage, converged


def _iterated(
    x: np.ndarray, c: np.ndarray, sigma: np.ndarray, shrinkage: float, max_steps: int
) -> tuple[np.ndarray, bool]:
    """EM steps until Σ changes by a fiftieth of its sampling error, about √(1 / devices)."""
    count, own = len(x), np.diagonal(c.mean(axis=0))
    sigma = _shrunk(sigma, shrinkage)
    for _ in range(max_steps):
        _, _, gradient = _gradient(x, c, sigma)
        new = _shrunk(sigma + sigma @ gradient @ sigma, shrinkage)
        size = np.sqrt(np.diagonal(new) + own)
        change = np.abs((new - sigma) / (size[:, None] * size[None, :])).max()
        sigma = new
        if change < 0.02 / np.sqrt(count):
            return sigma, True
    return sigma, False


def _gradient(
    x: np.ndarray, c: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """μ, V and the mean over devices of u uᵀ − W + W V W."""
    count = len(x)
    inverse = np.concatenate([np.linalg.inv(sigma + c[p]) for p in _parts(count)])
    of_mean = np.linalg.inv(inverse.sum(axis=0))
    of_mean = 0.5 * (of_mean + of_mean.T)
    mean = of_mean @ np.einsum("dij,dj->i", inverse, x)
    u = np.einsum("dij,dj->di", inverse, x - mean)
    restricted = sum(
        (np.matmul(inverse[p] @ of_mean, inverse[p]).sum(axis=0) for p in _parts(count)),
        np.zeros_like(sigma),
    )
    gradient = (u.T @ u - inverse.sum(axis=0) + restricted) / count
    return mean, of_mean, 0.5 * (gradient + gradient.T)


def _closed_form(x: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Σ where every device has the covariance `own`: the scatter's eigenvalues less one in units of it.

    What is not above `own` is set to a small part of it, from where the iteration can still grow.
    """
    away = x - x.mean(axis=0)
    scatter = away.T @ away / (len(x) - 1)
    lower = np.linalg.cholesky(own + 1e-14 * np.trace(own) / len(own) * np.eye(len(own)))
    half = np.linalg.solve(lower, scatter)
    values, vectors = np.linalg.eigh(np.linalg.solve(lower, half.T))
    back = lower @ vectors
    return (back * np.maximum(values - 1.0, 0.02)) @ back.T


def _shrinkage(sigma: np.ndarray, c: np.ndarray) -> float:
    """Schäfer and Strimmer's λ: the covariances' sampling variance over their squares, both summed.

    One device tells Σ_ij with the variance T_ii T_jj + T_ij², T = Σ + C_d.
    """
    told = np.zeros_like(sigma)
    for part in _parts(len(c)):
        total = sigma + c[part]
        size = np.diagonal(total, axis1=1, axis2=2)
        told += (1.0 / (size[:, :, None] * size[:, None, :] + np.square(total))).sum(axis=0)
    off = ~np.eye(len(sigma), dtype=bool)
    square = np.square(sigma)[off].sum()
    return float(np.clip((1.0 / told)[off].sum() / square, 0.0, 1.0)) if square > 0 else 1.0


def _shrunk(sigma: np.ndarray, shrinkage: float) -> np.ndarray:
    smaller = (1.0 - shrinkage) * sigma
    np.fill_diagonal(smaller, np.diagonal(sigma))
    return 0.5 * (smaller + smaller.T)
