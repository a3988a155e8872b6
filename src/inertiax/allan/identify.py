"""Noise terms of a log at rest: N, B, K and Q by maximum likelihood on its spectrum, R by least squares.

The spectrum of the log's differences has under each term an expectation known up to the coefficient's
square (see `spectrum`), behind a low-pass filter of the sensor's own (see `band`), so that the likelihood of
independent χ² ordinates is a regression (`likelihood`), and the limits are those of its profile (`limits`).
The ramp R comes from means of blocks with their full covariance under the other terms (`ramp`), and is taken
out first.

**Reference:** IEEE Std 952-1997, annex C.
"""

import numpy as np
from jaxtyping import Float

from ..reduction.mean_noise import quantisation_step
from .band import Band, corner_of, find_band, misfit
from .likelihood import covariance, Fit, model_of, Problem, variance
from .limits import terms_of
from .model import NoiseModel, NoiseTerm, TERMS
from .ramp import plain_slope, ramp_term, slope
from .repeats import own_samples
from .sensor_filter import recursion_of
from .spectrum import Spectrum, spectrum_of
from .statement import band_statement
from .stored_channel import Log


FEWEST = 256  # samples
RANDOM = ("Q", "N", "B", "K")
WIDE = 32.0  # ordinates of a bin whose mean tells a density to a fifth
ROUNDED = 1.2  # of the least density that a log shows, up to which rounding may be a part of it
UNKNOWN = NoiseTerm(None, None, 0.0, float("inf"))
# Of the samples' scatter: rounding to coarser steps is no noise that adds to the sensor's.
COARSE = 1.5
RISING = 0.5  # of the density in the highest third, what a rounded integral's log has in the lowest at most
_FOR_SCATTER = 20_000  # samples, which tell the converter's step, too
# χ² per degree of freedom up to which limits are widened, and beyond which the terms have no values.
FAILED = 4.0
# Relative error of N, one sigma, beyond which it has no value.
LOOSEST = 0.3


def identify(log: Float[np.ndarray, " time"], *, rate: float, triad: str = "gyro") -> NoiseModel:
    """Noise coefficients of a log at rest, sampled at a constant `rate` (Hz), in SI units.

    `triad` ("accel" or "gyro") tells the units, nothing else. Intervals are 95 %. Where the log repeats each of the
    sensor's samples, the sensor's own are used, at their rate.
    Raises `ValueError` where the log is too short (256 samples), not finite or constant.
    """
    log = np.asarray(log, float)
    if log.ndim != 1 or len(log) < FEWEST or not np.all(np.isfinite(log)):
        raise ValueError(
            f"`identify(log)`: 256 or more finite samples of one channel are needed, got shape "
            f"{log.shape}."
        )
    if np.ptp(log) == 0.0:
        raise ValueError(
            "`identify(log)`: the log is constant: a dead channel, or filled-in values."
        )
    own = own_samples([log])
    fresh, rate = own.of(log), own.rate(rate, len(log))
    if len(fresh) < FEWEST:
        raise ValueError(
            f"`identify(log)`: {len(fresh)} of the samples are new ones, the others repeat them; 256 are "
            f"needed."
        )
    return identify_samples(fresh, rate=rate, triad=triad)


def identify_samples(log: Log, *, rate: float, triad: str) -> NoiseModel:
    """As `identify`, of a checked log without repeated samples."""
    begin = log[:_FOR_SCATTER]
    step, duration = quantisation_step(begin), len(log) / rate
    ramp = plain_slope(log, rate)
    spectrum = spectrum_of(log, rate, ramp)
    rounding = _rounding(spectrum, step)
    band = find_band(spectrum, rounding)
    band, problem, names, fit = band.fitted(spectrum, rounding)
    # The ramp was taken out by least squares; now it is with the weights of the noise found.
    better, _ = slope(log, rate, _every(names, fit.squares))
    if _matters(better - ramp, spectrum, len(log)):
        ramp, spectrum = better, spectrum_of(log, rate, better)
        band, problem, names, fit = band.fitted(spectrum, rounding)
    chi2, _ = misfit(problem, fit)
    terms = terms_of(problem, fit, names, 1.0 if band.passes else max(chi2, 1.0))
    terms["R"] = _ramp(log, rate, problem, fit, names)
    terms = _judged(
        terms,
        band,
        failed=not band.passes and chi2 > FAILED,
        coarse=_is_coarse(begin, step, spectrum),
    )
    return NoiseModel(
        triad=triad,
        rate=rate,
        duration=duration,
        terms={name: terms.get(name, UNKNOWN) for name in TERMS},
        chi2_per_dof=_misfit_with_lines(spectrum, band, fit, rounding),
        band=(band.lower, band.upper),
        corner=corner_of(band, fit, rate) if band.seen else None,
        recursion=recursion_of(fit.filter, band.upper, rate) if band.seen else (),
        rounding=step,
        statement=band_statement(spectrum, band, fit),
    )


def _rounding(spectrum: Spectrum, step: float) -> float:
    """Density of rounding to a `step`, (unit)²/Hz; zero where the log shows less, as of a rounded integral."""
    density = step**2 / 12.0 / spectrum.rate
    wide = spectrum.width >= WIDE
    least = np.min(spectrum.power[wide] / spectrum.expected[wide, 1], initial=np.inf)
    return density if density < ROUNDED * least else 0.0


def _every(names: tuple[str, ...], squares: Float[np.ndarray, " term"]) -> Float[np.ndarray, "4"]:
    """Squares of all four random terms, zero for those that have no place in the fit."""
    known = dict(zip(names, squares, strict=True))
    return np.array([known.get(name, 0.0) for name in RANDOM])


def _matters(change: float, spectrum: Spectrum, samples: int) -> bool:
    """Whether a change of the ramp moves the lowest ordinate by a hundredth of itself."""
    return (change / spectrum.rate) ** 2 * samples > 0.01 * float(spectrum.power[0])


def _ramp(log: Log, rate: float, problem: Problem, fit: Fit, names: tuple[str, ...]) -> NoiseTerm:
    squares = _every(names, fit.squares)
    found, shares = slope(log, rate, squares)
    spread = [variance(problem, fit, own)[0] for own in range(len(names))]
    free = np.flatnonzero(fit.squares > 0)
    of_free = np.array([RANDOM.index(names[k]) for k in free], int)  # there may be none
    both = np.zeros((len(RANDOM), len(RANDOM)))
    both[np.ix_(of_free, of_free)] = covariance(problem, fit, free)[0]
    # Flicker and walk that were found to be zero count with their one sigma.
    slow = np.array([name in ("B", "K") for name in names])
    possible = np.where(slow & (fit.squares == 0.0), np.sqrt(spread), fit.squares)
    return ramp_term(found, shares, squares, both, _every(names, possible))


def _is_coarse(begin: Float[np.ndarray, " time"], step: float, spectrum: Spectrum) -> bool:
    """Whether rounding hides the noise; an integral that is rounded (an angle) is no such case."""
    if step <= COARSE * float(np.std(begin)):
        return False
    density, third = spectrum.power / spectrum.expected[:, 1], spectrum.upper[-1] / 3.0
    mean = lambda part: float(np.average(density[part], weights=spectrum.width[part]))
    low, high = spectrum.upper <= third, spectrum.upper > 2.0 * third
    return mean(low) > RISING * mean(high)


def _judged(
    terms: dict[str, NoiseTerm], band: Band, *, failed: bool, coarse: bool
) -> dict[str, NoiseTerm]:
    """The terms that the fit determines; the others have no value, and no limit where the model fails."""
    if failed or coarse:
        return {}
    white = terms["N"]
    if white.value is not None and white.std is not None:
        # Without an upper limit, a filter's corner takes what N gives.
        if white.std > LOOSEST * white.value or not np.isfinite(white.upper):
            terms["N"] = NoiseTerm(None, None, 0.0, white.upper, white.least)
    # What happens below the band is not described, so that it tells nothing of the slow terms.
    return {k: v for k, v in terms.items() if band.lower == 0.0 or k in ("Q", "N")}


def _misfit_with_lines(spectrum: Spectrum, band: Band, fit: Fit, rounding: float) -> float:
    """χ² per degree of freedom in the band, what was left out of it as lines included."""
    whole, _ = band.whole().problem(spectrum, rounding)
    model = model_of(whole, fit.squares, fit.filter)
    return misfit(whole, Fit(fit.squares, fit.filter, model, 0.0))[0]
