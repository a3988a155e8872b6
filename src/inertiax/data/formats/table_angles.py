"""What ideal triads read on a table, from the angles of its axes.

The room's axes are east, north and up. Every axis is stated as it points in the room while all angles are zero, the
outermost first, and turns right-handed about itself; a device axis is stated as it points then. With unit vectors
$a_k$, angles $\\theta_k$ and the device's axes as columns of $M$, the case stands in the room as

$$R = \\exp(\\theta_1 [a_1]_\\times) \\cdots \\exp(\\theta_n [a_n]_\\times) \\, M,$$

since an outer axis carries the inner ones along. Ideal triads read $R^T (0, 0, g)$ and $R^T \\Omega + \\sum_k
R_k^T \\dot\\theta_k a_k$, where $R_k$ is the product of the factors from the k-th on.
The rates are those of `table_rates`.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...physics.wgs84 import EARTH_RATE
from .columns import nearest
from .turntable import Direction, Turntable


DIRECTIONS = {
    "east": (1.0, 0.0, 0.0), "west": (-1.0, 0.0, 0.0), "north": (0.0, 1.0, 0.0),
    "south": (0.0, -1.0, 0.0), "up": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0),
}  # fmt: skip
_SQUARE = 1e-6  # by which the device's axes may miss being orthogonal, as digits of vectors do


class Readings(NamedTuple):
    """What ideal triads read; the rate is `None` where the table's rates are not known."""

    force: Float[np.ndarray, "rows 3"]  # m/s²
    rate: Float[np.ndarray, "rows 3"] | None  # rad/s


def ideal_readings(
    table: Turntable,
    angles: Float[np.ndarray, "rows axes"],
    rates: Float[np.ndarray, "rows axes"] | None,
    gravity: float,
    latitude: float | None,
) -> Readings:
    """Specific force and rate that ideal triads read, see the module.

    **Arguments:** `angles` in rad, `rates` in rad/s; `gravity` in m/s², `latitude` in rad, without which the Earth's
    rate is left out.

    Raises `ValueError` for directions that are none, for as many axes as there are no angles, and for device axes that
    are not orthogonal and right-handed.

    ```python
    import numpy as np
    from inertiax.data.formats.turntable import Turntable
    from inertiax.data.formats.table_angles import ideal_readings

    table = Turntable(axes=("up", "north"))     # a yaw axis that carries a roll axis
    print(ideal_readings(table, np.deg2rad([[30.0, 90.0]]), None, 9.81, None).force.round(3))    # [[-9.81  0.    0.  ]]
    ```
    """
    axes = [_unit(d, "axes") for d in table.axes]
    if angles.shape[1] != len(axes):
        raise ValueError(
            f"[table] axes has {len(axes)} directions, but [columns] table_angles names {angles.shape[1]} columns; "
            "each axis has one, the outermost first."
        )
    case = _case(table)
    force = np.tile([0.0, 0.0, gravity], (len(angles), 1))
    rate = (
        None if rates is None else np.tile(_earth(table.azimuth or 0.0, latitude), (len(angles), 1))
    )
    for k, axis in enumerate(axes):
        force = _turned(force, axis, -angles[:, k])
        if rate is not None and rates is not None:
            rate = _turned(rate, axis, -angles[:, k]) + rates[:, k : k + 1] * axis
    return Readings(force @ case, None if rate is None else rate @ case)


def two_axes(table: Turntable) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Unit vectors of a table with two axes: the outer one in the room (north, west, up), the inner one in the case.

    `None` for other tables. Raises `ValueError` as `ideal_readings`.

    ```python
    from inertiax.data.formats.turntable import Turntable
    from inertiax.data.formats.table_angles import two_axes

    print(two_axes(Turntable(axes=("west", "up"))))    # ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    ```
    """
    if len(table.axes) != 2:
        return None
    outer, inner = (_unit(d, "axes") for d in table.axes)
    a = math.radians(table.azimuth or 0.0)
    north = np.array([-math.sin(a), math.cos(a), 0.0])
    west = np.array([-north[1], north[0], 0.0])
    in_room = np.array([north @ outer, west @ outer, outer[2]]) + 0.0  # no zero is negative
    return tuple(in_room.tolist()), tuple((inner @ _case(table) + 0.0).tolist())


def _turned(
    vectors: Float[np.ndarray, "rows 3"],
    axis: Float[np.ndarray, "3"],
    angle: Float[np.ndarray, " rows"],
) -> Float[np.ndarray, "rows 3"]:
    """Vectors turned about one axis, Rodrigues' formula."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    along = (vectors @ axis)[:, None] * axis
    return c * vectors + s * np.cross(axis, vectors) + (1.0 - c) * along


def _earth(azimuth: float, latitude: float | None) -> Float[np.ndarray, "3"]:
    if latitude is None:
        return np.zeros(3)
    a = math.radians(azimuth)
    level = math.cos(latitude)
    return EARTH_RATE * np.array([-level * math.sin(a), level * math.cos(a), math.sin(latitude)])


def _case(table: Turntable) -> Float[np.ndarray, "3 3"]:
    """The device's axes in the room as columns."""
    case = np.stack([_unit(d, "case") for d in table.case], axis=1)
    if np.abs(case.T @ case - np.eye(3)).max() > _SQUARE:
        raise ValueError("[table] case: the device's axes x, y, z must be at right angles.")
    if np.linalg.det(case) < 0.0:
        raise ValueError(
            "[table] case: the device's axes x, y, z are left-handed; exchange two or turn one round."
        )
    return case


def _unit(direction: Direction, key: str) -> Float[np.ndarray, "3"]:
    if isinstance(direction, str):
        if direction not in DIRECTIONS:
            raise ValueError(
                f"[table] {key}: '{direction}' is no direction; {nearest(direction, DIRECTIONS)}one of "
                f"{', '.join(DIRECTIONS)} is needed, or a vector [east, north, up]."
            )
        return np.array(DIRECTIONS[direction])
    vector = np.asarray(direction, float)
    size = float(np.linalg.norm(vector))
    if not (math.isfinite(size) and size > 0.0):
        raise ValueError(f"[table] {key}: {list(direction)} is no direction.")
    return vector / size
