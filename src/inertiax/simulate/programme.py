"""A two-axis table and the programmes of positions it goes through.

The outer axis is horizontal (east), the inner axis rides on it and is vertical at outer angle 0;
the case's z axis lies along the inner axis. A position is the pair of angles (outer, inner).

The founding paper used "an optimal programme of 18 positions" from its reference [5], which is not
printed; `PROGRAMME_18` (six faces and twelve edges of a cube) is assumed in its place. Of the
paper's 8-position check only the number is known; `PROGRAMME_8` (the corners) is assumed.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._typing import AnyArray, Scalar, Vec3
from ..physics import rotation


class Table(eqx.Module):
    """Axes of a two-axis table, unit vectors at zero angles: the outer one in the local level
    frame (ENU), the inner one in the frame of the outer gimbal."""

    outer_axis: Vec3 = eqx.field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    inner_axis: Vec3 = eqx.field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    def attitude(self, outer: Scalar | float, inner: Scalar | float) -> Float[Array, "3 3"]:
        """Rotation from the case to the local level frame at two angles, rad:
        $R = R_{outer}\\, R_{inner}$."""
        return rotation.about(self.outer_axis, outer) @ rotation.about(self.inner_axis, inner)

    def turning(
        self, inner: Scalar | float, outer_rate: Scalar | float, inner_rate: Scalar | float
    ) -> Float[Array, "3"]:
        """Angular rate of the case against the room, in the case frame, rad/s:
        $R_{inner}^T n_{outer} \\dot\\alpha + n_{inner} \\dot\\beta$."""
        carried = rotation.about(self.inner_axis, inner).T @ jnp.asarray(self.outer_axis)
        return carried * outer_rate + jnp.asarray(self.inner_axis) * inner_rate


class Programme(eqx.Module):
    """Positions of the table in the order in which they are visited.

    `numbers` names each position, so that a reordered programme still says which one is which.
    """

    name: str = eqx.field(static=True)
    angles: Float[AnyArray, "position 2"]  # rad: outer, inner
    numbers: Int[AnyArray, " position"]

    @property
    def num_positions(self) -> int:
        """How many positions are visited."""
        return int(self.numbers.shape[0])

    def directions(self) -> Float[np.ndarray, "position 3"]:
        """Unit vectors of the specific force in the case frame, for an ideal table."""
        outer, inner = np.asarray(self.angles).T
        sin = np.sin(outer)
        return np.stack([np.sin(inner) * sin, np.cos(inner) * sin, np.cos(outer)], axis=1)


def programme_from_angles(name: str, degrees: Float[np.ndarray, "position 2"]) -> Programme:
    """A programme of (outer, inner) angles given in degrees, numbered from 0."""
    angles = np.deg2rad(np.asarray(degrees, float))
    return Programme(name, angles, np.arange(len(angles)))


def programme_from_directions(name: str, directions: Float[np.ndarray, "position 3"]) -> Programme:
    """The programme that points the specific force along each direction of the case frame.

    With u the unit vector, outer = atan2(|(u_x, u_y)|, u_z) and inner = atan2(u_x, u_y), which
    leaves the inner angle 0 where u is along the inner axis.
    """
    u = np.asarray(directions, float)
    if u.ndim != 2 or u.shape[1] != 3 or not np.all(np.linalg.norm(u, axis=1) > 0):
        raise ValueError(
            f"`programme_from_directions({name!r}, ...)` needs rows of 3 numbers, none of them all "
            f"zero; got shape {u.shape}."
        )
    angles = np.stack(
        [np.arctan2(np.hypot(u[:, 0], u[:, 1]), u[:, 2]), np.arctan2(u[:, 0], u[:, 1])], axis=1
    )
    return Programme(name, angles, np.arange(len(angles)))


def reordered(programme: Programme, order: str, *, seed: int = 0) -> Programme:
    """The same positions in another order: `"given"`, `"reversed"` or `"shuffled"` (by `seed`)."""
    count = programme.num_positions
    if order == "given":
        rows = np.arange(count)
    elif order == "reversed":
        rows = np.arange(count)[::-1]
    elif order == "shuffled":
        rows = np.random.default_rng(seed).permutation(count)
    else:
        raise ValueError(
            f"`reordered(order={order!r})`: no such order; it is one of {list(ORDERS)}."
        )
    return Programme(programme.name, programme.angles[rows], programme.numbers[rows])


ORDERS = ("given", "reversed", "shuffled")


def _tumble(step: float, *, fixed: float, turns: str) -> Float[np.ndarray, "position 2"]:
    angles = np.arange(0.0, 360.0, step)
    other = np.full_like(angles, fixed)
    return np.stack([angles, other] if turns == "outer" else [other, angles], axis=1)


# Eight positions 45° apart in each of the planes yz, xz and xy: faces are met twice.
_TUMBLES = np.concatenate(
    [
        _tumble(45.0, fixed=0.0, turns="outer"),
        _tumble(45.0, fixed=90.0, turns="outer"),
        _tumble(45.0, fixed=90.0, turns="inner"),
    ]
)

PROGRAMME_6 = programme_from_angles(
    "6", np.array([[0, 0], [180, 0], [90, 0], [270, 0], [90, 90], [270, 90]], float)
)
PROGRAMME_8 = programme_from_directions(
    "8",
    np.array(
        [
            [1, 1, 1],
            [-1, 1, 1],
            [-1, -1, 1],
            [1, -1, 1],
            [1, -1, -1],
            [-1, -1, -1],
            [-1, 1, -1],
            [1, 1, -1],
        ],
        float,
    ),
)
# The three tumbles without a direction that came before.
PROGRAMME_18 = programme_from_angles(
    "18", _TUMBLES[[*range(8), 9, 10, 11, 13, 14, 15, 17, 19, 21, 23]]
)
PROGRAMME_24 = programme_from_angles("24", _TUMBLES)

PROGRAMMES = {p.name: p for p in (PROGRAMME_6, PROGRAMME_8, PROGRAMME_18, PROGRAMME_24)}
