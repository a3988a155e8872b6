"""Devices of a fleet that are set aside because their means cannot be right."""

import numpy as np
import pytest

from inertiax.fleet.reduce.implausible_devices import implausible_devices
from inertiax.reduction.dwells import Dwells


DWELLS = 6


def fleet(devices: int = 4) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    n = devices * DWELLS
    up = rng.standard_normal((n, 3))
    sigma = rng.uniform(1e-6, 2e-6, (n, 3))
    return {
        "accel": 9.8 * up / np.linalg.norm(up, axis=1, keepdims=True),
        "gyro": 0.01 + 1e-4 * rng.standard_normal((n, 3)),
        "temperature": np.full(n, 25.0),
        "accel_covariance": sigma[:, :, None] * np.eye(3),
        "gyro_covariance": sigma[:, :, None] * np.eye(3),
    }


def reasons(columns: dict[str, np.ndarray]) -> list[str]:
    n = len(columns["temperature"])
    zeros = np.zeros(n, np.int64)
    dwells = Dwells(
        time=np.arange(n, dtype=float),
        duration=np.ones(n),
        count=np.full(n, 100.0),
        experiment=zeros,
        position=zeros,
        valid=np.ones(n, bool),
        **columns,
    )
    first = np.arange(0, n, DWELLS)
    return implausible_devices(first, np.full(len(first), DWELLS), dwells)


def test_good_devices_are_kept():
    assert reasons(fleet()) == [""] * 4


@pytest.mark.parametrize(
    ("column", "change", "words"),
    [
        ("temperature", lambda x: x + 273.15, "likely kelvin"),
        ("temperature", lambda x: x * 340 - 12420, "raw counts"),
        ("accel", lambda x: x / 9.8, "0.102 times gravity"),
        ("gyro", lambda x: x + 30.0, "rad/s at rest"),
    ],
)
def test_one_device_of_four_is_set_aside_with_the_reason(column, change, words):
    columns = fleet()
    mine = slice(DWELLS, 2 * DWELLS)
    columns[column][mine] = change(columns[column][mine])
    said = reasons(columns)
    assert words in said[1] and said[0] == said[2] == said[3] == ""


def test_gyros_that_never_change_are_told_of():
    columns = fleet()
    columns["gyro"][:DWELLS] = 0.0
    columns["gyro_covariance"][:DWELLS] = 0.0
    assert "never change" in reasons(columns)[0]


def test_a_dead_channel_of_one_device_is_told_of():
    columns = fleet()
    columns["accel"][:DWELLS, 1] = 0.0
    columns["accel_covariance"][:DWELLS, 1, 1] = 0.0
    said = reasons(columns)
    assert "accel_y never changes (0)" in said[0] and said[1:] == [""] * 3
