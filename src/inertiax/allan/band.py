"""The band of frequencies in which the noise terms, behind the sensor's low-pass filter, describe a log.

Nearly every sensor filters its output. Of a filter of whatever kind 1 / |H|² is near zero frequency a polynomial in
x = sin²(π f / rate); for a digital filter with poles only it is one everywhere. So the spectrum is fitted from zero
frequency up to the end of a band with a polynomial of low order, and the band is the widest one in which that passes.

The model passes where the misfit in narrow parts of the band is that of chance, and where further coefficients gain no
more than chance gives them. What is stated comes from one coefficient more than passes: an attenuation too
small to be seen would otherwise take from N more than its uncertainty.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import chdtrc, chdtri

from .._records import field, Module
from .likelihood import Fit, maximum_likelihood, Problem, spread_of_means
from .spectrum import Spectrum


_MOST = 3  # coefficients of the filter; one fewer must pass
_CHANCE = 0.05  # probability below which a misfit is not chance
# Of a log with both triads, each asked by itself: one of 20 logs of noise alone may show a filter, or an end of the
# band. Bands that are not the whole spectrum are asked at `_CHANCE` each: a slow swing hides in one that is narrow.
_CHANNELS = 6
_GAIN = (2.71, 4.61)  # of the deviance by one and two coefficients more, exceeded by chance in 10 %
_LARGEST_GAIN = (
    5.73  # by one, of the channel of six that gains most: exceeded by chance in 10 % of the logs
)
_FEWEST = 40  # bins of a band
_NARROWEST = 64.0  # ordinates of a band
_HALF_OCTAVE = np.sqrt(0.5)
_LINE = 5.0  # standard deviations above the model at which a bin is a line
_MOST_LINES = 0.15  # share of the bins
_ROUNDS = 3  # of looking for lines
_LINE_SKIRT = 3  # bins on either side that a line's leakage reaches where bins are single ordinates
# Of a line in the log. What a slower one leaks passes for a random walk: so does a swing of 15 periods and 2.5 standard
# deviations of a sample, while one of 50 periods and 8 does not (measured).
_FEWEST_PERIODS = 32.0
_ENOUGH = 0.03  # of the Nyquist frequency: a narrower band is taken only if no other beginning gives a wider one
_OPENS = 2.0  # by how much a band must reach higher without its lowest ordinates for these to be left out
_LOWEST = (0.0, 8.0, 16.0, 32.0, 64.0, 128.0)  # ordinates below which a band may begin, if it must


class Band(Module):
    """A band, the filter's shape in it, and how well the terms describe it."""

    kept: Bool[np.ndarray, " bin"]  # of the spectrum
    lines: Bool[np.ndarray, " bin"]  # in the band, but left out
    lower: float = field(static=True)  # Hz; 0 where the band begins at the lowest ordinate
    upper: float = field(static=True)  # Hz
    order: int = field(static=True)  # coefficients of the filter that are fitted
    seen: bool = field(static=True)  # whether there is a filter, as far as the log shows
    passes: bool = field(static=True)

    def problem(self, spectrum: Spectrum, rounding: float) -> tuple[Problem, tuple[str, ...]]:
        """The fit of this band with the names of its terms; Q has a place among them only without a filter."""
        found = _problem(spectrum, self.kept, rounding, self.order, self.upper)
        if not self.order:
            return found, ("Q", "N", "B", "K")
        return found.with_terms(np.arange(4) > 0), ("N", "B", "K")

    def fitted(
        self, spectrum: Spectrum, rounding: float
    ) -> tuple["Band", Problem, tuple[str, ...], Fit]:
        """The likeliest model with the band it holds for, which is one without a filter where the log tells no corner:
        of a filter that has halved the power before the band begins, N and the corner may be anything together."""
        problem, names = self.problem(spectrum, rounding)
        fit = maximum_likelihood(problem)
        if not self.order or _half_power(fit) >= _begin(spectrum, self):
            return self, problem, names, fit
        plain = dataclasses.replace(self, order=0, seen=False)
        problem, names = plain.problem(spectrum, rounding)
        fit = maximum_likelihood(problem)
        passes = misfit(problem, fit)[1] > _CHANCE
        return dataclasses.replace(plain, passes=passes), problem, names, fit

    def whole(self) -> "Band":
        """The band with its lines."""
        return dataclasses.replace(self, kept=self.kept | self.lines)


def find_band(spectrum: Spectrum, rounding: float) -> Band:
    """The widest band in which the terms describe the log; `passes` is false where there is none.

    `rounding` is the density of the output's rounding noise, (unit)²/Hz.
    """
    nyquist = 0.5 * spectrum.rate
    failing: list[tuple[float, Band]] = []
    total = np.cumsum(spectrum.width)
    passing: list[Band] = []
    for lowest in _LOWEST:
        band = _widest(spectrum, total > lowest, rounding, failing)
        if band is None:
            continue
        if band.upper > _ENOUGH * nyquist:
            return _opened(spectrum, band, lowest, rounding) or band
        passing.append(band)
    if passing:
        return max(passing, key=lambda band: float(spectrum.width[band.kept].sum()))
    if not failing:  # a log of a few hundred samples has one band only
        misfit, band = _tried(spectrum, np.ones(len(spectrum.power), bool), rounding)
        failing = [(misfit, band)]
    return min(failing, key=lambda pair: pair[0])[1]


def _opened(spectrum: Spectrum, narrow: Band, lowest: float, rounding: float) -> Band | None:
    """A band without the lowest ordinates that reaches an octave higher than a `narrow` one, if there is one.

    A drift may pass for a random walk in a narrow band; the band without it is wide.
    """
    total, least = np.cumsum(spectrum.width), _OPENS * narrow.upper
    later = (_widest(spectrum, total > low, rounding, [], least) for low in _LOWEST if low > lowest)
    return next((band for band in later if band is not None), None)


def _widest(
    spectrum: Spectrum,
    begins: Bool[np.ndarray, " bin"],
    rounding: float,
    failing: list[tuple[float, Band]],
    least: float = 0.0,
) -> Band | None:
    """The widest band from a beginning up to `least` Hz or more that passes; those that do not join `failing` with
    their misfit."""
    upper = float(spectrum.upper[-1])
    while upper > least:
        kept = begins & (spectrum.upper <= upper * (1.0 + 1e-9))
        if kept.sum() < _FEWEST or spectrum.width[kept].sum() < _NARROWEST:
            return None
        misfit, band = _tried(spectrum, kept, rounding)
        if band.passes:
            return band
        failing.append((misfit, band))
        upper *= _HALF_OCTAVE
    return None


def _tried(
    spectrum: Spectrum, kept: Bool[np.ndarray, " bin"], rounding: float
) -> tuple[float, Band]:
    """The lowest order that passes in one band, lines left out where it takes that; its misfit first."""
    lower = 0.0 if kept[0] else float(spectrum.upper[kept][0])
    upper = float(spectrum.upper[kept][-1])
    used, misfits = kept, []
    for _ in range(_ROUNDS):
        fits = _fits(_problem(spectrum, used, rounding, _MOST, upper))
        misfits = [misfit(p, f) for p, f in fits]
        order = _lowest_order(fits, misfits, bool(kept.all()))
        if order is not None:
            with_q = order == 0 and fits[0][1].squares[0] > 0.0
            stated = order + (not with_q)
            seen = _is_seen(fits, order)
            band = Band(used, kept & ~used, lower, upper, stated, seen=seen, passes=True)
            return misfits[order][0], band
        lines = _lines(*fits[-1], spectrum.frequency[used] / spectrum.frequency[0])
        if not lines.any() or (kept & ~used).sum() + lines.sum() > _MOST_LINES * kept.sum():
            break
        used = used.copy()
        used[np.flatnonzero(used)[lines]] = False
    return misfits[-1][0], Band(used, kept & ~used, lower, upper, _MOST, seen=True, passes=False)


def _fits(problem: Problem) -> list[tuple[Problem, Fit]]:
    """Fits with no filter (Q may be there) and with one of each order."""
    bare = problem.with_order(0)
    found = [(bare, maximum_likelihood(bare))]
    without = problem.with_terms(np.arange(problem.expected.shape[1]) > 0)
    fit = None
    for order in range(1, _MOST + 1):
        part = without.with_order(order)
        fit = maximum_likelihood(part, start=fit)
        found.append((part, fit))
    return found


def _lowest_order(
    fits: list[tuple[Problem, Fit]], misfits: list[tuple[float, float]], whole: bool
) -> int | None:
    """The lowest order that passes. Of the whole spectrum the highest one does, too, where a further coefficient gains
    what one of the channels may by chance: with all of them N is as free of a filter as a shorter band has it."""
    chance = _CHANCE / _CHANNELS if whole else _CHANCE
    for order in range(_MOST):
        gains = [
            (fits[order][1].deviance - f.deviance) / spread_of_means()
            for _, f in fits[order + 1 : order + 3]
        ]
        small = all(gain < most for gain, most in zip(gains, _GAIN, strict=False))
        last = whole and order == _MOST - 1 and gains[0] < _LARGEST_GAIN
        if misfits[order][1] > chance and (small or last):
            return order
    return None


def _is_seen(fits: list[tuple[Problem, Fit]], order: int) -> bool:
    """Whether the filter of that order gains more than chance gives some channel of a log without one.

    A coefficient is fitted where its gain is beyond 10 %, so that N is free of it; that is no sign of a filter.
    """
    gain = (fits[0][1].deviance - fits[order][1].deviance) / spread_of_means()
    return order > 0 and gain > float(chdtri(order, _CHANCE / _CHANNELS))


def misfit(problem: Problem, fit: Fit) -> tuple[float, float]:
    """χ² per degree of freedom of the relative misfit in groups of bins, and its probability by chance."""
    starts = _groups(problem.width)
    width = np.add.reduceat(problem.width, starts)
    relative = (problem.power / fit.model - 1.0) * problem.width
    mean = np.add.reduceat(relative, starts) / width
    chi2 = float(np.sum(mean**2 * width) / spread_of_means())
    dof = max(len(mean) - int(np.sum(fit.squares > 0)) - problem.order, 1)
    return chi2 / dof, float(chdtrc(dof, chi2))


def _groups(width: Float[np.ndarray, " bin"]) -> Int[np.ndarray, " group"]:
    """First bins of groups wide enough to be nearly Gaussian: thirds of octaves from eight ordinates up, and in the
    two highest octaves, where a filter bends the spectrum, twelfths."""
    total = np.cumsum(width)
    high = total > 0.25 * total[-1]
    per_octave = np.where(high & (total > 256.0), 12.0, 3.0)
    group = np.floor(per_octave * np.log2(np.maximum(total, 8.0))) + 1e4 * high
    return np.unique(group, return_index=True)[1]


def _lines(
    problem: Problem, fit: Fit, periods: Float[np.ndarray, " bin"]
) -> Bool[np.ndarray, " bin"]:
    """Bins that stand out of the model, with their neighbours; `periods` of each bin's frequency are in the log.

    What stands out from the lowest bin on, or has few periods, is a drift and no line.
    """
    above = problem.power / fit.model - 1.0
    out = np.flatnonzero(above > _LINE * np.sqrt(spread_of_means() / problem.width))
    reach = np.where(problem.width <= 1.0, _LINE_SKIRT, 1)
    near = np.zeros(len(above), bool)
    for run in np.split(out, np.flatnonzero(np.diff(out) > 1) + 1):
        if not len(run) or run[0] == 0 or periods[run[np.argmax(above[run])]] < _FEWEST_PERIODS:
            continue
        for k in run:
            near[max(k - reach[k], 0) : k + reach[k] + 1] = True
    return near


def _problem(
    spectrum: Spectrum,
    kept: Bool[np.ndarray, " bin"],
    rounding: float,
    order: int,
    upper: float,
) -> Problem:
    part = spectrum.of(kept)
    x = np.asarray(abscissa(part.frequency, spectrum.rate) / abscissa(upper, spectrum.rate))
    powers = x[:, None] ** np.arange(1, order + 1)
    return Problem(part.power, part.expected, part.width, rounding * part.expected[:, 1], powers)


def abscissa(
    frequency: Float[np.ndarray, " bin"] | float, rate: float
) -> Float[np.ndarray, " bin"] | float:
    """x = sin²(π f / rate)."""
    return np.square(np.sin(np.pi * frequency / rate))


def _begin(spectrum: Spectrum, band: Band) -> float:
    """x of the band's lowest ordinate."""
    lowest = float(spectrum.frequency[band.kept][0])
    return float(abscissa(lowest, spectrum.rate) / abscissa(band.upper, spectrum.rate))


def _half_power(fit: Fit) -> float:
    """x at which the filter has halved the power; infinity where it never does."""
    roots = np.roots(np.append(fit.filter[::-1], -1.0))  # c₁ x + c₂ x² + … = 1
    real = roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0.0)]
    return float(real.min(initial=np.inf))


def corner_of(band: Band, fit: Fit, rate: float) -> float | None:
    """Where the filter has halved the power, Hz; `None` where it does so beyond the band."""
    half = _half_power(fit)
    if half > 1.0:
        return None
    sine = float(np.sqrt(half * abscissa(band.upper, rate)))
    return rate / np.pi * float(np.arcsin(sine))
