"""Runs of an hour at most that a station, a hand or a chamber can add to a campaign.

A run is a `[plan]` of a scenario (`simulate.scenario`), so that it is simulated, written and read as any other. Where a
chamber moves, its path is made of experiments that follow each other without a pause, each a ramp or a soak; a pause of
half a minute or more between experiments is a power cycle (`observations.blocks.Log.cycle`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..._typing import AnyArray
from ...physics.directions import up_in_words
from ...simulate.programme import PROGRAMME_6, PROGRAMME_8, PROGRAMME_18, programme_from_angles
from ...simulate.scenario import PlanTable
from ..observations.blocks import Log


LONGEST = 3600.0  # s, of a run
ENOUGH_POSES = 6  # positions of a campaign from which the device can be turned at will
HEATED = 5.0  # °C over a campaign from which there is a chamber
FASTEST = 3.0  # °C/min, of a usual chamber (convention)
DWELL, SLEW = 50.0, 10.0  # s
PIECE = 6 * DWELL + 5 * SLEW  # s, of one experiment over six faces
PAUSE = 300.0  # s without power
REVOLVED = 6 * 14.0  # s of slews and spin-ups of six turns
_ROOM = 20.0  # °C, where nobody says

Angles = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Station:
    """What a campaign shows that can be done with the device."""

    turned: bool  # into any position
    temperature: float  # °C, mean
    span: float  # °C that a chamber moves; 0 without one
    rate: float  # deg/s, the fastest of a rate table; 0 without one


@dataclass(frozen=True)
class Run:
    """One run, in a few words and as a scenario's plan."""

    name: str
    plan: PlanTable

    @property
    def seconds(self) -> float:
        """How long it takes, pauses included."""
        turning = sum(REVOLVED + 6 * 360.0 / rate for _, rate in self.turns())
        count = len(self.plan.temperatures)
        return count * (self._resting + turning) + (count - 1) * self.plan.soak_time

    @property
    def minutes(self) -> float:
        """The same in minutes."""
        return self.seconds / 60.0

    @property
    def _resting(self) -> float:
        """How long one experiment's positions take, s."""
        said = self.plan
        return len(said.positions or ()) * (said.dwell_time + said.slew_time) - said.slew_time

    def stages(self) -> "tuple[Stage, ...]":
        """Its experiments in words, in their order."""
        said = self.plan
        changes = said.change
        if not isinstance(changes, tuple):
            changes = (changes,) * len(said.temperatures)
        directions = programme_from_angles(self.name, np.array(said.positions, float)).directions()
        ups = tuple((float(x), float(y), float(z)) for x, y, z in np.round(directions, 6) + 0.0)
        made = []
        for k, (start, change) in enumerate(zip(said.temperatures, changes, strict=True)):
            afresh = bool(k and said.soak_time)
            power = (
                f"power off, wait {said.soak_time / 60.0:.0f} min, power on and record at once"
                if afresh
                else ""
            )
            chamber = _chamber(start, change, self._resting / 60.0) if any(changes) else ""
            aim = start + change if any(changes) else None
            made.append(Stage(power, chamber, ups, aim))
        return tuple(made)

    def turns(self) -> tuple[tuple[str, float], ...]:
        """Turns of a rate table that come last: in words, and their rate, deg/s."""
        said = self.plan.turn_rate
        rates = said if isinstance(said, tuple) else (said,)
        words = "turn the table once each way about x, y and z at"
        return tuple((f"{words} {rate:g} deg/s", rate) for rate in rates if rate)

    def checklist(self) -> tuple[str, ...]:
        """What to do, step by step, in words; the same stages as `inertiax live --separate` tells."""
        said, steps = self.plan, []
        poses = said.positions or ()
        for stage in self.stages():
            if stage.power:
                steps.append(stage.power)
            if stage.chamber:
                where = f"; go on through the positions {_listed(poses)}" if len(poses) > 1 else ""
                steps.append(stage.chamber + where)
            elif len(poses) == 1:
                up = up_in_words(np.array(stage.ups[0]))
                steps.append(f"leave the device alone for {said.dwell_time / 60.0:.0f} min {up}")
            else:
                steps.append(
                    f"rest {said.dwell_time:.0f} s in each of the positions {_listed(poses)}"
                )
        return (*steps, *(words for words, _ in self.turns()))


@dataclass(frozen=True)
class Stage:
    """One experiment of a run."""

    power: str  # what is done with the power before, in words; "" where nothing is
    chamber: str  # what the chamber does meanwhile; "" where there is none
    ups: tuple[tuple[float, float, float], ...]  # direction of the specific force at each position
    aim: float | None  # °C that the chamber reaches

    @property
    def afresh(self) -> bool:
        """Whether the power was off before."""
        return self.power != ""


def _chamber(start: float, change: float, minutes: float) -> str:
    if not change:
        return f"hold {start:.0f} °C for {minutes:.0f} min"
    way = "heat" if change > 0.0 else "cool"
    return (
        f"{way} from {start:.0f} to {start + change:.0f} °C in {minutes:.0f} min "
        f"({abs(change) / minutes:.1f} °C/min)"
    )


def _listed(poses: Angles) -> str:
    """Angles of the outer and inner axis, deg."""
    return ", ".join(f"({outer:g}, {inner:g})" for outer, inner in poses)


def station_of(log: Log) -> Station:
    """What the campaign of a log was done with."""
    poses = np.unique(log.position[log.position >= 0])
    temperature, span = _ROOM, 0.0
    if log.temperature is not None:
        low, high = float(log.temperature.min()), float(log.temperature.max())
        temperature = 0.5 * (low + high)
        span = min(high - low, FASTEST * PIECE / 60.0) if high - low > HEATED else 0.0
    rate = 0.0
    if log.reference_gyro is not None:
        size = np.linalg.norm(log.reference_gyro, axis=1)
        steady = log.segments.position < 0
        inside = [
            float(np.median(size[a:b]))
            for a, b in zip(log.segments.start[steady], log.segments.stop[steady])
        ]
        rate = float(np.degrees(max(inside, default=0.0)))
    return Station(len(poses) >= ENOUGH_POSES, temperature, span, rate)


def menu(station: Station, axis: int) -> tuple[Run, ...]:
    """Runs that the station can do, none longer than `LONGEST`; with the case's `axis` (0, 1, 2) up where the device
    stays in one position, so that it feels gravity."""
    faces, corners, edges = (_angles(p.angles) for p in (PROGRAMME_6, PROGRAMME_8, PROGRAMME_18))
    alone = ((_UPRIGHT[axis]),) if station.turned else faces[:1]
    poses = faces if station.turned else alone
    runs = [
        Run("a long rest", _still(station, alone, dwell=3000.0)),
        Run("power cycles at one temperature", _still(station, alone, dwell=480.0, count=4)),
    ]
    if station.turned:
        runs += [
            Run("six faces twice", _still(station, 2 * faces)),
            Run("six faces out and back", _still(station, (*faces, *faces[::-1]))),
            Run("eight corners twice", _still(station, 2 * corners)),
            Run("six faces, twelve edges, eight corners", _still(station, (*edges, *corners))),
            Run("a tumble by 30 degrees about each axis", _still(station, _tumbles(30.0))),
        ]
    if station.span:
        runs += [Run(name, _heated(station, poses, parts)) for name, parts in _PATHS.items()]
    if station.span and station.turned:
        plan = _heated(station, edges, (1.0, -1.0))
        runs.append(Run("faces and edges while it heats, and again while it cools", plan))
    if station.rate:
        plan = _still(station, poses, rates=_rates(station.rate))
        runs.append(Run("a staircase of rates, both ways about three axes", plan))
    return tuple(run for run in runs if run.seconds <= LONGEST)


# Table angles, deg, with an axis of the case up.
_UPRIGHT = ((90.0, 90.0), (90.0, 0.0), (0.0, 0.0))

# Paths of a chamber as changes in the span that it moves, one experiment each; 0 is a soak.
_PATHS = {
    "ramps up and down at two speeds with soaks between": (
        *(1.0, 0.0, -1.0, 0.0),
        *(0.5, 0.5, 0.0, -0.5, -0.5),
    ),
    "soaks at one temperature, reached from below and from above": (
        *(0.0, 0.5, 0.0, -0.5, 0.0),
        *(-0.5, 0.0, 0.5, 0.0),
    ),
    "there and back: the first temperature again": (0.0, 1.0, 0.0, -1.0, 0.0),
}


def _still(
    station: Station,
    positions: Angles,
    *,
    dwell: float = DWELL,
    count: int = 1,
    rates: tuple[float, ...] = (),
) -> PlanTable:
    """Positions at one temperature, `count` times with the power off between, and turns at some rates."""
    return PlanTable(
        positions=positions,
        temperatures=count * (round(station.temperature, 3),),
        change=0.0,
        drift="one-sided",
        dwell_time=dwell,
        slew_time=SLEW,
        soak_time=PAUSE if count > 1 else 0.0,
        turn_rate=rates or 0.0,
    )


def _heated(station: Station, poses: Angles, parts: Sequence[float]) -> PlanTable:
    """Pieces of a chamber's path within the middle of what the campaign had."""
    path = np.cumsum([0.0, *parts])
    lowest = station.temperature - 0.5 * station.span
    start = lowest - min(path) * station.span
    dwell = DWELL if len(poses) > 1 else PIECE
    return PlanTable(
        positions=poses,
        temperatures=tuple(round(float(start + station.span * p), 3) for p in path[:-1]),
        change=tuple(round(float(station.span * p), 3) for p in parts),
        drift="one-sided",
        dwell_time=dwell,
        slew_time=SLEW,
        soak_time=0.0,
    )


def _rates(fastest: float) -> tuple[float, ...]:
    """Levels by halves from the fastest down, as far as an hour goes."""
    rates, seconds = [], PIECE
    for k in range(5):
        rate = fastest / 2.0**k
        seconds += REVOLVED + 6 * 360.0 / rate
        if seconds > LONGEST:
            break
        rates.append(round(rate, 4))
    return tuple(rates)


def _angles(radians: AnyArray) -> Angles:
    return tuple((float(a), float(b)) for a, b in np.round(np.degrees(np.asarray(radians)), 6))


def _tumbles(step: float) -> Angles:
    around = np.arange(0.0, 360.0, step)
    outer = [(float(a), inner) for inner in (0.0, 90.0) for a in around]
    return (*outer, *((90.0, float(a)) for a in around))
