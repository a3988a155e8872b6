"""N, B, K and Q from a log by maximum likelihood on its spectrum; R by generalised least squares.

The log's differences from sample to sample are stationary under every term. Their spectrum, averaged
over sine tapers, has under each term an expectation known exactly (leakage included) up to the
coefficient's square, so the likelihood of independent χ² ordinates (Whittle's) is a regression with four
non-negative unknowns. The uncertainties allow for the correlation of neighbouring ordinates. The ramp R
comes from means of blocks with their full covariance under the other terms, and is taken out first.

**References:** Whittle, *Ark. Mat.* 2 (1953) 423; Riedel & Sidorenko, IEEE Trans. SP 43 (1995) 188
(sine tapers); Sykulski et al., *Biometrika* 106 (2019) 251 (expectations instead of the spectrum);
IEEE Std 952-1997, annex C.
"""

from collections.abc import Callable

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy.fft import next_fast_len, rfft
from scipy.linalg import toeplitz
from scipy.optimize import nnls
from scipy.stats import chi2, norm

from .model import NoiseModel, NoiseTerm


_TAPERS = 5
_SINGLE = 256  # ordinates kept one by one; above them they are averaged
_PER_OCTAVE = 24  # averaged bins
_SMALL = 1 << 14  # samples at which flicker's leakage is computed; it scales
_BLOCKS = 256  # means for the ramp
_MOST_PASSES = 100
_RANDOM = ("Q", "N", "B", "K")


class _Spectrum(eqx.Module):
    """Averages over bins of ordinates, of differences in (unit)²."""

    power: Float[np.ndarray, " bin"]
    expected: Float[np.ndarray, "bin term"]  # for unit coefficients, in the order of `_RANDOM`
    width: Float[np.ndarray, " bin"]  # ordinates in the bin


def identify(log: Float[np.ndarray, " time"], *, rate: float, triad: str = "gyro") -> NoiseModel:
    """Noise coefficients of a log at rest, sampled at a constant `rate` (Hz), in SI units.

    `triad` ("accel" or "gyro") tells the units, nothing else. Intervals are 95 %.
    Raises `ValueError` where the log is too short (256 samples), not finite or constant.
    """
    log = np.asarray(log, float)
    if log.ndim != 1 or len(log) < 256 or not np.all(np.isfinite(log)):
        raise ValueError(
            f"`identify(log)`: 256 or more finite samples of one channel are needed, got shape "
            f"{log.shape}."
        )
    if np.ptp(log) == 0.0:
        raise ValueError(
            "`identify(log)`: the log is constant: a dead channel, or filled-in values."
        )
    log = log[: _fast_length(len(log))]
    times = np.arange(len(log)) / rate
    ramp = float(np.polyfit(times - times.mean(), log, 1)[0])
    # The ramp is taken out by least squares first, then with the weights of the noise found.
    first = _maximum_likelihood(_spectrum(np.diff(log) - ramp / rate, rate))
    ramp, _ = _ramp(log, rate, first)
    spectrum = _spectrum(np.diff(log) - ramp / rate, rate)
    squares = _maximum_likelihood(spectrum)
    ramp, ramp_std = _ramp(log, rate, squares)
    variances, naive = _variances(spectrum, squares)
    terms = {
        name: _term(spectrum, squares, k, variances[k], naive[k]) for k, name in enumerate(_RANDOM)
    }
    terms["R"] = _ramp_term(ramp, ramp_std)
    return NoiseModel(triad, rate, len(log) / rate, terms, _chi2_per_dof(spectrum, squares))


def _fast_length(samples: int) -> int:
    """The longest part of a log whose transform is quick, a few samples shorter at most."""
    for length in range(samples, 0, -1):
        if next_fast_len(2 * length, real=True) == 2 * length:
            return length
    return samples


# The spectrum and what to expect of it ---------------------------------------------------------------


def _spectrum(differences: Float[np.ndarray, " step"], rate: float) -> _Spectrum:
    power = _tapered(differences)
    size = len(differences) + 1
    ordinates = np.arange(1, len(power) + 1)
    expected = _expected(size, ordinates, rate)
    last = len(power)
    edges = _SINGLE * 2.0 ** (
        np.arange(1, 1 + np.log2(max(last / _SINGLE, 1.0)) * _PER_OCTAVE) / _PER_OCTAVE
    )
    starts = np.unique(np.concatenate([np.arange(min(_SINGLE, last)), edges.astype(int)]))
    starts = starts[starts < last]
    width = np.diff(np.append(starts, last)).astype(float)
    mean = lambda x: np.add.reduceat(x, starts, axis=0) / (width if x.ndim == 1 else width[:, None])
    return _Spectrum(mean(power), mean(expected), width)


def _tapered(z: Float[np.ndarray, " step"]) -> Float[np.ndarray, " ordinate"]:
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
    for a in range(1, _TAPERS + 1):
        apart = _at(transform, 2 * ordinates - a, size) - _at(transform, 2 * ordinates + a, size)
        power += np.square(np.abs(apart))
    return power / (2.0 * size * _TAPERS)


def _at(transform: np.ndarray, index: np.ndarray, size: int) -> np.ndarray:
    """A real signal's transform of length 2 size at any index."""
    index = np.mod(index, 2 * size)
    mirrored = index > size
    values = transform[np.where(mirrored, 2 * size - index, index)]
    return np.where(mirrored, values.conj(), values)


def _expected(size: int, ordinates: np.ndarray, rate: float) -> Float[np.ndarray, "ordinate term"]:
    """Expectation of `_tapered` for Q, N, B and K of one."""
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
    angle = np.pi * np.arange(1, _TAPERS + 1) / size
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
    for a in range(1, _TAPERS + 1):
        taper = np.sqrt(2.0 / size) * np.sin(np.pi * a * t / size)
        overlap += np.fft.irfft(np.square(np.abs(np.fft.rfft(taper, 2 * size))), 2 * size)
    sequence = gamma * overlap[:size] / _TAPERS
    sequence[1:] *= 2.0
    return np.real(np.fft.rfft(sequence, size))


# The coefficients ------------------------------------------------------------------------------------


def _maximum_likelihood(
    spectrum: _Spectrum, *, held: tuple[int, float] | None = None
) -> Float[np.ndarray, " term"]:
    """Squares of the coefficients that minimise Σ n (log m + p / m), m = Σ θ e, θ ≥ 0.

    `held` keeps one term (its index) at a given square.
    """
    which, kept = (-1, 0.0) if held is None else held
    free = np.arange(spectrum.expected.shape[1]) != which
    expected, weight = spectrum.expected[:, free], np.sqrt(spectrum.width)
    offset = 0.0 if held is None else kept * spectrum.expected[:, which]
    model, theta = spectrum.power, np.zeros(expected.shape[1])
    for count in range(_MOST_PASSES):
        rows = expected / model[:, None] * weight[:, None]
        scale = np.linalg.norm(rows, axis=0)
        new = nnls(rows / scale, (spectrum.power - offset) / model * weight)[0] / scale
        change = np.max(np.abs(new - theta) * scale)
        # Half steps: whole ones may swing between two terms of nearly the same shape.
        theta = 0.5 * (theta + new) if change > 1e-3 and count > 0 else new
        if change < 1e-6:
            break
        model = np.maximum(offset + expected @ theta, 1e-6 * spectrum.power)
    result = np.empty(len(free))
    result[free] = theta
    if held is not None:
        result[which] = kept
    return result


def _deviance(spectrum: _Spectrum, squares: Float[np.ndarray, " term"]) -> float:
    """−2 log L of independent ordinates, each the mean of the tapers', up to a constant."""
    model = spectrum.expected @ squares
    if not np.all(model > 0):
        return np.inf
    terms = spectrum.width * (np.log(model) + spectrum.power / model)
    return 2.0 * float(np.sum(terms))


def _variances(
    spectrum: _Spectrum, squares: Float[np.ndarray, " term"]
) -> tuple[Float[np.ndarray, " term"], Float[np.ndarray, " term"]]:
    """Variances of the squares: the diagonals of H⁻¹ J H⁻¹ and of H⁻¹.

    J is the covariance of the score: ordinates within a taper's width correlate. Terms that were found
    to be zero are left out for the others' uncertainty; their own is that of being let free.
    """
    model = spectrum.expected @ squares
    rows = spectrum.expected / model[:, None] * np.sqrt(spectrum.width)[:, None]
    scale = np.linalg.norm(rows, axis=0)
    rows = rows / scale
    alike = _correlation(spectrum.width)
    right, naive = np.empty(len(squares)), np.empty(len(squares))
    free = np.flatnonzero(squares > 0)
    for own in range(len(squares)):
        used = np.union1d(free, [own])
        part, at = rows[:, used], int(np.flatnonzero(np.union1d(free, [own]) == own)[0])
        bread = np.linalg.pinv(part.T @ part)
        right[own] = (bread @ (part.T @ alike(part)) @ bread)[at, at] / scale[own] ** 2
        naive[own] = bread[at, at] / scale[own] ** 2
    return right, naive


def _correlation(width: Float[np.ndarray, " bin"]):
    """v ↦ C v for the covariance C of relative bin means times √width."""
    lags, alone = _ordinate_covariance()
    inside = alone[0] + 2.0 * alone[1:].sum()
    single = int(np.sum(width == 1.0))
    matrix = toeplitz(np.concatenate([alone, np.zeros(max(single - len(alone), 0))])[:single])
    # Near zero frequency an ordinate meets its mirror image as well.
    index = np.arange(1, single + 1)
    together = index[:, None] + index[None, :]
    matrix = matrix + np.where(
        together < len(lags), alone[np.minimum(together, len(lags) - 1)], 0.0
    )

    def apply(v: np.ndarray) -> np.ndarray:
        result = inside * v
        result[:single] = matrix @ v[:single]
        return result

    return apply


def _ordinate_covariance() -> tuple[np.ndarray, np.ndarray]:
    """Covariance of two relative ordinates by the steps between them: Σ |Σ h_a h_b e^{iωt}|² / T²."""
    size, lags = 4096, np.arange(2 * _TAPERS)
    t = np.arange(size)
    tapers = np.sqrt(2.0 / size) * np.sin(np.pi * np.arange(1, _TAPERS + 1)[:, None] * t / size)
    products = tapers[:, None, :] * tapers[None, :, :]
    transform = np.fft.rfft(products, axis=2)[:, :, : len(lags)]
    return lags, np.sum(np.square(np.abs(transform)), axis=(0, 1)) / _TAPERS**2


def _term(
    spectrum: _Spectrum,
    squares: Float[np.ndarray, " term"],
    which: int,
    variance: float,
    naive: float,
) -> NoiseTerm:
    """A coefficient with the limits at which the profile of the likelihood falls by its 95 % point.

    `variance / naive` is by how much the ordinates' correlation dulls the likelihood.
    """
    square, std = float(squares[which]), float(np.sqrt(variance))
    limit = _deviance(spectrum, squares) + float(chi2.ppf(0.95, 1)) * variance / naive

    def excess(candidate: float) -> float:
        held = _maximum_likelihood(spectrum, held=(which, candidate))
        return _deviance(spectrum, held) - limit

    lower = 0.0
    if square > 0.0 and excess(0.0) > 0.0:
        lower = _crossing(excess, square, 0.5)
    upper = _crossing(excess, square if square > 0.0 else 0.1 * std, 2.0)
    value = float(np.sqrt(square))
    spread = float(std / (2.0 * value)) if value > 0 else float("inf")
    return NoiseTerm(value, spread, float(np.sqrt(lower)), float(np.sqrt(upper)))


def _crossing(excess: Callable[[float], float], start: float, factor: float) -> float:
    """Where a profile's excess turns positive, going from `start` by factors and then bisecting."""
    inside, outside = start, factor * start
    for _ in range(100):
        if excess(outside) > 0.0:
            break
        inside, outside = outside, factor * outside
    for _ in range(10):
        middle = float(np.sqrt(inside * outside))
        inside, outside = (inside, middle) if excess(middle) > 0.0 else (middle, outside)
    return float(np.sqrt(inside * outside))


def _chi2_per_dof(spectrum: _Spectrum, squares: Float[np.ndarray, " term"]) -> float:
    """Of the relative misfit in groups of bins, each wide enough to be nearly Gaussian."""
    model = spectrum.expected @ squares
    relative = spectrum.power / model - 1.0
    total = np.cumsum(spectrum.width)
    # Thirds of octaves, from eight ordinates up.
    group = np.floor(3.0 * np.log2(np.maximum(total, 8.0))).astype(int)
    _, starts = np.unique(group, return_index=True)
    width = np.add.reduceat(spectrum.width, starts)
    mean = np.add.reduceat(relative * spectrum.width, starts) / width
    _, alone = _ordinate_covariance()
    variance = (alone[0] + 2.0 * alone[1:].sum()) / width
    dof = len(mean) - int(np.sum(squares > 0))
    return float(np.sum(mean**2 / variance) / max(dof, 1))


# The ramp --------------------------------------------------------------------------------------------


def _ramp(
    log: Float[np.ndarray, " time"], rate: float, squares: Float[np.ndarray, " term"]
) -> tuple[float, float]:
    """Slope of the log and its standard deviation, from the differences of block means."""
    length = max(len(log) // _BLOCKS, 1)
    means = log[: len(log) // length * length].reshape(-1, length).mean(axis=1)
    step = length / rate
    covariance = toeplitz(_block_covariance(len(means) - 1, length, step, squares))
    ones = np.ones(len(means) - 1)
    weights = np.linalg.solve(covariance, ones)
    slope = float(weights @ np.diff(means) / weights.sum() / step)
    return float(slope), float(1.0 / np.sqrt(weights.sum()) / step)


def _block_covariance(
    count: int, length: int, step: float, squares: Float[np.ndarray, " term"]
) -> Float[np.ndarray, " lag"]:
    """Autocovariance of the differences of block means `step` seconds long under the four terms."""
    quantisation, white, flicker, walk = squares
    result = np.zeros(max(count, 3))
    result[:3] += quantisation / step**2 * np.array([6.0, -4.0, 1.0])
    result[:2] += white / step * np.array([2.0, -1.0])
    within = 1.0 / (6.0 * length**2)
    result[:2] += walk * step * np.array([2.0 / 3.0 + 2.0 * within, 1.0 / 6.0 - within])
    t = np.abs(np.arange(-2, len(result) + 2).astype(float))
    phase = t**2 * np.log(np.where(t > 0, t, 1.0)) / (2.0 * np.pi)
    fourth = np.convolve(phase, [1.0, -4.0, 6.0, -4.0, 1.0], mode="valid")
    return (result + flicker * fourth)[:count]


def _ramp_term(slope: float, std: float) -> NoiseTerm:
    wide = float(norm.ppf(0.975)) * std
    value = abs(slope)
    return NoiseTerm(value, std, max(value - wide, 0.0), value + wide)
