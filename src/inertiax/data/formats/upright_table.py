"""What ideal triads read on a table that turns about the vertical alone, from its rate and the face the device lies on.

Such a table has no angles that tell how the device stands. A fixture puts one of the device's axes upright, and gravity
at rest says which: with that axis as the unit vector u of the case, ideal triads read

    a = g u,    ω = (r + Ω sin φ) u

at the table's rate r about up. What lies across u is told by nobody: of the force while the table turns, and of Earth's
rate, the horizontal part. Of whole turns its mean is zero.
"""

import math

import numpy as np
from jaxtyping import Float

from ...physics.wgs84 import EARTH_RATE
from .turntable import Turntable


SLOW = (
    1e-3  # rad/s (0.06 °/s): a slower table rests, and its rate is an encoder's noise (convention)
)
# rad, of gravity's direction off an axis of the case: biases, misalignment and fixture together make a few degrees of a
# consumer device, and between two faces there are 45 (convention).
_LEANS = math.radians(20.0)
_MOVED = 0.1  # part of the rows at rest that may be farther off: the device is lifted out at the end (convention)


def is_upright_table(table: Turntable) -> bool:
    """Whether `[table]` says that there is one axis, the vertical.

    ```python
    from inertiax.data.formats.turntable import Turntable
    from inertiax.data.formats.upright_table import is_upright_table

    print(is_upright_table(Turntable(axes=("up",))), is_upright_table(Turntable(axes=("up", "north"))))    # True False
    ```
    """
    return table.axes in (("up",), ("down",))


def readings_on_a_face(
    table: Turntable,
    accel: Float[np.ndarray, "rows 3"],
    rate: Float[np.ndarray, " rows"],
    gravity: float,
    latitude: float | None,
    where: str,
) -> tuple[Float[np.ndarray, "rows 3"], Float[np.ndarray, "rows 3"]]:
    """Specific force (m/s², zero while the table turns) and rate (rad/s), see the module.

    **Arguments:** `accel` are the outputs, m/s², of one mounting; `rate` in rad/s about the table's axis, up or down;
    `latitude` in rad, without which the Earth's rate is left out.

    Raises `ValueError` where the table never rests, where gravity lies along no axis of the case, and where it does not
    lie along one all along.

    ```python
    import numpy as np
    from inertiax.data.formats.turntable import Turntable
    from inertiax.data.formats.upright_table import readings_on_a_face

    accel = np.tile([0.1, -9.7, 0.2], (3, 1))    # y points down
    force, rate = readings_on_a_face(Turntable(axes=("up",)), accel, np.array([0.0, 0.0, 1.0]), 9.81, None, "log")
    print(force[0], rate[2])    # [ 0.   -9.81  0.  ] [ 0. -1.  0.]
    ```
    """
    rests = np.abs(rate) < SLOW
    if not rests.any():
        raise ValueError(
            f"{where}: the table never rests, so that gravity does not tell which axis of the device points up; let it "
            "rest for some seconds before and after its rates."
        )
    felt = accel[rests]
    mean = felt.mean(axis=0)
    axis = int(np.argmax(np.abs(mean)))
    up = np.sign(mean[axis]) * np.eye(3)[axis]
    cosine = felt @ up / np.maximum(np.linalg.norm(felt, axis=1), 1e-300)
    if np.mean(cosine < math.cos(_LEANS)) > _MOVED:
        lean = math.degrees(math.acos(min(float(mean @ up / np.linalg.norm(mean)), 1.0)))
        raise ValueError(
            f"{where}: [columns] table_rates without table_angles: gravity at rest must lie along one axis of the "
            f"device all along, and its mean is {lean:.0f}° from the nearest. Give each mounting a file of its own, or "
            "write reference_accel and reference_gyro."
        )
    sense = 1.0 if table.axes == ("up",) else -1.0
    vertical = 0.0 if latitude is None else EARTH_RATE * math.sin(latitude)
    turning = np.where(rests, 0.0, sense * rate)
    return np.outer(gravity * rests, up), np.outer(turning + vertical, up)
