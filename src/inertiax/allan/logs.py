"""Noise of every channel of a recording at rest."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from .._records import field, Module
from ..data.recording import Recording
from .confidence import interval
from .deviations import Deviations, deviations, short_deviations, usual_factors
from .identify import FEWEST, identify_samples
from .model import NoiseModel
from .repeats import own_samples
from .rest_channels import longest_rest, name_of
from .stored_channel import blocks_of, is_constant, Log
from .temperature_drift import follows_temperature, without_slow_terms


_LONG = 1 << 18  # samples from which on long averaging times use means of neighbours
_LEAST_WINDOW = 64  # samples over which one sample's scatter is taken
_TOUCHED = 10.0  # of the windows' median variance: beyond it the device was touched (convention)
_THINNED = 16  # samples to such a mean
UNLIKE = 5.0  # chi2_per_dof above which the terms do not describe a channel


class ChannelNoise(Module):
    """One channel: its Allan deviation with 68 % limits, and the noise terms."""

    channel: str = field(static=True)  # e.g. "gyro_x"
    curve: Deviations
    lower: Float[np.ndarray, " tau"]
    upper: Float[np.ndarray, " tau"]
    model: NoiseModel
    sample: float = field(static=True, default=math.nan)  # scatter of one sample, SI


class LogNoise(Module):
    """Noise of one recording's longest rest."""

    recording: str = field(static=True)
    device: str = field(static=True)
    rate: float = field(static=True)  # Hz
    duration: float = field(static=True)  # s
    channels: tuple[ChannelNoise, ...]
    notes: tuple[str, ...] = field(static=True)  # what a reader should know


def noise_of(
    recording: Recording | Sequence[Recording],
    *,
    compensated: bool = False,
    progress: Callable[[str], None] | None = None,
) -> LogNoise:
    """Allan deviations and noise terms of all channels, over the longest rest without a pause.

    **Arguments:** `recording`, or the parts of one log in their order (`data.stored_recording`); `compensated` where
    its columns are what `inertiax compensate` wrote.

    Raises `ValueError` where no rest of 256 samples is found.
    """
    parts = (recording,) if isinstance(recording, Recording) else tuple(recording)
    tell = progress if progress is not None else lambda _: None
    where = name_of(parts)
    tell(f"looking for rests in {where or 'the recording'}")
    rest, notes = longest_rest(parts, compensated=compensated)
    first, last = rest.span
    rate = float((rest.num_samples - 1) / (last - first))
    channels: list[ChannelNoise] = []
    warm: list[str] = []  # channels that follow the temperature
    warmed = None
    if rest.has("temperature") and not compensated:
        warmed = np.concatenate([t[:, 0] for t in rest.pieces("temperature")])
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
            if warmed is not None and follows_temperature(fresh, warmed):
                model = without_slow_terms(channels[-1].model)
                channels[-1] = dataclasses.replace(channels[-1], model=model)
                warm.append(name)
    if not channels:
        reason = "; ".join(notes) if notes else "every channel is constant"
        raise ValueError(f"{where or 'the recording'}: no channel tells noise: {reason}.")
    if warm:
        notes.append(
            f"{', '.join(warm)} follow the temperature: bias instability (B), random walk (K) and ramp (R) are "
            "not told of them: no value, and not exported; the compensated log tells them"
        )
    notes += [*_misfits(channels, warm), *_sampling(channels), *_untold(channels, warm)]
    return LogNoise(
        where,
        parts[0].device,
        rate,
        rest.num_samples / rate,
        tuple(channels),
        tuple(notes),
    )


def noise_of_triads(
    accel: Recording, gyro: Recording, *, progress: Callable[[str], None] | None = None
) -> LogNoise:
    """The noise of a log whose triads were logged apart, each by its own samples.

    Of samples put onto the other triad's stamps by straight lines as little as half of the white noise would be left.
    Rate and duration are the accelerometers'; each channel has its own rate.

    Raises `ValueError` as `noise_of` does.
    """
    one, other = (noise_of(r, progress=progress) for r in (accel, gyro))
    return LogNoise(
        f"{one.recording} + {other.recording}",
        one.device or other.device,
        one.rate,
        one.duration,
        (*one.channels, *other.channels),
        tuple(dict.fromkeys((*one.notes, *other.notes))),
    )


def _channel(name: str, triad: str, log: Log, rate: float) -> ChannelNoise:
    model = identify_samples(log, rate=rate, triad=triad)
    curve = _curve(log, rate)
    lower, upper = interval(curve, model.exponents(curve.tau))
    return ChannelNoise(name, curve, lower, upper, model, _scatter_of_samples(log, model))


def _scatter_of_samples(log: Log, model: NoiseModel) -> float:
    """Standard deviation of one sample as it was recorded, without what changes over seconds, SI.

    σ² = ⟨(x − x̄)²⟩ + N²/T within windows of T = 1 s, for the mean of T seconds takes N²/T of the variance away. Behind
    a low-pass filter it is less than N √rate.
    """
    width = max(int(round(model.rate)), _LEAST_WINDOW)
    whole = (block[: len(block) // width * width].reshape(-1, width) for block in blocks_of(log))
    variances = np.concatenate([windows.var(axis=1) for windows in whole])
    if not len(variances):
        return float(np.std(log[:], ddof=1))
    usual = variances[variances <= _TOUCHED * np.median(variances)]
    white = model.terms["N"].value or 0.0
    return float(np.sqrt(usual.mean() + white**2 * model.rate / width))


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


def _misfits(channels: list[ChannelNoise], warm: Sequence[str]) -> list[str]:
    """Channels whose spectrum the terms miss, in part or as a whole, with by how much; not by temperature."""
    unlike = [c for c in channels if c.model.chi2_per_dof > UNLIKE and c.channel not in warm]
    if not unlike:
        return []
    sizes = ", ".join(f"{c.channel} ({c.model.chi2_per_dof:.0f})" for c in unlike)
    return [
        f"the terms miss the spectrum by more than chance, χ² per degree of freedom: {sizes}; look for vibration"
    ]


def _sampling(channels: list[ChannelNoise]) -> list[str]:
    """Triads whose N holds at their sampling rate alone."""
    triads: dict[float, list[str]] = {}
    for triad in ("accel", "gyro"):
        models = [c.model for c in channels if c.model.triad == triad]
        if models and all(model.white_throughout for model in models):
            triads.setdefault(models[0].rate, []).append(triad)
    return [
        f"the noise of {' and '.join(names)} is white up to {0.5 * rate:.4g} Hz, half the sampling rate: N holds for "
        f"{rate:.4g} samples a second that are not averaged; at another rate one sample scatters as much, and N goes "
        f"with 1/√rate"
        for rate, names in triads.items()
    ]


def _untold(channels: list[ChannelNoise], warm: Sequence[str]) -> list[str]:
    """Terms without a value: those that a drift hides, and those that the log does not show."""
    follow = [c for c in channels if c.channel in warm]
    drifting = [c for c in channels if c.model.band[0] > 0.0 and c not in follow]
    remarks = []
    if drifting:
        names = ", ".join(c.channel for c in drifting)
        slowest = max(1.0 / c.model.band[0] for c in drifting)
        remarks.append(
            f"over {slowest:.3g} s and longer {names} drift as none of the terms does: bias instability (B), random "
            f"walk (K) and ramp (R) are not told: no value, and not exported"
        )
    for term, what in (("N", "white noise"), ("B", "bias instability"), ("K", "random walk")):
        hidden = [*drifting, *follow] if term != "N" else []
        untold = [c.channel for c in channels if not c.model.terms[term].shown and c not in hidden]
        if untold:
            remarks.append(
                f"the log does not determine {what} ({term}) of {', '.join(untold)}: no value, and not exported"
            )
    return remarks
