"""The multitaper spectrum of a log's differences, and its expectation under each noise term.

The differences from sample to sample are stationary under every term. Their spectrum, averaged over sine tapers,
has under each term an expectation known exactly, leakage included, up to the coefficient's square.

**References:** Riedel & Sidorenko, IEEE Trans. SP 43 (1995) 188 (sine tapers); Sykulski et al., *Biometrika*
106 (2019) 251 (expectations instead of the spectrum).
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy.fft import rfft


TAPERS = 5
_SINGLE = 256  # ordinates kept one by one; above them they are averaged
_PER_OCTAVE = 24  # averaged bins
_SMALL = 1 << 14  # samples at which flicker's leakage is computed; it scales


class Spectrum(eqx.Module):
    """Averages over bins of ordinates, of differences in (unit)²."""

    power: Float[np.ndarray, " bin"]
    expected: Float[np.ndarray, "bin term"]  # for unit coefficients, in the order Q, N, B, K
    width: Float[np.ndarray, " bin"]  # ordinates in the bin


def spectrum_of(differences: Float[np.ndarray, " step"], rate: float) -> Spectrum:
    """The multitaper spectrum of a log's differences (at `rate` Hz) in bands, with what each noise
    term would give there."""
    power = tapered(differences)
    size = len(differences) + 1
    ordinates = np.arange(1, len(power) + 1)
    expected = expected_of(size, ordinates, rate)
    last = len(power)
    edges = _SINGLE * 2.0 ** (
        np.arange(1, 1 + np.log2(max(last / _SINGLE, 1.0)) * _PER_OCTAVE) / _PER_OCTAVE
    )
    starts = np.unique(np.concatenate([np.arange(min(_SINGLE, last)), edges.astype(int)]))
    starts = starts[starts < last]
    width = np.diff(np.append(starts, last)).astype(float)
    mean = lambda x: np.add.reduceat(x, starts, axis=0) / (width if x.ndim == 1 else width[:, None])
    return Spectrum(mean(power), mean(expected), width)


def tapered(z: Float[np.ndarray, " step"]) -> Float[np.ndarray, " ordinate"]:
    """|Σ h z e^{-iωt}|² at ω = π 2k / size, mean over the first sine tapers, for k = 1, 2, …

    h_a(t) = √(2/size) sin(π a t / size), t = 1 …: the transform of h z is the difference of the
    transform of z at a half-steps either way, so one transform serves all tapers.
    """
    size = len(z) + 1
    padded = np.zeros(2 * size)
    padded[1:size] = z
    transform = np.asarray(rfft(padded))
    ordinates = np.arange(1, size // 2 + 1)
    power = np.zeros(len(ordinates))
    for a in range(1, TAPERS + 1):
        apart = _at(transform, 2 * ordinates - a, size) - _at(transform, 2 * ordinates + a, size)
        power += np.square(np.abs(apart))
    return power / (2.0 * size * TAPERS)


def _at(transform: np.ndarray, index: np.ndarray, size: int) -> np.ndarray:
    """A real signal's transform of length 2 size at any index."""
    index = np.mod(index, 2 * size)
    mirrored = index > size
    values = transform[np.where(mirrored, 2 * size - index, index)]
    return np.where(mirrored, values.conj(), values)


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
