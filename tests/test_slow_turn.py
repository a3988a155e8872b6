"""Accelerometers that never lie still for long: calibrated from stretches of a slow turn, or refused.

Logs are made with NumPy and SciPy's rotations, and what they tell is fitted again by SciPy.
"""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign
from inertiax.reduction.segments import segment
from inertiax.reduction.slow_turn import slow_turn


G = 9.81
LOWER = np.tril_indices(3)
RATE = 100.0  # Hz


def tumbled(seed, speed=0.6, force=0.1, lasts=0.1, noise=0.02, seconds=60.0):
    """Outputs of a device turned by `speed` (rad/s, rms) with a hand's force (m/s², rms) of a correlation time; the
    bias and the lower triangular matrix that undo its errors."""
    rng = np.random.default_rng(seed)
    count = int(RATE * seconds)

    def wandering(size, time):
        keep = np.exp(-1.0 / (RATE * time))
        white = rng.standard_normal((count, 3))
        return size * lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white, axis=0)

    steps = Rotation.from_rotvec(-wandering(speed, 1.0) / RATE).as_matrix()
    up = np.empty((count, 3))
    up[0] = Rotation.random(random_state=seed).apply([0.0, 0.0, 1.0])
    for k in range(1, count):
        up[k] = steps[k] @ up[k - 1]
    bias, matrix = 0.3 * rng.standard_normal(3), np.eye(3)
    matrix[LOWER] += 0.02 * rng.standard_normal(6)
    moved = G * up + wandering(force, lasts)
    outputs = moved @ np.linalg.inv(matrix).T + bias + noise * rng.standard_normal((count, 3))
    return outputs, bias, matrix


def by_scipy(means, sigma):
    """Bias and matrix with |matrix (mean − bias)| = g, and one standard deviation of each."""

    def misfit(p):
        matrix = np.zeros((3, 3))
        matrix[LOWER] = p[3:]
        return (np.linalg.norm((means - p[:3]) @ matrix.T, axis=1) - G) / sigma

    found = least_squares(misfit, np.concatenate([np.zeros(3), np.eye(3)[LOWER]]))
    return found.x, np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))


@pytest.mark.parametrize("speed, force, lasts", [(0.6, 0.1, 0.1), (1.5, 0.15, 0.2)])
def test_the_stretches_tell_bias_and_matrix_within_their_sigma(speed, force, lasts):
    """Of 16 logs with nine parameters each, 95 % are within 1.96 sigma; 86 % would be 4 sigma of that share below, if
    the nine were worth four that are independent."""
    off = []
    for seed in range(16):
        outputs, bias, matrix = tumbled(seed, speed, force, lasts)
        found = slow_turn(outputs)
        assert found is not None
        means = np.array([outputs[a:b].mean(axis=0) for a, b in zip(found.start, found.stop)])
        values, sigma = by_scipy(means, found.sigma)
        off.append((values - np.concatenate([bias, matrix[LOWER]])) / sigma)
    assert np.mean(np.abs(off) < 1.96) > 0.86
    assert np.abs(off).max() < 5.0


def about_a_point_beside(seed, arm):
    """A device turned slowly here and fast there about a point `arm` (m) beside it, with what that adds to gravity."""
    rng = np.random.default_rng(seed)
    count = int(RATE * 60.0)

    def wandering(time):
        keep = np.exp(-1.0 / (RATE * time))
        white = rng.standard_normal((count, 3))
        return lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white, axis=0)

    rate = 0.7 * np.exp(0.8 * wandering(2.0)[:, :1]) * wandering(1.5)
    steps = Rotation.from_rotvec(-rate / RATE).as_matrix()
    up = np.empty((count, 3))
    up[0] = Rotation.random(random_state=seed).apply([0.0, 0.0, 1.0])
    for k in range(1, count):
        up[k] = steps[k] @ up[k - 1]
    lever = arm * np.array([0.5, 0.3, -0.8])
    force = G * up + np.cross(rate, np.cross(rate, lever))
    return force + 0.02 * rng.standard_normal((count, 3))


def test_a_force_that_goes_with_the_turn_widens_the_sigma():
    """Of ten logs: without the arm's force in it, sigma was a third of the errors; the mean of it cannot be told, so
    that twice the sigma is asked for and not all of it."""
    off = []
    for seed in range(10):
        outputs = about_a_point_beside(seed, 0.05)
        found = slow_turn(outputs)
        assert found is not None
        means = np.array([outputs[a:b].mean(axis=0) for a, b in zip(found.start, found.stop)])
        values, sigma = by_scipy(means, found.sigma)
        off.append((values - np.concatenate([np.zeros(3), np.eye(3)[LOWER]])) / sigma)
    assert np.sqrt(np.mean(np.square(off))) < 2.2


def test_the_unit_does_not_matter():
    outputs, _, _ = tumbled(1)
    found, counts = slow_turn(outputs), slow_turn(outputs * 1670.0 + 32768.0)
    assert found is not None and counts is not None
    np.testing.assert_array_equal(found.start, counts.start)
    np.testing.assert_allclose(counts.sigma, 1670.0 * found.sigma, rtol=1e-6)


def test_a_tumbled_log_is_calibrated_with_a_reservation():
    outputs, bias, matrix = tumbled(2)
    log = Recording(time=np.arange(len(outputs)) / RATE, accel=outputs, name="tumble.csv")
    campaign = Campaign((log,), Site(gravity=G))
    assert check_campaign(campaign).verdict == "plausible"
    result = calibrate_device(campaign)
    calibrated = result.calibration.accel
    assert calibrated is not None
    values = np.asarray(calibrated.curve.coefficients)[0]
    sigma = np.sqrt(np.diag(np.asarray(calibrated.covariance)))
    # The model has outputs = (1 + E) f + b; here f = matrix (outputs − bias).
    error = np.linalg.inv(matrix) - np.eye(3)
    truth = np.concatenate([bias, error[LOWER]])
    assert np.all(np.abs(values - truth) < 4.0 * sigma)
    assert np.all(sigma[:3] < 0.02)  # m/s²
    quality = judge(result)
    assert quality.verdict == "usable"
    assert any("stretches of 8 rows" in w for w in result.warnings)


def test_poses_behind_each_other_without_a_motion_between():
    """16 poses of a second each, as somebody joined them: no second of rest is without a jump at its ends."""
    rng = np.random.default_rng(5)
    up = np.concatenate([np.eye(3), -np.eye(3), rng.standard_normal((10, 3))])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    outputs = np.repeat(G * up + [0.2, -0.1, 0.3], 100, axis=0)
    outputs = outputs + 0.01 * rng.standard_normal(outputs.shape)
    found = slow_turn(outputs)
    assert found is not None
    assert not np.any((found.start % 100 > found.stop % 100) & (found.stop % 100 > 0))  # no jump
    means = np.array([outputs[a:b].mean(axis=0) for a, b in zip(found.start, found.stop)])
    values, sigma = by_scipy(means, found.sigma)
    assert np.all(np.abs(values[:3] - [0.2, -0.1, 0.3]) < 4.0 * sigma[:3])


def about_one_axis():
    angle = 0.3 * np.arange(6000) / RATE
    return G * np.stack([np.sin(angle), np.cos(angle), 0.0 * angle], axis=1)


def walked():
    t = np.arange(6000) / RATE
    step = 3.0 * np.sin(2 * np.pi * 1.8 * t) + 1.5 * np.sin(2 * np.pi * 3.6 * t)
    return np.stack([0.3 * step, 0.5 * step[::-1], G + step], axis=1)


@pytest.mark.parametrize(
    "outputs",
    [
        tumbled(3, speed=3.0, force=0.6)[0],
        tumbled(3, speed=0.03, force=0.05)[0],
        about_one_axis(),
        walked(),
        np.tile([0.1, -0.2, 9.8], (6000, 1)),
        np.zeros((6000, 3)),
    ],
    ids=["shaken", "one side", "one axis", "walking", "one pose", "dead"],
)
def test_what_is_no_slow_turn_through_all_orientations(outputs):
    rng = np.random.default_rng(0)
    assert slow_turn(outputs + 0.02 * rng.standard_normal(outputs.shape)) is None


def test_stretches_at_the_end_of_the_range_are_left_out():
    outputs, _, _ = tumbled(6)
    limited = np.minimum(outputs, [np.inf, np.quantile(outputs[:, 1], 0.93), np.inf])
    found = slow_turn(limited)
    assert found is not None
    at_end = limited[:, 1] == limited[:, 1].max()
    assert not any(at_end[a:b].any() for a, b in zip(found.start, found.stop))


def test_a_log_that_rests_keeps_its_rests():
    """Twelve poses of four seconds with slow turns between them."""
    keys = Rotation.random(12, random_state=4)
    held, moving = int(4 * RATE), int(2 * RATE)
    force = []
    for first, second in zip(keys[:-1], keys[1:]):
        turn = (first.inv() * second).as_rotvec()
        share = np.concatenate([np.zeros(held), np.linspace(0, 1, moving, endpoint=False)])
        attitude = first * Rotation.from_rotvec(share[:, None] * turn)
        force.append(attitude.inv().apply([0.0, 0.0, G]))
    outputs = np.concatenate(force)
    outputs = outputs + 0.02 * np.random.default_rng(1).standard_normal(outputs.shape)
    found = segment(Recording(time=np.arange(len(outputs)) / RATE, accel=outputs))
    assert found.turning is None and found.num_segments == 11
