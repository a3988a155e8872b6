"""What the station is told to do: positions, temperatures and times of every experiment.

An experiment is dwell, slew, dwell, …, dwell over the programme's positions and then the turns, if
any, while the chamber's temperature drifts. Between experiments lies a soak, in which nothing is
recorded.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._typing import Scalar
from .chamber import Chamber, PAPER_CHANGES, PAPER_TEMPERATURES
from .motion import Segment, segments, start_times, Turn
from .programme import Programme, PROGRAMME_8, PROGRAMME_18, Table


PAPER_GRAVITY = 9.815179  # m/s², the founding paper's reference value
PAPER_LATITUDE = float(np.deg2rad(55.57))  # rad; not printed: the authors' town, Ramenskoye


class Plan(eqx.Module):
    """A campaign of experiments over one programme; see the module's docstring."""

    programme: Programme
    chamber: Chamber
    table: Table = Table()
    gravity: Scalar | float = PAPER_GRAVITY  # m/s²
    latitude: Scalar | float = PAPER_LATITUDE  # rad
    dwell_time: float = eqx.field(static=True, default=60.0)  # s at each position
    slew_time: float = eqx.field(static=True, default=10.0)  # s from one position to the next
    soak_time: float = eqx.field(static=True, default=7200.0)  # s between experiments
    turns: tuple[Turn, ...] = ()  # constant-rate turns after the positions, for gyros
    position_error: Scalar | float = 0.0  # rad, 1 sigma of each axis at each positioning

    def __check_init__(self):
        if not (self.dwell_time > 0 and self.slew_time > 0 and self.soak_time >= 0):
            raise ValueError(
                "`Plan(dwell_time=..., slew_time=..., soak_time=...)` needs times in s, the first "
                f"two above 0; got {self.dwell_time}, {self.slew_time} and {self.soak_time}."
            )

    @property
    def num_experiments(self) -> int:
        """How many experiments are run."""
        return int(np.shape(self.chamber.nominal)[0])

    @property
    def experiment_time(self) -> float:
        """Length of one experiment, s."""
        n = self.programme.num_positions
        turning = sum(self.slew_time + 2.0 * t.spin_up + t.plateau for t in self.turns)
        return n * self.dwell_time + (n - 1) * self.slew_time + turning

    def start_times(self) -> Float[np.ndarray, " experiment"]:
        """When each experiment starts, s from the start of the campaign."""
        return np.arange(self.num_experiments) * (self.experiment_time + self.soak_time)

    def segments(self, errors: Float[np.ndarray, "position 2"] | None = None) -> list[Segment]:
        """The table's motion in one experiment, stretch by stretch; with positioning `errors`
        (rad) the motion that really happens."""
        programme = self.programme
        if errors is not None:
            angles = np.asarray(programme.angles) + errors
            programme = Programme(programme.name, angles, programme.numbers)
        return segments(programme, self.turns, dwell_time=self.dwell_time, slew_time=self.slew_time)

    def dwells(self) -> tuple[Float[np.ndarray, " dwell"], Float[np.ndarray, " dwell"]]:
        """Middle (s from the start of an experiment) and duration (s) of each rest, in the order
        visited, and then of each turn's plateau."""
        parts = self.segments()
        kept = [i for i, p in enumerate(parts) if p.law in ("rest", "plateau")]
        duration = np.array([parts[i].duration for i in kept])
        return start_times(parts)[kept] + 0.5 * duration, duration


def paper_set(
    number: int,
    *,
    programme: Programme = PROGRAMME_18,
    drift: str = "centred",
    temperatures: tuple[float, ...] = PAPER_TEMPERATURES,
    change: float | None = None,
    dwell_time: float = 60.0,
    slew_time: float = 10.0,
    turns: tuple[Turn, ...] = (),
) -> Plan:
    """The founding paper's set 1, 2 or 3: 13 experiments from −55 to +60 °C over 18 positions, in
    each of which the temperature changes by 15, 4 or 0.5 °C (or by `change`).

    The times are assumed (the paper prints none): a minute at each position and 10 s between make
    an experiment of 20 min 50 s. Other plans come from other arguments.
    """
    if number not in (1, 2, 3):
        raise ValueError(f"`paper_set({number})`: the paper's sets are 1, 2 and 3.")
    size = PAPER_CHANGES[number - 1] if change is None else change
    return Plan(
        programme,
        # The size as an array: the three sets then share what is compiled for one.
        Chamber(jnp.asarray(temperatures), jnp.asarray(float(size)), drift),
        dwell_time=dwell_time,
        slew_time=slew_time,
        turns=turns,
    )


def paper_check(*, programme: Programme = PROGRAMME_8, start: float = 20.0) -> Plan:
    """The founding paper's check: 8 positions while the chamber goes from +20 to +30 °C at
    +2 °C/min, so in 300 s; 27 s at each position and 12 s between them (assumed)."""
    return Plan(
        programme,
        Chamber(jnp.asarray([start]), 10.0, "one-sided"),
        dwell_time=27.0,
        slew_time=12.0,
    )
