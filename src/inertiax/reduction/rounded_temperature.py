"""A probe that reads in whole steps, as in whole degrees, put back between its steps.

Where the temperature passes from one reading to the next it is midway between both, whatever the step: these moments
tell its course. In between a cubic spline through them follows it, within half a step of the reading. A reading that
goes back and forth is dithered by noise and needs none of this; one that changes nearly every row is fine enough.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ..data.recording import Recording, Rig
from .mean_noise import quantisation_step


_FEWEST = 8  # changes of the reading: twice the unknowns of a cubic (convention)
_HELD = 4.0  # rows from change to change in the mean, below which a step costs nothing that a mean has not
_SINGLE = 0.9  # of the changes by one step: more at once is a gap, or another probe
_BACK = 0.2  # of the changes that take the one before back; noise of a tenth of a step makes half of them
# Times the holds beside it, from which a reading's hold is a soak, of which no spline knows the level; an exponential
# approach makes its last hold 3 times as long as the one before.
_SOAK = 6.0
# Steps, from which the course beyond the last change has left the reading: three changes tell where an exponential
# approach ends to half a step.
_OVER = 1.5
# Steps, rms, of the error between changes: in 234 simulated warm-ups, waves and ramps 0.00 to 0.05 outside soaks. In
# soaks, before the first change and behind the last one it was 0.03 to 0.28, where all of a step has 0.29.
_BETWEEN = 0.05
_WITHIN = 1.0 / math.sqrt(12.0)


def temperature_step(temperature: Float[np.ndarray, " time"]) -> float:
    """The step that a probe's readings go on by, where it hides the temperature's course in between; 0 elsewhere."""
    at = np.flatnonzero(np.diff(temperature))
    if len(at) < _FEWEST or len(temperature) < _HELD * len(at):
        return 0.0
    step = quantisation_step(temperature[np.r_[at, at[-1] + 1]])
    if step == 0.0:
        return 0.0
    jumps = np.round(np.diff(temperature)[at] / step)
    back = np.mean(jumps[1:] == -jumps[:-1])
    return step if np.mean(np.abs(jumps) == 1.0) >= _SINGLE and back <= _BACK else 0.0


def between_steps(
    time: Float[np.ndarray, " time"], temperature: Float[np.ndarray, " time"]
) -> Float[np.ndarray, " time"]:
    """The readings put between their steps; as they are where none shows."""
    step = temperature_step(temperature)
    if step == 0.0:
        return temperature
    at = np.flatnonzero(np.diff(temperature))
    moments = 0.5 * (time[at] + time[at + 1])
    middles = 0.5 * (temperature[at] + temperature[at + 1])
    # A soak stays at its reading, which is all that is known of it.
    edges, holds, soak = _soaks(time, moments)
    inner = np.concatenate([edges[soak] + 0.25 * holds[soak], edges[soak] + 0.75 * holds[soak]])
    level = temperature[np.searchsorted(time, inner)]
    order = np.argsort(np.r_[moments, inner])
    knots, values = np.r_[moments, inner][order], np.r_[middles, level][order]
    from scipy.interpolate import CubicSpline  # which few logs need

    course = CubicSpline(knots, values)
    made = course(time)
    for k in soak:
        made[(time > edges[k] + 0.25 * holds[k]) & (time < edges[k] + 0.75 * holds[k])] = (
            temperature[np.searchsorted(time, edges[k] + 0.5 * holds[k])]
        )
    first, last = time < moments[0], time > moments[-1]
    made[first] = _beyond(moments[2::-1], middles[2::-1], time[first], step)
    made[last] = _beyond(moments[-3:], middles[-3:], time[last], step)
    return np.clip(made, temperature - 0.5 * step, temperature + 0.5 * step)


def _soaks(
    time: Float[np.ndarray, " time"], moments: Float[np.ndarray, " change"]
) -> tuple[Float[np.ndarray, " edge"], Float[np.ndarray, " hold"], Int[np.ndarray, " soak"]]:
    """The changes with both ends of the time, how long each reading holds, and which holds are soaks."""
    edges = np.r_[time[0], moments, time[-1]]
    holds = np.diff(edges)
    return edges, holds, 1 + np.flatnonzero(holds[1:-1] > _SOAK * np.maximum(holds[:-2], holds[2:]))


def hidden_by_steps(recordings: Sequence[Recording]) -> float:
    """What is not known of the temperature between the steps of the first probes, °C, 1 sigma over all rows.

    Between two changes the course is known to a twentieth of a step; in a soak, before the first change and behind the
    last one it may be anywhere in the step. Zero where no steps show.
    """
    variance, rows = 0.0, 0
    for recording in recordings:
        rows += recording.num_samples
        if recording.temperature is None or type(recording) is not Recording:
            continue
        time, probe = np.asarray(recording.time), np.asarray(recording.temperature)[:, 0]
        step = temperature_step(probe)
        if step == 0.0:
            continue
        at = np.flatnonzero(np.diff(probe))
        _, holds, soak = _soaks(time, 0.5 * (time[at] + time[at + 1]))
        share = (holds[soak].sum() + holds[0] + holds[-1]) / holds.sum()
        variance += len(probe) * step**2 * (share * _WITHIN**2 + (1.0 - share) * _BETWEEN**2)
    return math.sqrt(variance / max(rows, 1))


def probe_sigma(rig: Rig) -> float:
    """1 sigma of the temperatures, °C: as the station states it, and what the readings' steps hide."""
    return math.hypot(rig.temperature_uncertainty or 0.0, rig.hidden_by_steps)


def with_rounding(rig: Rig, recordings: Sequence[Recording]) -> Rig:
    """The rig with what the probe's steps hide; the same where that is known, or nothing is hidden."""
    hidden = rig.hidden_by_steps or hidden_by_steps(recordings)
    return dataclasses.replace(rig, hidden_by_steps=hidden) if hidden else rig


def _beyond(
    moments: Float[np.ndarray, "3"],
    middles: Float[np.ndarray, "3"],
    time: Float[np.ndarray, " time"],
    step: float,
) -> Float[np.ndarray, " time"]:
    """The course beyond the last of three changes: its slope goes on to fall off as it did between them,
    exponentially; a slope that does not fall stays.

    Where that would change the reading once more, which it did not, the temperature turned or settled: from the same
    slope it goes to the middle of the step, exponentially, for nothing tells where in the step it stayed.
    """
    if not len(time):
        return np.zeros(0)
    away = np.abs(time - moments[-1])
    length = np.abs(np.diff(moments))
    before, slope = np.diff(middles) / length
    falls = 0.0 < slope / before < 1.0 if before != 0.0 else False
    if falls:
        rate = -float(np.log(slope / before)) / float(np.mean(length))
        slope = slope * np.exp(-rate * 0.5 * length[1])  # at the last change
        made = -slope * np.expm1(-rate * away) / rate
    else:
        made = slope * away
    if np.abs(made).max() > _OVER * step:
        half = 0.5 * step
        made = -np.sign(slope) * half * np.expm1(-np.abs(slope) / half * away)
    return middles[-1] + made


def with_courses(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """The recordings with their first probes' readings between steps; the same objects where nothing changes."""
    return tuple(_with_course(r) for r in recordings)


def _with_course(recording: Recording) -> Recording:
    if recording.temperature is None or type(recording) is not Recording:
        return recording
    first = np.asarray(recording.temperature)[:, 0]
    made = between_steps(np.asarray(recording.time), first)
    if made is first:
        return recording
    columns = np.column_stack([made, np.asarray(recording.temperature)[:, 1:]])
    return dataclasses.replace(recording, temperature=columns)
