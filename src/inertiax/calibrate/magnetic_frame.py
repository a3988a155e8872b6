"""The magnetometers in the frame of the accelerometers, where rests with a known vertical tell the rotation."""

import math

import numpy as np
from jaxtyping import Float

from .._jax import eqx
from ..estimators.magnetic_field import turn_to_vertical
from ..physics.temperature import Constant
from ..reduction.dwells import Dwells
from ..reduction.field_rows import STILL
from .magnetic_fit import Fit, free_coefficients, solved


SURE_OF_FRAME = 0.1  # rad, 1 sigma of the rotation: beyond, the accelerometers' frame is not known
_STEEP = 0.3  # of the field, upward part, from which its sign tells the hemisphere


def in_frame(
    own: Fit,
    latitude: float | None,
    field: float | None,
    warnings: list[str],
    *,
    unsteady: int = 0,
) -> Fit:
    """The fit in the frame of the accelerometers where the rests tell it, else as it is, with the reason.

    **Arguments:** `unsteady` is how many rests were left out because the field moves in them.
    """
    dwells = own.rows
    known = np.zeros(dwells.num_dwells, bool)
    if dwells.accel is not None:
        known = np.asarray(dwells.position) >= 0
    rests = np.flatnonzero(known)
    why = f"{len(rests)} rests with calibrated accelerometers do not tell the rotation between the triads"
    names = own.estimator.names
    if len(rests) >= 6:
        rows = eqx.tree_at(lambda d: d.position, dwells, np.where(known, np.arange(len(known)), -1))
        start = _turned_start(own, rows, rests, latitude)
        free = free_coefficients(names, (0, 0), turned=True)
        try:
            fit = solved(own.estimator, Constant(), rows, free, start, field)
        except ValueError:
            pass
        else:
            unsure = _rotation_sigma(fit)
            if fit.converged and unsure <= SURE_OF_FRAME:
                warnings.extend(_exchanged(fit))
                return fit
            why += f" better than {math.degrees(unsure):.0f}°" if math.isfinite(unsure) else ""
    cure = "rest in more orientations"
    if unsteady:
        cure = (
            f"the field moves within {unsteady} further rests by more than {math.degrees(STILL):.0f}°, as beside a "
            "current that changes: keep it steady at rest, or log it,"
        )
    warnings.append(
        f"magnetometers: in their own frame (x axis as it is, y in its xy plane), because {why}; {cure} to have them "
        "in that of the accelerometers"
    )
    return own


def _turned_start(
    own: Fit, rows: Dwells, rests: np.ndarray, latitude: float | None
) -> Float[np.ndarray, "1 parameter"]:
    """The ellipsoid turned so that the field keeps its angle to the vertical."""
    vector = own.coefficients[0]
    product = np.eye(3) + vector[3:12].reshape(3, 3)
    outputs = np.asarray(rows.mag)[rests] - vector[:3]
    if own.estimator.with_current:
        outputs = outputs - np.asarray(rows.current)[rests, None] * vector[12:15]
    force = np.asarray(rows.accel)[rests]
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    turn, vertical = turn_to_vertical(np.linalg.solve(product, outputs.T).T, up)
    steep = abs(vertical) > _STEEP * float(np.asarray(own.estimator.field))
    if latitude is not None and steep and abs(latitude) > _STEEP:
        inverted = vertical * latitude > 0.0  # north of the equator the field points down
    else:
        inverted = np.trace(turn) < 0.0
    sign = -1.0 if inverted else 1.0
    start = vector.copy()
    start[3:12] = (sign * product @ turn.T - np.eye(3)).ravel()
    start[-1] = sign * vertical
    return start[None, :]


def _orthogonal(product: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The orthogonal factor of a matrix: how its axes lie, mirrored ones too."""
    left, _, right = np.linalg.svd(product)
    return left @ right


def _rotation_sigma(fit: Fit) -> float:
    """The largest standard deviation of the triad's rotation against the accelerometers, rad."""
    own = slice(3, 12)
    spread = fit.covariance()[: len(fit.free[0]), : len(fit.free[0])][own, own]
    if not np.all(np.isfinite(spread)):
        return float("nan")
    turn = _orthogonal(np.eye(3) + fit.coefficients[0][own].reshape(3, 3))
    # Of a small change dS, the antisymmetric part of dS Rᵀ is the rotation.
    axes = np.zeros((3, 9))
    for k, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        axes[k] = 0.5 * (np.outer(np.eye(3)[i], turn[j]) - np.outer(np.eye(3)[j], turn[i])).ravel()
    return float(np.sqrt(np.linalg.eigvalsh(axes @ spread @ axes.T)[-1]))


def _exchanged(fit: Fit) -> list[str]:
    """A warning where the triad's axes lie along others than their columns say: the nearest of all 48 ways."""
    turn = _orthogonal(np.eye(3) + fit.coefficients[0][3:12].reshape(3, 3))
    nearest = np.zeros((3, 3))
    left = np.abs(turn)
    for _ in range(3):
        i, j = np.unravel_index(int(np.argmax(left)), (3, 3))
        nearest[i, j] = np.sign(turn[i, j])
        left[i, :] = left[:, j] = -1.0
    if np.allclose(nearest, np.eye(3)):
        return []
    words = ", ".join(
        f"{'xyz'[i]} along {'+' if nearest[i].sum() > 0 else '−'}{'xyz'[int(np.argmax(np.abs(nearest[i])))]}"
        for i in range(3)
    )
    return [
        f"magnetometers: by their angle to the vertical their axes lie {words} of the accelerometers; the matrix "
        "turns them, but look whether columns are exchanged or a sign is missing"
    ]
