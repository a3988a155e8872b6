"""`compensate` says which channels reach the end of their range: the compensated columns do not show it."""

import numpy as np
import polars as pl
import pytest

from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.data.recording import Recording
from inertiax.exports.compensated_recording import compensate_file
from inertiax.exports.range_ends import RangeEnds
from inertiax.physics.temperature import Constant, Curve
from inertiax.reduction.clipping import clipped_rows


RATE = 100.0
END = np.radians(250.0)


def turns(rows=4000, *, end=END, noise=1e-3, step=1e-5):
    """Gyros that swing at up to 300 °/s about z and are cut at `end`, in steps of a converter; rad/s."""
    rng = np.random.default_rng(2)
    time = np.arange(rows) / RATE
    swing = np.radians([[20.0, 30.0, 300.0]]) * np.sin(0.7 * time)[:, None]
    return np.clip(
        step * np.round((swing + noise * rng.standard_normal((rows, 3))) / step), -end, end
    )


def counted(gyro, cuts=()):
    ends, edges = RangeEnds(), [0, *cuts, len(gyro)]
    time = np.arange(len(gyro)) / RATE
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        ends.add(Recording(time=time[a:b], gyro=gyro[a:b], name="log.csv"))
    return ends.notes("log.csv")


@pytest.mark.parametrize("cuts", [(), (1000, 1001, 2500)])
def test_both_ends_of_a_clipped_channel_are_said_with_their_rows(cuts):
    gyro = turns()
    said = counted(gyro, cuts)
    assert len(said) == 2 and all("gyro z reads no further than" in s for s in said)
    rows = [int(np.sum(gyro[:, 2] == v)) for v in (-END, END)]
    assert (
        f"-250 °/s, in {rows[0]} rows" in said[0] and f"than 250 °/s, in {rows[1]} rows" in said[1]
    )
    assert sum(rows) == int(clipped_rows(gyro).sum())  # as calibrations leave them out


def test_a_channel_that_is_not_clipped_and_coarse_rests_are_told_nothing():
    assert counted(turns(end=np.inf)) == ()
    assert counted(np.zeros((4000, 3))) == ()
    coarse = turns(end=np.inf, noise=3e-3, step=1e-2)  # repeats its values all along
    assert counted(coarse) == () and not clipped_rows(coarse).any()


def test_a_compensated_file_comes_with_the_note(tmp_path):
    gyro = turns()
    names = ("gyro.bias[0]", "gyro.bias[1]", "gyro.bias[2]")
    names += tuple(f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3))
    values = np.array([[0.01, -0.02, 0.0, 0.01, 0.0, 0.02, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0]])
    triad = TriadCalibration(Curve(Constant(), values), np.zeros((12, 12)), names, "reference")
    columns = {"time": np.arange(len(gyro)) / RATE}
    columns |= {f"gyro_{a}": gyro[:, k] for k, a in enumerate("xyz")}
    pl.DataFrame(columns).write_csv(tmp_path / "log.csv")
    made = compensate_file(Calibration(gravity=9.81, gyro=triad), tmp_path / "log.csv")
    assert sum("gyro z reads no further" in n for n in made.notes) == 2
