"""A diagnosis says what dwells still differ by, where that is far more than their noise."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose, diagnose_model
from inertiax.diagnose.custom_model import prepare_model
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.wording.scatter import model_scatter_sentence, scatter_sentence


def plateaus(spread):
    """60 plateaus of 4 s at 1 rad/s between rests, each `spread` rad/s off at random; 1e-4 rad/s of noise at 50 Hz."""
    rng = np.random.default_rng(2)
    axis = np.repeat(np.tile(np.concatenate([np.eye(3), -np.eye(3)]), (20, 1)), 200, axis=0)
    still = np.repeat(np.arange(120) % 2 == 0, 200)
    rate = np.where(still[:, None], 0.0, axis)
    off = np.repeat(spread * rng.standard_normal((120, 3)), 200, axis=0) * ~still[:, None]
    recording = Recording(
        time=np.arange(24_000) / 50.0,
        gyro=rate + off + 1e-4 * rng.standard_normal(rate.shape),
        reference_gyro=rate,
        position=np.where(still, 0, -1),
    )
    model = ModelChoice(gyro_estimator="reference", temperature_degree=0)
    return Campaign((recording,), Site(9.81), Rig(), model)


def test_said_with_its_size_only_where_it_is_far_more_than_noise():
    assert scatter_sentence(calibrate_device(plateaus(0.0))) == ""
    said = scatter_sentence(calibrate_device(plateaus(3e-4)))
    ratio = float(re.search(r"([\d.]+) times their noise", said)[1])
    # By hand: half of the dwells are 3e-4 off, the noise of a mean is 1e-4 / √200 = 7e-6 rad/s.
    assert ratio == pytest.approx(3e-4 / np.sqrt(2.0) / (1e-4 / np.sqrt(200.0)), rel=0.2)


@pytest.mark.slow
def test_plateaus_that_differ_at_random_are_not_silently_consistent():
    found = diagnose(plateaus(3e-4))
    assert found.verdict == "unexplained" or "times their noise" in found.summary


def affine(parameters, signal):
    """Biases and scale factors, as a user's own model."""
    bias, scale = (jnp.asarray(p)[None] for p in parameters)
    return bias + (1.0 + scale) * jnp.asarray(signal.input)


def of_own_model(spread):
    """The words of a user's own model of `plateaus`, its noise fitted."""
    with jax.enable_x64(True):
        made = prepare_model(affine, (np.zeros(3), np.zeros(3)), plateaus(spread), (), triad="gyro")
        return model_scatter_sentence(made.system, made.blocks, fit_noise(made.system, ()))


@pytest.mark.slow
def test_of_an_own_model_it_is_said_likewise():
    assert of_own_model(0.0) == ""
    said = of_own_model(3e-4)
    assert said.startswith("The dwells of gyro_x, gyro_y, gyro_z still differ")
    ratio = float(re.search(r"([\d.]+) times their noise", said)[1])
    # By hand, as above; the largest of three channels, each known from 120 dwells to 1 / √240 of itself.
    assert ratio == pytest.approx(3e-4 / np.sqrt(2.0) / (1e-4 / np.sqrt(200.0)), rel=0.2)


@pytest.mark.slow
def test_a_diagnosed_own_model_is_not_silently_consistent():
    (recording,) = plateaus(3e-4).recordings
    found = diagnose_model(affine, (np.zeros(3), np.zeros(3)), recording, triad="gyro")
    assert found.verdict == "unexplained" or "times their noise" in found.summary
