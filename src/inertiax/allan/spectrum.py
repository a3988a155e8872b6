"""The multitaper spectrum of a log's differences, and its expectation under each noise term.

The differences from sample to sample are stationary under every term. Their spectrum, averaged over sine tapers,
has under each term an expectation known exactly, leakage included, up to the coefficient's square.

**References:** Riedel & Sidorenko, IEEE Trans. SP 43 (1995) 188 (sine tapers); Sykulski et al., *Biometrika*
106 (2019) 251 (expectations instead of the spectrum).
"""

from functools import cache

import numpy as np
from jaxtyping import Bool, Float
from scipy.fft import next_fast_len, rfft

from .._records import field, Module
from .stored_channel import Log


TAPERS = 5
_SINGLE = 256  # ordinates kept one by one; above them they are averaged
_PER_OCTAVE = 24  # averaged bins
_SMALL = 1 << 14  # samples at which flicker's leakage is computed; it scales
_LONG = 1 << 19  # samples of a log that is transformed as a whole; longer ones in two parts
_SEGMENT = 1 << 16  # samples of a part of the log, for the higher frequencies
_THINNED = 32  # samples to one of the thinned log, for the lower frequencies
_THINNED_AT_ONCE = 1 << 14  # samples of the thinned log
_SEAM = 1.0 / 128.0  # of the rate: where both meet, half the thinned log's Nyquist frequency


class Spectrum(Module):
    """Averages over bins of ordinates, of differences in (unit)²."""

    power: Float[np.ndarray, " bin"]
    expected: Float[np.ndarray, "bin term"]  # for unit coefficients, in the order Q, N, B, K
    width: Float[np.ndarray, " bin"]  # ordinates of the whole log in the bin
    frequency: Float[np.ndarray, " bin"]  # Hz, mean
    upper: Float[np.ndarray, " bin"]  # Hz, of the last ordinate
    rate: float = field(static=True)  # Hz

    def of(self, kept: Bool[np.ndarray, " bin"]) -> "Spectrum":
        """The bins `kept`."""
        return Spectrum(
            self.power[kept], self.expected[kept], self.width[kept], self.frequency[kept],
            self.upper[kept], self.rate,
        )  # fmt: skip


def spectrum_of(log: Log, rate: float, ramp: float = 0.0) -> Spectrum:
    """The multitaper spectrum of a log's differences (at `rate` Hz, the `ramp` a second taken out) in bins.

    A log of more than half a million samples is thinned for its lowest frequencies and cut into segments for
    the others, whose spectra are averaged, so that the memory taken does not grow much with the log.
    """
    size = fast_length(len(log))
    if size <= _LONG:
        power = tapered(np.diff(log[:size]) - ramp / rate)
        ordinates = np.arange(1, len(power) + 1)
        expected = expected_of(size, ordinates, rate)
        return _binned(power, expected, ordinates * (rate / size), 1.0, rate, _SINGLE)
    return _joined(_thinned(log, size, rate, ramp), _segments(log, size, rate, ramp))


def fast_length(samples: int) -> int:
    """The longest part of a log whose transform is quick, a few samples shorter at most."""
    for length in range(samples, 0, -1):
        if next_fast_len(2 * length, real=True) == 2 * length:
            return length
    return samples


def _segments(log: Log, size: int, rate: float, ramp: float) -> Spectrum:
    """Mean over segments of the first `size` samples, above the seam."""
    count = size // _SEGMENT
    first = int(_SEAM * _SEGMENT) + 1
    power = np.zeros(_SEGMENT // 2 - first + 1)
    for k in range(count):
        part = log[k * _SEGMENT : (k + 1) * _SEGMENT]
        power += tapered(np.diff(part) - ramp / rate)[first - 1 :]
    ordinates = np.arange(first, _SEGMENT // 2 + 1)
    expected = expected_of(_SEGMENT, ordinates, rate)
    frequency = ordinates * (rate / _SEGMENT)
    return _binned(power / count, expected, frequency, size / _SEGMENT, rate, 0)


def _low_passed(log: Log, size: int) -> Float[np.ndarray, " slow"]:
    """Every 32nd sample of the first `size` behind a low-pass filter, where all its taps lie in the log."""
    from scipy.signal import firwin, upfirdn

    reach = 20  # samples of the thinned log
    # flat to 1e-4 up to half the new Nyquist frequency
    taps = firwin(reach * _THINNED + 1, 1.0 / _THINNED)
    count = (size - len(taps)) // _THINNED + 1
    slow, start = np.empty(count), log[0:1]
    for a in range(0, count, _THINNED_AT_ONCE):
        b = min(a + _THINNED_AT_ONCE, count)
        part = log[a * _THINNED : (b - 1) * _THINNED + len(taps)] - start
        slow[a:b] = np.asarray(upfirdn(taps, part, 1, _THINNED))[reach : reach + b - a]
    return slow


def _thinned(log: Log, size: int, rate: float, ramp: float) -> Spectrum:
    """The spectrum of a log low-passed and thinned, up to the seam."""
    slow = _low_passed(log, size)
    slow = slow[: fast_length(len(slow))]
    slower = rate / _THINNED
    last = int(_SEAM * _THINNED * len(slow))
    power = tapered(np.diff(slow) - ramp / slower)[:last]
    ordinates = np.arange(1, last + 1)
    frequency = ordinates * (slower / len(slow))
    expected = expected_of(len(slow), ordinates, slower)
    # At the slower rate the differences of the terms bend away from powers of f sooner.
    bend = slower * np.sin(np.pi * frequency / slower)
    bend /= rate * np.sin(np.pi * frequency / rate)
    expected *= bend[:, None] ** np.array([-2.0, 0.0, 1.0, 2.0])
    return _binned(power, expected, frequency, 1.0, rate, _SINGLE)


def _binned(
    power: Float[np.ndarray, " ordinate"],
    expected: Float[np.ndarray, "ordinate term"],
    frequency: Float[np.ndarray, " ordinate"],
    each: float,
    rate: float,
    single: int,
) -> Spectrum:
    """Averages of ordinates, of which each counts for `each` of the whole log's; the first `single` stay alone."""
    last = len(power)
    first = max(single, 1)
    # Where the lowest ordinates are missing an octave is what their frequencies say.
    before = (
        round(frequency[0] / (frequency[-1] - frequency[0]) * (last - 1)) - 1 if last > 1 else 0
    )
    octaves = np.log2(max((last + before) / (first + before), 1.0))
    edges = (first + before) * 2.0 ** (np.arange(1, 1 + octaves * _PER_OCTAVE) / _PER_OCTAVE)
    starts = np.concatenate([np.arange(min(first, last)), edges.astype(int) - before])
    starts = np.unique(starts[starts < last])
    count = np.diff(np.append(starts, last)).astype(float)
    mean = lambda x: np.add.reduceat(x, starts, axis=0) / (count if x.ndim == 1 else count[:, None])
    upper = frequency[np.append(starts[1:], last) - 1]
    return Spectrum(mean(power), mean(expected), count * each, mean(frequency), upper, rate)


def _joined(low: Spectrum, high: Spectrum) -> Spectrum:
    both = lambda name: np.concatenate([getattr(low, name), getattr(high, name)])
    return Spectrum(
        both("power"), both("expected"), both("width"), both("frequency"), both("upper"), low.rate
    )


def tapered(z: Float[np.ndarray, " step"]) -> Float[np.ndarray, " ordinate"]:
    """|Σ h z e^{-iωt}|² at ω = π 2k / size, mean over the first sine tapers, for k = 1, 2, …

    h_a(t) = √(2/size) sin(π a t / size), t = 1 …: the transform of h z is the difference of the
    transform of z at a half-steps either way, so one transform serves all tapers.
    """
    size = len(z) + 1
    padded = np.zeros(2 * size)
    padded[1:size] = z
    transform = np.asarray(rfft(padded))
    # A real signal's transform goes on at either end as its own mirror image.
    before, after = transform[TAPERS:0:-1].conj(), transform[-2 : -2 - TAPERS : -1].conj()
    transform = np.concatenate([before, transform, after])
    count = size // 2
    at = lambda offset: transform[TAPERS + 2 + offset :: 2][:count]
    power = np.zeros(count)
    for a in range(1, TAPERS + 1):
        apart = at(-a) - at(a)
        power += np.square(np.real(apart)) + np.square(np.imag(apart))
    return power / (2.0 * size * TAPERS)


def expected_of(
    size: int, ordinates: np.ndarray, rate: float
) -> Float[np.ndarray, "ordinate term"]:
    """Expectation of `tapered` for Q, N, B and K of one."""
    omega = 2.0 * np.pi * ordinates / size
    overlap = [_taper_overlap(size, lag) for lag in range(3)]
    moving = lambda c: sum(
        (1.0 if j == 0 else 2.0) * c[j] * overlap[j] * np.cos(j * omega) for j in range(len(c))
    )
    quantisation = moving([6.0, -4.0, 1.0]) * rate**2
    white = moving([2.0, -1.0]) * rate
    walk = np.full(len(omega), overlap[0] / rate)
    return np.stack([quantisation, white, _expected_flicker(size, ordinates), walk], axis=1)


def _taper_overlap(size: int, lag: int) -> float:
    """Σ h(t) h(t + lag), mean over the tapers, in closed form."""
    angle = np.pi * np.arange(1, TAPERS + 1) / size
    inner = (size - lag) * np.cos(angle * lag) + np.sin(angle * lag) / np.tan(angle)
    return float(np.mean(inner) / size)


def _expected_flicker(size: int, ordinates: np.ndarray) -> Float[np.ndarray, " ordinate"]:
    """Expectation under differences of flicker noise with B = 1, whose spectrum is 2 sin(ω/2).

    Leakage matters at the lowest ordinates only, where all scales with 1/size.
    """
    smooth = 2.0 * np.sin(np.pi * ordinates / size)
    small = min(size, _SMALL)
    near = min(small // 8, len(ordinates))
    result = smooth.copy()
    result[:near] = _leaked_flicker(small)[1 : near + 1] * (small / size)
    return result


@cache
def _leaked_flicker(size: int) -> Float[np.ndarray, " ordinate"]:
    # Fractional noise of order −1/2: γ(k) = γ(k−1) (k − 3/2) / (k + 1/2), γ(0) = 4/π.
    k = np.arange(1, size)
    gamma = 4.0 / np.pi * np.concatenate([[1.0], np.cumprod((k - 1.5) / (k + 0.5))])
    t = np.arange(size)
    overlap = np.zeros(2 * size)
    for a in range(1, TAPERS + 1):
        taper = np.sqrt(2.0 / size) * np.sin(np.pi * a * t / size)
        overlap += np.fft.irfft(np.square(np.abs(np.fft.rfft(taper, 2 * size))), 2 * size)
    sequence = gamma * overlap[:size] / TAPERS
    sequence[1:] *= 2.0
    return np.real(np.fft.rfft(sequence, size))
