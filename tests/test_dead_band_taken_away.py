"""Gyros with a dead band: slow rates are put right, and the noise within the band stays what it was."""

import numpy as np
import pytest

from inertiax.calibration.calibration import Calibration
from inertiax.calibration.fitted_effects import FittedEffect
from inertiax.calibration.triad import TriadCalibration
from inertiax.data.recording import Recording
from inertiax.diagnose.estimates.applied_effects import compensate
from inertiax.physics.temperature import Constant, Curve


WIDTH, NOISE = 1e-3, 1e-4  # rad/s
BIAS = np.array([0.01, -0.02, 0.005])
NAMES = tuple(f"gyro.bias[{i}]" for i in range(3)) + tuple(
    f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3)
)


def outputs(rate, form):
    """IEEE 647's lock-in, a zone in which nothing comes out, and one that is missing from all rates, by hand."""
    if form == "lock-in":
        return np.sign(rate) * np.sqrt(np.maximum(rate**2 - WIDTH**2, 0.0))
    if form == "zone":
        return np.where(np.abs(rate) < WIDTH, 0.0, rate)
    return np.sign(rate) * np.maximum(np.abs(rate) - WIDTH, 0.0)


@pytest.mark.parametrize("form", ["lock-in", "zone", "offset"])
def test_slow_rates_are_right_and_rests_no_noisier(form):
    rng = np.random.default_rng(5)
    levels = np.array([0.0, 3e-4, -6e-4, 2e-3, -2e-3, 5e-3, 0.1])
    rate = np.repeat(levels, 400)[:, None] * [1.0, 0.0, 0.0]
    gyro = rate + BIAS + rng.normal(0.0, NOISE, rate.shape)
    gyro[:, 0] += outputs(rate[:, 0], form) - rate[:, 0]
    matrix = np.concatenate([BIAS, np.zeros(9)])[None]
    triad = TriadCalibration(Curve(Constant(), matrix), np.eye(12) * 1e-12, NAMES, "reference")
    settings = (("form", form), ("width", WIDTH))
    band = FittedEffect(
        "dead_band", "gyro", (0,), settings, np.array([1.0]), np.eye(1), "1", greatest_input=0.1
    )
    calibration = Calibration(gravity=9.81, gyro=triad, effects=(band,))
    found = compensate(calibration, Recording(time=np.arange(len(gyro)) * 0.01, gyro=gyro)).gyro
    parts = found[:, 0].reshape(len(levels), 400)

    inside = np.abs(levels) < WIDTH
    # All that comes out there is noise: none of it is known to be rate, and none is added.
    np.testing.assert_allclose(
        parts[inside].std(axis=1), NOISE, rtol=0.15
    )  # 4 sigma of 400 samples
    np.testing.assert_allclose(parts[inside].mean(axis=1), 0.0, atol=4.0 * NOISE / 20.0)
    # Outside, what the band took is there again: it was up to a half of 2 mrad/s.
    np.testing.assert_allclose(
        parts[~inside].mean(axis=1), levels[~inside], atol=6.0 * NOISE / 20.0
    )
    np.testing.assert_allclose(found[:, 1:].std(axis=0), NOISE, rtol=0.06)
