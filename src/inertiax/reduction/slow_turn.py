"""Accelerometers that are turned slowly all along: short stretches of the turn stand for rests.

Nobody lays such a device down, but gravity turns through all of its axes, and where the hand is slow the outputs lie on
the ellipsoid that rests would lie on. A stretch is so short that the device hardly turns in it. Its mean is off by what
the hand adds to gravity; that, and how long it lasts, is read off the distances from the ellipsoid.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .._typing import Mask
from ..physics.directions import num_directions
from ..physics.vectors import angle_between
from .clipping import clipped_rows


_LENGTHS = (64, 32, 16, 8, 4, 2)  # rows
_STEADY = np.radians(5.0)  # a mean over such a turn is 0.03 % short
_JUMP = np.radians(10.0)  # within a stretch, which then holds two poses or a swing
_MOST_FORCE = 0.03  # of gravity, rms: more is driving, walking or a shaken hand
_LEAST_KEPT = 0.6  # of the stretches
_DIRECTIONS = 12  # that are 10° apart, see `_APART`; nine unknowns and some to spare
_APART = np.radians(10.0)
_MOST = 400  # stretches; neighbours say the same, and each is a row of the estimate
_FEWEST = 40
_FAR = 5.0  # times the usual distance from the ellipsoid
_AROUND = 0.3  # see `_all_around`; 0.58 for a whole sphere, 0.23 for half of it, 0 for a turn about one axis
_BLOCKS = 20  # turns of a log in order: enough to tell a variance to a third, each of rows enough to hold a turn
_LEAST_FREE = 1e-3  # a block that alone tells an unknown leaves nothing of its misfit
_CONDITION = 0.02  # least over greatest singular value of a fit that determines its unknowns


class Stretches(NamedTuple):
    """Ranges `[start, stop)` of rows, and 1 sigma of each mean in each channel, in the outputs' unit."""

    start: Int[np.ndarray, " stretch"]
    stop: Int[np.ndarray, " stretch"]
    sigma: float


def slow_turn(accel: Float[np.ndarray, "time 3"]) -> Stretches | None:
    """Stretches of accelerometers that turn slowly through all orientations, `None` where they do not.

    The outputs may be in any unit. Asked for are twelve directions that are 10° apart, and distances from the
    ellipsoid of 3 % of gravity at most, rms. With ρ_k their correlation from a stretch to the k-th after it,

        sigma² = rms² (1 + 2 Σ ρ_k),

    summed as long as ρ_k is positive: so many neighbours say the same. Motion goes with direction, too, which turns as
    slowly: where blocks of the log in order pull the ellipsoid by more than that, their factor counts (`_by_blocks`).
    And where stretches that are left out lie just beyond the limit, as those of a heavy tail do, the limit chose the
    answer, which is widened by what twice as wide a one makes of it (`_by_limit`).

    **Reference:** for the ellipsoid, Q. Li, J. G. Griffiths, Least squares ellipsoid specific fitting, GMP 2004 (here
    without the constraint, since the points are all around); for the sum, C. J. Geyer, Practical Markov chain Monte
    Carlo, Statist. Sci. 7 (1992), section 3.3; for the blocks, R. M. Bell, D. F. McCaffrey, Bias reduction in standard
    errors for linear regression with multi-stage samples, Survey Methodology 28 (2002).
    """
    if len(accel) < _FEWEST or not np.isfinite(accel).all():
        return None
    length = _length(accel)
    start = np.arange(len(accel) // length) * length
    parts = accel[: len(start) * length].reshape(-1, length, 3)
    clipped = clipped_rows(accel)[: parts.shape[0] * length].reshape(-1, length).any(axis=1)
    kept = _steady(parts, _centre(accel)) & ~clipped
    means = parts.mean(axis=1)
    if kept.sum() < max(_FEWEST, _LEAST_KEPT * len(start)):
        return None
    kept = np.flatnonzero(kept)
    away = _distances(means[kept])
    if away is None:
        return None
    usual = float(np.median(np.abs(away)))
    beyond = kept[np.abs(away) <= 2.0 * _FAR * usual]
    kept = kept[np.abs(away) <= _FAR * usual]
    if len(kept) < max(_FEWEST, _LEAST_KEPT * len(start)):
        return None
    thin = -(-len(kept) // _MOST)
    limit = 1.0 + _by_limit(means[kept], means[beyond]) / thin
    kept = kept[::thin]
    away = _distances(means[kept])
    if away is None or np.sqrt(np.mean(away**2)) > _MOST_FORCE:
        return None
    apart = means[kept] - _centre(means[kept])
    if num_directions(apart, _APART, _DIRECTIONS) < _DIRECTIONS or not _all_around(apart):
        return None
    radius = float(np.median(np.linalg.norm(apart, axis=1)))
    alike = max(_alike(away), _by_blocks(means[kept])) * limit
    sigma = radius * float(np.sqrt(np.mean(away**2) * alike))
    return Stretches(start[kept], start[kept] + length, sigma)


def _centre(points: Float[np.ndarray, "row 3"]) -> Float[np.ndarray, "3"]:
    return 0.5 * (points.min(axis=0) + points.max(axis=0))


def _length(accel: Float[np.ndarray, "time 3"]) -> int:
    """The most rows over which the device usually turns by 5° or less; one row turns by nothing."""
    apart = accel - _centre(accel)
    for length in _LENGTHS:
        count = len(apart) // length
        if count < _FEWEST:
            continue
        means = apart[: count * length].reshape(count, length, 3).mean(axis=1)
        if np.quantile(angle_between(means[1:], means[:-1]), 0.75) <= _STEADY:
            return length
    return 1


def _steady(parts: Float[np.ndarray, "stretch row 3"], centre: Float[np.ndarray, "3"]) -> Mask:
    """Stretches in which the device does not jump from one pose to another."""
    half = parts.shape[1] // 2
    if not half:
        return np.ones(len(parts), bool)
    apart = parts - centre
    return angle_between(apart[:, :half].mean(axis=1), apart[:, half:].mean(axis=1)) <= _JUMP


def _all_around(apart: Float[np.ndarray, "row 3"]) -> bool:
    """Whether directions tell a sphere's centre and radius well: least over greatest singular value of (1, u)."""
    units = apart / np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), 1e-300)
    singular = np.linalg.svd(np.column_stack([np.ones(len(units)), units]), compute_uv=False)
    return bool(singular[-1] > _AROUND * singular[0])


def _distances(points: Float[np.ndarray, "row 3"]) -> Float[np.ndarray, " row"] | None:
    """Distances from the ellipsoid through the points, in its radii, `None` where they lie on none.

    Points around one axis alone tell no oblique ellipsoid, and those of few poses only a sphere.
    """
    start = _centre(points)
    radius = float(np.median(np.linalg.norm(points - start, axis=1)))
    if not radius > 0:
        return None
    p = (points - start) / radius
    design = _design(p)
    if design is None:
        return None
    found = np.linalg.lstsq(design, np.ones(len(p)), rcond=None)[0]
    # pᵀ Q p + 2 l·p = 1 is (p − c)ᵀ Q (p − c) = 1 + cᵀ Q c about c = −Q⁻¹ l.
    own = found[:-3]
    form = np.diag(own[:3] if len(own) > 1 else np.full(3, own[0]))
    if len(own) == 6:
        form[[1, 2, 0], [2, 0, 1]] = form[[2, 0, 1], [1, 2, 0]] = own[3:]
    if np.linalg.eigvalsh(form)[0] <= 0:
        return None
    middle = -np.linalg.solve(form, found[-3:])
    about = p - middle
    inside = np.einsum("ni,ij,nj->n", about, form, about) / (1.0 + middle @ form @ middle)
    return np.sqrt(np.maximum(inside, 0.0)) - 1.0


def _design(p: Float[np.ndarray, "row 3"]) -> Float[np.ndarray, "row unknown"] | None:
    """What multiplies an ellipsoid's unknowns in points about its middle: as many as they determine."""
    x, y, z = p.T
    square = np.square(p)
    oblique = 2.0 * np.column_stack([y * z, z * x, x * y])
    for design in (
        np.column_stack([square, oblique, 2.0 * p]),
        np.column_stack([square, 2.0 * p]),
        np.column_stack([square.sum(axis=1), 2.0 * p]),
    ):
        singular = np.linalg.svd(design, compute_uv=False)
        if singular[-1] > _CONDITION * singular[0]:
            return design
    return None


def _about(points: Float[np.ndarray, "row 3"], others: Float[np.ndarray, "other 3"]) -> np.ndarray:
    """Points about the middle of others, in their radius."""
    middle = _centre(others)
    return (points - middle) / float(np.median(np.linalg.norm(others - middle, axis=1)))


def _by_blocks(points: Float[np.ndarray, "row 3"]) -> float:
    """How much more the unknowns scatter by blocks of the points in order than by single ones; mean of the variances.

    Each block's misfits are freed of what the fit took of them, by (I − H_b)^−½.
    """
    design = _design(_about(points, points))
    if design is None:
        return 1.0
    own = np.linalg.qr(design)[0]
    left = 1.0 - own @ own.sum(axis=0)
    pulled = 0.0
    for rows in np.array_split(np.arange(len(own)), _BLOCKS):
        values, vectors = np.linalg.eigh(np.eye(len(rows)) - own[rows] @ own[rows].T)
        freed = vectors @ (vectors.T @ left[rows] / np.sqrt(np.maximum(values, _LEAST_FREE)))
        pulled += float(np.sum(np.square(own[rows].T @ freed)))
    unknowns = own.shape[1]
    variance = float(left @ left) / (len(own) - unknowns)
    return pulled / unknowns / variance if variance > 0.0 else 1.0


def _by_limit(points: Float[np.ndarray, "row 3"], beyond: Float[np.ndarray, "wider 3"]) -> float:
    """ΔᵀP⁻¹Δ / unknowns of the change that a limit twice as wide makes; P is the covariance within the limit."""
    design, wider = _design(_about(points, points)), _design(_about(beyond, points))
    if design is None or wider is None or design.shape[1] != wider.shape[1]:
        return 0.0
    solve = lambda d: np.linalg.lstsq(d, np.ones(len(d)), rcond=None)[0]
    found = solve(design)
    left = 1.0 - design @ found
    variance = float(left @ left) / (len(left) - len(found))
    change = design @ (solve(wider) - found)
    return float(change @ change) / (variance * len(found)) if variance > 0.0 else 0.0


def _alike(away: Float[np.ndarray, " stretch"]) -> float:
    """How many neighbours say the same: 1 + 2 Σ ρ_k."""
    size = float(np.mean(away**2))
    if not size > 0:
        return 1.0
    total = 1.0
    for k in range(1, len(away) // 4):
        rho = float(np.mean(away[k:] * away[:-k])) / size
        if rho <= 0:
            break
        total += 2.0 * rho
    return total
