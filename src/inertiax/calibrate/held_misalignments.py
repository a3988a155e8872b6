"""What misalignments that are held at zero do to biases and scale factors, and to their stated uncertainty.

Six faces determine no misalignments. A face that is off by an angle $\\epsilon$ reads $\\epsilon \\gamma$ of a
misalignment $\\gamma$ all the same, and the fit puts that into bias and scale factor. With the whitened rows' Jacobians
$J$ of what is fitted and $J_\\gamma$ of what is held, and the usual size $s$ of a misalignment as its standard
deviation (consider covariance),

$$S = -P J^T J_\\gamma, \\qquad C = P + s^2 S S^T, \\qquad C_{x\\gamma} = s^2 S.$$

**Reference:** Schmidt, *Application of state-space methods to navigation problems*, Advances in Control
Systems 3, 1966.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._jax import eqx
from ..estimators import Invariant
from ..procedure.single_device import Problem
from .goodness_of_fit import LIMITS
from .results import TriadResult


USUAL = LIMITS.usual_size["accel.matrix"]  # rad, 1 sigma of a misalignment that nobody measured


class WithHeld(NamedTuple):
    """Accelerometer coefficients with misalignments that are held at zero among them."""

    names: tuple[str, ...]
    coefficients: Float[np.ndarray, "size parameter"]
    covariance: Float[np.ndarray, "unknowns unknowns"]  # row-major (size, parameters)


def stated_with_held(accel: TriadResult) -> TriadResult:
    """The accelerometers' estimate with C of the module in the place of P, the covariance that its dwells give, slow
    noise included; as it is where nothing is held."""
    if not _holds(accel):
        return accel
    slope = _slope(accel)
    own = np.asarray(accel.solution.covariance) + USUAL**2 * slope @ slope.T
    return eqx.tree_at(lambda r: r.solution.covariance, accel, own)


def with_held(accel: TriadResult) -> WithHeld:
    """All coefficients of a `stated_with_held` estimate with their joint covariance. A held misalignment is the same at
    all temperatures."""
    coefficients = np.asarray(accel.solution.curve.coefficients)
    names, stated = accel.estimator.names, np.asarray(accel.solution.covariance)
    if not _holds(accel):
        return WithHeld(names, coefficients, stated)
    every = _larger(accel).names
    wide = np.zeros((len(coefficients), len(every)))
    wide[:, [every.index(n) for n in names]] = coefficients
    own, held, slope = _places(accel, every), _held(accel, every), _slope(accel)
    made = np.zeros((wide.size, wide.size))
    made[np.ix_(own, own)] = stated
    made[np.ix_(own, held)] = USUAL**2 * slope
    made[np.ix_(held, own)] = USUAL**2 * slope.T
    made[held, held] = USUAL**2
    return WithHeld(every, wide, made)


def _slope(accel: TriadResult) -> Float[np.ndarray, "unknowns held"]:
    """S of the module."""
    larger = _larger(accel)
    coefficients = np.asarray(accel.solution.curve.coefficients)
    wide = np.zeros((len(coefficients), larger.num_parameters))
    wide[:, [larger.names.index(n) for n in accel.estimator.names]] = coefficients
    design, _ = Problem(larger, accel.solution.curve.basis, accel.dwells).rows(wide)
    fitted = design[:, _places(accel, larger.names)]
    return -np.linalg.lstsq(fitted, design[:, _held(accel, larger.names)], rcond=None)[0]


def _larger(accel: TriadResult) -> Invariant:
    """The estimator with the misalignments."""
    assert isinstance(accel.estimator, Invariant)  # `_holds`
    return dataclasses.replace(accel.estimator, misalignments=True)


def _held(accel: TriadResult, names: tuple[str, ...]) -> list[int]:
    """Where the held ones' constants stand; the basis' first function is 1."""
    return [k for k, n in enumerate(names) if n not in accel.estimator.names]


def _holds(accel: TriadResult) -> bool:
    return isinstance(accel.estimator, Invariant) and not accel.estimator.misalignments


def _places(accel: TriadResult, names: tuple[str, ...]) -> list[int]:
    """Where the fitted coefficients stand among those of all names."""
    columns = [names.index(n) for n in accel.estimator.names]
    size = accel.solution.curve.basis.size
    return [a * len(names) + c for a in range(size) for c in columns]
