"""The accelerometers' uncertainty in gyros that were calibrated by gravity's rotation between rests.

Gravity's directions come from calibrated accelerometers, and an error of their misalignments turns each direction
alike at every rest of that attitude: no number of motions averages it. With the whitened rows $r(\\beta, \\alpha)$ of
the gyros' coefficients $\\beta$ and the accelerometers' $\\alpha$, the normal equations $J^T r = 0$ give by implicit
differentiation (of Gauss-Newton's order)

$$S = \\frac{d\\beta}{d\\alpha} = -P J^T \\frac{\\partial r}{\\partial \\alpha}, \\qquad
C_\\beta = P + S\\, C_\\alpha S^T, \\qquad C_{\\alpha\\beta} = C_\\alpha S^T.$$

The noise of the means of the rests is in both: along gravity in the accelerometers' coefficients (`invariant`), across
it in the directions, so that the two do not go together.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._jax import eqx
from ..estimators.host_forms import host_form
from ..estimators.host_forms.gravity_rotation import GravityRotationOnHost
from ..estimators.host_forms.layout import Layout
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from .held_misalignments import with_held
from .results import TriadResult


class GyrosByGravity(NamedTuple):
    """The gyros' estimate with the accelerometers' uncertainty in its covariance."""

    result: TriadResult
    # Of the accelerometers' coefficients with the gyros', both row-major (size, parameters).
    cross_covariance: Float[np.ndarray, "accel_unknowns gyro_unknowns"]


def with_accelerometers(gyro: TriadResult, accel: TriadResult, dwells: Dwells) -> GyrosByGravity:
    """The gyros' estimate by gravity with C_β of the module in the place of P, and C_αβ.

    **Arguments:** `dwells` are all rests that the gyros were estimated on, with their motions, the accelerometers'
    outputs compensated.
    """
    whole = with_held(accel)
    slope = sensitivity(gyro, accel, dwells)
    known = whole.covariance
    moved = slope @ known @ slope.T
    covariance = np.asarray(gyro.solution.covariance) + 0.5 * (moved + moved.T)
    result = eqx.tree_at(lambda r: r.solution.covariance, gyro, covariance)
    size, names = accel.solution.curve.basis.size, accel.estimator.names
    own = [a * len(whole.names) + whole.names.index(n) for a in range(size) for n in names]
    return GyrosByGravity(result, (known @ slope.T)[own])


def sensitivity(
    gyro: TriadResult, accel: TriadResult, dwells: Dwells
) -> Float[np.ndarray, "gyro_unknowns accel_unknowns"]:
    """S = dβ/dα of the module, SI units; arguments as in `with_accelerometers`.

    α are the coefficients of `held_misalignments.with_held`: a misalignment that is held at zero turns gravity's
    directions as well as an estimated one.
    """
    problem = Problem(gyro.estimator, gyro.solution.curve.basis, dwells)
    coefficients = np.asarray(gyro.solution.curve.coefficients)
    form = host_form(gyro.estimator)
    assert isinstance(form, GravityRotationOnHost)  # that estimator's
    design, _ = problem.rows(coefficients)
    by_force = form.by_force(problem.vectors(coefficients), problem.dwells)
    here = _force_by_coefficients(accel, problem.dwells)
    # A motion starts at the rest before
    before = np.concatenate([np.zeros_like(here[:1]), here[:-1]])
    by_accel = by_force[:, :, :3] @ here + by_force[:, :, 3:] @ before
    rows = problem.decorrelated(by_accel.reshape(-1, here.shape[2]))
    # P of the module, which slow noise has no part in: the estimate is that of least squares.
    return -problem.covariance(coefficients) @ design.T @ rows


def _force_by_coefficients(
    accel: TriadResult, dwells: Dwells
) -> Float[np.ndarray, "dwell 3 accel_unknowns"]:
    """∂f/∂α of the compensated force f = (E + Γ)⁻¹ (a' − b), m/s² per coefficient."""
    whole = with_held(accel)
    layout = Layout(whole.names)
    phi = accel.solution.curve.basis.rows(np.asarray(dwells.temperature))
    errors = layout.unpack(phi @ whole.coefficients)
    refine = np.linalg.inv(np.eye(3) + errors.matrix)
    force = np.asarray(dwells.accel)
    own = -refine[:, :, layout.output] * layout.inputs(force, np.zeros_like(force))[:, None, :]
    return np.einsum("na,nip->niap", phi, own).reshape(len(force), 3, -1)
