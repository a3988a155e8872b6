"""Does an iteration converge on this plan? Its spectral radius, and the combination that goes wrong."""

import numpy as np
from jaxtyping import Float

from .._jax import Array, eqx, jax, jnp, PyTree
from .._typing import AnyArray
from ..reduction.dwells import Dwells
from .experiment_sets import ExperimentPass
from .single_device import Problem
from .thermal_iterations import AbstractIteration, PaperIteration


class ConvergenceRate(eqx.Module):
    """Spectral radius of an iteration at its fixed point, and the combination that goes wrong."""

    radius: float  # below 1: error shrinks by this factor per pass; 1 or more: it does not converge
    mode: Float[np.ndarray, "size parameters"]  # dominant eigenvector, in standard deviations


def convergence_rate(
    procedure: AbstractIteration,
    coefficients: Float[AnyArray, "size parameters"],
    dwells: Dwells,
) -> ConvergenceRate:
    """Largest |eigenvalue| of ∂C[k+1]/∂C[k]: by automatic differentiation of the whole pass, of the paper's by
    `ExperimentPass.jacobian` where it can.

    Evaluate it at the joint fit's answer, which is (nearly) the fixed point even of an iteration that
    never gets there.
    """
    estimator, basis, jacobian = procedure.estimator, procedure.basis, None
    if isinstance(procedure, PaperIteration):
        jacobian = ExperimentPass(estimator, basis, dwells).jacobian(coefficients)
    if jacobian is None:
        jacobian = np.asarray(pass_jacobian(procedure, jnp.asarray(coefficients), dwells))
    values, vectors = np.linalg.eig(jacobian)
    worst = int(np.argmax(np.abs(values)))
    covariance = Problem(estimator, basis, dwells).covariance(np.asarray(coefficients))
    sigma = np.sqrt(np.diagonal(covariance))
    mode = np.real(vectors[:, worst]) / sigma
    return ConvergenceRate(
        radius=float(np.abs(values[worst])),
        mode=(mode / np.max(np.abs(mode))).reshape(np.shape(coefficients)),
    )


@eqx.filter_jit
def pass_jacobian(procedure: AbstractIteration, coefficients: Array, dwells: Dwells) -> PyTree:
    """∂C[k+1]/∂C[k] of any iteration, by automatic differentiation."""
    flat = lambda c: procedure.refine(c.reshape(coefficients.shape), dwells).reshape(-1)
    return jax.jacfwd(flat)(coefficients.reshape(-1))


def rate_warning(
    procedure: AbstractIteration, rate: ConvergenceRate, dwells: Dwells, *, limit: float = 0.9
) -> str | None:
    """One line that names the plan's problem where the spectral radius is near or above 1."""
    if rate.radius < limit:
        return None
    labels, valid = np.asarray(dwells.experiment), np.asarray(dwells.valid)
    temperature = np.asarray(dwells.temperature)
    spans = {n: float(np.ptp(temperature[valid & (labels == n)])) for n in np.unique(labels[valid])}
    worst = max(spans, key=lambda n: spans[n])
    name = procedure.estimator.names[int(np.argmax(np.max(np.abs(rate.mode), axis=0)))]
    fate = "diverges" if rate.radius >= 1.0 else "crawls"
    return (
        f"the '{procedure.method}' iteration {fate} on this plan (spectral radius {rate.radius:.2f}):"
        f" the temperature moves by up to {spans[worst]:.1f} °C inside an experiment (experiment"
        f" {worst}) and, in the order in which the positions were visited, that drift looks like"
        f" {name}; use the default method, visit the positions in another order, or centre the drift"
        f" on the nominal temperature"
    )
