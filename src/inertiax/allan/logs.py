"""Noise of every channel of a recording at rest."""

from collections.abc import Callable

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..data.recording import Recording
from ..reduction.host_stamps import remark
from ..reduction.rests import PAUSE, usual_step
from ..reduction.segments import segment
from .confidence import interval
from .deviations import Deviations, deviations, usual_factors
from .identify import FEWEST, identify_samples
from .model import NoiseModel
from .repeats import own_samples


_LONG = 1 << 18  # samples from which on long averaging times use means of neighbours
_THINNED = 16  # samples to such a mean
UNLIKE = 5.0  # chi2_per_dof above which the terms do not describe a channel


class ChannelNoise(eqx.Module):
    """One channel: its Allan deviation with 68 % limits, and the noise terms."""

    channel: str = eqx.field(static=True)  # e.g. "gyro_x"
    curve: Deviations
    lower: Float[np.ndarray, " tau"]
    upper: Float[np.ndarray, " tau"]
    model: NoiseModel


class LogNoise(eqx.Module):
    """Noise of one recording's longest rest."""

    recording: str = eqx.field(static=True)
    device: str = eqx.field(static=True)
    rate: float = eqx.field(static=True)  # Hz
    duration: float = eqx.field(static=True)  # s
    channels: tuple[ChannelNoise, ...]
    notes: tuple[str, ...] = eqx.field(static=True)  # what a reader should know


def noise_of(recording: Recording, *, progress: Callable[[str], None] | None = None) -> LogNoise:
    """Allan deviations and noise terms of all channels, over the longest rest without a pause.

    Raises `ValueError` where no rest of 256 samples is found.
    """
    tell = progress if progress is not None else lambda _: None
    tell(f"looking for rests in {recording.name or 'the recording'}")
    rest, notes = _longest_rest(recording)
    rate = float((rest.num_samples - 1) / (rest.time[-1] - rest.time[0]))
    channels: list[ChannelNoise] = []
    for triad in ("accel", "gyro"):
        values = getattr(rest, triad)
        if values is None:
            continue
        own = own_samples(values)
        own_rate = own.rate(rate, len(values))
        if own.rows is not None:
            notes.append(
                f"{100.0 * own.share:.0f} % of the {triad} rows repeat the row before: the sensor's own "
                f"samples are used, {own_rate:.4g} a second"
            )
            if len(own.rows) < FEWEST:
                notes.append(f"{triad} has {len(own.rows)} samples of its own; {FEWEST} are needed")
                continue
        for axis, letter in enumerate("xyz"):
            name = f"{triad}_{letter}"
            tell(f"noise of {name}")
            log = np.ascontiguousarray(own.of(values[:, axis]))
            if np.ptp(log) == 0.0:
                notes.append(f"{name} is constant: a dead channel, or filled-in values")
                continue
            channels.append(_channel(name, triad, log, own_rate))
    if not channels:
        reason = "; ".join(notes) if notes else "every channel is constant"
        raise ValueError(f"{recording.name or 'the recording'}: no channel tells noise: {reason}.")
    notes += _remarks(channels)
    return LogNoise(
        recording.name,
        recording.device,
        rate,
        rest.num_samples / rate,
        tuple(channels),
        tuple(notes),
    )


def _channel(name: str, triad: str, log: Float[np.ndarray, " time"], rate: float) -> ChannelNoise:
    model = identify_samples(log, rate=rate, triad=triad)
    curve = _curve(log, rate)
    lower, upper = interval(curve, model.exponents(curve.tau))
    return ChannelNoise(name, curve, lower, upper, model)


def _curve(log: Float[np.ndarray, " time"], rate: float) -> Deviations:
    """Overlapping Allan deviations; of a long log those of long times from means of neighbours.

    Differences that begin at every sample or at every sixteenth tell the same where they span hundreds.
    """
    factors = usual_factors(len(log))
    if len(log) < _LONG:
        return deviations(log, rate=rate, factors=factors)
    short = deviations(log, rate=rate, factors=factors[factors < _THINNED**2])
    means = log[: len(log) // _THINNED * _THINNED].reshape(-1, _THINNED).mean(axis=1)
    longer = np.unique(factors[factors >= _THINNED**2] // _THINNED)
    long = deviations(means, rate=rate / _THINNED, factors=longer)
    join = lambda name, factor=1: np.concatenate(
        [getattr(short, name), getattr(long, name) * factor]
    )
    return Deviations(
        "oadev",
        rate,
        len(log),
        join("factor", _THINNED),
        join("tau"),
        join("deviation"),
        join("count"),
    )


def _longest_rest(recording: Recording) -> tuple[Recording, list[str]]:
    where = recording.name or "the recording"
    found = segment(recording)
    ranges = [
        piece
        for start, stop, rests in zip(found.start, found.stop, found.resting, strict=True)
        if rests
        for piece in _without_pauses(recording, int(start), int(stop))
    ]
    start, stop = max(ranges, key=lambda r: r[1] - r[0], default=(0, 0))
    if stop - start < FEWEST:
        raise ValueError(
            f"{where}: the longest rest has {stop - start} samples; noise needs a log of {FEWEST} or "
            f"more at rest, and hours of it for bias instability and random walk.{remark(recording)}"
        )
    rest, notes = recording[slice(start, stop)], []
    if stop - start < recording.num_samples:
        seconds = rest.time[-1] - rest.time[0]
        notes.append(
            f"only the longest rest is used: {seconds:.0f} s from {rest.time[0]:.0f} s on, of "
            f"{recording.time[-1] - recording.time[0]:.0f} s"
        )
    steps = np.diff(rest.time)
    if np.std(steps) > 0.2 * np.mean(steps):
        notes.append("the time stamps are uneven; equal steps were assumed")
    if rest.temperature is not None and np.ptp(rest.temperature[:, 0]) > 2.0:
        notes.append(
            f"the temperature moved by {np.ptp(rest.temperature[:, 0]):.1f} °C, which looks like random "
            f"walk or ramp; compensate the log first"
        )
    return rest, notes


def _without_pauses(recording: Recording, start: int, stop: int) -> list[tuple[int, int]]:
    steps = np.diff(recording.time[start:stop])
    cuts = start + 1 + np.flatnonzero(steps > PAUSE * usual_step(recording))
    edges = [start, *cuts.tolist(), stop]
    return list(zip(edges[:-1], edges[1:], strict=True))


def _remarks(channels: list[ChannelNoise]) -> list[str]:
    unlike = [c.channel for c in channels if c.model.chi2_per_dof > UNLIKE]
    remarks: list[str] = []
    if unlike:
        remarks.append(
            f"the terms do not describe {', '.join(unlike)} (see chi2_per_dof): look for vibration or a drifting "
            f"temperature"
        )
    for term, what in (("N", "white noise"), ("B", "bias instability"), ("K", "random walk")):
        untold = [c.channel for c in channels if not c.model.terms[term].shown]
        if untold:
            remarks.append(
                f"the log does not determine {what} ({term}) of {', '.join(untold)}: no value, and not exported"
            )
    return remarks
