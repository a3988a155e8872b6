"""Two days in one campaign: a gyro bias of each day's own is said with its size, and noise is not."""

import equinox as eqx
import numpy as np
import pytest
from scipy.optimize import least_squares

from hand_log_data import G, hand_log
from inertiax.calibrate.level_by_recording import levels, triad_words
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.diagnose.wording.scatter import scatter_sentence
from inertiax.estimators import Invariant


def days(shift, force=0.0, slopes=None):
    made = []
    for day in (0, 1):
        time, accel, gyro = hand_log(rate=50.0, rests=14, seed=day)
        accel, gyro, heat = accel + day * force, gyro + day * shift, None
        if slopes is not None:
            heat = 20.0 + 10.0 * time[:, None] / time[-1]
            gyro = gyro + slopes[day] * (heat - 25.0)
        time = 86400.0 * day + time
        made.append(Recording(time=time, accel=accel, gyro=gyro, temperature=heat))
    return calibrate_device(Campaign(tuple(made), Site(G)))


@pytest.fixture(scope="module")
def apart():
    return days(np.array([5e-4, 0.0, 0.0]), np.array([0.0, 0.03, 0.0]))


def test_a_second_day_s_bias_is_said_with_its_size(apart):
    """5e-4 rad/s on x: two values stand 5e-4 / √2 about their mean, 72.9 °/h; the others differ by noise."""
    found = apart
    (said,) = [w for w in found.warnings if "gyros: the biases of the 2 recordings differ" in w]
    sizes = [float(x) for x in said.split("differ by ")[1].split(" °/h")[0].split(", ")]
    # A rest's mean of 200 samples of 0.05 °/s is known to 12.7 °/h, a day's of 14 rests to 3.4.
    assert sizes[0] == pytest.approx(72.9, abs=4 * 3.4)
    assert max(sizes[1:]) < 4 * 3.4
    level, error = levels(found.gyro, G)
    assert level[1, 0] - level[0, 0] == pytest.approx(5e-4, abs=4 * np.hypot(*error[:, 0]))


def test_accelerometers_by_their_magnitude_alone_too(apart):
    """0.03 m/s² on y, 0.0212 about the mean; least squares by SciPy of what each day's rests say by themselves."""
    (said,) = [w for w in apart.warnings if w.startswith("accelerometers: the biases of the 2")]
    sizes = [float(x) for x in said.split("differ by ")[1].split(" m/s²")[0].split(", ")]
    assert sizes[1] == pytest.approx(0.03 / np.sqrt(2.0), rel=0.1)
    assert max(sizes[0], sizes[2]) < 0.005
    # By SciPy from magnitudes: the 9 parameters of the model common to both days, and 3 biases of the second.
    means, number = np.asarray(apart.accel.dwells.accel), np.asarray(apart.accel.dwells.rows)[:, 0]

    def misfit(p):
        lower = np.zeros((3, 3))
        lower[np.tril_indices(3)] = p[3:9]
        force = np.linalg.solve(np.eye(3) + lower, (means - p[:3] - np.outer(number, p[9:])).T)
        return np.linalg.norm(force, axis=0) - G

    found = least_squares(misfit, np.zeros(12), x_scale="jac")
    level, error = levels(apart.accel, G)
    np.testing.assert_allclose(level[1] - level[0], found.x[9:], atol=2e-4)
    spread = np.linalg.inv(found.jac.T @ found.jac) * 2.0 * found.cost / (len(means) - 12)
    np.testing.assert_allclose(np.hypot(*error), np.sqrt(np.diag(spread))[9:], rtol=0.05)
    assert "Taken as noise: accelerometers: the biases of the 2" in scatter_sentence(apart)


def test_recordings_at_temperatures_of_their_own_tell_no_level(apart):
    """One a temperature, as in a chamber: a curve over temperature that is too simple would differ, too."""
    heat = np.where(np.asarray(apart.gyro.dwells.rows)[:, 0] == 0, 10.0, 40.0)
    assert triad_words(apart.gyro, G) is not None
    chamber = eqx.tree_at(lambda r: r.dwells.temperature, apart.gyro, heat)
    assert triad_words(chamber, G) is None


def test_a_recording_of_one_face_tells_no_level_by_magnitudes():
    """Six faces, a file each, one bias: across gravity a magnitude tells nothing of the bias, and 6 m/s² were said."""
    rng, time = np.random.default_rng(5), np.arange(0.0, 130.0, 0.02)
    bias, made = np.array([0.26, 0.39, 0.12]), []
    for face in (*np.eye(3), *-np.eye(3)):
        held = np.repeat(
            np.array([0, 1, 0, -1, 0, 2, 0, -2, 0, 3, 0, -3, 0], float), len(time) // 13
        )
        accel = G * face + bias + 6e-3 * rng.standard_normal((len(time), 3))
        gyro = np.outer(held, face) + 1e-3 * rng.standard_normal((len(time), 3))
        made.append(Recording(time=time + 200.0 * len(made), accel=accel, gyro=gyro))
    found = calibrate_device(Campaign(tuple(made), Site(G)))
    assert isinstance(found.accel.estimator, Invariant)
    assert levels(found.accel, G) is None
    assert not [w for w in found.warnings if "accelerometers: the biases of the" in w]


def test_days_that_differ_by_noise_alone_are_not():
    found = days(np.zeros(3))
    assert not [w for w in found.warnings if "recordings differ" in w]


def test_one_recording_tells_no_level():
    time, accel, gyro = hand_log(rate=50.0, rests=14)
    found = calibrate_device(Campaign((Recording(time=time, accel=accel, gyro=gyro),), Site(G)))
    assert levels(found.gyro, G) is None


def test_slopes_over_temperature_that_contradict_each_other_are_said():
    """+2e-4 and −2e-4 rad/s/°C with the same mean: 4e-4 rad/s/°C are 82.5 °/h/°C apart, and the levels are the same."""
    found = days(np.zeros(3), slopes=(2e-4, -2e-4))
    (said,) = [w for w in found.warnings if "slopes that differ" in w]
    sizes = [float(x) for x in said.split("differ by up to ")[1].split(" °/h/°C")[0].split(", ")]
    np.testing.assert_allclose(sizes, 82.5, atol=6.0)
    assert "switching on" not in said
