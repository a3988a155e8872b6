"""Noise along the specific force, as calibrated accelerometers show it.

Second form, written out for a batch, of what `estimators.Invariant` gives of dwells that its own parameters have
compensated, as the paper's iteration does (`tests/test_fleet_moments.py` holds the two together):

    σ² = uᵀ X C Xᵀ u,   X = (E + Γ)⁻¹,   u = f/‖f‖,   f = X (a' − a⁰)
"""

import jax
import numpy as np
from jaxtyping import Float

from ...physics.temperature import AbstractBasis
from ...reduction.dwells import Dwells


def refined_sigma(
    basis: AbstractBasis,
    dwells: Dwells,
    parameters: Float[np.ndarray, "devices unknowns"],
    own: Float[np.ndarray, "devices dwells 1"],
) -> Float[np.ndarray, "devices dwells 1"]:
    """Standard deviations, m/s²; `own`, which is along the output, where a device's parameters are of no use.

    **Arguments:** `parameters` of all nine of `Invariant`, row-major (basis, parameters).
    """
    with jax.enable_x64(True):
        phi = np.asarray(jax.vmap(jax.vmap(basis))(np.asarray(dwells.temperature)))
    coefficients = parameters.reshape(len(parameters), basis.size, 9)
    at = np.moveaxis(np.einsum("dnk,dkp->dnp", phi, coefficients), -1, 0)
    a0, a1, a2 = np.moveaxis(np.asarray(dwells.accel), -1, 0) - at[:3]
    g00, g10, g11, g20, g21, g22 = at[3:]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        f0 = a0 / (1.0 + g00)
        f1 = (a1 - g10 * f0) / (1.0 + g11)
        f2 = (a2 - g20 * f0 - g21 * f1) / (1.0 + g22)
        size = np.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
        # w = Xᵀ u, by the rows of (E + Γ)ᵀ from the last.
        w2 = f2 / size / (1.0 + g22)
        w1 = (f1 / size - g21 * w2) / (1.0 + g11)
        w0 = (f0 / size - g10 * w1 - g20 * w2) / (1.0 + g00)
        w = np.stack([w0, w1, w2], axis=-1)
        covariance = np.asarray(dwells.accel_covariance)
        sigma = np.sqrt(np.einsum("dni,dnij,dnj->dn", w, covariance, w))[:, :, None]
    good = np.all(np.isfinite(sigma) & ((sigma > 0.0) | (own == 0.0)), axis=(1, 2), keepdims=True)
    return np.where(good, sigma, own)
