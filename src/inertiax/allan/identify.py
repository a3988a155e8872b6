"""N, B, K and Q from a log by maximum likelihood on its spectrum; R by generalised least squares.

The spectrum of the log's differences has under each term an expectation known up to the coefficient's
square (see `spectrum`), so the likelihood of independent χ² ordinates (Whittle's) is a regression with four
non-negative unknowns. The uncertainties allow for the correlation of neighbouring ordinates. The ramp R
comes from means of blocks with their full covariance under the other terms, and is taken out first.

**References:** Whittle, *Ark. Mat.* 2 (1953) 423; IEEE Std 952-1997, annex C.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.fft import next_fast_len
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.optimize import nnls
from scipy.sparse import csr_array
from scipy.stats import chi2, t as student

from .model import NoiseModel, NoiseTerm
from .spectrum import Spectrum, spectrum_of, TAPERS


_BLOCKS = 256  # means for the ramp
_MOST_PASSES = 100
_LEAST_STEP = 1e-3
_SETTLED = 1e-7  # of the deviance, whose limits are some units away
_RANDOM = ("Q", "N", "B", "K")


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
    first = _maximum_likelihood(spectrum_of(np.diff(log) - ramp / rate, rate))
    ramp, _ = _ramp(log, rate, first)
    spectrum = spectrum_of(np.diff(log) - ramp / rate, rate)
    squares = _maximum_likelihood(spectrum)
    ramp, shares = _ramp(log, rate, squares)
    terms = _terms(spectrum, squares)
    variances, _ = _variances(spectrum, squares)
    terms["R"] = _ramp_term(ramp, spectrum, squares, variances, shares)
    return NoiseModel(triad, rate, len(log) / rate, terms, _chi2_per_dof(spectrum, squares))


def _fast_length(samples: int) -> int:
    """The longest part of a log whose transform is quick, a few samples shorter at most."""
    for length in range(samples, 0, -1):
        if next_fast_len(2 * length, real=True) == 2 * length:
            return length
    return samples


# The coefficients ------------------------------------------------------------------------------------


def _maximum_likelihood(
    spectrum: Spectrum, *, held: tuple[int, float] | None = None
) -> Float[np.ndarray, " term"]:
    """Squares of the coefficients that minimise Σ n (log m + p / m), m = Σ θ e, θ ≥ 0.

    `held` keeps one term (its index) at a given square.
    """
    which, kept = (-1, 0.0) if held is None else held
    free = np.arange(spectrum.expected.shape[1]) != which
    if not free.any():
        return np.array([kept])
    expected, weight = spectrum.expected[:, free], np.sqrt(spectrum.width)
    offset = 0.0 if held is None else kept * spectrum.expected[:, which]

    def scored(model: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fisher's scoring: the next squares, and the scale of each."""
        rows = expected / model[:, None] * weight[:, None]
        scale = np.linalg.norm(rows, axis=0)
        return nnls(rows / scale, (spectrum.power - offset) / model * weight)[0] / scale, scale

    theta, _ = scored(spectrum.power)
    model = np.maximum(offset + expected @ theta, 1e-6 * spectrum.power)
    now = _misfit(spectrum, model)
    for _ in range(_MOST_PASSES):
        new, scale = scored(model)
        step = 1.0
        # Whole steps may swing between two terms of nearly the same shape.
        while step > _LEAST_STEP:
            trial = theta + step * (new - theta)
            model = np.maximum(offset + expected @ trial, 1e-6 * spectrum.power)
            fallen = now - _misfit(spectrum, model)
            if fallen > 0.0:
                break
            step *= 0.5
        else:
            break
        theta, now = trial, now - fallen
        if fallen < _SETTLED or np.max(np.abs(new - theta) * scale) < 1e-6:
            break
    result = np.empty(len(free))
    result[free] = theta
    if held is not None:
        result[which] = kept
    return result


def _deviance(spectrum: Spectrum, squares: Float[np.ndarray, " term"]) -> float:
    """−2 log L of independent ordinates, each the mean of the tapers', up to a constant."""
    model = spectrum.expected @ squares
    return _misfit(spectrum, model) if np.all(model > 0) else np.inf


def _misfit(spectrum: Spectrum, model: Float[np.ndarray, " bin"]) -> float:
    return 2.0 * float(spectrum.width @ (np.log(model) + spectrum.power / model))


def _variances(
    spectrum: Spectrum, squares: Float[np.ndarray, " term"]
) -> tuple[Float[np.ndarray, " term"], Float[np.ndarray, " term"]]:
    """Variances of the squares: the diagonals of H⁻¹ J H⁻¹ and of H⁻¹.

    J is the covariance of the score: ordinates within a taper's width correlate. Terms that were found
    to be zero are left out for the others' uncertainty; their own is that of being let free.
    """
    right, naive = np.empty(len(squares)), np.empty(len(squares))
    free = np.flatnonzero(squares > 0)
    for own in range(len(squares)):
        used = np.union1d(free, [own])
        both = _covariance(spectrum, squares, used)
        right[own], naive[own] = (c[used == own, used == own][0] for c in both)
    return right, naive


def _covariance(
    spectrum: Spectrum, squares: Float[np.ndarray, " term"], used: np.ndarray
) -> tuple[Float[np.ndarray, "used used"], Float[np.ndarray, "used used"]]:
    """H⁻¹ J H⁻¹ and H⁻¹ of the squares of the terms `used`, the others held."""
    model = spectrum.expected @ squares
    rows = spectrum.expected[:, used] / model[:, None] * np.sqrt(spectrum.width)[:, None]
    scale = np.linalg.norm(rows, axis=0)
    rows = rows / scale
    bread = np.linalg.pinv(rows.T @ rows)
    right = bread @ (rows.T @ _correlation(spectrum.width)(rows)) @ bread
    return right / np.outer(scale, scale), bread / np.outer(scale, scale)


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

    matrix = csr_array(matrix)

    def apply(v: np.ndarray) -> np.ndarray:
        result = inside * v
        result[:single] = matrix @ v[:single]
        return result

    return apply


def _ordinate_covariance() -> tuple[np.ndarray, np.ndarray]:
    """Covariance of two relative ordinates by the steps between them: Σ |Σ h_a h_b e^{iωt}|² / T²."""
    size, lags = 4096, np.arange(2 * TAPERS)
    t = np.arange(size)
    tapers = np.sqrt(2.0 / size) * np.sin(np.pi * np.arange(1, TAPERS + 1)[:, None] * t / size)
    products = tapers[:, None, :] * tapers[None, :, :]
    transform = np.fft.rfft(products, axis=2)[:, :, : len(lags)]
    return lags, np.sum(np.square(np.abs(transform)), axis=(0, 1)) / TAPERS**2


def _terms(spectrum: Spectrum, squares: Float[np.ndarray, " term"]) -> dict[str, NoiseTerm]:
    """The four random terms. Limits hold whether the terms that the log does not show are there or not.

    A term that is absent is still estimated as zero or more, never less, and what it takes is missing
    in the others: limits from a fit with all terms alone would be too low. So they are joined with those of a
    fit without the terms that do not show.
    """
    every = _limited(spectrum, squares)
    shown = np.array([term.shown for term in every])
    if shown.any() and not shown.all():
        fewer = Spectrum(spectrum.power, spectrum.expected[:, shown], spectrum.width)
        alone = _limited(fewer, _maximum_likelihood(fewer))
        for k, other in zip(np.flatnonzero(shown), alone, strict=True):
            own = every[k]
            lower, upper = min(own.lower, other.lower), max(own.upper, other.upper)
            every[k] = NoiseTerm(own.value, own.std, lower, upper)
    return dict(zip(_RANDOM, every, strict=True))


def _limited(spectrum: Spectrum, squares: Float[np.ndarray, " term"]) -> list[NoiseTerm]:
    variances, naive = _variances(spectrum, squares)
    return [_term(spectrum, squares, k, variances[k], naive[k]) for k in range(len(squares))]


def _term(
    spectrum: Spectrum,
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


def _chi2_per_dof(spectrum: Spectrum, squares: Float[np.ndarray, " term"]) -> float:
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
) -> tuple[float, Float[np.ndarray, " term"]]:
    """Slope of the log from the differences of block means, and its variance per square of each term."""
    length = max(len(log) // _BLOCKS, 1)
    means = log[: len(log) // length * length].reshape(-1, length).mean(axis=1)
    step, count = length / rate, len(means) - 1
    weights = solve_toeplitz(_block_covariance(count, length, step, squares), np.ones(count))
    weights = weights / weights.sum()
    lagged = np.correlate(weights, weights, mode="full")[count - 1 :]
    lagged[1:] *= 2.0
    shares = [lagged @ _block_covariance(count, length, step, one) for one in np.eye(len(squares))]
    return float(weights @ np.diff(means) / step), np.array(shares) / step**2


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


def _ramp_term(
    slope: float,
    spectrum: Spectrum,
    squares: Float[np.ndarray, " term"],
    variances: Float[np.ndarray, " term"],
    shares: Float[np.ndarray, " term"],
) -> NoiseTerm:
    """The slope's size; limits by Student's t, since its variance V = Σ v θ is itself an estimate.

    V rests on few low frequencies where random walk prevails: its degrees of freedom are ν = 2 V² / Var V
    (Satterthwaite). For the limits, flicker and walk that were found to be zero count with their 1 sigma.
    """
    free = np.flatnonzero(squares > 0)
    covariance, _ = _covariance(spectrum, squares, free)
    variance = float(shares @ squares)
    slow = [k for k in (_RANDOM.index("B"), _RANDOM.index("K")) if squares[k] == 0.0]
    possible = variance + float(shares[slow] @ np.sqrt(variances[slow]))
    freedom = 2.0 * possible**2 / float(shares[free] @ covariance @ shares[free])
    wide = float(student.ppf(0.975, max(freedom, 1.0)) * np.sqrt(possible))
    value = abs(slope)
    return NoiseTerm(value, float(np.sqrt(variance)), max(value - wide, 0.0), value + wide)
