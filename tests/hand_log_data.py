"""A log of a device that is turned by hand, made with NumPy and SciPy's rotations."""

import tomllib

import numpy as np
from scipy.spatial.transform import Rotation

from inertiax.campaign_draft import draft_campaign


G, DEGREE = 9.80665, np.pi / 180
ACCEL_BIAS, GYRO_BIAS = np.array([0.10, -0.15, 0.25]), DEGREE * np.array([0.8, -0.5, 0.3])


def hand_log(rate=50.0, rests=12, seed=0):
    """A device at rest for 4 s in each of some poses, turned from one to the next within 1.5 s."""
    rng = np.random.default_rng(seed)
    still, moving = int(4 * rate), int(1.5 * rate)
    attitude, force, turning = Rotation.identity(), [], []
    for _ in range(rests):
        up = attitude.inv().apply([0.0, 0.0, G])
        force.append(np.tile(up, (still, 1)))
        turning.append(np.zeros((still, 3)))
        axis = rng.standard_normal(3)
        angle = rng.uniform(0.9, 1.8) * axis / np.linalg.norm(axis)
        profile = 1.0 - np.cos(2 * np.pi * (np.arange(moving) + 0.5) / moving)  # sums to its length
        for part in profile / moving:
            turning.append((angle * part * rate)[None])
            force.append(attitude.inv().apply([0.0, 0.0, G])[None])
            attitude = attitude * Rotation.from_rotvec(angle * part)
    accel = np.concatenate(force) + ACCEL_BIAS
    gyro = np.concatenate(turning) + GYRO_BIAS
    accel = accel + 0.02 * rng.standard_normal(accel.shape)
    gyro = gyro + 0.05 * DEGREE * rng.standard_normal(gyro.shape)
    return np.arange(len(accel)) / rate, accel, gyro


CANONICAL = "ax,ay,az,gx,gy,gz"


def written(path, columns, header=None, delimiter=","):
    rows = [delimiter.join(f"{v:.7g}" for v in row) for row in np.column_stack(columns)]
    path.write_text("\n".join([*([] if header is None else [header]), *rows]) + "\n")
    return path


def draft(path, **settings):
    text = draft_campaign(path, path.parent, **settings).text
    (path.parent / "campaign.toml").write_text(text)
    return tomllib.loads(text)
