"""Two days in one campaign: a gyro bias of each day's own is said with its size, and noise is not."""

import numpy as np
import pytest

from hand_log_data import G, hand_log
from inertiax.calibrate.level_by_recording import levels
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.recording import Campaign, Recording, Site


def days(shift):
    made = []
    for day in (0, 1):
        time, accel, gyro = hand_log(rate=50.0, rests=14, seed=day)
        made.append(Recording(time=86400.0 * day + time, accel=accel, gyro=gyro + day * shift))
    return calibrate_device(Campaign(tuple(made), Site(G)))


def test_a_second_day_s_bias_is_said_with_its_size():
    """5e-4 rad/s on x: two values stand 5e-4 / √2 about their mean, 72.9 °/h; the others differ by noise."""
    found = days(np.array([5e-4, 0.0, 0.0]))
    (said,) = [w for w in found.warnings if "the biases of the 2 recordings differ" in w]
    sizes = [float(x) for x in said.split("differ by ")[1].split(" °/h")[0].split(", ")]
    # A rest's mean of 200 samples of 0.05 °/s is known to 12.7 °/h, a day's of 14 rests to 3.4.
    assert sizes[0] == pytest.approx(72.9, abs=4 * 3.4)
    assert max(sizes[1:]) < 4 * 3.4
    level, error = levels(found.gyro, G)
    assert level[1, 0] - level[0, 0] == pytest.approx(5e-4, abs=4 * np.hypot(*error[:, 0]))


def test_days_that_differ_by_noise_alone_are_not():
    found = days(np.zeros(3))
    assert not [w for w in found.warnings if "recordings differ" in w]


def test_one_recording_tells_no_level():
    time, accel, gyro = hand_log(rate=50.0, rests=14)
    found = calibrate_device(Campaign((Recording(time=time, accel=accel, gyro=gyro),), Site(G)))
    assert levels(found.gyro, G) is None
