"""The degree of the polynomials in temperature, by what the dwells tell."""

import numpy as np
from jaxtyping import Float

from ..estimators import AbstractEstimator
from ..numerics.further_columns import log_odds
from ..numerics.left_out import log_left_out
from ..physics.temperature import Constant
from ..procedure.rank import has_full_rank
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from .model_spec import LEAST_SPAN


HIGHEST_DEGREE = 6  # of the founding paper; more asks for more experiments than people run

# Part of the information on a degree's own coefficients that must be left beside those of the lower degrees, over what
# is left of them at degree 0. Five equal steps leave 0.6 at degree 4; four temperatures with ramps in one pose between
# them 0.00 to 0.01. Where it is 0.01 their standard errors are ten times what temperatures spread for it give.
# Convention.
LEAST_TOLD = 0.01

SPARE = (
    3  # equations beyond the unknowns, so that something is left to judge a degree by. Convention.
)

# Part of the whole span by which the temperature of an experiment may creep and still be one temperature. Slopes
# within such an experiment are few hundredths of the curve, which slow noise and a table's errors give as well; two
# of the twelve steps of `separate_temperatures`. Convention.
CREEP = 1.0 / 6.0

# The reason where no degree above 0 is determined.
UNDETERMINED = "the dwells determine no dependence on temperature, so the parameters are constants"

STRETCHES = 8  # of a campaign's time, each predicted from the others


def choose_degree(estimator: AbstractEstimator, dwells: Dwells) -> tuple[int, str]:
    """Degree of the temperature polynomials by the Bayesian information criterion.

    The problem is linearised once at the closed-form start, where the design of every degree is the
    Kronecker product of Chebyshev values and the dwells' Jacobians. Each degree is compared with the best one below it,
    by the criterion's form for few rows (`numerics.further_columns`), and must predict each dwell from the others
    better (`numerics.left_out`): what single rests of a hand hold beyond noise, few rests' temperatures follow by luck.
    The criterion prices every parameter of a degree, a matrix with twenty coefficients included. A degree is taken as
    well where the biases' coefficients alone are worth their number and predict stretches of time from the others
    better: biases off by a curvature are in no uncertainty; but biases follow a lag or a warm-up as well, which is
    another one when the same temperature comes again.
    No degree is considered that the number of different temperatures cannot carry, where an experiment whose
    temperature creeps counts as one (`CREEP`), or whose unknowns the dwells do not determine, and none from the first
    on whose own coefficients they hardly tell (`LEAST_TOLD`).
    **Returns** the degree and the reason in words.

    Raises `ValueError` where a dwell has a channel without any scatter, whose weight would be infinite.
    """
    temperature = np.asarray(dwells.temperature)
    span = float(np.ptp(temperature))
    if span < LEAST_SPAN:
        return 0, f"the temperature moves by only {span:.2f} °C, so the parameters are constants"
    problem = Problem(estimator, Constant(), dwells)
    now = problem.at(problem.start())
    rows, parameters = problem.decorrelated(now.residual.reshape(-1)), now.jacobian
    if not (np.isfinite(rows).all() and np.isfinite(parameters).all()):
        raise ValueError(
            f"{estimator.triad}: a channel has no scatter at all within a dwell, so that its weight would be infinite: "
            "look for a dead or filled-in channel (`inertiax check`)."
        )
    num_dwells, per_dwell, count = parameters.shape
    x = 2.0 * (temperature - temperature.min()) / span - 1.0
    best, least, predicted, highest = 0, 0.0, 0.0, -1
    biases = np.array([".bias[" in name for name in estimator.names])
    stretch = per_dwell * -(-num_dwells // STRETCHES)
    alone, asked, ahead = np.ones(count), "", 0.0
    levels = temperature_levels(_at_settings(temperature, np.asarray(dwells.experiment)))
    for degree in range(min(HIGHEST_DEGREE, levels - 1) + 1):
        unknowns = (degree + 1) * count
        if num_dwells * per_dwell < unknowns + SPARE:
            break
        phi = np.polynomial.chebyshev.chebvander(x, degree)
        design = np.einsum("na,nri->nrai", phi, parameters)
        design = problem.decorrelated(design.reshape(-1, unknowns))
        gram = design.T @ design
        if not has_full_rank(gram, estimator.names, degree + 1):
            break
        told = _told_beside_the_rest(gram)[-count:]
        if degree == 0:
            alone = told
        elif (told < LEAST_TOLD * alone).any():
            break
        solution, *_ = np.linalg.lstsq(design, rows, rcond=1e-10)
        rss = float(np.sum((rows - design @ solution) ** 2))
        highest = degree
        if degree == 0:
            least, predicted = rss, log_left_out(design, rows, per_dwell)
            ahead = log_left_out(design, rows, stretch)
            continue
        kept = (best + 1) * count
        own = np.r_[np.ones(kept, bool), np.tile(biases, degree - best)]
        worth = _worth(design, rows, kept, least)
        told_by_biases = not worth and _worth(design[:, own], rows, kept, least)
        if worth or told_by_biases:
            error = log_left_out(design, rows, per_dwell)
            if error < predicted and (worth or log_left_out(design[:, own], rows, stretch) < ahead):
                best, least, predicted = degree, rss, error
                ahead = log_left_out(design, rows, stretch)
                asked = " of the biases alone" if told_by_biases else ""
    if highest < 1:
        return 0, UNDETERMINED
    return best, f"temperature degree {best} by BIC{asked} among 0…{highest}"


def biases_follow(estimator: AbstractEstimator, dwells: Dwells) -> bool:
    """Whether biases linear in temperature are worth their number where everything else is constant.

    A log by hand that warms up meets each attitude at one temperature, and hardly tells a slope of every element of a
    matrix; slopes of the biases alone it may tell well.
    """
    problem = Problem(estimator, Constant(), dwells)
    now = problem.at(problem.start())
    rows, parameters = problem.decorrelated(now.residual.reshape(-1)), now.jacobian
    temperature = np.asarray(dwells.temperature)
    x = 2.0 * (temperature - temperature.min()) / np.ptp(temperature) - 1.0
    biases = parameters[:, :, [".bias[" in name for name in estimator.names]]
    design = np.concatenate([parameters, x[:, None, None] * biases], axis=2)
    design = problem.decorrelated(design.reshape(-1, design.shape[2]))
    kept = parameters.shape[2]
    if len(rows) < design.shape[1] + SPARE:
        return False
    solution, *_ = np.linalg.lstsq(design[:, :kept], rows, rcond=1e-10)
    return _worth(design, rows, kept, float(np.sum((rows - design[:, :kept] @ solution) ** 2)))


def _worth(
    design: Float[np.ndarray, "row unknown"],
    rows: Float[np.ndarray, " row"],
    kept: int,
    least: float,
) -> bool:
    """Whether the columns beyond the first `kept` ones, which leave the sum of squares `least`, are worth their
    number."""
    solution, *_ = np.linalg.lstsq(design, rows, rcond=1e-10)
    rss = float(np.sum((rows - design @ solution) ** 2))
    left = rss / least if least > 0.0 else 1.0
    return log_odds(len(rows), kept, design.shape[1] - kept, left) > 0.0


def _told_beside_the_rest(
    gram: Float[np.ndarray, "unknown unknown"],
) -> Float[np.ndarray, " unknown"]:
    r"""The part $1/(G_{ii} (G^{-1})_{ii})$ of each unknown's information that is left beside the others'."""
    scale = np.sqrt(np.diagonal(gram))
    inverse = np.linalg.pinv(gram / np.outer(scale, scale), rcond=1e-14, hermitian=True)
    return 1.0 / np.diagonal(inverse)


def _at_settings(
    temperature: Float[np.ndarray, " dwell"], experiment: np.ndarray
) -> Float[np.ndarray, " dwell"]:
    """The temperatures with a setting's mean where it creeps by no more than `CREEP` of the whole span.

    A setting ends with the experiment, or where a temperature is more than half of that from the one before it: a file
    may hold several.
    """
    settled, most = temperature.astype(float), CREEP * np.ptp(temperature)
    ends = np.diff(experiment) != 0
    ends |= np.abs(np.diff(temperature)) > 0.5 * most
    for own in np.split(np.arange(len(temperature)), np.flatnonzero(ends) + 1):
        if np.ptp(temperature[own]) <= most:
            settled[own] = temperature[own].mean()
    return settled


def temperature_levels(temperature: np.ndarray) -> int:
    """How many temperatures there are apart, see `separate_temperatures`."""
    return len(separate_temperatures(temperature))


def separate_temperatures(temperature: np.ndarray) -> list[float]:
    """The lowest of each group of temperatures at least 1/12 of the whole span apart, which is what a
    polynomial of degree 6 can tell apart near its middle; °C."""
    ordered = np.sort(temperature)
    apart = (ordered[-1] - ordered[0]) / (2 * HIGHEST_DEGREE)
    kept = [float(ordered[0])]
    for value in ordered:
        if value - kept[-1] >= apart and value > kept[-1]:
            kept.append(float(value))
    return kept
