"""What a compensated log reads at rest: `python hand_log_check.py COMPENSATED.csv`."""

import sys

import numpy as np
import polars as pl


GRAVITY = 9.80856  # m/s²
POSES, TURNING, RESTING = 6, 75, 200  # of `hand_log.py`: samples of a turn and of a rest

log = pl.read_csv(sys.argv[1])
force = log.select("accel_x", "accel_y", "accel_z").to_numpy().reshape(POSES, TURNING + RESTING, 3)
rate = log.select("gyro_x", "gyro_y", "gyro_z").to_numpy().reshape(force.shape)
means = force[:, TURNING:].mean(axis=1)
still = np.abs(rate[:, TURNING:].mean(axis=1)).max()
print(
    f"|a| at rest: {np.linalg.norm(means, axis=1).mean():.4f} m/s², gravity is {GRAVITY:.4f}; "
    f"rates at rest: {still:.5f} rad/s"
)
