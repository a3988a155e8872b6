"""Numbers that mean nothing end in one line where they are given, and a rate has no more digits than stamps tell."""

import numpy as np
import pytest

import inertiax as ix
from inertiax.exports import kalibr
from inertiax.exports.noise import known_settings
from inertiax.physics.shapes import check_given


FORCE = 9.81 * np.concatenate([np.eye(3), -np.eye(3)])


@pytest.mark.parametrize("gravity", [-9.81, 0.0, np.nan])
def test_a_gravity_that_is_none_is_refused_where_it_is_given(gravity):
    with pytest.raises(ValueError, match=r"`Invariant\(gravity=...\)`: .* above 0 m/s²"):
        ix.Invariant(gravity=gravity)


def test_complex_numbers_are_a_type_error_in_one_line():
    with pytest.raises(
        TypeError, match=r"`Dwells.from_arrays\(accel=...\)`: holds complex numbers"
    ):
        ix.Dwells.from_arrays(FORCE + 0j)
    with pytest.raises(TypeError, match="`calibration`: gyro is complex"):
        check_given("calibration", accel=FORCE[0], gyro=np.zeros(3, complex))


def test_a_measured_rate_is_written_without_the_digits_of_binary_fractions():
    assert known_settings(kalibr, 100.00000000000213, None) == {"update_rate": 100.0}
    assert known_settings(kalibr, 1.0 / 0.0075, None)["update_rate"] == pytest.approx(
        133.3333, rel=1e-6
    )
