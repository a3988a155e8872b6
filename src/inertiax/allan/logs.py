"""Noise of every channel of a recording at rest."""

from collections.abc import Callable, Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..data.recording import Recording
from .confidence import interval
from .deviations import Deviations, deviations, short_deviations, usual_factors
from .identify import FEWEST, identify_samples
from .model import NoiseModel
from .repeats import own_samples
from .rest_channels import longest_rest, name_of
from .stored_channel import blocks_of, is_constant, Log


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


def noise_of(
    recording: Recording | Sequence[Recording], *, progress: Callable[[str], None] | None = None
) -> LogNoise:
    """Allan deviations and noise terms of all channels, over the longest rest without a pause.

    **Arguments:** `recording`, or the parts of one log in their order (`data.stored_recording`).

    Raises `ValueError` where no rest of 256 samples is found.
    """
    parts = (recording,) if isinstance(recording, Recording) else tuple(recording)
    tell = progress if progress is not None else lambda _: None
    where = name_of(parts)
    tell(f"looking for rests in {where or 'the recording'}")
    rest, notes = longest_rest(parts)
    first, last = rest.span
    rate = float((rest.num_samples - 1) / (last - first))
    channels: list[ChannelNoise] = []
    for triad in ("accel", "gyro"):
        if not rest.has(triad):
            continue
        axes = [rest.channel(triad, axis) for axis in range(3)]
        own = own_samples(axes)
        own_rate = own.rate(rate, rest.num_samples)
        if own.rows is not None:
            notes.append(
                f"{100.0 * own.share:.0f} % of the {triad} rows repeat the row before: the sensor's own "
                f"samples are used, {own_rate:.4g} a second"
            )
            if len(own.rows) < FEWEST:
                notes.append(f"{triad} has {len(own.rows)} samples of its own; {FEWEST} are needed")
                continue
        for axis, letter in zip(axes, "xyz", strict=True):
            name = f"{triad}_{letter}"
            tell(f"noise of {name}")
            fresh = own.of(axis)
            if is_constant(fresh):
                notes.append(f"{name} is constant: a dead channel, or filled-in values")
                continue
            channels.append(_channel(name, triad, fresh, own_rate))
    if not channels:
        reason = "; ".join(notes) if notes else "every channel is constant"
        raise ValueError(f"{where or 'the recording'}: no channel tells noise: {reason}.")
    notes += _remarks(channels)
    return LogNoise(
        where,
        parts[0].device,
        rate,
        rest.num_samples / rate,
        tuple(channels),
        tuple(notes),
    )


def _channel(name: str, triad: str, log: Log, rate: float) -> ChannelNoise:
    model = identify_samples(log, rate=rate, triad=triad)
    curve = _curve(log, rate)
    lower, upper = interval(curve, model.exponents(curve.tau))
    return ChannelNoise(name, curve, lower, upper, model)


def _curve(log: Log, rate: float) -> Deviations:
    """Overlapping Allan deviations; of a long log those of long times from means of neighbours.

    Differences that begin at every sample or at every sixteenth tell the same where they span hundreds.
    """
    factors = usual_factors(len(log))
    if len(log) < _LONG:
        return deviations(log[:], rate=rate, factors=factors)
    short = short_deviations(log, rate=rate, factors=factors[factors < _THINNED**2])
    whole = (b[: len(b) // _THINNED * _THINNED] for b in blocks_of(log))
    means = np.concatenate([b.reshape(-1, _THINNED).mean(axis=1) for b in whole])
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
