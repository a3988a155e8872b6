"""A temperature that a logger writes once in many rows, and one for each axis."""

import numpy as np
import pytest

from hand_log_data import draft, G, hand_log
from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.columns import ColumnMap, Layout, ProbeColumns
from inertiax.data.formats.long_logs import read_long
from inertiax.exports.compensated_recording import compensate_file
from inertiax.exports.compensated_stream import write_compensated
from inertiax.live.text_rows import TextRows
from inertiax.physics.temperature import Constant, Curve


TIME, ACCEL, _ = hand_log()
WARM = 20.0 + 10.0 * np.sin(TIME / 30.0)  # °C
EVERY = 50  # rows: once a second
READ = np.unique(np.r_[np.arange(0, len(TIME), EVERY), len(TIME) - 1])
BETWEEN = np.interp(TIME, TIME[READ], WARM[READ])
PROBE = ColumnMap(temperature=ProbeColumns(name="temp"))


def log_at(path, told=READ, names="temp"):
    """The hand log with a temperature in some rows, and blanks in the others."""
    told = set(told.tolist())
    lines = [
        f"{t:.9g},{','.join(f'{v:.9g}' for v in a)},{f'{w:.15g}' if k in told else ''}"
        + f",{w + 1:.9g},{w + 2:.9g}" * ("," in names)
        for k, (t, a, w) in enumerate(zip(TIME, ACCEL, WARM, strict=True))
    ]
    path.write_text("\n".join([f"time,accel_x,accel_y,accel_z,{names}", *lines]) + "\n")
    return path


def test_init_reads_it_by_straight_lines_between_its_rows(tmp_path):
    found = draft(log_at(tmp_path / "log.csv"))["columns"]
    assert found["temperature"] == {"name": "temp", "unit": "degC"}
    campaign = load_campaign(tmp_path)
    np.testing.assert_allclose(campaign.recordings[0].temperature[:, 0], BETWEEN, atol=1e-9)
    assert any("straight lines between readings some 1 s apart" in n for n in campaign.notes)
    assert not campaign.reservations


def test_readings_that_do_not_cover_the_log_are_refused(tmp_path):
    draft(log_at(tmp_path / "log.csv", READ[:20]))
    with pytest.raises(ValueError, match="no finite number in 3280 of 3300 rows, and what"):
        load_campaign(tmp_path)


def test_a_log_of_its_own_leaves_no_mark_of_the_column(tmp_path):
    path = log_at(tmp_path / "log.csv", READ[:1])
    (tmp_path / "chamber.csv").write_text("time,temperature\n0,20\n30,21\n90,22\n")
    draft(path, temperature=tmp_path / "chamber.csv")
    text = (tmp_path / "campaign.toml").read_text()
    assert "left out" not in text and 'temperature_files = ["chamber.csv"]' in text


def test_pieces_have_the_temperatures_of_the_whole(tmp_path):
    """A row without one may lie between readings of two pieces."""
    path = log_at(tmp_path / "log.csv")
    parts = read_long(path, PROBE, Layout(), part=500, rows=100, size=5000)
    joined = np.concatenate([p.temperature[:, 0] for p in parts])
    np.testing.assert_allclose(joined, BETWEEN, atol=1e-9)
    draft(path)
    names = tuple(f"accel.bias[{k}]" for k in range(3))
    bias = Curve(Constant(), np.array([[0.1, -0.2, 0.3]]))
    calibration = Calibration(
        gravity=G, accel=TriadCalibration(bias, np.zeros((3, 3)), names, "invariant")
    )
    write_compensated(calibration, path, tmp_path / "out.csv", campaign=tmp_path, size=5000)
    made = compensate_file(calibration, path, campaign=tmp_path).table
    written = np.genfromtxt(tmp_path / "out.csv", delimiter=",", names=True)["temperature"]
    np.testing.assert_allclose(written, made["temperature"].to_numpy(), rtol=1e-12)
    np.testing.assert_allclose(written, BETWEEN, atol=1e-9)


def test_live_holds_the_last_reading(tmp_path):
    lines = log_at(tmp_path / "log.csv").read_bytes().splitlines()
    reader = TextRows(PROBE, Layout(), "log.csv")
    chunks = [reader.read(lines[:80]), reader.read(lines[80:130])]  # the second begins at row 79
    read = np.concatenate([c.rows.temperature[:, 0] for c in chunks])
    np.testing.assert_allclose(read, WARM[np.arange(129) // EVERY * EVERY], rtol=1e-12)
    assert not any(c.garbled for c in chunks)


def test_of_one_for_each_axis_the_first_is_read_and_marked(tmp_path):
    path = log_at(tmp_path / "log.csv", np.arange(len(TIME)), "temp_x,temp_y,temp_z")
    assert draft(path)["columns"]["temperature"]["name"] == "temp_x"
    text = (tmp_path / "campaign.toml").read_text()
    assert "# CHECK temperature: 20" in text and "it stands for all axes" in text
