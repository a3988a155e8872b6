"""Where the fitted noise is not that of the longest rest, the answer says so."""

import numpy as np
import pytest
from scipy.stats import norm

from inertiax.diagnose.estimates.allan_check import AllanCheck
from inertiax.diagnose.wording.noise_doubt import CHANCE, doubted, noise_sentence


def check(channel, measured, expected=2e-3, spread=0.1):
    """With the 99 % interval of a log-normal quantity of this spread."""
    low, high = expected * np.exp(spread * np.array(norm.interval(0.99)))
    return AllanCheck(channel, 0.5, float(measured), expected, float(low), float(high))


def test_a_deviate_is_the_distance_of_the_logarithms():
    assert check("gyro_x", 2e-3 * np.exp(-0.25)).deviate == pytest.approx(-2.5, rel=1e-6)


@pytest.mark.slow
def test_no_more_sound_noises_are_called_doubtful_than_are_allowed():
    """Eight comparisons of a sound noise, 1000 times."""
    rng = np.random.default_rng(1)
    values = 2e-3 * np.exp(0.1 * rng.standard_normal((1000, 8)))
    called = sum(bool(doubted([check("gyro_x", v) for v in row])) for row in values)
    assert abs(called / 1000 - CHANCE) < 4.0 * np.sqrt(CHANCE / 1000)


def test_the_sentence_names_the_channel_and_by_how_much():
    checks = [check("gyro_x", 2e-3), check("gyro_y", 8e-4), check("gyro_y", 1e-3)]
    found = doubted(checks)
    assert [(c.channel, c.measured) for c in found] == [("gyro_y", 8e-4)]
    text = noise_sentence(found)
    assert "gyro_y 2.5 times its Allan deviation at 0.5 s" in text and "gyro_x" not in text
    assert noise_sentence(doubted(checks[:1])) == ""
