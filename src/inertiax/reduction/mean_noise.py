"""The noise of a mean: correlated samples, quantisation, and variances known from few samples.

The mean of n samples of standard deviation σ has the variance S(n) / n², S(n) being the variance of a
sum of n neighbours: σ² n for white noise, more where samples resemble their neighbours. How S grows is
the instrument's (`NoiseShape`) and is pooled over all dwells; σ² is the dwell's own, drawn
towards the pooled one as far as the data say that dwells are alike.
"""

import weakref
from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.special import digamma, polygamma

from .._records import field, Module
from .._typing import AnyArray
from ..numerics.nonnegative import nonnegative_least_squares, squares_with_one_more


class NoiseShape(Module):
    """Autocorrelation of a stationary noise of unit variance, as shares of simple noises.

    `white` has no memory; `differenced` is the difference of successive white samples (angle noise in
    a gyro's increments; its sums do not grow); `red[i]` decays as Re `decay[i]`^h: Gauss-Markov for a real decay, a
    band about a frequency, as a hand's tremor or a motor have it, for a complex one.
    """

    white: float = field(static=True, default=1.0)
    differenced: float = field(static=True, default=0.0)
    red: tuple[float, ...] = field(static=True, default=())
    decay: tuple[complex | float, ...] = field(static=True, default=())

    def sum_variance(self, counts: AnyArray) -> Float[np.ndarray, " count"]:
        """S(n) in units of σ²; n for white noise."""
        n = np.asarray(counts, float)
        total = self.white * n + self.differenced
        for share, decay in zip(self.red, self.decay, strict=True):
            total = total + share * red_sum_variance(decay, n)
        return total

    def mean_factor(self, counts: AnyArray) -> Float[np.ndarray, " count"]:
        """τ(n) = S(n) / n, so that the mean of n samples has the variance σ² τ / n."""
        n = np.asarray(counts, float)
        return self.sum_variance(n) / n

    @property
    def squared_sum(self) -> float:
        """1 + 2 Σ ρ_h²: a variance from n samples is known as from n over this many independent
        ones (Bartlett)."""
        total = 1.0 + 0.5 * self.differenced**2
        for a, p in zip(self.red, self.decay, strict=True):
            # Re p^h Re q^h = Re ((p q)^h + (p q*)^h) / 2
            for b, q in zip(self.red, self.decay, strict=True):
                both = (p * q, p * q.conjugate())
                total += a * b * sum((z / (1 - z)).real for z in both)
            total -= 2.0 * a * p.real * self.differenced
        return max(total, 1.0)

    def slope_variance(self, count: int) -> float:
        """Variance of u·x in units of σ² for the unit vector u proportional to time within a dwell:
        what fitting a straight line takes from n samples beside the mean."""
        if count > 5000:
            return float(self.mean_factor(np.array([count]))[0])
        middle, lag = 0.5 * (count - 1), np.arange(1, count)
        # Σ u_i u_{i+h} of a ramp, in closed form: i runs from 0 to n − h − 1.
        last = count - lag
        first = last * (last - 1) / 2 - middle * last
        second = last * (last - 1) * (2 * last - 1) / 6 - middle * last * (last - 1 - middle)
        products = (second + lag * first) / (count * (count**2 - 1) / 12)
        total = self.white + self.differenced * (1.0 - products[0])
        for share, decay in zip(self.red, self.decay, strict=True):
            total += share * (1.0 + 2.0 * float((decay**lag).real @ products))
        return float(total)


def red_sum_variance(
    decay: complex | float | np.ndarray, counts: AnyArray
) -> Float[np.ndarray, "*component count"]:
    """Variance of a sum of n samples with ρ_h = Re φ^h: the real part of
    n (1 + φ) / (1 − φ) − 2 φ (1 − φⁿ) / (1 − φ)²."""
    n = np.asarray(counts, float)
    total = n * (1 + decay) / (1 - decay) - 2 * decay * (1 - decay**n) / (1 - decay) ** 2
    return np.real(total)


def second_differences(
    deviations: Float[np.ndarray, " sample"], starts: Int[np.ndarray, " dwell"]
) -> tuple[Int[np.ndarray, " level"], Float[np.ndarray, " level"], Float[np.ndarray, " level"]]:
    """Hadamard variances of means over m = 1, 2, 4, … samples, within dwells, pooled.

    With A, B, C the sums of three neighbouring groups of m samples, the mean of (A − 2 B + C)² / 6 m²
    at every offset. A dwell's own mean and slope drop out, so nothing is lost to estimating
    them. **Returns** m, the variances, and about how many independent differences each rests on
    (levels with fewer than 8 are left out, and those that only a few long dwells can judge).
    """
    counts = np.diff(np.append(starts, len(deviations)))
    end = np.repeat(np.append(starts[1:], len(deviations)), counts)
    sums = np.append(0.0, np.cumsum(deviations))
    levels, variances, freedom = [], [], []
    m = 1
    while 3 * m <= counts.max():
        enough = counts[counts >= 3 * m]
        independent = float(np.sum(1.0 + (enough - 3 * m) / (1.4 * m)))
        if independent < 8 or 2 * enough.sum() < counts.sum():
            break
        first = np.flatnonzero(np.arange(len(deviations)) + 3 * m <= end)
        third = sums[first + 3 * m] - 3 * sums[first + 2 * m] + 3 * sums[first + m] - sums[first]
        levels.append(m)
        variances.append(float(np.mean(third**2)) / (6.0 * m * m))
        freedom.append(independent)
        m *= 2
    return np.array(levels, np.int64), np.array(variances), np.array(freedom)


def fit_noise_shape(
    deviations: Float[np.ndarray, " sample"], starts: Int[np.ndarray, " dwell"]
) -> NoiseShape:
    """The noise shape whose Hadamard variances are those of the samples; white where none shows.

    Starts from white noise and adds, one at a time, the component that lowers χ² most, while
    that is by more than its cost; all shares stay non-negative (NNLS). Memories tried: up to two
    thirds of the longest averages that can be judged; what is slower passes for a change from
    dwell to dwell. Bands tried have periods of such averages at most.

    For a noise with S(n), the second difference of sums of m has the variance
    15 S(m) − 6 S(2m) + S(3m).
    """
    levels, variances, freedom = second_differences(deviations, starts)
    seen = variances > 0
    levels, variances, freedom = levels[seen], variances[seen], freedom[seen]
    if len(levels) < 2:
        return NoiseShape()
    longest = max(float(levels[-1]) / 1.5, 1.0)
    memories = np.geomspace(0.5, longest, max(2, int(6 * np.log2(longest / 0.5)) + 1))
    bands = _bands(memories[::2], longest)
    decays = np.concatenate([np.exp(-1.0 / memories), bands])
    columns = [_hadamard(lambda n: n, levels), _hadamard(lambda n: np.ones_like(n), levels)]
    by_decay = _hadamard(lambda n: red_sum_variance(decays[:, None], n), levels)
    design = np.column_stack([*columns, by_decay.T])
    cost = np.full(design.shape[1], _GAIN)
    cost[len(cost) - len(bands) :] = _GAIN_OF_BAND
    shares, expected = np.zeros(design.shape[1]), variances
    for _ in range(3):
        # A variance is uncertain in proportion to what it should be; weighted with what it happens
        # to be, chance lows would count for more than chance highs.
        weight = np.sqrt(freedom / 2.0) / expected
        shares = _grow(design * weight[:, None], variances * weight, cost)
        expected = design @ shares
    shares = shares / shares.sum()
    red = np.flatnonzero(shares[2:])
    return NoiseShape(
        white=float(shares[0]),
        differenced=float(shares[1]),
        red=tuple(shares[2 + red].tolist()),
        decay=tuple(complex(d) for d in decays[red]),
    )


def _hadamard(
    sum_variance: Callable[[np.ndarray], np.ndarray], levels: Int[np.ndarray, " level"]
) -> Float[np.ndarray, "*component level"]:
    m = levels.astype(float)
    return (15 * sum_variance(m) - 6 * sum_variance(2 * m) + sum_variance(3 * m)) / (6 * m**2)


# In χ², for which another component is taken: 3 sigma, and 5 for a band, of whose hundreds some fit by chance.
_GAIN, _GAIN_OF_BAND = 9.0, 25.0
_PER_OCTAVE = 8  # frequencies of bands


def _bands(memories: Float[np.ndarray, " memory"], longest: float) -> Complex[np.ndarray, " band"]:
    """φ = exp(−1/memory + i ω) with periods 2π/ω from two samples to `longest`."""
    octaves = max(np.log2(0.5 * longest), 0.0)
    frequencies = np.pi / np.geomspace(1.0, 2.0**octaves, int(_PER_OCTAVE * octaves) + 1)
    return np.exp(-1.0 / memories[:, None] + 1j * frequencies).ravel()


def _grow(
    design: Float[np.ndarray, "level component"],
    target: Float[np.ndarray, " level"],
    cost: Float[np.ndarray, " component"],
) -> Float[np.ndarray, " component"]:
    """Shares of the components chosen one at a time, from white noise on, by the drop in χ² beyond their cost."""
    chosen = [0]
    white = design[:, 0]
    shares = np.array([max(white @ target, 0.0) / (white @ white)])
    left = float(np.sum(np.square(target - shares[0] * white)))
    while len(chosen) < min(4, len(target)):
        gain = left - squares_with_one_more(design, chosen, target) - cost
        best = int(np.argmax(gain))
        if not gain[best] > 0.0:
            break
        chosen.append(best)
        shares, left = nonnegative_least_squares(design[:, chosen], target)
    return np.bincount(chosen, shares, minlength=design.shape[1])


def prior_freedom(
    log_variance: Float[np.ndarray, "dwell channel"], freedom: Float[np.ndarray, "dwell channel"]
) -> tuple[float, Float[np.ndarray, " channel"]]:
    """How many degrees of freedom ν₀ the other dwells are worth to one dwell's variance, and the
    variance s₀² that they draw it to.

    With σ²_k scattered as a scaled inverse χ² of ν₀ degrees of freedom, the variance of log s²_k is
    ψ'(ν_k/2) + ψ'(ν₀/2): what sampling leaves unexplained gives ν₀. Dwells as alike as sampling
    lets them be give ν₀ = ∞ (all take the pooled variance), very unlike ones ν₀ → 0. Fewer
    than three dwells cannot tell, and get ν₀ = 4.

    **Reference:** Smyth, *Linear models and empirical Bayes methods*, Stat. Appl. Genet. Mol. Biol.
    3 (2004) 3, section 6.2.
    """
    centred = log_variance - digamma(freedom / 2) + np.log(freedom / 2)
    if len(log_variance) < 3:
        prior = 4.0
    else:
        excess = float(centred.var(axis=0, ddof=1).mean() - polygamma(1, freedom / 2).mean())
        prior = 2.0 * _inverse_trigamma(excess) if excess > 0 else np.inf
    shift = digamma(prior / 2) - np.log(prior / 2) if np.isfinite(prior) else 0.0
    return prior, np.exp(centred.mean(axis=0) + shift)


def _inverse_trigamma(value: float) -> float:
    if value > 1e7:
        return 1.0 / np.sqrt(value)
    if value < 1e-6:
        return 1.0 / value
    x = 0.5 + 1.0 / value  # Newton on 1 / ψ', which is nearly a line (Smyth, appendix)
    for _ in range(50):
        slope = polygamma(2, x)
        step = polygamma(1, x) * (1.0 - polygamma(1, x) / value) / slope
        x += step
        if -step / x < 1e-10:
            break
    return float(x)


def quantisation_step(values: Float[np.ndarray, " time"]) -> float:
    """The step (LSB) of a channel's digital grid, in its own unit; 0 where there is none to see.

    The smallest difference of neighbouring samples is the step if nearly all differences are whole
    multiples of it, and if it is not so fine that any number would be.
    """
    steps = np.abs(np.diff(values[:20_000]))
    steps = steps[steps > 1e-12 * max(float(np.abs(values[:20_000]).max()), 1e-300)]
    if len(steps) < 3:
        return 0.0
    least = float(steps.min())
    least = float(steps[steps < 1.5 * least].mean())
    multiples = steps / least
    near = multiples[multiples < 1000]
    if 2 * len(near) < len(multiples):
        return 0.0
    on_grid = np.abs(near - np.round(near)) < 0.02 * np.maximum(1.0, 0.01 * near)
    return least if on_grid.mean() > 0.99 else 0.0


_STEPS: dict[int, tuple[weakref.ref, np.ndarray]] = {}


def converter_steps(outputs: Float[np.ndarray, "time 3"]) -> Float[np.ndarray, "3"]:
    """`quantisation_step` of each channel of a triad; kept as long as the outputs are, since every stage asks."""
    key = id(outputs)
    known = _STEPS.get(key)
    if known is None or known[0]() is not outputs:
        steps = np.array([quantisation_step(outputs[:, axis]) for axis in range(outputs.shape[1])])
        known = weakref.ref(outputs, lambda _: _STEPS.pop(key, None)), steps
        _STEPS[key] = known
    return known[1]


def quantisation_floor(
    step: Float[AnyArray, "*any"], variance: Float[AnyArray, "*any"]
) -> Float[np.ndarray, "*any"]:
    """Variance that averaging does not remove from the mean of a rounded signal, unit².

    With noise σ before rounding the mean's error has the variance

        LSB² / (2π²) Σ_k exp(−4π² k² σ² / LSB²) / k²,

    which is LSB²/12 for a constant signal and nothing above σ ≈ LSB/2, where noise dithers the
    converter. `variance` is that of the samples as recorded, so σ² = max(variance − LSB²/12, 0).

    **Reference:** Widrow, Kollár, *Quantization Noise*, Cambridge 2008, ch. 5 and appendix G.
    """
    lsb2 = np.asarray(step, float) ** 2
    sigma2 = np.maximum(np.asarray(variance) - lsb2 / 12.0, 0.0)
    floor = np.where(sigma2 == 0.0, lsb2 / 12.0, 0.0)
    # Beyond σ = LSB the series is below 1e-17 of LSB².
    dithered = np.broadcast_to((sigma2 > 0.0) & (sigma2 < lsb2), floor.shape)
    lsb2, sigma2 = (np.broadcast_to(x, floor.shape)[dithered] for x in (lsb2, sigma2))
    k2 = np.arange(1, 30.0) ** 2
    decay = np.exp(-4.0 * np.pi**2 * (sigma2 / lsb2)[:, None] * k2)
    floor[dithered] = lsb2 / (2.0 * np.pi**2) * (decay / k2).sum(axis=-1)
    return floor
