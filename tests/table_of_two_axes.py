"""Logs of a table with two axes whose angles an encoder writes: rotations by SciPy, the device in NumPy, and no
function of the package but the one that loads a campaign."""

import functools

import numpy as np
import polars as pl
from scipy.spatial.transform import Rotation

from inertiax.data.campaign import load_campaign


RATE, GRAVITY, LATITUDE = 50.0, 9.81, 48.0
EARTH = 7.292115e-5
MATRIX = np.array([[4e-3, -2e-3, 3e-3], [1e-3, -5e-3, 2e-3], [-3e-3, 4e-3, 1e-3]])
BIAS = np.array([0.004, -0.003, 0.002])
NOISE = np.deg2rad(0.03)
ENCODER = 5e-4  # deg
HEADER = "time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,outer,inner"
CAMPAIGN = f"""[site]
gravity = {GRAVITY}
latitude = {LATITUDE}
[recordings]
files = ["log.csv"]
[columns]
table_angles = {{ names = ["outer", "inner"], unit = "deg" }}
[table]
axes = ["east", "up"]
case = ["east", "north", "up"]
azimuth = 0.0
"""


def smooth(a, b, seconds):
    u = np.arange(1, int(seconds * RATE) + 1) / int(seconds * RATE)
    return a + (b - a) * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def profile(*, turns=True, outer_turns=False):
    """Angles of both axes, deg: 20 attitudes, then rates about the inner axis, and about the outer one."""
    angles = [np.zeros((int(6 * RATE), 2))]
    at = lambda: angles[-1][-1].copy()
    hold = lambda s: angles.append(np.tile(at(), (int(s * RATE), 1)))

    def move(goal):
        seconds = max(float(np.abs(goal - at()).max()) / 30.0, 1.0)
        angles.append(np.stack([smooth(a, b, seconds) for a, b in zip(at(), goal)], axis=1))

    def turn(axis, rate):
        ramp = np.clip(np.minimum(np.arange(1, 401) / RATE, (400 - np.arange(1, 401)) / RATE), 0, 1)
        row = np.tile(at(), (400, 1))
        row[:, axis] += np.cumsum(rate * ramp) / RATE
        angles.append(row)

    for k, outer in enumerate((0, 45, 90, 135, 180)):
        for inner in (0, 90, 180, -90)[
            :: -1 if k % 2 else 1
        ]:  # the outer axis turns at two inner angles
            move(np.array([outer, inner], float))
            hold(6)
    for outer in (0, 90) if turns else ():
        move(np.array([outer, 0.0]))
        hold(6)
        for rate in (60.0, -60.0):
            turn(1, rate)
            hold(4)
    if outer_turns:
        for inner in (0.0, 90.0):
            move(np.array([0.0, inner]))
            hold(4)
            for rate in (60.0, -60.0):
                turn(0, rate)
                hold(4)
    return np.concatenate(angles)


def readings(angles):
    """Specific force and rate in the case: the outer axis points east, the inner one up while the angles are zero."""
    turned = np.deg2rad(angles)
    rates = np.gradient(turned, 1.0 / RATE, axis=0)
    inner = Rotation.from_euler("z", turned[:, 1:])
    whole = Rotation.from_euler("x", turned[:, :1]) * inner
    north = EARTH * np.array([0.0, np.cos(np.deg2rad(LATITUDE)), np.sin(np.deg2rad(LATITUDE))])
    rate = whole.inv().apply(np.tile(north, (len(angles), 1)))
    rate += inner.inv().apply(rates[:, :1] * [1.0, 0.0, 0.0]) + rates[:, 1:] * [0.0, 0.0, 1.0]
    return whole.inv().apply(np.tile([0.0, 0.0, GRAVITY], (len(angles), 1))), rate


@functools.cache
def ideal(turns, outer_turns):
    """Angles, specific force and rate of a programme."""
    angles = profile(turns=turns, outer_turns=outer_turns)
    return angles, *readings(angles)


def record(
    folder,
    seed=1,
    *,
    turns=True,
    outer_turns=False,
    lag=0,
    by_force=None,
    columns="",
    extra=None,
    held=1,
    whole=None,
):
    """A campaign of one log; `lag` rows by which the gyros are late, `by_force` their g-sensitivity, rad/s/(m/s²);
    angles are `held` for so many rows, and start anew at the angle `whole`, deg."""
    rng = np.random.default_rng(seed)
    angles, force, rate = ideal(turns, outer_turns)
    felt = np.concatenate([np.repeat(rate[:1], lag, axis=0), rate[: len(rate) - lag]])
    gyro = felt + felt @ MATRIX.T + BIAS + rng.normal(0.0, NOISE, rate.shape)
    if by_force is not None:
        gyro = gyro + force @ by_force.T
    accel = force + rng.normal(0.0, 0.01, force.shape)
    seen = angles + rng.normal(0.0, ENCODER, angles.shape)
    seen = seen[np.arange(len(seen)) // held * held]
    seen = seen if whole is None else seen % whole
    time = np.arange(len(angles)) / RATE
    table = np.column_stack(
        [time, accel, gyro, seen] + ([] if extra is None else [extra(force, rate)])
    )
    folder.mkdir(exist_ok=True)
    header = HEADER + columns
    pl.DataFrame(table, header.split(",")).write_csv(folder / "log.csv")
    (folder / "campaign.toml").write_text(CAMPAIGN)
    return load_campaign(folder)
