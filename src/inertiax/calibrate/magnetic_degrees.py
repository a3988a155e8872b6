"""Degrees of hard and soft iron over temperature, by the Bayesian information criterion."""

import math

import numpy as np

from ..model_selection.model_spec import LEAST_SPAN
from ..model_selection.temperature_degree import HIGHEST_DEGREE, temperature_levels
from .magnetic_fit import Fit, free_coefficients


def choose_degrees(fit: Fit, asked: int | None) -> tuple[tuple[int, int], str]:
    """Degrees of hard and soft iron over temperature, and the reason in words.

    Linearised once at the constant solution, where the design of every pair of degrees is made of the same columns.
    """
    dwells = fit.problem.dwells[: fit.problem.num_dwells]
    temperature = np.asarray(dwells.temperature)
    span = float(np.ptp(temperature))
    if asked == 0:
        return (0, 0), "magnetometers: constants, as asked"
    if span < LEAST_SPAN:
        moves = f"moves by {span:.2f} °C" if span > 0.0 else "is not known to move"
        return (0, 0), f"magnetometers: constants, because the temperature {moves}"
    highest = min(HIGHEST_DEGREE, temperature_levels(temperature) - 1)
    if asked is not None:
        highest = asked
    now = fit.problem.at(fit.coefficients)
    counted = np.column_stack([np.ones(len(now.misfit), bool), fit.resting & fit.turned])
    right = now.residual[counted]
    # Samples that tell alike count as one.
    moving = fit.moving
    n = float(np.sum(~moving) + np.sum(moving) / float(np.asarray(fit.estimator.alike)))
    n += int(np.sum(fit.resting & fit.turned))
    x = 2.0 * (temperature - temperature.min()) / span - 1.0
    phi = np.polynomial.chebyshev.chebvander(x, max(highest, 0))
    design = np.einsum("na,nri->nrai", phi, now.jacobian)[counted]
    scores: dict[tuple[int, int], float] = {}
    for hard in range(highest + 1) if asked is None else [asked]:
        for soft in range(hard + 1):
            free = free_coefficients(fit.estimator.names, (hard, soft), turned=fit.turned)
            columns = design[:, : hard + 1][:, free]
            # With about as many unknowns as rows the misfit vanishes, and ln RSS rewards it beyond all measure.
            if n < 2.0 * columns.shape[1] and (hard, soft) != (0, 0):
                continue
            step, *_ = np.linalg.lstsq(columns, right, rcond=1e-10)
            rss = float(np.sum(np.square(right - columns @ step)))
            k = columns.shape[1]
            scores[hard, soft] = n * math.log(max(rss, 1e-300) / n) + k * math.log(n)
    if not scores:
        return (0, 0), "magnetometers: constants, because there are too few rows for more"
    hard, soft = min(scores, key=lambda d: scores[d])
    how = "by BIC" if asked is None else "as asked, soft iron by BIC"
    return (hard, soft), (
        f"magnetometers: temperature degree {hard} of the hard iron and {soft} of the soft iron, {how}"
    )
