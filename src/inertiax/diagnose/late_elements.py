"""Elements so late behind the probe that nothing else can be told before: lag, degree and parameters at once.

A model that was calibrated without a strong lag has parameters that the lag has bent, and often a degree too low, for
the lag is scatter to the criterion that chose it. Every candidate is then judged beside curvature that is missing, and
signatures of lags are made of the bent parameters: a hysteresis and a dependence on the rate of temperature together
fit better. Means of the dwells tell such a lag by themselves, for of a given time constant the model is linear,

$$\\bar y_n = \\sum_k T_k(x(\\bar T_{s,n})) \\, J_n \\, \\theta_k, \\qquad \\tau \\dot T_s + T_s = T_p,$$

and the Bayesian information criterion chooses time constant and degree. What it finds is where the search begins. The
search decides whether it is a lag.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..effects import CATALOGUE, Variant
from ..effects.thermal_lag import element_behind
from ..model_selection.model_spec import LEAST_SPAN
from ..model_selection.temperature_degree import HIGHEST_DEGREE, temperature_levels
from ..procedure.rank import has_full_rank
from .element_temperature import Curves
from .problem import Prepared, Problem


# Convention: where a lag leaves less than half of the squares, it has bent the parameters by as much as they tell.
STRONG = 0.5
ENOUGH = 2.0  # times the squares of the best degree that a lower one may leave
WORTH = 20.0  # by the criterion: odds of 20 000 to 1
(LAG,) = (e for e in CATALOGUE if e.name == "thermal_lag")


class Chain(NamedTuple):
    """Rows of one chain, a dwell each: outputs, and their derivatives by the parameters at one temperature."""

    output: Float[np.ndarray, " dwell"]
    jacobian: Float[np.ndarray, "dwell parameter"]
    bias: Float[np.ndarray, "dwell bias"]  # of them those of biases
    names: tuple[str, ...]  # of the parameters


class _Fit(NamedTuple):
    """The model at given temperatures of the elements: criterion, squares left, coefficients chain by chain."""

    criterion: float
    left: float
    degree: int
    coefficients: list[Float[np.ndarray, "parameter size"]]


def late_elements(problem: Problem) -> dict[str, Curves]:
    """By triad whose elements are late by much, the parameters beside that lag and over the elements' temperature.

    Their degree is the model's where the user gave it.
    """
    model = problem.plain.model
    if model.together or model.lever_arms:
        return {}
    chosen_by, found = dict(model.chosen_by), {}
    for prepared in problem.triads:
        triad = prepared.form.triad
        given = chosen_by.get(f"{triad}.temperature_degree") != "tool"
        curves = _late(prepared, prepared.form.degree if given else None)
        if curves is not None:
            found[triad] = curves
    return found


def _late(prepared: Prepared, degree: int | None) -> Curves | None:
    signal, blocks = prepared.signal, prepared.blocks
    if signal.temperature is None or signal.at_temperature is None:
        return None
    place = np.unique(blocks.dwell, return_inverse=True)[1]
    probe = means_of_dwells(blocks.mean(np.asarray(signal.temperature)), place)
    low, high = float(probe.min()), float(probe.max())
    if high - low < LEAST_SPAN:
        return None
    chains = chains_of(prepared, place)
    highest = min(HIGHEST_DEGREE, temperature_levels(probe) - 1)
    degrees = range(1, highest + 1) if degree is None else range(degree, degree + 1)

    def fitted(temperature: Float[np.ndarray, " dwell"], left: np.ndarray) -> Iterable[_Fit]:
        x = (2.0 * temperature - low - high) / (high - low)
        made = (_fit(chains, np.polynomial.chebyshev.chebvander(x, d), left) for d in degrees)
        return (f for f in made if f is not None)

    nothing = np.zeros((len(probe), 0))
    plain = min(fitted(probe, nothing), default=None)
    every = [list(fitted(*element_at_dwells(prepared, place, v))) for v in LAG.variants(signal)]
    late = min((f for fits in every for f in fits), default=None)
    if plain is None or late is None:
        return None
    # Dwells that err alike make the criterion greedy; what more there is, is chosen again beside what was named.
    late = next(f for f in max(every, key=lambda fits: late in fits) if f.left < ENOUGH * late.left)
    if plain.criterion - late.criterion < WORTH or late.left > STRONG * plain.left:
        return None
    size = prepared.form.degree + 1
    values = np.zeros((len(prepared.form.names), late.degree + 1))
    for index, mine in zip(prepared.system.base.index, late.coefficients):
        values[index[::size] // size] = mine
    return Curves(low, high, values)


def element_at_dwells(
    prepared: Prepared, place: np.ndarray, variant: Variant
) -> tuple[Float[np.ndarray, " dwell"], Float[np.ndarray, "dwell pause"]]:
    """Temperature of late elements at the dwells, and what is left there of a degree that each pause changed it by."""
    signal, blocks = prepared.signal, prepared.blocks
    assert signal.temperature is not None
    constant = float(variant.settings["time_constant"])
    element = np.asarray(element_behind(signal, constant))
    since = np.asarray(signal.rows_for)
    cycle = np.cumsum(np.r_[False, np.diff(since) < 0.0])
    left = np.exp(-since / constant)[:, None] * (cycle[:, None] == np.arange(1, cycle[-1] + 1))
    return means_of_dwells(blocks.mean(element), place), means_of_dwells(blocks.mean(left), place)


def chains_of(prepared: Prepared, place: np.ndarray) -> list[Chain]:
    """The triad's rows, linear in the parameters about the calibration's, as means of dwells."""
    base, size, made = prepared.system.base, prepared.form.degree + 1, []
    flat = base.coefficients.reshape(-1)
    for observed, columns, index in zip(base.observed, base.columns, base.index):
        # The first of each parameter's columns is of the constant polynomial.
        output = observed + columns @ flat[index]
        jacobian = means_of_dwells(columns[:, ::size], place)
        names = tuple(prepared.form.names[k] for k in index[::size] // size)
        biases = [".bias[" in name for name in names]
        made.append(Chain(means_of_dwells(output, place), jacobian, jacobian[:, biases], names))
    return made


def means_of_dwells(rows: Float[np.ndarray, "block *more"], place: np.ndarray) -> np.ndarray:
    """Means over the blocks of each dwell."""
    total = np.zeros((place.max() + 1, *rows.shape[1:]))
    np.add.at(total, place, rows)
    return (total.T / np.bincount(place)).T


def _fit(
    chains: list[Chain],
    basis: Float[np.ndarray, "dwell size"],
    left: Float[np.ndarray, "dwell pause"],
) -> _Fit | None:
    """Least squares of every chain with variances of their own; `None` where dwells are too few for it, or leave
    curves open, as each face that is at one temperature leaves scale factors: no calibration has that degree.

    What a pause did to the elements changes biases: a first order that each channel has by itself.
    """
    criterion, squares, made = 0.0, 0.0, []
    for output, jacobian, bias, names in chains:
        count, rows = jacobian.shape[1], len(output)
        by_degree = (basis[:, :, None] * jacobian[:, None, :]).reshape(rows, -1)
        if not has_full_rank(by_degree.T @ by_degree, names, basis.shape[1]):
            return None
        curves = (jacobian[:, :, None] * basis[:, None, :]).reshape(rows, -1)
        pauses = (bias[:, :, None] * left[:, None, :]).reshape(rows, -1)
        design = np.concatenate([curves, pauses], axis=1)
        if rows < 2 * design.shape[1]:
            return None
        solution, *_ = np.linalg.lstsq(design, output, rcond=1e-10)
        mine = float(np.sum((output - design @ solution) ** 2))
        criterion += rows * np.log(max(mine, 1e-300)) + len(solution) * np.log(rows)
        squares += mine
        made.append(solution[: curves.shape[1]].reshape(count, -1))
    return _Fit(criterion, squares, basis.shape[1] - 1, made)
