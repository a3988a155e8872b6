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

    summed as long as ρ_k is positive: so many neighbours say the same.

    **Reference:** for the ellipsoid, Q. Li, J. G. Griffiths, Least squares ellipsoid specific fitting, GMP 2004 (here
    without the constraint, since the points are all around); for the sum, C. J. Geyer, Practical Markov chain Monte
    Carlo, Statist. Sci. 7 (1992), section 3.3.
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
    near = np.abs(away) <= _FAR * np.median(np.abs(away))
    kept = kept[near]
    if len(kept) < max(_FEWEST, _LEAST_KEPT * len(start)):
        return None
    kept = kept[:: -(-len(kept) // _MOST)]
    away = _distances(means[kept])
    if away is None or np.sqrt(np.mean(away**2)) > _MOST_FORCE:
        return None
    apart = means[kept] - _centre(means[kept])
    if num_directions(apart, _APART, _DIRECTIONS) < _DIRECTIONS or not _all_around(apart):
        return None
    radius = float(np.median(np.linalg.norm(apart, axis=1)))
    sigma = radius * float(np.sqrt(np.mean(away**2) * _alike(away)))
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
    x, y, z = p.T
    square = np.square(p)
    oblique = 2.0 * np.column_stack([y * z, z * x, x * y])
    for design in (
        np.column_stack([square, oblique, 2.0 * p]),
        np.column_stack([square, 2.0 * p]),
        np.column_stack([square.sum(axis=1), 2.0 * p]),
    ):
        found, _, _, singular = np.linalg.lstsq(design, np.ones(len(p)), rcond=None)
        if singular[-1] > _CONDITION * singular[0]:
            break
    else:
        return None
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
