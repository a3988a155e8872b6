"""A few stamps that repeat or go back: the others keep the clock, and with it the pauses of lost rows."""

import numpy as np
import polars as pl
import pytest

from hand_log_data import CANONICAL, DEGREE, draft, G, hand_log, written
from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.data.campaign import load_campaign
from inertiax.data.formats import ColumnMap
from inertiax.data.formats.columns import time_scale, TimeColumn
from inertiax.data.formats.long_logs import read_long
from inertiax.data.formats.mended_stamps import can_be_mended, full, mended
from inertiax.exports.compensated_recording import compensate_file
from inertiax.exports.compensated_stream import write_compensated
from inertiax.fleet.reduce.columns import time_name
from inertiax.physics.temperature import Constant, Curve


LOST = [700, 1100, 1101, 1102, 2000]  # rows of the log that were never written
SLIPS = (
    150,
    900,
    1500,
)  # rows of what is left that have the stamp of the row before; the last one 3 ms less


def slipped():
    """True times, s, and stamps in ms of a hand log: five rows lost, two stamps twice and one 3 ms back."""
    time, accel, gyro = hand_log()
    kept = np.setdiff1d(np.arange(len(time)), LOST)
    stamps = np.round(1e3 * time[kept]) + 4000
    for row in SLIPS:
        stamps[row] = stamps[row - 1]
    stamps[SLIPS[-1]] -= 3.0
    return time[kept], stamps, accel[kept], gyro[kept]


@pytest.mark.parametrize(
    "given, right",
    [
        ([0.0, 1.0, 1.0, 3.0, 4.0], [0.0, 1.0, 2.0, 3.0, 4.0]),
        ([0.0, 1.0, 2.5, 2.25, 4.0], [0.0, 1.0, 2.5, 3.25, 4.0]),  # late, and then in time
        ([0.0, 1.0, 2.0, 3.0, 3.0], [0.0, 1.0, 2.0, 3.0, 4.0]),  # none behind it: the usual step
        ([0.0, 1.0, 1.0, 8.0, 9.0], [0.0, 1.0, 4.5, 8.0, 9.0]),  # rows were lost beside it
        ([0.0, 1.0, 2.0, 3.0, 4.5], [0.0, 1.0, 2.0, 3.0, 4.5]),
        # Begun anew once, after a time that is not known; a counter that is full, twice, after a step.
        ([7.0, 8.0, 9.0, 11.0, 0.0, 1.0, 3.0], [7.0, 8.0, 9.0, 11.0, 36.0, 37.0, 39.0]),
        (np.arange(24.0) % 8.0, np.arange(24.0)),
    ],
)
def test_stamps_by_hand(given, right):
    np.testing.assert_allclose(mended(np.array(given)), right, rtol=1e-15)


def test_stamps_in_order_stay_and_the_others_are_off_by_less_than_a_step():
    """A reader that is late now and then: what it stamps too late, and the next in time, as a loop writes them."""
    rng = np.random.default_rng(3)
    true = 0.01 * np.arange(20_000)
    late = np.where(rng.random(20_000) < 0.003, rng.uniform(0.0, 0.025, 20_000), 0.0)
    stamps = true + late
    out = np.r_[False, stamps[1:] <= np.maximum.accumulate(stamps)[:-1]]
    assert 20 < out.sum() < 200
    found = mended(stamps)
    assert (np.diff(found) > 0.0).all()
    np.testing.assert_array_equal(found[~out], stamps[~out])
    # Between a stamp that is late by up to 25 ms and the next that is not: at most the lateness.
    assert np.abs(found - true).max() <= 0.025


def test_a_clock_that_is_too_coarse_or_far_off_in_one_row_is_refused():
    steps = np.arange(1000.0)
    ahead, behind = steps.copy(), steps.copy()
    ahead[500], behind[500] = 5000.0, 10.0  # a row alone is no clock that begins anew
    for bad in (ahead, behind, np.floor(steps / 10), np.r_[steps, np.nan]):
        assert not can_be_mended(bad)
    with pytest.raises(ValueError, match="a.csv: 900 of 1000 stamps .* count rows"):
        mended(np.floor(steps / 10), "a.csv")
    with pytest.raises(ValueError, match="both mend and rate are given"):
        time_scale(TimeColumn(rate=50.0, mend=True), "[columns]")
    with pytest.raises(ValueError, match="mend is for logs of one device"):
        time_name(ColumnMap(time=TimeColumn(name="t", mend=True)))


def test_init_mends_and_lost_rows_stay_a_pause(tmp_path):
    true, stamps, accel, gyro = slipped()
    columns = (stamps, accel / G, gyro / DEGREE)
    path = written(tmp_path / "log.csv", columns, f"millis,{CANONICAL}")
    found = draft(path)["columns"]["time"]
    assert found == {"name": "millis", "unit": "ms", "mend": True}
    assert "3 stamps that repeat or go back" in (tmp_path / "campaign.toml").read_text()
    (recording,) = load_campaign(tmp_path).recordings
    # The neighbours of the three are all there, 20 ms before and behind, so that the middle is the true time.
    np.testing.assert_allclose(recording.time - recording.time[0], true - true[0], atol=1e-9)
    counted = np.arange(len(true)) * (true[-1] - true[0]) / (len(true) - 1)
    assert np.abs(counted - (true - true[0])).max() > 0.03  # what counting would give


def test_a_restart_leaves_the_pauses_of_lost_rows_and_is_marked(tmp_path):
    """Counted at a mean rate, a log with one row in a hundred lost had gyro biases over 100 sigma wrong."""
    true, _, accel, gyro = slipped()
    half = len(true) // 2
    stamps = np.round(1e6 * np.r_[true[:half] + 123.0, true[half:] - true[half]])
    path = written(
        tmp_path / "log.csv", (stamps, accel / G, gyro / DEGREE), f"timestamp_us,{CANONICAL}"
    )
    found = draft(path)["columns"]["time"]
    assert found == {"name": "timestamp_us", "unit": "us", "mend": True}
    lines = (tmp_path / "campaign.toml").read_text().splitlines()
    assert any("CHECK time" in x and f"begins anew at row {half}:" in x for x in lines)
    (recording,) = load_campaign(tmp_path).recordings
    steps = np.diff(true)
    steps[half - 1] = 25 * 0.02
    np.testing.assert_allclose(np.diff(recording.time), steps, atol=2e-6)


def test_two_files_of_one_clock_that_begins_anew(tmp_path):
    """Their stamps kept neither their step nor their order, and the log was refused by a time that no row has."""
    true, _, accel, gyro = slipped()
    half, ahead = len(true) // 2, 30.0
    stamps = np.r_[true[:half] + ahead, true[half:] + ahead - 0.898]
    path = written(tmp_path / "accelerometer.csv", (stamps, accel), "time,accel_x,accel_y,accel_z")
    other = written(tmp_path / "gyroscope.csv", (stamps, gyro), "time,gyro_x,gyro_y,gyro_z")
    columns = draft(path, gyro=other)["columns"]
    assert columns["time"] == {"name": "time", "unit": "s", "mend": True}
    assert (columns["accel"]["unit"], columns["gyro"]["unit"]) == ("m/s^2", "rad/s")
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.gyro, gyro, rtol=1e-5, atol=1e-7)
    steps = np.diff(true)
    steps[half - 1] = 25 * 0.02
    np.testing.assert_allclose(np.diff(recording.time), steps, atol=2e-5)  # seven digits written


def test_who_wrote_no_mend_is_told_of_it(tmp_path):
    _, stamps, accel, gyro = slipped()
    path = written(tmp_path / "log.csv", (stamps, accel / G, gyro / DEGREE), f"millis,{CANONICAL}")
    draft(path)
    toml = tmp_path / "campaign.toml"
    toml.write_text(toml.read_text().replace(", mend = true", ""))
    told = "row 150 .* repeats .* 2 repeated and 1 backward .* Add mend = true to"
    with pytest.raises(ValueError, match=told):
        load_campaign(tmp_path)


def test_pieces_have_the_stamps_of_the_whole(tmp_path):
    """A slip may stand where a log is cut: its neighbours are those of another piece."""
    _, stamps, accel, gyro = slipped()
    columns = {"time": stamps / 1e3}
    columns |= {f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}
    columns |= {f"gyro_{a}": gyro[:, k] for k, a in enumerate("xyz")}
    path = tmp_path / "log.csv"
    pl.DataFrame(columns).write_csv(path)
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["log.csv"]\n[columns]\ntime = { name = "time", mend = true }\n'
    )
    mends = ColumnMap(time=TimeColumn(name="time", mend=True))
    (whole,) = read_long(path, mends)
    (cut,) = read_long(path, mends, part=500, rows=100, size=5000)
    np.testing.assert_array_equal(cut.time, whole.time)
    names = tuple(f"accel.bias[{k}]" for k in range(3))
    bias = Curve(Constant(), np.array([[0.1, -0.2, 0.3]]))
    calibration = Calibration(
        gravity=9.81, accel=TriadCalibration(bias, np.zeros((3, 3)), names, "invariant")
    )
    write_compensated(calibration, path, tmp_path / "out.csv", campaign=tmp_path, size=5000)
    made = compensate_file(calibration, path, campaign=tmp_path).table
    written_time = pl.read_csv(tmp_path / "out.csv")["time"].to_numpy()
    np.testing.assert_allclose(written_time, made["time"].to_numpy(), rtol=1e-15)
    assert (np.diff(written_time) > 0.0).all()


@pytest.mark.parametrize(("bits", "tick", "unit"), [(32, 1e-6, "us"), (16, 1e-3, "ms")])
def test_a_counter_that_is_full_once_goes_on_after_its_own_step(tmp_path, bits, tick, unit):
    """Arduino's `micros()` after 71 minutes, and a counter of ms in 16 bits."""
    true, _, accel, gyro = slipped()
    ticks = np.round((true - true[len(true) // 2]) / tick) + 2.0**bits - 7.0
    path = written(tmp_path / "log.csv", (accel / G, gyro / DEGREE), CANONICAL)
    lines = path.read_text().splitlines()
    stamps = [f"timer_{unit}", *(f"{t % 2.0**bits:.0f}" for t in ticks)]
    path.write_text("\n".join(f"{t},{x}" for t, x in zip(stamps, lines)) + "\n")
    found = draft(path)["columns"]["time"]
    assert found == {"name": f"timer_{unit}", "unit": unit, "mend": True}
    text = (tmp_path / "campaign.toml").read_text()
    assert "CHECK time" not in text and "its counter is full at row" in text
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(np.diff(recording.time), np.diff(true), atol=2.1 * tick)


def test_a_clock_that_goes_back_by_about_what_a_counter_holds_begins_anew():
    """Ten steps off, it was none that was full."""
    true = np.arange(3000) * 0.01
    counts = np.r_[true[:1500] + 65.536 - 15.1, true[1500:] - 15.0]
    assert not len(full(counts))
    assert np.diff(mended(counts))[1499] == pytest.approx(0.25)
