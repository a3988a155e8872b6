"""Drift of a single device: its change beside its own uncertainty, for it has no spread between devices."""

import numpy as np
import pytest

from inertiax.fleet.overview.recalibration import Drift
from inertiax.report.fleet_drift import _common_table, drift_sentence


def test_one_device_has_its_own_uncertainty_and_no_spread():
    change, sigma = np.array([[[1e-3, 2e-4]]]), np.full((1, 1, 2), 1e-4)
    names = ("accel.bias[0]", "accel.matrix[0,0]")
    values = {
        "devices": ("A",),
        "temperatures": np.array([20.0]),
        "names": names,
        "change": change,
        "sigma": sigma,
    }
    drift = Drift(**values)
    sentence = drift_sentence("accel", drift)
    assert (
        "1 device was calibrated before; 1 of 2 changes" in sentence and "about 0" not in sentence
    )
    table = _common_table(drift, ((1.0, "m/s²"), (1e6, "ppm")))
    assert [row[2] for row in table.rows] == ["0.00100 ± 0.00010", "200 ± 100"]


@pytest.mark.parametrize(
    "covered, said",
    [
        ((-20.0, 60.0), "At -45, 85 °C curves go on beyond what both runs cover, -20 to 60 °C."),
        ((30.0, 10.0), "At -45, 20, 85 °C curves go on beyond what both runs cover, no temp"),
        ((-50.0, 90.0), ""),
        (None, ""),
    ],
)
def test_temperatures_that_the_runs_do_not_cover_are_said(covered, said):
    drift = Drift(
        names=("accel.bias[0]",),
        devices=("A",),
        temperatures=np.array([-45.0, 20.0, 85.0]),
        change=np.zeros((1, 3, 1)),
        sigma=np.ones((1, 3, 1)),
        covered=covered,
    )
    sentence = drift_sentence("accel", drift)
    assert said in sentence and ("go on" in sentence) == bool(said)
