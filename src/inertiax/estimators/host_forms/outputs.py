"""Outputs against what they should be: `ReferenceAccel`, `ReferenceGyro`, `StaticAccel` and `StaticGyro`.

    r = W (y' − (E + M) y − b − D a / g)

with M and D where the estimator has them; the residual is linear in the parameters.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from ...reduction.dwells import Dwells
from .form import AbstractHostForm, LinearisedDwells, Vectors, whitening


class OutputsOnHost(AbstractHostForm):
    """Mean outputs against a reference, or against `nominal` where the plan gives none."""

    def __init__(self, estimator: Any):
        super().__init__(estimator)
        self.nominal = np.asarray(getattr(estimator, "nominal", np.zeros(3)))

    def linearise(self, vectors: Vectors, dwells: Dwells) -> LinearisedDwells:
        errors = self.layout.unpack(vectors)
        known = self._known(dwells)
        force = self.force(dwells) / self.gravity
        expected = known + errors.bias + np.einsum("nij,nj->ni", errors.matrix, known)
        expected += np.einsum("nij,nj->ni", errors.g_sensitivity, force)
        misfit = np.asarray(getattr(dwells, self.triad)) - expected
        covariance = np.asarray(getattr(dwells, f"{self.triad}_covariance"))
        whiten = whitening(covariance, self.scatter)
        jacobian = -whiten[:, :, self.layout.output] * self.layout.inputs(known, force)[:, None, :]
        return self.weighed(
            dwells,
            np.einsum("nij,nj->ni", whiten, misfit),
            jacobian,
            misfit,
            np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        )

    def start(self, dwells: Dwells) -> Float[np.ndarray, " parameter"]:
        del dwells  # the residual is linear: Gauss-Newton needs no start
        return np.zeros(self.layout.size)

    def _known(self, dwells: Dwells) -> Float[np.ndarray, "dwell 3"]:
        given = getattr(dwells, f"reference_{self.triad}")
        if given is not None:
            return np.asarray(given)
        return np.broadcast_to(self.nominal, (dwells.num_dwells, 3))
