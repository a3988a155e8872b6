"""The table's motion in one experiment: rests, slews and turns at constant rate.

Slews take the shorter way and follow s(u) = u − sin(2πu)/2π, whose rate starts and ends at zero
without a jump; a turn spins up by s(u) = 2u³ − u⁴, goes round whole revolutions at constant rate and
spins down as it spun up. Angles and rates come from the same formulas, so that integrating the
rate gives the attitude.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from .._typing import AnyArray
from .programme import Programme


class Turn(eqx.Module):
    """Whole revolutions about one axis at constant rate, the other axis standing still."""

    axis: str = eqx.field(static=True)  # "outer" or "inner"
    rate: float = eqx.field(static=True)  # rad/s, signed
    revolutions: int = eqx.field(static=True, default=1)
    start: tuple[float, float] = eqx.field(static=True, default=(0.0, 0.0))  # rad: outer, inner
    spin_up: float = eqx.field(static=True, default=2.0)  # s, and as much to spin down

    def __check_init__(self):
        if self.axis not in ("outer", "inner"):
            raise ValueError(f"`Turn(axis={self.axis!r})`: it is 'outer' or 'inner'.")
        if self.rate == 0 or self.revolutions < 1 or self.spin_up <= 0:
            raise ValueError(
                "`Turn(rate=..., revolutions=..., spin_up=...)` needs a rate other than 0, at least "
                f"1 revolution and a time above 0 s; got {self.rate}, {self.revolutions} and "
                f"{self.spin_up}."
            )

    @property
    def plateau(self) -> float:
        """Time at constant rate, s."""
        return 2.0 * np.pi * self.revolutions / abs(self.rate)

    @property
    def index(self) -> int:
        """Column of the turning axis in a pair of angles."""
        return ("outer", "inner").index(self.axis)


def turns_about_three_axes(rate: float, *, revolutions: int = 1) -> tuple[Turn, ...]:
    """Turns both ways about the case's x, y and z axes, `rate` in rad/s: what gyros' scale factors
    and misalignments need. x and y lie along the outer axis at inner angles 0 and −90°."""
    starts = [("outer", (0.0, 0.0)), ("outer", (0.0, -0.5 * np.pi)), ("inner", (0.0, 0.0))]
    return tuple(
        Turn(axis, sign * rate, revolutions, start)
        for axis, start in starts
        for sign in (1.0, -1.0)
    )


class Segment(eqx.Module):
    """A stretch of motion by one law; `change` is how far each axis gets, rad."""

    law: str = eqx.field(static=True)  # rest | slew | up | plateau | down
    duration: float = eqx.field(static=True)  # s
    start: Float[np.ndarray, "2"]  # rad: outer, inner
    change: Float[np.ndarray, "2"]  # rad
    position: int = eqx.field(static=True, default=-1)


class Motion(eqx.Module):
    """Table angles and their rates at given times."""

    angles: Float[AnyArray, "time 2"]  # rad: outer, inner
    rates: Float[AnyArray, "time 2"]  # rad/s
    position: Int[AnyArray, " time"]  # -1 while the table turns


def segments(
    programme: Programme, turns: tuple[Turn, ...], *, dwell_time: float, slew_time: float
) -> list[Segment]:
    """The stretches of one experiment: the programme's positions, then the turns."""
    here = np.asarray(programme.angles)[0]
    found = []
    for angles, number in zip(
        np.asarray(programme.angles), np.asarray(programme.numbers), strict=True
    ):
        if found:
            found.append(_slew(here, angles, slew_time))
            here = here + found[-1].change
        found.append(Segment("rest", dwell_time, here, np.zeros(2), int(number)))
    for turn in turns:
        found.append(_slew(here, np.asarray(turn.start), slew_time))
        here = here + found[-1].change
        axis = np.eye(2)[turn.index]
        ramp = 0.5 * turn.rate * turn.spin_up * axis
        round_ = np.sign(turn.rate) * 2.0 * np.pi * turn.revolutions * axis
        parts = [("up", turn.spin_up, ramp), ("plateau", turn.plateau, round_)]
        for law, duration, change in [*parts, ("down", turn.spin_up, ramp)]:
            found.append(Segment(law, duration, here, change))
            here = here + change
    return found


def _slew(here: np.ndarray, there: np.ndarray, duration: float) -> Segment:
    change = (there - here + np.pi) % (2.0 * np.pi) - np.pi
    return Segment("slew", duration, here, change)


def start_times(parts: list[Segment]) -> Float[np.ndarray, " bounds"]:
    """When each segment starts, and last when the whole ends, s."""
    return np.concatenate([[0.0], np.cumsum([p.duration for p in parts])])


def move(parts: list[Segment], time: Float[np.ndarray, " time"]) -> Motion:
    """The table's motion at times (s) from the start of an experiment."""
    bounds = start_times(parts)
    # A sample that falls on a bound belongs to the stretch that starts there; rounding of the
    # bounds' sum must not give it to the one before.
    which = np.searchsorted(bounds, time + 1e-9, side="right") - 1
    which = np.clip(which, 0, len(parts) - 1)
    angles, rates = np.zeros((len(time), 2)), np.zeros((len(time), 2))
    position = np.full(len(time), -1)
    for i, part in enumerate(parts):
        rows = which == i
        u = np.clip((time[rows] - bounds[i]) / part.duration, 0.0, 1.0)
        progress, speed = _LAWS[part.law](u)
        angles[rows] = part.start + np.outer(progress, part.change)
        rates[rows] = np.outer(speed / part.duration, part.change)
        position[rows] = part.position
    return Motion(angles, rates, position)


def _slew_law(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    turn = 2.0 * np.pi * u
    return u - np.sin(turn) / (2.0 * np.pi), 1.0 - np.cos(turn)


def _up_law(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 2.0 * u**3 - u**4, 6.0 * u**2 - 4.0 * u**3


def _down_law(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    progress, speed = _up_law(1.0 - u)
    return 1.0 - progress, speed


# Progress from 0 to 1 and its derivative, as functions of u = 0…1.
_LAWS = {
    "rest": lambda u: (np.zeros_like(u), np.zeros_like(u)),
    "slew": _slew_law,
    "up": _up_law,
    "plateau": lambda u: (u, np.ones_like(u)),
    "down": _down_law,
}
