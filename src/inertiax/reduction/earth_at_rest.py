"""Earth's rate in the gyros' means at rest, where no reference holds it.

At rest ideal gyros read Earth's rate, whose vertical part is known by the latitude φ and by the direction u of the
specific force beside it, whatever the heading:

    ω = Ω sin φ u + Ω cos φ n,     n ⊥ u, |n| = 1, of unknown heading

Where a reference tells all of it and gyros are calibrated by gravity's rotation all the same, all is taken away. Else
the first part is. It is what a g-sensitivity of Ω sin φ on all axes would read. It has no part in
gravity's turn between rests, since a rotation about the vertical leaves the vertical where it is. The second part
stays in the biases, with the variance of a heading that may be any: (Ω cos φ)² / 2 on each horizontal axis, one draw
for each attitude.

A table that turns about the vertical alone has a reference that holds the vertical part and no heading
(`data.formats.upright_table`): each of its rests errs by the horizontal part, and its plateaus by what a mean over less
than whole turns leaves of that, `untold_heading_covariance`.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .._typing import AnyArray
from ..data.recording import Campaign, Recording, Site
from ..physics.vectors import unit_vector
from ..physics.wgs84 import EARTH_RATE
from .dwells import Dwells
from .mean_noise import converter_steps
from .shown_earth_rate import rounding_hides_it, Shown, shown_earth_rate


# Earth rates: what a reference that holds all of it has across gravity, from 1° off the poles on.
_VERTICAL = 0.02
_GRAVITY = 0.2  # relative: what is felt at rest, raw scales and biases included
# A device that is turned by less keeps most of its heading: rests as near as this are one draw of it.
_ONE_DRAW = math.cos(math.radians(45.0))


def vertical_earth_rate(
    force: Float[AnyArray, "rest 3"], site: Site
) -> Float[np.ndarray, "rest 3"]:
    """Ω sin φ u of rests by their specific force (m/s²), rad/s; zero where that is not gravity, and without a latitude.

    ```python
    import numpy as np
    from inertiax.data.recording import Site
    from inertiax.reduction.earth_at_rest import vertical_earth_rate

    level = np.array([[0.0, 0.0, 9.81]])
    print(np.rad2deg(vertical_earth_rate(level, Site(9.81, np.deg2rad(30.0)))) * 3600.0)    # [[0.   0.   7.52]] °/h
    ```
    """
    size = np.linalg.norm(force, axis=1, keepdims=True)
    if site.latitude is None:
        return np.zeros(np.shape(force))
    felt = np.abs(size / site.gravity - 1.0) < _GRAVITY
    up = np.asarray(force) / np.maximum(size, 1e-12)
    return np.where(felt, EARTH_RATE * math.sin(site.latitude) * up, 0.0)


def without_vertical_earth_rate(dwells: Dwells, site: Site) -> Dwells:
    """Dwells whose gyro means at rest are without Earth's vertical part; unchanged where a reference holds Earth's
    rate, without accelerometers, without a latitude, and where the gyros show none of it (`shown_earth_rate`)."""
    shown = shown_by_dwells(dwells, site)
    if not is_known(dwells, site) or (shown is not None and shown.absent):
        return dwells
    rest = np.asarray(dwells.position)[:, None] >= 0
    vertical = np.where(rest, vertical_earth_rate(np.asarray(dwells.accel), site), 0.0)
    return dataclasses.replace(dwells, gyro=np.asarray(dwells.gyro) - vertical)


def shown_by_dwells(dwells: Dwells, site: Site) -> Shown | None:
    """How much of Earth's vertical part the means of rests show; `None` where it is not known, or they do not tell."""
    if not is_known(dwells, site):
        return None
    rest = (np.asarray(dwells.position) >= 0) & np.asarray(dwells.valid)
    used = (dwells.gyro, dwells.accel, dwells.count, dwells.temperature)
    gyro, force, count, temperature = (np.asarray(x)[rest] for x in used)
    return shown_earth_rate(gyro, force, count, site, temperature)


def rounding_hides_earth(dwells: Dwells, recordings: Sequence[Recording], site: Site) -> bool:
    """Whether some recording's gyros are too coarse to tell (`shown_earth_rate.rounding_hides_it`)."""
    if dwells.rows is None:
        return False
    rows = np.asarray(dwells.rows)[np.asarray(dwells.position) >= 0]
    for number, recording in enumerate(recordings):
        own = rows[rows[:, 0] == number]
        if recording.gyro is not None and len(own):
            variance = np.array([recording.gyro[a:b].var(axis=0) for _, a, b, _ in own.tolist()])
            if rounding_hides_it(converter_steps(recording.gyro), variance, site):
                return True
    return False


def without_earth_rate(dwells: Dwells, campaign: Campaign) -> Dwells:
    """Dwells whose gyro means at rest are without what is known of Earth's rate: all of it where `[model]` asks for
    gravity's rotation beside a reference of rates, else its vertical part (`without_vertical_earth_rate`).

    Gravity's rotation has no use for a reference but this.
    """
    known = dwells.reference_gyro
    if not is_told_beside_gravity(campaign) or known is None or dwells.gyro is None:
        return without_vertical_earth_rate(dwells, campaign.site)
    rest = np.asarray(dwells.position)[:, None] >= 0
    return dataclasses.replace(dwells, gyro=np.asarray(dwells.gyro) - np.where(rest, known, 0.0))


def is_told_beside_gravity(campaign: Campaign) -> bool:
    """Whether gyros are to be calibrated by gravity's rotation, and a reference holds Earth's rate at rest."""
    told = all(r.reference_gyro is not None for r in campaign.recordings)
    return told and campaign.model.gyro_estimator == "gravity"


def is_known(dwells: Dwells, site: Site) -> bool:
    """Whether Earth's vertical part is known and in no reference."""
    alone = dwells.gyro is not None and dwells.reference_gyro is None
    return alone and dwells.accel is not None and site.latitude is not None


def heading_is_untold(
    position: Int[AnyArray, "*dwell"],
    rate: Float[AnyArray, "*dwell 3"],
    force: Float[AnyArray, "*dwell 3"],
) -> Bool[np.ndarray, "*dwell"]:
    """Which dwells are rests whose reference ω holds the vertical part of Earth's rate alone.

    **Arguments:** those of `untold_heading_covariance`.
    """
    rate, force = np.asarray(rate, float), np.asarray(force, float)
    size = np.linalg.norm(rate, axis=-1) / EARTH_RATE
    across = np.linalg.norm(np.cross(unit_vector(force), rate), axis=-1) / EARTH_RATE
    some = (size > _VERTICAL) & (size < 1.0 - _VERTICAL)
    return (np.asarray(position) >= 0) & np.any(force != 0.0, axis=-1) & (across < _VERTICAL) & some


def untold_heading_covariance(
    position: Int[AnyArray, "*dwell"],
    rate: Float[AnyArray, "*dwell 3"],
    force: Float[AnyArray, "*dwell 3"],
    duration: Float[AnyArray, "*dwell"],
    move: Bool[AnyArray, "*dwell"] | None = None,
) -> Float[np.ndarray, "*dwell 3 3"]:
    """What the horizontal part of Earth's rate gives to gyros' means where a reference holds its vertical part alone.

    Of rests ½ (Ω² − |ω|²) (E − u uᵀ), (rad/s)², with gravity's direction u; of the plateaus of such a table, which
    turn about the vertical for T s, the same about their own axis by sin²(|ω| T / 2) / (|ω| T / 2)². Zero elsewhere,
    and of moves from rest to rest, which turn often.

    **Arguments:** `position` is −1 while the table turns; `rate` and `force` are the references, rad/s and m/s²;
    `duration` in s; `move` marks moves.

    ```python
    import numpy as np
    from inertiax.physics.wgs84 import EARTH_RATE
    from inertiax.reduction.earth_at_rest import untold_heading_covariance

    up = np.array([0.0, 0.0, 1.0])
    rate = np.outer([0.5 * EARTH_RATE, 0.2, 0.2], up)    # at 30° of latitude: the horizontal part is 0.87 of the whole
    force = np.outer([9.81, 0.0, 0.0], up)
    found = untold_heading_covariance(np.array([0, -1, -1]), rate, force, np.array([20.0, 2.0, 31.416]))
    print(found[:, 0, 0] / EARTH_RATE**2)    # of a rest, a short plateau and a whole turn: [0.375 0.37  0.   ]
    ```
    """
    position, rate, force = np.asarray(position), np.asarray(rate, float), np.asarray(force, float)
    square = np.sum(np.square(rate), axis=-1) / EARTH_RATE**2
    level = np.where(heading_is_untold(position, rate, force), 1.0 - square, 0.0)
    most = np.max(level, axis=-1, keepdims=True, initial=0.0)
    turned = np.sqrt(square) * EARTH_RATE * np.asarray(duration)
    turning = (position < 0) & (turned > 0.0)
    if move is not None:
        most = np.where(np.asarray(move), 0.0, most)
    left = np.where(turning, most * np.square(np.sinc(turned / (2.0 * np.pi))), level)
    axis = unit_vector(np.where(turning[..., None], rate, force))
    part = 0.5 * EARTH_RATE**2 * left[..., None, None]
    return part * (np.eye(3) - axis[..., :, None] * axis[..., None, :])


def horizontal_covariance(dwells: Dwells, site: Site) -> Float[np.ndarray, "3 3"]:
    """What the unknown heading gives to the covariance of the gyros' bias, (rad/s)²:
    $\\frac{1}{2} (\\Omega \\cos\\varphi)^2 \\sum_p w_p^2 (E - u_p u_p^T)$ over attitudes p that have the part w_p of
    the rests. Rests within 45° count as one attitude, for a device that is turned by less keeps most of its heading."""
    if not is_known(dwells, site) or site.latitude is None:
        return np.zeros((3, 3))
    force = np.asarray(dwells.accel)[np.asarray(dwells.position) >= 0]
    up = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-12)
    left, total = np.ones(len(up), bool), np.zeros((3, 3))
    while left.any():
        first = up[int(np.argmax(left))]
        near = left & (up @ first > _ONE_DRAW)
        level = np.eye(3) - up[near].T @ up[near] / near.sum()
        total += (near.sum() / len(up)) ** 2 * level
        left &= ~near
    return 0.5 * (EARTH_RATE * math.cos(site.latitude)) ** 2 * total
