"""What a station promises of its positions and rates, as covariances of dwells against their reference.

A positioning that is off by small independent angles of standard deviation α turns the reference u by α × u, and a
rate that is off by the part ρ scales it:

    C = α² (|u|² E − u uᵀ) + ρ² u uᵀ

Plateaus of one positioning, rests between which a table turned about the vertical alone (`positionings`) and the pieces
that one long rest is cut into share its angles ε, so that two of them err together:

    δ_k = ε × u_k = −[u_k]× ε,     cov(δ_j, δ_k) = α² [u_j]× [u_k]×ᵀ

What all dwells of a campaign share, the level of the base and the right angle of the axes, is `table_errors`.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .._jax import eqx, jnp
from .._typing import AnyArray
from ..data.recording import Rig
from ..physics.vectors import unit_vector
from .dwells import Dwells, is_told, known_force
from .earth_at_rest import heading_is_untold, untold_heading_covariance
from .positionings import attitudes, shared_positionings
from .room_attitudes import turns_told
from .standing_axes import standing_errors, StandingErrors
from .table_errors import (
    leans_of_part_turns,
    states_table_errors,
    table_error_words,
    table_errors,
    TableErrors,
)


def rig_covariance(
    reference: Float[np.ndarray, "*dwell 3"],
    angle: float | Float[np.ndarray, " *dwell"],
    rate: float = 0.0,
) -> Float[np.ndarray, "*dwell 3 3"]:
    """Covariance of the reference, in its unit squared.

    **Arguments:** `reference` in m/s² or rad/s; `angle` of each positioning, rad, and `rate`, a part of the reference,
    both 1 sigma.
    """
    outer = reference[..., :, None] * reference[..., None, :]
    square = np.sum(np.square(reference), axis=-1)[..., None, None]
    turned = np.square(angle)[..., None, None] if np.ndim(angle) else np.square(angle)
    return turned * (square * np.eye(3) - outer) + rate**2 * outer


def rate_words(estimator: str, rig: Rig) -> tuple[str, ...]:
    """That the covariance of gyros has the rate's error as drawn anew for each rate; nothing where none is stated.

    Not as a common one, which no row tells and which devices on one table share: a fleet's devices would look alike
    to within it.
    """
    rate = rig.rate_uncertainty
    if rate is None or estimator != "reference":
        return ()
    return (
        f"± holds the table's {1e6 * rate:.3g} ppm as an error drawn anew for each rate. As far as all rates share it, "
        "every scale factor is off by that much (1 sigma) beside ±; `inertiax protocol` adds it.",
    )


def errors_of_table(dwells: Dwells, rig: Rig) -> TableErrors | None:
    """What the table's errors do to references; `None` where the station states none, or there are none of both
    triads."""
    if not states_table_errors(rig) or dwells.reference_accel is None:
        return None
    if dwells.reference_gyro is None:
        return None
    return table_errors(
        np.asarray(dwells.position),
        np.asarray(dwells.reference_accel, float),
        np.asarray(dwells.reference_gyro, float),
        rig,
        run=None if dwells.rows is None else np.asarray(dwells.rows)[..., 0],
        valid=np.asarray(dwells.valid),
    )


def errors_of_standing_axes(dwells: Dwells, rig: Rig) -> StandingErrors | None:
    """What axes that stand do to references (`standing_axes`); `None` where none stands through several positions, or
    there are no references of both triads."""
    if dwells.reference_accel is None or dwells.reference_gyro is None:
        return None
    return standing_errors(
        np.asarray(dwells.position),
        np.asarray(dwells.reference_accel, float),
        np.asarray(dwells.reference_gyro, float),
        rig,
        run=None if dwells.rows is None else np.asarray(dwells.rows)[..., 0],
        valid=np.asarray(dwells.valid),
    )


def own_angle(dwells: Dwells, angle: float) -> Float[np.ndarray, " *dwell"] | float:
    """Standard deviation of the angles, rad, that each dwell has by itself, of `angle` of a positioning."""
    part = 0.0 if dwells.standing_part is None else np.asarray(dwells.standing_part)
    alone = 1.0 if dwells.shared_angle is None else np.asarray(dwells.shared_angle) == 0.0
    return angle * np.sqrt(np.maximum(1.0 - part, 0.0)) * alone


def table_words(dwells: Dwells, rig: Rig, estimators: Sequence[str | None]) -> tuple[str, ...]:
    """What of the table's stated errors could not be used, where an estimator compares with references."""
    if not states_table_errors(rig) or "reference" not in estimators:
        return ()
    force, rate = dwells.reference_accel, dwells.reference_gyro
    found = errors_of_table(dwells, rig)
    if found is not None and force is not None and rate is not None and not rig.axes:
        leaning = heading_is_untold(dwells.position, rate, force)  # by `leans_of_rests`
        found = found._replace(known=found.known | leaning)
    return table_error_words(
        rig, found, np.asarray(dwells.position), None if force is None else np.asarray(force)
    )


def turned_by(reference: Float[AnyArray, "*dwell 3"]) -> Float[AnyArray, "*dwell 3 3"]:
    """−[u]×: what small angles of the case's position, rad, add to the reference; column k is e_k × u."""
    library = np if isinstance(reference, np.ndarray) else jnp
    x, y, z = (reference[..., k] for k in range(3))
    zero = library.zeros_like(x)
    rows = [[zero, z, -y], [-z, zero, x], [y, -x, zero]]
    return library.stack([library.stack(row, axis=-1) for row in rows], axis=-2)


def with_rig_errors(dwells: Dwells, rig: Rig) -> Dwells:
    """The dwells with the errors of their reference in the covariances of their means; any leading axes.

    Beside what the rig states these are the Earth's rate in a heading that no reference tells.
    Dwells that share their positioning say so in `positioning` and have its standard deviation in `shared_angle`:
    the covariance of their own mean is without it, and without `standing_part`.
    """
    angle, rate = rig.position_uncertainty or 0.0, rig.rate_uncertainty or 0.0
    standing = errors_of_standing_axes(dwells, rig)
    if standing is not None:
        dwells = _with(dwells, standing_part=standing.part)
    if angle:
        numbers = positionings(dwells)
        if np.any(numbers >= 0):
            shared = np.where(numbers >= 0, own_angle(dwells, angle), 0.0)
            dwells = _with(dwells, positioning=numbers, shared_angle=shared)
    own_of_rig = own_angle(dwells, angle)
    for triad, part in (("accel", 0.0), ("gyro", rate)):
        reference = getattr(dwells, f"reference_{triad}")
        own = getattr(dwells, f"{triad}_covariance")
        if reference is None or own is None or not (angle or part or rig.level_uncertainty):
            continue
        wider = np.asarray(own) + rig_covariance(np.asarray(reference), own_of_rig, part)
        more = (
            angles_of_moves(dwells, angle) if triad == "gyro" else leans_by_themselves(dwells, rig)
        )
        wider = wider + more
        dwells = eqx.tree_at(lambda d, t=triad: getattr(d, f"{t}_covariance"), dwells, wider)
    heading = heading_errors(dwells)
    if dwells.gyro_covariance is not None and np.any(heading):
        wider = np.asarray(dwells.gyro_covariance) + heading
        dwells = eqx.tree_at(lambda d: d.gyro_covariance, dwells, wider)
    return _with_table_errors(dwells, rig, standing)


def _with(dwells: Dwells, **columns: np.ndarray) -> Dwells:
    """The dwells with these columns, which they may have lacked."""
    where = lambda d: tuple(getattr(d, k) for k in columns)
    return eqx.tree_at(where, dwells, tuple(columns.values()), is_leaf=lambda x: x is None)


def positionings(dwells: Dwells) -> Int[np.ndarray, "*dwell"]:
    """Numbers from 0 of the positionings that several dwells share, plateaus or rests; −1 for the others."""
    if dwells.reference_gyro is None:
        return _with_rests(np.full(np.shape(dwells.position), -1), dwells)
    force = known_force(dwells.reference_accel, dwells.accel)
    numbers = shared_positionings(
        np.asarray(dwells.position),
        np.asarray(dwells.reference_gyro),
        None if force is None else np.asarray(force),
        np.asarray(dwells.valid),
    )
    return _with_rests(numbers, dwells)


def leans_by_themselves(dwells: Dwells, rig: Rig) -> Float[AnyArray, "*dwell 3 3"] | float:
    """What a base out of level adds to each dwell's force by itself, (m/s²)²: to rests without a heading
    (`leans_of_rests`) and to parts of turns about the vertical (`leans_of_part_turns`), where rows tell durations."""
    rests = leans_of_rests(dwells, rig)
    if isinstance(rests, float) or dwells.rows is None:
        return rests
    stands = dwells.position, dwells.reference_accel, dwells.reference_gyro
    position, force, rate = map(np.asarray, stands)
    told = turns_told(position, force, rate, np.asarray(dwells.rows)[..., 0], rig.axes)
    duration = np.asarray(dwells.duration)
    return rests + leans_of_part_turns(position, force, rate, duration, rig, told)


def leans_of_rests(dwells: Dwells, rig: Rig) -> Float[AnyArray, "*dwell 3 3"] | float:
    """λ² (|u|² E − u uᵀ), (m/s²)², of rests that tell no heading, by the level λ of their base: a lean that is the same
    in the room is another in the case at each of them. Zero elsewhere: `table_errors` has those with a heading."""
    level = rig.level_uncertainty or 0.0
    if not level or dwells.reference_accel is None or dwells.reference_gyro is None:
        return 0.0
    told = dwells.position, dwells.reference_gyro, dwells.reference_accel
    return rig_covariance(np.asarray(dwells.reference_accel), level * heading_is_untold(*told))


def heading_errors(dwells: Dwells) -> Float[AnyArray, "*dwell 3 3"] | float:
    """`untold_heading_covariance` of dwells; zero where they have no references of both triads."""
    if dwells.reference_accel is None or dwells.reference_gyro is None:
        return 0.0
    told = dwells.position, dwells.reference_gyro, dwells.reference_accel
    return untold_heading_covariance(*told, dwells.duration, dwells.move)


def angles_of_moves(dwells: Dwells, angle: float) -> Float[AnyArray, "*dwell 3 3"] | float:
    """`move_covariance` of dwells; zero where none is a move."""
    if dwells.move is None:
        return 0.0
    return move_covariance(np.asarray(dwells.move), np.asarray(dwells.duration), angle)


def move_covariance(
    move: Bool[np.ndarray, "*dwell"], duration: Float[np.ndarray, "*dwell"], angle: float
) -> Float[np.ndarray, "*dwell 3 3"]:
    """2 α² / T² E, (rad/s)²: the mean rate of a move is the difference of two positionings over its duration T, s."""
    square = np.where(move, 2.0 * angle**2 / np.square(duration), 0.0)
    return square[..., None, None] * np.eye(3)


def _with_table_errors(dwells: Dwells, rig: Rig, standing: StandingErrors | None) -> Dwells:
    """The dwells with the signatures of the table's errors. Plateaus whose axis stands nobody knows how get the level's
    error as one of their own: a mean over whole turns keeps what is along the axis."""
    found = errors_of_table(dwells, rig)
    accel, gyro = [], []
    if found is not None and found.known.any():
        dwells = _with_leans_of_plateaus(dwells, rig, found.known)
        accel, gyro = [found.accel], [found.gyro]
    if standing is not None:
        none = np.zeros((*np.shape(dwells.position), 3, 3))
        accel, gyro = [*(accel or [none]), standing.accel], [*(gyro or [none]), standing.gyro]
    if not accel:
        return dwells
    made = (np.concatenate(x, axis=-1) for x in (accel, gyro))
    return _with(dwells, **dict(zip(("table_accel", "table_gyro"), made, strict=True)))


def _with_leans_of_plateaus(dwells: Dwells, rig: Rig, known: Bool[np.ndarray, " *dwell"]) -> Dwells:
    level, own = rig.level_uncertainty or 0.0, dwells.accel_covariance
    force, rate = np.asarray(dwells.reference_accel), np.asarray(dwells.reference_gyro)
    lacking = (np.asarray(dwells.position) < 0) & is_told(force) & ~known
    if not level or own is None or not lacking.any():
        return dwells
    axis = unit_vector(rate)
    gravity = np.median(np.linalg.norm(force[known], axis=-1))
    across = np.square(gravity) - np.square(np.sum(axis * force, axis=-1))
    part = np.where(lacking, level**2 * np.maximum(across, 0.0), 0.0)[..., None, None]
    wider = np.asarray(own) + part * axis[..., :, None] * axis[..., None, :]
    return _with(dwells, accel_covariance=wider)


def _with_rests(numbers: Int[np.ndarray, "*dwell"], dwells: Dwells) -> Int[np.ndarray, "*dwell"]:
    """The numbers, with one for each attitude in which several dwells rest; as they are where no rows tell rests."""
    if dwells.rows is None or numbers.ndim != 1:
        return numbers
    rest = np.asarray(dwells.valid) & (np.asarray(dwells.position) >= 0) & (numbers < 0)
    _, place, count = np.unique(
        _attitudes(dwells)[rest], axis=0, return_inverse=True, return_counts=True
    )
    several = count[place.reshape(-1)] > 1
    _, renamed = np.unique(place.reshape(-1)[several], return_inverse=True)
    made = numbers.copy()
    made[np.flatnonzero(rest)[several]] = numbers.max(initial=-1) + 1 + renamed
    return made


def _attitudes(dwells: Dwells) -> Int[np.ndarray, "dwell 2"]:
    """Recording and segment of each dwell, of rests the segment in which the device came to stand as it does there."""
    own = np.asarray(dwells.rows)[:, [0, 3]]
    if dwells.reference_accel is None or dwells.reference_gyro is None:
        return own
    kept = np.flatnonzero(np.asarray(dwells.valid))
    position = np.asarray(dwells.position)[kept]
    rate, force = (np.asarray(x)[kept] for x in (dwells.reference_gyro, dwells.reference_accel))
    _, first, segment = np.unique(own[kept], axis=0, return_index=True, return_inverse=True)
    stands = attitudes(position, rate, force, own[kept, 0], segment.reshape(-1))
    made = own.copy()
    made[kept] = own[kept[first]][stands]
    return made
