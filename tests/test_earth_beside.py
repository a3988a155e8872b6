"""A g-sensitivity as large as the Earth's rate that was taken from rests too few to tell whether gyros show it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.data.recording import Campaign, Recording, Site
from inertiax.diagnose import diagnose
from inertiax.physics.wgs84 import EARTH_RATE


LATITUDE = np.deg2rad(48.0)
VERTICAL = EARTH_RATE * np.sin(LATITUDE)
RATE, STILL, TURN = 50.0, 200, 75


def by_hand(shown: float, per_g: float = 0.0, rests: int = 11) -> Campaign:
    """Rests of 4 s with smooth turns between them, of gyros known to 0.4 °/h in each, with a part of Earth's rate."""
    rng = np.random.default_rng(1)
    attitude, up, omega = Rotation.random(random_state=1), [], []
    fraction = np.arange(1, TURN + 1) / TURN
    done = fraction - np.sin(2 * np.pi * fraction) / (2 * np.pi)
    speed = (1 - np.cos(2 * np.pi * fraction)) * RATE / TURN
    for _ in range(rests):
        axis = rng.standard_normal(3)
        turn = rng.uniform(1.0, 2.4) * axis / np.linalg.norm(axis)
        path = attitude * Rotation.from_rotvec(done[:, None] * turn)
        up += [
            np.tile(attitude.inv().apply([0, 0, 1.0]), (STILL, 1)),
            path.inv().apply([0, 0, 1.0]),
        ]
        omega += [np.zeros((STILL, 3)), speed[:, None] * turn]
        attitude = attitude * Rotation.from_rotvec(turn)
    up, omega = np.concatenate(up), np.concatenate(omega)
    row, number = np.divmod(np.arange(len(up)), STILL + TURN)[::-1]
    gyro = omega + [0.01, -0.008, 0.005] + (shown * VERTICAL + per_g) * up
    recording = Recording(
        np.arange(len(up)) / RATE, position=np.where(row < STILL, number, -1),
        accel=9.81 * up + [0.1, -0.1, 0.05] + 2e-3 * rng.standard_normal(up.shape),
        gyro=gyro + 2e-6 * np.sqrt(STILL) * rng.standard_normal(up.shape),
    )  # fmt: skip
    return Campaign((recording,), Site(9.81, LATITUDE))


@pytest.mark.slow
def test_earths_rate_stands_beside_a_g_sensitivity_of_its_size():
    (found,) = diagnose(by_hand(0.0)).effects
    assert found.name == "g_sensitivity" and found.alternatives == ("earth_rate",)
    assert "hold none of it" in found.statement and "driver" in found.separating_experiment


@pytest.mark.slow
def test_it_does_not_stand_beside_a_g_sensitivity_of_another_size_nor_where_it_is_in_the_outputs():
    (found,) = diagnose(by_hand(1.0, per_g=4.0 * VERTICAL)).effects
    assert found.name == "g_sensitivity" and found.alternatives == ()
    assert diagnose(by_hand(1.0)).verdict == "consistent"
