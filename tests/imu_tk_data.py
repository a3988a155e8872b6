"""The published optimum of imu_tk's Xsens recording, and our parameters in its form."""

import os

import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.estimators import (
    Invariant,
)


GRAVITY = 9.81744
recordings = os.environ.get("INERTIAX_RECORDINGS")
needs_recordings = pytest.mark.skipif(
    recordings is None, reason="INERTIAX_RECORDINGS does not name the folder of real recordings"
)
# Optimum on which Ceres, SciPy and others agree; x' = T K (x - b) with counts, T unit upper.
PUBLISHED = {
    "misalignment": (0.00338802912, -0.00917255064, 0.0213631395),  # yz, zy, zx
    "scale": (0.00241300189, 0.00242700002, 0.00241184764),  # m/s² per count
    "bias": (33123.8308, 33275.1550, 32364.4937),  # counts
}
SIGMAS = np.array([1.3e-4, 4.8e-4, 1.2e-4, 0.65e-4, 0.34e-4, 0.39e-4, 0.25, 0.14, 0.15])
NOMINAL = np.array([415.0, 413.0, 415.0])  # counts per m/s²
OFFSET = 32768.0


def to_imu_tk(vector):
    """Our parameters as imu_tk's (yz, zy, zx, scales, biases): T K = R with R upper triangular and
    RᵀR = LᵀL, L = (E + Γ)⁻¹ / nominal; the rotation between R and L is the gauge."""
    matrix = Invariant(gravity=GRAVITY).unpack(vector).matrix
    lower = jnp.linalg.inv(jnp.eye(3) + matrix) @ jnp.diag(1.0 / jnp.asarray(NOMINAL))
    upper = jnp.linalg.cholesky(lower.T @ lower).T
    scale = jnp.diagonal(upper)
    unit = upper / scale[None, :]
    bias = OFFSET + jnp.asarray(NOMINAL) * vector[:3]
    return jnp.concatenate([jnp.stack([-unit[0, 1], unit[0, 2], -unit[1, 2]]), scale, bias])
