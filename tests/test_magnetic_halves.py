"""Magnetometers whose hard iron is another one in the second half of a log: its ± holds the change."""

import dataclasses

import numpy as np
import pytest

from inertiax.calibrate.magnetic_halves import spread_of_halves
from inertiax.calibrate.magnetic_memory import Memory
from inertiax.calibrate.magnetometers import calibrate_magnetometers
from magnetometer_cases import FIELD, rows


def test_halves_by_hand():
    """Independent rows of unit variance, one unknown each: a half's step is the mean of its misfits."""
    design = np.kron(np.ones((200, 1)), np.eye(3))
    step = np.array([0.3, -0.2, 0.1])
    left = np.where(np.arange(600) < 300, 1.0, -1.0) * np.tile(step, 200)
    found = spread_of_halves(design, left, Memory(), 1.0)  # χ² is 50 · 0.56, of 3
    np.testing.assert_allclose(found, np.outer(step, step), rtol=1e-9)
    assert not spread_of_halves(design, 0.5 * left, Memory(), 1.0).any()  # 7 of 3


def test_halves_that_say_the_same_add_nothing():
    """Of 50 logs of white noise at most one by chance: 0.05 are expected."""
    rng = np.random.default_rng(5)
    made = [
        spread_of_halves(rng.normal(size=(400, 9)), rng.normal(size=400), Memory(), 1.0)
        for _ in range(50)
    ]
    assert sum(m.any() for m in made) <= 1


def sigmas(change):
    """The hard iron's ± on each axis, T, where the second half of the samples has `change` (T) more on z."""
    log = rows(4, rests=0, moving=600)
    mag = np.array(log.mag)
    mag[300:, 2] += change
    found = calibrate_magnetometers(dataclasses.replace(log, mag=mag), field=FIELD)
    return np.sqrt(np.diag(np.asarray(found.covariance))[:3])


@pytest.mark.slow
def test_a_hard_iron_that_changes_is_in_the_sigma():
    """Each half is 1 µT off the whole; what the samples' noise adds is a hundredth of that."""
    quiet, moved = sigmas(0.0), sigmas(2e-6)
    assert quiet[2] < 5e-9
    assert moved[2] == pytest.approx(1e-6, rel=0.1)
    assert moved[0] < 0.2e-6
