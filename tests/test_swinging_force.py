"""What goes with gravity while it turns through the case is no noise of a plateau's mean; rows from NumPy."""

import numpy as np
import pytest

from inertiax.data.recording import Recording
from inertiax.reduction.dwell_means import reduce_to_dwells


RATE, SECONDS, G = 25.0, 12.0, 9.81
NOISE = 3e-4  # rad/s


def plateaus(sensitivity, told):
    """Six rests and six plateaus about a horizontal x at ±30 °/s; D in rad/s per g, of one element of the diagonal."""
    rng, n = np.random.default_rng(4), int(RATE * SECONDS)
    angle, rate, label = [], [], []
    for k in range(6):
        speed = np.deg2rad(30.0) * (-1.0) ** k
        angle += [np.full(n, 0.5 * k), 0.5 * k + speed * np.arange(n) / RATE]
        rate += [np.zeros(n), np.full(n, speed)]
        label += [np.full(n, k), np.full(n, -1)]
    angle, rate, label = map(np.concatenate, (angle, rate, label))
    up = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=1)
    omega = np.stack([rate, 0.0 * rate, 0.0 * rate], axis=1)
    gyro = omega + up @ np.diag([0.0, 1.0, -0.7]) * sensitivity
    stated = np.where((label < 0)[:, None] & (not told), 0.0, G * up)
    return Recording(
        time=np.arange(len(label)) / RATE, accel=G * up + 2e-3 * rng.standard_normal(up.shape),
        gyro=gyro + NOISE * rng.standard_normal(up.shape), position=label,
        reference_gyro=omega, reference_accel=stated,
    )  # fmt: skip


@pytest.mark.parametrize(
    "told", [True, False]
)  # whether the plan tells the force while the table turns
def test_a_g_sensitivity_makes_no_plateau_less_certain(told):
    plain, other = (reduce_to_dwells(plateaus(d, told)) for d in (0.0, 1e-3))
    assert np.sum(np.asarray(other.position) < 0) == 6
    sigma = lambda dwells: np.sqrt(
        np.diagonal(np.asarray(dwells.gyro_covariance), axis1=1, axis2=2)
    )
    np.testing.assert_allclose(sigma(other), sigma(plain), rtol=0.01)
    # White noise of 300 samples each, pooled over six: its standard deviation is known to 2 %.
    np.testing.assert_allclose(sigma(other), NOISE / np.sqrt(300.0), rtol=0.1)
    np.testing.assert_allclose(other.gyro - plain.gyro, (plateau_means(1e-3)), atol=1e-9)


def plateau_means(sensitivity):
    """What D adds to the means, exactly: nothing is taken away from those."""
    return (
        np.asarray(reduce_to_dwells(plateaus(sensitivity, True)).reference_accel)
        / G
        @ (np.diag([0.0, 1.0, -0.7]) * sensitivity)
    )
