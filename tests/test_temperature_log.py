"""A temperature that a chamber or a probe logs apart from the device."""

import hashlib
import tomllib
from datetime import datetime, timedelta, UTC

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.campaign_draft import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.columns import ColumnMap, Layout
from inertiax.data.formats.long_logs import read_long
from inertiax.data.formats.temperature_at_stamps import TemperatureLog
from inertiax.data.inputs import campaign_inputs
from inertiax.exports.compensated_recording import compensate_file
from inertiax.fleet.pipeline import run_fleet
from inertiax.fleet.results import fleet_calibration
from inertiax.live.follow import plan


G = 9.80665
RATE = 20.0  # Hz
RESTS, ROWS = 30, 60


def chamber(time):
    """°C at times since the start: 2 K a minute, and a wave as a controller makes it."""
    return -10.0 + time / 30.0 + 0.2 * np.sin(time / 40.0)


def device():
    """Time and outputs of 30 rests in a chamber; biases and scales follow the temperature."""
    rng = np.random.default_rng(4)
    up = rng.standard_normal((RESTS, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    time = np.arange(RESTS * ROWS) / RATE
    warm = chamber(time)[:, None] - 10.0
    force = np.repeat(G * up, ROWS, axis=0)
    accel = (1.0 + 1e-4 * warm) * force + [0.05, -0.02, 0.1] + 2e-3 * warm
    return time, accel + 1e-3 * rng.standard_normal(accel.shape)


def written(folder, *, said="", late=0.0, step=1.0, columns="", apart=True):
    """A campaign whose temperature stands in chamber.csv (`late` s late), or in a column of the device's log."""
    folder.mkdir(parents=True, exist_ok=True)
    time, accel = device()
    table = pl.DataFrame({"time": time, **{f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}})
    table = table.with_columns(position=np.repeat(np.arange(RESTS), ROWS))
    readings = np.arange(0.0, time[-1] + step, step)
    pl.DataFrame({"t": readings + late, "T": chamber(readings)}).write_csv(folder / "chamber.csv")
    if not apart:
        table = table.with_columns(temperature=np.interp(time, readings, chamber(readings)))
    table.write_csv(folder / "imu.csv")
    logs = 'temperature_files = ["chamber.csv"]\n' if apart else ""
    names = 'temperature = { name = "T" }\ntemperature_time = { name = "t" }\n' if apart else ""
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {G}\n[recordings]\nfiles = ["imu.csv"]\n{logs}{said}[columns]\n{columns}{names}'
    )
    return folder


@pytest.mark.parametrize("late", [0.0, 1700.0])
def test_readings_are_put_onto_the_stamps_by_straight_lines(tmp_path, late):
    said = f"temperature_delay = {late}\n" if late else ""
    campaign = load_campaign(written(tmp_path, said=said, late=late, step=5.0))
    time, _ = device()
    readings = np.arange(0.0, time[-1] + 5.0, 5.0)
    (recording,) = campaign.recordings
    # Stamps near 2e3 s, written to the last digit
    np.testing.assert_allclose(
        recording.temperature[:, 0], np.interp(time, readings, chamber(readings)), atol=1e-9
    )
    assert any("straight lines between readings some 5 s apart" in n for n in campaign.notes)
    assert not campaign.reservations


def test_a_calibration_is_that_of_the_same_log_with_a_column(tmp_path):
    apart, column = (
        calibrate_device(load_campaign(written(tmp_path / f"{k}", apart=k))) for k in (True, False)
    )
    assert apart.model.document() == column.model.document()
    assert apart.model.accel.temperature_degree >= 1
    a, b = (r.calibration.accel.curve.coefficients for r in (apart, column))
    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


def test_compensated_with_the_campaign_as_with_a_column(tmp_path):
    """Of the file that the campaign names, and of a later log that the same chamber's log covers."""
    folders = [written(tmp_path / f"{k}", apart=k) for k in (True, False)]
    calibration = calibrate_device(load_campaign(folders[1])).calibration
    tables = [compensate_file(calibration, f / "imu.csv", campaign=f).table for f in folders]
    for name in ("accel_x", "accel_y", "accel_z", "temperature"):
        np.testing.assert_allclose(tables[0][name], tables[1][name], rtol=1e-12)
    later = pl.read_csv(folders[0] / "imu.csv")[900:]
    later.write_csv(folders[0] / "later.csv")
    again = compensate_file(calibration, folders[0] / "later.csv", campaign=folders[0]).table
    np.testing.assert_allclose(again["accel_x"], tables[1]["accel_x"][900:], rtol=1e-12)


def test_a_probe_of_the_device_stays_the_first(tmp_path):
    folder = written(tmp_path)
    own = pl.read_csv(folder / "imu.csv").with_columns(temperature=pl.lit(21.5))
    own.write_csv(folder / "imu.csv")
    (recording,) = load_campaign(folder).recordings
    assert recording.temperature.shape == (RESTS * ROWS, 2)
    assert np.all(recording.temperature[:, 0] == 21.5)
    np.testing.assert_allclose(recording.temperature[0, 1], chamber(0.0))


def test_rows_without_a_number_and_stamps_that_repeat_are_left_out(tmp_path):
    folder = written(tmp_path)
    rows = (folder / "chamber.csv").read_text().splitlines()
    rows[5:6] = [rows[4], f"{rows[5].split(',')[0]},"]
    (folder / "chamber.csv").write_text("\n".join(rows) + "\n")
    (recording,) = load_campaign(folder).recordings
    time, _ = device()
    readings = np.delete(np.arange(0.0, time[-1] + 1.0), 4)
    expected = np.interp(time, readings, chamber(readings))
    np.testing.assert_allclose(recording.temperature[:, 0], expected, atol=1e-9)


def test_the_rate_of_the_devices_rows_is_not_the_logs(tmp_path):
    folder = written(tmp_path, columns=f"time = {{ rate = {RATE} }}\n", step=5.0)
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text.replace('temperature_time = { name = "t" }\n', ""))
    with pytest.raises(ValueError, match="chamber.csv: column 'time' is missing"):
        load_campaign(folder)
    renamed = (folder / "chamber.csv").read_text().replace("t,T", "time,T")
    (folder / "chamber.csv").write_text(renamed)
    (recording,) = load_campaign(folder).recordings
    readings = np.arange(0.0, device()[0][-1] + 5.0, 5.0)
    expected = np.interp(device()[0], readings, chamber(readings))
    np.testing.assert_allclose(recording.temperature[:, 0], expected, atol=1e-9)


def test_each_file_has_its_own_log_or_all_have_one(tmp_path):
    folder = written(tmp_path)
    both = '"imu.csv", "imu2.csv"'
    (folder / "imu2.csv").write_text((folder / "imu.csv").read_text())
    text = (folder / "campaign.toml").read_text().replace('"imu.csv"', both)
    (folder / "campaign.toml").write_text(text)
    first, second = load_campaign(folder).recordings
    np.testing.assert_array_equal(first.temperature, second.temperature)
    warmer = pl.read_csv(folder / "chamber.csv").with_columns(pl.col("T") + 5.0)
    warmer.write_csv(folder / "warmer.csv")
    text = text.replace('["chamber.csv"]', '["chamber.csv", "warmer.csv"]')
    (folder / "campaign.toml").write_text(text)
    first, second = load_campaign(folder).recordings
    np.testing.assert_allclose(second.temperature - first.temperature, 5.0, atol=1e-9)
    three = text.replace('"warmer.csv"', '"warmer.csv", "chamber.csv", "w2.csv"')
    warmer.write_csv(folder / "w2.csv")
    (folder / "campaign.toml").write_text(three)
    with pytest.raises(ValueError, match=r"temperature_files names 3 for 2 files; give one for"):
        load_campaign(folder)


def test_a_glob_of_the_devices_files_leaves_the_others_out(tmp_path):
    folder = written(tmp_path)
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text.replace('files = ["imu.csv"]', 'files = ["*.csv"]'))
    (recording,) = load_campaign(folder).recordings
    assert recording.name == "imu.csv" and recording.temperature is not None
    assert [i.file for i in campaign_inputs(folder / "campaign.toml")] == [
        "campaign.toml", "chamber.csv", "imu.csv",
    ]  # fmt: skip


def test_parts_of_a_long_log_have_it_too(tmp_path):
    folder = written(tmp_path)
    readings = np.arange(0.0, 100.0)
    log = TemperatureLog("chamber.csv", readings, chamber(readings)[:, None])
    layout = Layout(temperature_log=log)
    parts = read_long(folder / "imu.csv", ColumnMap(), layout, part=400, rows=300, size=20_000)
    (whole,) = load_campaign(folder).recordings
    assert len(parts) > 1
    np.testing.assert_allclose(
        np.concatenate([p.temperature for p in parts]), whole.temperature, atol=1e-9
    )


def test_readings_that_do_not_cover_the_log_are_refused_with_the_cure(tmp_path):
    folder = written(tmp_path, late=3600.0)
    message = (
        r"chamber.csv: its readings are from 3600.000 to 3690.000 s, the samples of imu.csv from 0.000 to 89.950 s"
        r".*temperature_delay, 3600.000 s more if both began at once"
    )
    with pytest.raises(ValueError, match=message):
        load_campaign(folder)


@pytest.mark.parametrize(
    ("said", "columns", "message"),
    [
        ("temperature_delay = 2.0\n", "", r"temperature_delay is for .* temperature_files"),
        ("", 'temperature_time = "t"\n', r"temperature_time is for .* temperature_files"),
    ],
)
def test_keys_of_a_log_that_is_not_given_are_refused(tmp_path, said, columns, message):
    with pytest.raises(ValueError, match=message):
        load_campaign(written(tmp_path, apart=False, said=said, columns=columns))


def test_the_log_is_one_of_the_campaigns_inputs(tmp_path):
    folder = written(tmp_path)
    inputs = {i.file: i.sha256 for i in campaign_inputs(folder / "campaign.toml")}
    digest = hashlib.sha256((folder / "chamber.csv").read_bytes()).hexdigest()
    assert inputs["chamber.csv"] == digest


@pytest.mark.slow
def test_a_fleet_of_folders_has_it_and_sees_that_it_changed(tmp_path):
    for name in ("A-1", "A-2"):
        folder = written(tmp_path / "line" / name, apart=name == "A-1")
        own = pl.read_csv(folder / "imu.csv")  # a copy to the last digit would be set aside
        own.with_columns(pl.col("accel_x") + (1e-9 if name == "A-2" else 0.0)).write_csv(
            folder / "imu.csv"
        )
    run = lambda: run_fleet(tmp_path / "line", tmp_path / "out")
    assert run().calibrated == 2
    first = [fleet_calibration(tmp_path / "out", n).accel.curve for n in ("A-1", "A-2")]
    np.testing.assert_allclose(first[0].coefficients, first[1].coefficients, atol=1e-6)
    chamber_log = tmp_path / "line" / "A-1" / "chamber.csv"
    pl.read_csv(chamber_log).with_columns(pl.col("T") + 0.05).write_csv(chamber_log)
    assert run().calibrated == 2
    again = fleet_calibration(tmp_path / "out", "A-1").accel.curve
    # The same outputs at temperatures a little higher
    np.testing.assert_allclose(again(-7.95), first[0](-8.0), atol=1e-8)
    assert np.abs(again(-8.0) - first[0](-8.0)).max() > 1e-6


def test_what_cannot_have_it_says_so(tmp_path):
    written(tmp_path / "line" / "A-1")
    with pytest.raises(ValueError, match="temperature_files: the files of many devices hold"):
        run_fleet(tmp_path / "line" / "A-1" / "campaign.toml", tmp_path / "out")
    with pytest.raises(ValueError, match="temperature_files logs the temperature apart; `live`"):
        plan(tmp_path / "line" / "A-1", None, piped=False, target=None)


# --- init ----------------------------------------------------------------------------------------


def drafted(folder, logs, **given):
    draft = draft_campaign(logs[0], folder, others=logs[1:], **given)
    (folder / "campaign.toml").write_text(draft.text)
    return tomllib.loads(draft.text), draft


def by_hand(folder, probe, *, dated=False):
    """The device's log under names of its own, and a probe's."""
    time, accel = device()
    stamps = [
        f"{START + timedelta(seconds=float(t)):%Y-%m-%dT%H:%M:%S.%f}" if dated else t for t in time
    ]
    rows = "\n".join(
        f"{t},{a:.5f},{b:.5f},{c:.5f}" for t, (a, b, c) in zip(stamps, accel, strict=True)
    )
    (folder / "imu.csv").write_text(f"time,ax,ay,az\n{rows}\n")
    (folder / "chamber_temp.csv").write_text(probe)
    return [folder / "imu.csv", folder / "chamber_temp.csv"]


def test_init_takes_a_chambers_log_among_the_others(tmp_path):
    """A slow log: its stamps are no IMU's, and the air's temperature is not the probe's."""
    readings = np.arange(0.0, 100.0, 10.0)
    rows = "\n".join(f"{t:.0f},{chamber(t) + 3.0:.3f},{chamber(t):.3f}" for t in readings)
    table, draft = drafted(tmp_path, by_hand(tmp_path, f"t,temp_air,temp_plate\n{rows}\n"))
    assert table["recordings"]["temperature_files"] == ["chamber_temp.csv"]
    assert table["recordings"]["temperature_delay"] == 0.0
    assert "so it is if they are one" in draft.untold["temperature_delay"]
    assert table["columns"]["temperature"] == {"name": "temp_plate", "unit": "degC"}
    assert table["columns"]["temperature_time"] == {"name": "t", "unit": "s"}
    (recording,) = load_campaign(tmp_path).recordings
    time, _ = device()
    expected = np.interp(time, readings, chamber(readings))
    np.testing.assert_allclose(recording.temperature[:, 0], expected, atol=1e-3)


def test_init_reads_a_temperature_in_rows_of_its_own(tmp_path):
    """As a log of messages has it: a row with a sample has no temperature, and it "holds no two numbers"."""
    time, accel = device()
    lines = [(t, f"{t},{a:.5f},{b:.5f},{c:.5f},") for t, (a, b, c) in zip(time, accel, strict=True)]
    readings = time[::50] + 0.002
    lines += [(t, f"{t},,,,{chamber(t):.4f}") for t in readings]
    text = "\n".join(line for _, line in sorted(lines))
    (tmp_path / "imu.csv").write_text(f"time,ax,ay,az,temp\n{text}\n")
    table, draft = drafted(tmp_path, [tmp_path / "imu.csv"])
    assert table["recordings"]["temperature_files"] == ["imu.csv"]
    assert "temperature_delay" not in table["recordings"] | draft.untold
    (recording,) = load_campaign(tmp_path).recordings
    expected = np.interp(time, readings, chamber(readings))
    np.testing.assert_allclose(recording.temperature[:, 0], expected, atol=1e-3)


START = datetime(2026, 3, 2, 9, 30, tzinfo=UTC)


@pytest.mark.parametrize(
    ("clock", "stamp", "ahead", "delay", "why"),
    [
        ("seconds", "%Y-%m-%dT%H:%M:%S", 0, START.timestamp(), "both began at once"),
        ("seconds", "%H:%M:%S", 0, 9.5 * 3600, "both began at once"),
        ("dated", "%Y/%m/%d %H:%M:%S", 0, None, None),
        ("dated", "%Y-%m-%d %H:%M:%S", 2, 7200.0, "hours between two time zones"),
        ("dated", "%d.%m.%Y %H:%M:%S", -5, -18000.0, "hours between two time zones"),
        ("dated", "%H:%M:%S", 0, 9.5 * 3600 - START.timestamp(), "a time of day"),
    ],
)
def test_init_tells_how_the_clocks_differ(tmp_path, clock, stamp, ahead, delay, why):
    """A chamber that stamps the time of day or the local time beside a device with seconds or dates."""
    readings = np.arange(0.0, 100.0, 2.0)
    at = [START + timedelta(seconds=float(t), hours=ahead) for t in readings]
    rows = "\n".join(
        f"{a:{stamp}},{chamber(t) + 273.15:.3f}" for a, t in zip(at, readings, strict=True)
    )
    logs = by_hand(tmp_path, f"stamp,temperature [K]\n{rows}\n", dated=clock == "dated")
    table, draft = drafted(tmp_path, logs[:1], temperature=logs[1])
    assert table["recordings"].get("temperature_delay") == delay
    assert why is None or why in draft.untold["temperature_delay"]
    assert table["columns"]["temperature"]["unit"] == "K"
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(
        recording.temperature[:, 0], np.interp(device()[0], readings, chamber(readings)), atol=2e-3
    )


@pytest.mark.parametrize(
    "name, unit, seconds",
    [
        ("Elapsed time [min]", "min", 60.0),
        ("t_min", "min", 60.0),
        ("Hours", "h", 3600.0),
        ("datenum", "d", 86400.0),
        ("t", "min", 60.0),  # in which it lasts as long as the device's log
    ],
)
def test_a_station_counts_minutes_hours_or_days(tmp_path, name, unit, seconds):
    readings = np.arange(0.0, 100.0, 2.0)
    rows = "\n".join(f"{t / seconds:.9f},{chamber(t):.4f}" for t in readings)
    logs = by_hand(tmp_path, f"{name},probe_temp\n{rows}\n")
    table, _ = drafted(tmp_path, logs[:1], temperature=logs[1])
    assert table["columns"]["temperature_time"] == {"name": name, "unit": unit}
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(
        recording.temperature[:, 0], np.interp(device()[0], readings, chamber(readings)), atol=2e-4
    )


def test_init_reads_an_array_whose_columns_are_called_alike(tmp_path):
    """As a MATLAB file holds it, stamps first."""
    logs = by_hand(tmp_path, "")
    readings = np.arange(0.0, 91.0)
    values = np.column_stack([readings, chamber(readings)])
    savemat(tmp_path / "chamber_temp.mat", {"temperatureBuffer": values})
    table, _ = drafted(tmp_path, [logs[0], tmp_path / "chamber_temp.mat"])
    assert table["columns"]["temperature"]["name"] == "temperatureBuffer_1"
    assert table["columns"]["temperature_time"]["name"] == "temperatureBuffer_0"
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(
        recording.temperature[:, 0], np.interp(device()[0], readings, chamber(readings))
    )


def test_init_refuses_a_temperatures_log_without_a_temperature(tmp_path):
    logs = by_hand(tmp_path, "t,a,b\n" + "\n".join(f"{k},1,{k % 3}" for k in range(90)) + "\n")
    with pytest.raises(ValueError, match="no column is called a temperature"):
        drafted(tmp_path, logs[:1], temperature=logs[1])
    with pytest.raises(ValueError, match="--temperature FILE"):
        drafted(tmp_path, logs)
    words = "\n".join(f"day 61 9 h {k} min,2{k}.5" for k in range(10, 40))
    logs = by_hand(tmp_path, f"stamp,temp\n{words}\n")
    with pytest.raises(ValueError, match="no column of times in it.*as 2026-03-02 09:30:00"):
        drafted(tmp_path, logs[:1], temperature=logs[1])
