"""The paper's pass over its experiments, driven from the host: no program is compiled for it.

One set of parameters per experiment, composed with the curve at the experiment's mean temperature, and curves through
the sets again: blocks 3 to 6 of figure 1, as `thermal_iterations.PaperIteration` has them.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray
from ..estimators import AbstractEstimator
from ..estimators.host_forms import host_form
from ..physics.temperature import AbstractBasis, Constant
from ..reduction.dwells import Dwells
from .single_device import compose_on_host, Problem
from .thermal_iterations import PaperIteration


class ExperimentPass:
    """One device's dwells, by experiment.

    Raises `ValueError` with fewer experiments than basis functions.
    """

    def __init__(self, estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells):
        plan = PaperIteration.plan(estimator, basis, dwells)
        self.members = [
            np.asarray(r)[np.asarray(k)] for r, k in zip(plan.rows, plan.kept, strict=True)
        ]
        self.problem = Problem(estimator, basis, dwells)
        temperature = np.asarray(dwells.temperature)
        self.means = np.array([temperature[m].mean() for m in self.members])
        self.phi = basis.rows(self.means)

    def sets(
        self, coefficients: Float[AnyArray, "size parameters"]
    ) -> Float[np.ndarray, "experiments parameters"]:
        """Each experiment's parameters, refined about a curve."""
        estimator = self.problem.estimator
        at_means = self.phi @ np.asarray(coefficients)
        return compose_on_host(estimator, at_means, self._corrections(coefficients))

    def refine(
        self, coefficients: Float[AnyArray, "size parameters"]
    ) -> Float[np.ndarray, "size parameters"]:
        """The next curve: least squares through the sets."""
        return np.linalg.lstsq(self.phi, self.sets(coefficients), rcond=None)[0]

    def _corrections(
        self, coefficients: Float[AnyArray, "size parameters"]
    ) -> Float[np.ndarray, "experiments parameters"]:
        refined = self.problem.compensated(coefficients)
        each = [Problem(self.problem.estimator, Constant(), refined[m]) for m in self.members]
        return np.stack([p.solve(p.start())[0][0] for p in each])

    def jacobian(
        self, coefficients: Float[AnyArray, "size parameters"]
    ) -> Float[np.ndarray, "unknowns unknowns"] | None:
        """∂(next)/∂(coefficients), row-major; `None` for an estimator without a NumPy form and for dwells
        that share errors.

        An experiment's correction c makes g(c, θ) = Σ Jᵀr zero, where θ are the dwells' parameters on the curve, so
        that dc = −(∂g/∂c)⁻¹ (∂g/∂θ) dθ. Each dwell adds to g by its own θ alone: central differences over all dwells
        at once, by as much as all dwells tell a parameter apart, give the slopes.
        """
        problem, form = self.problem, host_form(self.problem.estimator)
        if form is None or problem.shared is not None:
            return None
        rows = np.concatenate(self.members)
        starts = np.cumsum([0, *(len(m) for m in self.members[:-1])])
        which = np.repeat(np.arange(len(self.members)), [len(m) for m in self.members])
        dwells, vectors = problem.dwells[rows], problem.vectors(coefficients)[rows]
        corrections = self._corrections(coefficients)
        steps = 1.0 / np.linalg.norm(form.linearise(vectors, dwells).jacobian, axis=(0, 1))

        def gradient(corrections: np.ndarray, vectors: np.ndarray) -> np.ndarray:
            now = form.linearise(corrections, form.compensate(vectors, dwells))
            return np.einsum("nrp,nr->np", now.jacobian, now.residual)

        own, summed = corrections[which], lambda slopes: np.add.reduceat(slopes, starts, axis=0)
        curvature = summed(_slopes(lambda c: gradient(c, vectors), own, steps))
        by_dwell = _slopes(lambda v: gradient(own, v), vectors, steps)
        mixed = summed(np.einsum("npq,nk->npkq", by_dwell, problem.phi[rows]))
        count, size = len(steps), problem.basis.size
        change = -np.linalg.solve(curvature, mixed.reshape(len(curvature), count, -1))
        change = change.reshape(-1, count, size, count)
        at_means = self.phi @ np.asarray(coefficients)
        first = _slopes(lambda a: form.compose(a, corrections), at_means, steps)
        second = _slopes(lambda c: form.compose(at_means, c), corrections, steps)
        sets = np.einsum("epq,ek->epkq", first, self.phi)
        sets += np.einsum("epr,erkq->epkq", second, change)
        whole = np.einsum("ae,epkq->apkq", np.linalg.pinv(self.phi), sets)
        return whole.reshape(size * count, size * count)


def _slopes(
    function: Callable[[np.ndarray], np.ndarray],
    at: Float[np.ndarray, "row parameter"],
    steps: Float[np.ndarray, " parameter"],
) -> Float[np.ndarray, "row value parameter"]:
    """Each row's derivatives by its own parameters, by central differences."""
    shifts = np.diag(steps)
    found = [(function(at + d) - function(at - d)) / (2.0 * s) for d, s in zip(shifts, steps)]
    return np.stack(found, axis=-1)
