"""Logs without a header line: which column is a clock, a date or a serial number, by their numbers."""

import numpy as np
import pytest

from hand_log_data import DEGREE, draft, G, hand_log, written
from inertiax.campaign_draft.column_numbers import is_clock_set_back
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()
STAMPS = np.round(1e3 * TIME)  # ms


@pytest.mark.parametrize("again", [(5, 5, 4), (1,), (700, 3)], ids=str)
def test_a_clock_that_begins_anew_is_a_clock(tmp_path, again):
    """A public log of an Arduino begins with 14 rows of the run before, in which the stamps go back three times: the
    stamps were taken for the first magnetometer."""
    before = np.concatenate([59_022.0 + 10.0 * np.arange(n) for n in again])
    stamps = np.concatenate([before, 10.0 * np.arange(len(TIME))])
    rows = np.concatenate([np.repeat(ACCEL[:1], len(before), axis=0), ACCEL]) / G
    path = written(tmp_path / "log.csv", (stamps, rows))
    found = draft(path)
    assert found["recordings"]["names"] == ["time", "accel_x", "accel_y", "accel_z"]
    assert found["columns"]["accel"] == {"unit": "g"}
    (recording,) = load_campaign(tmp_path).recordings
    assert np.median(np.diff(recording.time)) == pytest.approx(0.01, rel=0.02)


def test_outputs_are_no_clocks():
    rows = np.arange(5000)
    assert is_clock_set_back((10.0 * rows) % 30_000.0)
    assert not is_clock_set_back((0.9 * rows) % 360.0)  # a heading on a table that keeps turning
    assert not is_clock_set_back(rows % 2000.0)  # rows of a run
    assert not is_clock_set_back(np.sin(rows / 2000.0))
    assert not is_clock_set_back(np.random.default_rng(0).normal(size=5000))


def _dated(date, tmp_path, scale):
    """Rows as an altimeter for rockets writes them: a word, its serial number, the date, a counter, outputs."""
    path = tmp_path / "log.txt"
    lines = []
    for k, (t, a, w) in enumerate(zip(TIME, scale * ACCEL / G, 131.0 * GYRO / DEGREE, strict=True)):
        clock = f"16:{24 + int(t // 60):02d}:{t % 60:06.3f}"
        numbers = " ".join(f"{v:6.0f}" for v in (*a, *w))
        lines.append(f"@ HIR  139 {date} {clock} {2 * k + 75:4d} {numbers}")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("date", ["2023  8 09", "09 8 2023", "2023 12 31"])
def test_a_serial_number_and_a_date_are_no_outputs(tmp_path, date):
    """Serial, year, month and day of a public log were accelerometers and a gyro of 2048 counts per g, without a mark:
    the norm of year and month is 2028."""
    found = draft(_dated(date, tmp_path, 4096.0))
    assert found["recordings"]["names"][:3] == ["column_1", "column_2", "column_3"]
    assert found["columns"]["time"] == {"name": "time"}
    assert found["columns"]["accel"]["scale"] == 4096.0
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.accel, ACCEL, atol=0.5 * G / 4096.0 + 1e-9)
    np.testing.assert_allclose(recording.gyro, GYRO, atol=0.5 * DEGREE / 131.0 + 1e-9)


def test_a_coarse_axis_that_stands_still_is_an_output(tmp_path):
    """At rest an 8-bit accelerometer reads one number in x, and hardly another one in y and z."""
    rng = np.random.default_rng(2)
    accel = np.column_stack(
        [np.full(2000, 3), rng.integers(-1, 1, 2000), rng.integers(63, 65, 2000)]
    )
    gyro = rng.integers(-40, 40, size=(2000, 3))
    path = written(tmp_path / "log.csv", (10.0 * np.arange(2000), accel, gyro))
    names = draft(path)["recordings"]["names"]
    assert names == ["time", *(f"{t}_{a}" for t in ("accel", "gyro") for a in "xyz")]


def test_gyros_in_a_text_named_as_matlab_names_its_files(tmp_path):
    """imu_tk's public `xsens_gyro.mat`: the draft said gyros, and its file was read as accelerometers of 5.6e4 m/s²."""
    path = tmp_path / "xsens_gyro.mat"
    np.savetxt(path, np.column_stack([TIME, np.round(32_768.0 + 131.0 * GYRO / DEGREE)]))
    found = draft(path)
    assert found["recordings"]["format"] == "csv"
    assert found["recordings"]["names"] == ["time", "gyro_x", "gyro_y", "gyro_z"]
    (recording,) = load_campaign(tmp_path).recordings
    assert recording.accel is None
    np.testing.assert_allclose(recording.gyro, GYRO, atol=0.51 * DEGREE / 131.0)


def test_both_triads_in_a_text_named_as_matlab_names_its_files(tmp_path):
    path = tmp_path / "imu.mat"
    np.savetxt(path, np.column_stack([TIME, ACCEL, GYRO]))
    assert draft(path)["recordings"]["format"] == "csv"
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.accel, ACCEL, atol=1e-9)
    np.testing.assert_allclose(recording.gyro, GYRO, atol=1e-9)
