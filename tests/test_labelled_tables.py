"""Gyros good to 0.002 °/h on a table whose rests are labelled: what a label or a reference is off by is more than that.

The table, its rotations (SciPy's) and the device are made here, by no function of the package.
"""

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.table_rates import rates_of_angles


FINE, ROWS = 100, 10  # a second: of what is simulated, and of the log, which has means
GRAVITY, LATITUDE, EARTH = 9.81, 48.0, 7.292115e-5
WALK = np.radians(0.002 / 60.0)  # rad/√s
MATRIX = np.array([[3e-5, -2e-5, 1e-5], [1e-5, -4e-5, 2e-5], [-1e-5, 3e-5, 2e-5]])
CAMPAIGN = f"""[site]
gravity = {GRAVITY}
latitude = {LATITUDE}
[recordings]
files = ["log.csv"]
[columns]
table_angles = {{ names = ["outer", "inner"], unit = "deg" }}
[table]
axes = ["east", "north"]
case = ["east", "north", "up"]
azimuth = 0.0
"""


def programme(rng):
    """Both angles (rad) and the label: −1 in moves, which are smooth, and while one axis waits for the other.

    An axis that is told to go to where it is steps by two arc seconds.
    """
    angles, label = [np.zeros((40 * FINE, 2))], [np.ones(40 * FINE)]

    def go(axis, goal):
        start = angles[-1][-1]
        turn = goal + rng.normal() * 1e-5 - start[axis]
        count = round(max(abs(turn) * 5.7, 1.0) * FINE)
        u = (np.arange(count) + 0.5) / count
        part = np.tile(start, (count, 1))
        part[:, axis] += turn * (u - np.sin(2 * np.pi * u) / (2 * np.pi))
        part[-1, axis] = start[axis] + turn
        angles.append(part)
        label.append(np.full(count, -1.0))

    def stand(seconds, number):
        angles.append(np.tile(angles[-1][-1], (round(seconds * FINE), 1)))
        label.append(np.full(round(seconds * FINE), float(number)))

    number, right = 1, np.pi / 2
    for k, outer in enumerate(np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5]) * right):
        go(0, outer)
        stand(2.0, -1)
        for inner in np.array([0.0, 0.5, 1.0, 2.0, 3.0])[:: -1 if k % 2 else 1] * right:
            number += 1
            go(1, inner)
            stand(40.0, number)
    return np.concatenate(angles), np.concatenate(label)


def record(folder, seed, rows=ROWS):
    """A campaign of means of both triads and of the angles; a row is labelled where all of it stands.

    A log of one row a second writes the angles at the rows' ends.
    """
    rng = np.random.default_rng(seed)
    angles, label = programme(rng)
    outer, inner = angles.T
    place = Rotation.from_euler("X", outer[:, None]) * Rotation.from_euler("Y", inner[:, None])
    latitude = np.radians(LATITUDE)
    earth = EARTH * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    speed = np.gradient(angles, 1.0 / FINE, axis=0)
    rate = place.inv().apply(speed[:, :1] * [1.0, 0.0, 0.0] + earth)
    rate += speed[:, 1:] * [0.0, 1.0, 0.0]
    force = place.inv().apply([0.0, 0.0, GRAVITY])
    each = FINE // rows
    mean = lambda x: x[: len(x) // each * each].reshape(-1, each, x.shape[1]).mean(axis=1)
    rate, force, seen = mean(rate @ (np.eye(3) + MATRIX).T), mean(force), np.degrees(mean(angles))
    if rows == 1:
        seen = np.degrees(angles[each - 1 :: each][: len(rate)])
    rate += WALK * np.sqrt(rows) * rng.normal(size=rate.shape)
    force += 5e-5 * np.sqrt(rows) * rng.normal(size=force.shape)
    stands = label[: len(rate) * each].reshape(-1, each).min(axis=1).astype(int)
    table = {"time": (np.arange(len(rate)) + 0.5) / rows, "position": stands}
    table |= {f"accel_{a}": x for a, x in zip("xyz", force.T)}
    table |= {f"gyro_{a}": x for a, x in zip("xyz", rate.T)}
    folder.mkdir(parents=True)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    pl.DataFrame(table | {"outer": seen[:, 0], "inner": seen[:, 1]}).write_csv(folder / "log.csv")
    return load_campaign(folder)


# By moves; and where they last for two rows, by the Earth's rate at the rests.
@pytest.mark.slow
@pytest.mark.parametrize("rows, certain", [(10, 5e-6), (1, 3e-3)])
def test_errors_of_gyros_on_a_table_that_only_positions_are_as_stated(tmp_path, rows, certain):
    off = []
    for seed in (1, 2):
        result = calibrate_device(record(tmp_path / str(seed), seed, rows))
        gyro = result.calibration.gyro
        kept = [k for k, name in enumerate(gyro.names) if "matrix" in name or "bias" in name]
        truth = np.r_[np.zeros(3), MATRIX.ravel()]
        sigma = np.sqrt(np.diagonal(np.asarray(gyro.covariance)))[kept]
        assert sigma[3:].max() < certain
        off.append((np.asarray(gyro.curve(25.0))[kept] - truth) / sigma)
    # 24 numbers of unit variance, were sigmas right: the mean square within 3 of its deviations.
    assert np.mean(np.square(off)) < 1.0 + 3.0 * np.sqrt(2.0 / 24.0)


def test_a_step_of_arc_seconds_between_two_stands_is_in_the_rates():
    rng = np.random.default_rng(3)
    time = np.arange(400) / ROWS
    angle = np.where(time < 20.0, 0.0, 1e-4)[:, None] + 2e-6 * rng.normal(size=(400, 1))
    made = rates_of_angles(angle, time)
    assert made.sum() / ROWS == pytest.approx(1e-4, abs=1e-5)
    assert np.count_nonzero(made) <= 10


def test_a_servo_that_hunts_all_the_time_stands():
    time = np.arange(400) / ROWS
    angle = 1e-5 * np.sign(np.sin(2.0 * np.pi * 0.5 * time))[:, None]
    assert not rates_of_angles(angle, time).any()
