"""A log of a device turned by hand from rest to rest, by NumPy and SciPy alone.

Each motion turns about one axis fixed in the case with the rate of a raised cosine, so that attitudes are exact; in
the middle of the motions the hand shakes what the accelerometers feel.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from inertiax.data.recording import Campaign, Recording, Site


GRAVITY = 9.81
SCALE = np.array([[1.012, 0.004, -0.003], [-0.006, 0.991, 0.005], [0.002, -0.004, 1.007]])  # E + Θ
BIAS = np.array([0.011, -0.02, 0.016])  # rad/s


def log(
    seed: int,
    added: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
    *,
    motions: int = 30,
    rate: float = 100.0,
    noise: float = 2e-3,
) -> Campaign:
    """The campaign; `added` gives what the gyros' outputs hold beyond scale and bias, of the true rates, rad/s."""
    rng = np.random.default_rng(seed)
    attitude, up = Rotation.from_rotvec(rng.standard_normal(3)), np.array([0.0, 0.0, GRAVITY])
    rest, turn = int(4.0 * rate), int(2.0 * rate)
    time = np.arange(turn) / rate
    # The integral of the raised cosine over the motion is the whole angle.
    speed = (1.0 - np.cos(np.pi * time)) / 2.0
    part = (time - np.sin(np.pi * time) / np.pi) / 2.0
    force, rates = [], []
    for k in range(motions + 1):
        force.append(np.tile(attitude.inv().apply(up), (rest, 1)))
        rates.append(np.zeros((rest, 3)))
        if k == motions:
            break
        axis = rng.standard_normal(3)
        angle = rng.uniform(0.7, 2.6) * axis / np.linalg.norm(axis)
        along = attitude * Rotation.from_rotvec(part[:, None] * angle)
        shaken = 0.4 * np.sin(np.pi * time / 2.0)[:, None] * rng.standard_normal((turn, 3))
        force.append(along.inv().apply(up) + shaken)
        rates.append(speed[:, None] * angle)
        attitude = attitude * Rotation.from_rotvec(angle)
    f, w = np.concatenate(force), np.concatenate(rates)
    made = Recording(
        time=np.arange(len(f)) / rate,
        accel=1.004 * f + [0.1, -0.2, 0.05] + 0.02 * rng.standard_normal(f.shape),
        gyro=w @ SCALE.T + BIAS + added(w) + noise * rng.standard_normal(w.shape),
        name="hand",
    )
    return Campaign((made,), Site(gravity=GRAVITY))
