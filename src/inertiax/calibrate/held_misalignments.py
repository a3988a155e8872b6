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

import equinox as eqx
import numpy as np
from jaxtyping import Float

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
    """The accelerometers' estimate with C of the module in the place of P; as it is where nothing is held."""
    if not _holds(accel):
        return accel
    whole = with_held(accel)
    own = _places(accel, whole.names)
    return eqx.tree_at(lambda r: r.solution.covariance, accel, whole.covariance[np.ix_(own, own)])


def with_held(accel: TriadResult) -> WithHeld:
    """All coefficients with their joint covariance. A held misalignment is the same at all temperatures."""
    coefficients = np.asarray(accel.solution.curve.coefficients)
    names = accel.estimator.names
    if not _holds(accel):
        return WithHeld(names, coefficients, np.asarray(accel.solution.covariance))
    assert isinstance(accel.estimator, Invariant)  # `_holds`
    larger = dataclasses.replace(accel.estimator, misalignments=True)
    basis, count = accel.solution.curve.basis, larger.num_parameters
    wide = np.zeros((len(coefficients), count))
    wide[:, [larger.names.index(n) for n in names]] = coefficients
    problem = Problem(larger, basis, accel.dwells)
    design, _ = problem.rows(wide)
    own = _places(accel, larger.names)
    held = [
        k for k, n in enumerate(larger.names) if n not in names
    ]  # the basis' first function is 1
    fitted = design[:, own]
    slope = -np.linalg.lstsq(fitted, design[:, held], rcond=None)[0]
    made = np.zeros((wide.size, wide.size))
    least = Problem(accel.estimator, basis, accel.dwells).covariance(coefficients)
    made[np.ix_(own, own)] = least + USUAL**2 * slope @ slope.T
    made[np.ix_(own, held)] = USUAL**2 * slope
    made[np.ix_(held, own)] = USUAL**2 * slope.T
    made[held, held] = USUAL**2
    return WithHeld(larger.names, wide, made)


def _holds(accel: TriadResult) -> bool:
    return isinstance(accel.estimator, Invariant) and not accel.estimator.misalignments


def _places(accel: TriadResult, names: tuple[str, ...]) -> list[int]:
    """Where the fitted coefficients stand among those of all names."""
    columns = [names.index(n) for n in accel.estimator.names]
    size = accel.solution.curve.basis.size
    return [a * len(names) + c for a in range(size) for c in columns]
