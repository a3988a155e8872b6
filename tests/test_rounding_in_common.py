"""A gyro's bias within a step that its noise does not dither is not known better than the step allows."""

import numpy as np
import pytest

from hand_log_data import G, GYRO_BIAS, hand_log
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.calibrate.rounding_in_common import _noise
from inertiax.data.recording import Campaign, ModelChoice, Recording, Site


def biases(gyro, time, accel, estimator=None):
    recording = Recording(time=time, accel=accel, gyro=gyro)
    model = ModelChoice(gyro_estimator=estimator)
    # A rest that is held for seconds is an error of its channel, too.
    result = calibrate_device(Campaign((recording,), Site(gravity=G), model=model), force=True)
    triad = result.calibration.gyro
    covariance = np.asarray(triad.covariance)
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
    own = [triad.names.index(f"gyro.bias[{k}]") for k in range(3)]
    values = np.ravel(np.asarray(triad.curve.coefficients))[own]
    return values, np.sqrt(np.diag(covariance))[own], result.gyro


@pytest.mark.parametrize("noise, phase", [(0.3, 0.0), (0.3, 0.4), (0.5, 0.5), (1.5, 0.2)])
def test_the_noise_before_rounding_is_told_by_the_levels(noise, phase):
    x = phase + noise * np.random.default_rng(0).standard_normal(20_000)
    # 20 000 samples tell a deviation to 1 %, the rarer of two limits' shares (1e-3) to a quarter of that of z.
    assert np.sqrt(_noise(np.round(x))) == pytest.approx(noise, rel=0.05)


def test_one_level_or_two_tell_no_noise():
    assert _noise(np.zeros(100)) == 0.0
    assert _noise(np.repeat([0.0, 1.0], 50)) == 0.0


@pytest.mark.slow
def test_rests_that_read_one_value_know_it_to_a_twelfth_of_the_steps_square():
    time, accel, gyro = hand_log(rests=16)
    step = 0.02  # rad/s, twenty times the noise
    values, sigma, fit = biases(step * np.round(gyro / step), time, accel, "static")
    assert fit.rounding is not None
    # The sum ends at its twelfth term, with 95 % of the variance; y lies 1.5 sigma of its noise from a limit between
    # two steps, so that its rests differ.
    np.testing.assert_allclose(sigma, step / np.sqrt(12.0), rtol=0.12)
    assert np.all(np.abs(values - GYRO_BIAS) < 3.0 * sigma)


@pytest.mark.slow
def test_motions_tell_more_than_such_rests():
    """What 15 turns of 1.5 s show of a bias is within the step."""
    time, accel, gyro = hand_log(rests=16)
    step = 0.02
    values, sigma, _ = biases(step * np.round(gyro / step), time, accel)
    assert np.all(sigma < step / np.sqrt(12.0))
    assert np.all(np.abs(values - GYRO_BIAS) < 3.0 * sigma)


@pytest.mark.slow
def test_a_dead_band_without_a_step_leaves_what_such_gyros_have():
    time, accel, gyro = hand_log(rests=16)
    band = 0.05  # rad/s
    held = np.sign(gyro) * np.sqrt(np.maximum(gyro**2 - band**2, 0.0))
    values, sigma, _ = biases(held, time, accel)
    assert np.all(sigma > 0.002)  # rad/s; their usual size is 0.01, and the turns tell some of it
    assert np.all(np.abs(values - GYRO_BIAS) < 3.0 * sigma)


@pytest.mark.slow
def test_noise_that_dithers_leaves_nothing_in_common():
    time, accel, gyro = hand_log(rests=16)
    _, fine, fit = biases(gyro, time, accel)
    assert fit.rounding is None
    noise = 0.05 * np.pi / 180
    _, sigma, fit = biases(noise * np.round(gyro / noise), time, accel)
    assert fit.rounding is None
    np.testing.assert_allclose(sigma, fine, rtol=0.2)
