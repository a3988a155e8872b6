"""Runs of an hour at most that a station, a hand or a chamber can add to a campaign.

A run is a `[plan]` of a scenario (`simulate.scenario`), so that it is simulated, written and read as any other. Where a
chamber moves, its path is made of experiments that follow each other without a pause, each a ramp or a soak; a pause of
half a minute or more between experiments is a power cycle (`observations.blocks.Log.cycle`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..._typing import AnyArray
from ...simulate.programme import PROGRAMME_6, PROGRAMME_8, PROGRAMME_18
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
        said = self.plan
        positions = said.positions or ()
        rates = said.turn_rate if isinstance(said.turn_rate, tuple) else (said.turn_rate,)
        turning = sum(REVOLVED + 6 * 360.0 / r for r in rates if r)
        one = len(positions) * (said.dwell_time + said.slew_time) - said.slew_time + turning
        count = len(said.temperatures)
        return count * one + (count - 1) * said.soak_time

    @property
    def minutes(self) -> float:
        """The same in minutes."""
        return self.seconds / 60.0

    def checklist(self) -> tuple[str, ...]:
        """What to do, step by step, in words."""
        said, steps = self.plan, []
        changes = said.change if isinstance(said.change, tuple) else (said.change,)
        minutes = (self.seconds - (len(changes) - 1) * said.soak_time) / 60.0 / len(changes)
        poses = said.positions or ()
        heated = any(changes)
        for k, (start, change) in enumerate(zip(said.temperatures, changes)):
            if k and said.soak_time:
                steps.append(
                    f"power off, wait {said.soak_time / 60.0:.0f} min, power on and record at once"
                )
            where = f"; go on through the positions {_listed(poses)}" if len(poses) > 1 else ""
            if heated and change:
                way = "heat" if change > 0.0 else "cool"
                steps.append(
                    f"{way} from {start:.0f} to {start + change:.0f} °C in {minutes:.0f} min "
                    f"({abs(change) / minutes:.1f} °C/min){where}"
                )
            elif heated:
                steps.append(f"hold {start:.0f} °C for {minutes:.0f} min{where}")
            elif len(poses) == 1:
                steps.append(f"leave the device alone for {said.dwell_time / 60.0:.0f} min")
            else:
                steps.append(
                    f"rest {said.dwell_time:.0f} s in each of the positions {_listed(poses)}"
                )
        rates = said.turn_rate if isinstance(said.turn_rate, tuple) else (said.turn_rate,)
        steps += [
            f"turn the table once each way about x, y and z at {rate:g} deg/s"
            for rate in rates
            if rate
        ]
        return tuple(steps)


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
