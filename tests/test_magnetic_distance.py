"""Magnetometers in a field that scatters by a tenth: the ellipsoid by its distance, where its magnitude leads away."""

import numpy as np
import pytest

from inertiax.calibrate.magnetometers import calibrate_magnetometers
from magnetometer_cases import FIELD, HARD, rows


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 5])
def test_a_field_that_scatters_by_a_tenth_has_an_ellipsoid(seed):
    """By the magnitude the centre goes to infinity, where the outputs are one point."""
    log = rows(seed, rests=0, moving=200, uneven=4e-6)
    found = calibrate_magnetometers(log, field=FIELD)
    assert found.estimator.by_distance
    away = np.asarray(found.curve.coefficients)[0, :3] - HARD
    sigma = np.sqrt(np.diag(np.asarray(found.covariance))[:3])
    assert np.all(np.abs(away) < 3.0 * sigma)
    assert np.all(sigma < 0.1 * FIELD)  # some 25 independent places in 200 samples


@pytest.mark.slow
def test_outputs_that_go_round_no_ellipsoid_are_refused():
    """A cap of the sphere: neither way has an answer, and what has is no magnetometer's."""
    log = rows(1, rests=0, moving=4000, uneven=4e-6)
    mag = np.asarray(log.mag) - HARD
    near = np.flatnonzero(mag @ [0.6, 0.0, 0.8] > 0.8 * np.linalg.norm(mag, axis=1))
    with pytest.raises(ValueError, match="mag: "):
        calibrate_magnetometers(log[near], field=FIELD)
