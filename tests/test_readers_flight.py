"""Flight controllers' logs: PX4's ULog, read by pyulog, and ArduPilot's dataflash, read by pymavlink.

Neither library writes a log from nothing, so the samples are laid out here after the formats'
specifications and read back with the libraries themselves before our readers see them.
"""

import struct

import numpy as np
import pytest

from inertiax.data.formats import ColumnMap, Layout, read_recordings
from inertiax.data.formats.columns import TriadColumns
from inertiax.data.formats.dataflash_messages import messages
from readers_cases import campaign, check, made_up, refusal
from readers_data import COLUMNS, dataflash, HEAD, raw_log, sensor_rows, ulog


SINGLE = 1e-7  # relative rounding of a 32-bit float


# ULog --------------------------------------------------------------------------------------------


def test_ulog_sensors_are_read_from_a_campaign(tmp_path):
    pyulog = pytest.importorskip("pyulog", reason="pyulog is not installed (inertiax[px4])")
    data = made_up()
    raw_log(tmp_path / "a.ulg", data)
    theirs = pyulog.ULog(str(tmp_path / "a.ulg")).get_dataset("sensor_accel").data
    np.testing.assert_array_equal(theirs["x"], data["accel"][:, 0].astype(np.float32))
    (recording,) = campaign(tmp_path, ["a.ulg"])
    check(recording, data, rtol=SINGLE)
    assert recording.device == ""


def test_every_imu_of_a_ulog_is_a_device(tmp_path):
    pytest.importorskip("pyulog")
    data = made_up()
    raw_log(tmp_path / "a.ulg", data, instances=(0, 2))
    found = read_recordings(tmp_path / "a.ulg")
    assert [r.device for r in found] == ["imu0", "imu2"]
    (one,) = campaign(tmp_path, ["a.ulg"], "instance = 2")
    check(one, data, rtol=SINGLE)


def test_gyros_of_other_stamps_are_put_onto_the_accelerometers_by_straight_lines(tmp_path):
    pytest.importorskip("pyulog")
    data = made_up()
    delay = 0.001
    slope = np.array([0.3, -0.2, 0.1])
    data["gyro"] = (data["time"] + delay)[:, None] * slope
    streams = [("sensor_accel", 0, sensor_rows(data, "accel"))]
    streams += [("sensor_gyro", 0, sensor_rows(data, "gyro", delay=delay))]
    ulog(tmp_path / "a.ulg", streams)
    (recording,) = read_recordings(tmp_path / "a.ulg")
    # A straight line is met exactly; the first stamp is before the first rate and is left out.
    np.testing.assert_allclose(recording.time, data["time"][1:], rtol=1e-15)
    np.testing.assert_allclose(recording.gyro, data["time"][1:, None] * slope, rtol=SINGLE)


def test_sensor_combined_is_read_where_asked_for(tmp_path):
    pytest.importorskip("pyulog")
    data = made_up()
    stamps = (1e6 * data["time"]).round().astype(int).tolist()
    rows = [(t, *w, *a) for t, w, a in zip(stamps, data["gyro"], data["accel"], strict=True)]
    ulog(tmp_path / "a.ulg", [("sensor_combined", 0, rows)])
    (recording,) = campaign(tmp_path, ["a.ulg"], 'topic = "sensor_combined"')
    check(recording, data | {"temperature": None}, rtol=SINGLE)
    said = refusal(read_recordings, tmp_path / "a.ulg")
    assert "no topic sensor_accel or sensor_gyro in the log; it has ['sensor_combined']" in said
    assert said.endswith(
        '[recordings] topic = "sensor_combined" reads that, which PX4 has corrected.'
    )


FIELD = np.array([0.21, -0.05, 0.43])  # gauss


def test_slower_sensors_of_a_ulog_are_in_the_rows_nearest_to_their_samples(tmp_path):
    pyulog = pytest.importorskip("pyulog")
    data = made_up()
    stamps = (1e6 * data["time"][5::10]).round().astype(int).tolist()
    late = (
        1e6 * float(np.median(np.diff(data["time"]))) / 4.0
    )  # of a row's distance: nearest is the row before
    mag = [(int(t + late), int(t + late), 7, *FIELD.tolist(), 30.0) for t in stamps]
    streams = [(f"sensor_{k}", 0, sensor_rows(data, k)) for k in ("accel", "gyro")]
    streams += [("sensor_mag", 0, mag), ("battery_status", 0, [(t, 12.5) for t in stamps])]
    streams += [("sensor_baro", 0, [(t, 1013.25) for t in stamps])]  # mbar, as before PX4 1.14
    ulog(tmp_path / "a.ulg", streams)
    theirs = pyulog.ULog(str(tmp_path / "a.ulg")).get_dataset("sensor_mag").data
    assert len(theirs["x"]) == len(stamps)
    (recording,) = read_recordings(tmp_path / "a.ulg")
    seen = np.flatnonzero(~np.isnan(recording.mag[:, 0]))
    np.testing.assert_array_equal(seen, np.arange(5, len(data["time"]), 10))
    np.testing.assert_allclose(
        recording.mag[seen], np.tile(1e-4 * FIELD, (len(seen), 1)), rtol=SINGLE
    )
    np.testing.assert_allclose(recording.pressure[seen], 101325.0, rtol=SINGLE)
    np.testing.assert_allclose(recording.current[seen], 12.5, rtol=SINGLE)
    assert np.isnan(recording.pressure[np.setdiff1d(np.arange(len(data["time"])), seen)]).all()


def test_units_of_a_ulog_may_be_mapped(tmp_path):
    pytest.importorskip("pyulog")
    data = made_up()
    raw_log(tmp_path / "a.ulg", data | {"accel": data["accel"] / 9.80665})
    columns = ColumnMap(accel=TriadColumns(unit="g"))
    (recording,) = read_recordings(tmp_path / "a.ulg", columns)
    check(recording, data, rtol=2 * SINGLE)


def test_bad_ulogs_are_refused_in_one_line(tmp_path, monkeypatch):
    pytest.importorskip("pyulog")
    path = tmp_path / "a.ulg"
    data = made_up()
    raw_log(path, data)
    whole = path.read_bytes()
    say = lambda **k: refusal(read_recordings, path, layout=Layout(**k))
    assert say(topic="vehicle_imu").startswith("a.ulg: topic 'vehicle_imu' is not read; one of ")
    assert say(instance=3) == "a.ulg: instance 3 of sensor_accel is missing; the log has [0]."

    path.write_bytes(b"no log")
    assert say() == "a.ulg: not a ULog: it does not begin with ULog's header."
    path.write_bytes(whole[:12])
    assert "damaged" in say()
    path.write_bytes(whole[:60])
    assert "corrupt" in say() or "damaged" in say()  # by pyulog's version

    # A log that ends within a message (the power was cut) is read up to there.
    path.write_bytes(whole[:-10])
    (recording,) = read_recordings(path)
    assert recording.num_samples == 399

    repeated = data | {"time": np.where(np.arange(400) == 9, data["time"][8], data["time"])}
    raw_log(path, repeated)
    assert "time must increase strictly" in say()
    broken = data | {"gyro": np.where(np.arange(400)[:, None] == 9, np.nan, data["gyro"])}
    raw_log(path, broken)
    assert "no finite number in 1 of 400 rows, first in row 9" in say()
    apart = [("sensor_accel", 0, sensor_rows(data, "accel"))]
    apart += [("sensor_gyro", 0, sensor_rows(data, "gyro", delay=100.0))]
    ulog(path, apart)
    assert "were not logged at the same time" in say()

    import sys

    monkeypatch.setitem(sys.modules, "pyulog", None)
    assert say() == "a.ulg: reading it needs the library pyulog: pip install 'inertiax[px4]'."


# Dataflash ---------------------------------------------------------------------------------------


def test_dataflash_messages_are_read_from_a_campaign(tmp_path):
    reader = pytest.importorskip("pymavlink.DFReader", reason="pymavlink is not installed")
    data = made_up()
    dataflash(tmp_path / "a.bin", data)
    log = reader.DFReader_binary(str(tmp_path / "a.bin"))
    first = log.recv_match(type="IMU").to_dict()
    log.close()
    assert first["AccZ"] == np.float32(data["accel"][0, 2])
    (recording,) = campaign(tmp_path, ["a.bin"])
    check(recording, data, rtol=SINGLE)


def test_every_imu_of_a_dataflash_log_is_a_device(tmp_path):
    data = made_up()
    dataflash(tmp_path / "a.bin", data, instances=(0, 1))
    assert [r.device for r in read_recordings(tmp_path / "a.bin")] == ["imu0", "imu1"]
    (one,) = campaign(tmp_path, ["a.bin"], "instance = 1")
    check(one, data, rtol=SINGLE)


def test_older_logs_without_probe_or_instance_are_read(tmp_path):
    data = made_up()
    columns = tuple(c for c in COLUMNS if c not in ("I", "T"))
    dataflash(tmp_path / "a.bin", data, columns=columns)
    (recording,) = read_recordings(tmp_path / "a.bin")
    check(recording, data | {"temperature": None}, rtol=SINGLE)


def test_stamps_in_milliseconds_of_old_logs_are_read(tmp_path):
    data = made_up() | {"time": 0.02 * np.arange(400)}
    dataflash(tmp_path / "a.bin", data, columns=("TimeMS", *COLUMNS[2:8]))
    (recording,) = read_recordings(tmp_path / "a.bin")
    check(recording, data | {"temperature": None}, rtol=SINGLE)


def test_slower_sensors_of_a_dataflash_log_come_without_the_compass_offsets(tmp_path):
    data = made_up()
    stamps = (1e6 * data["time"][3::20]).round().astype(int).tolist()
    offset, motor = np.array([12.0, -30.0, 5.0]), np.array([1.0, 2.0, -3.0])  # mgauss
    axes = "XYZ"
    fields = ("TimeUS", "I", *(f"{k}{a}" for k in ("Mag", "Ofs", "MO") for a in axes))
    told = (*(1e3 * FIELD + offset + motor).tolist(), *offset.tolist(), *motor.tolist())
    others = [
        ("MAG", fields, [(t, 0, *told) for t in stamps]),
        ("BARO", ("TimeUS", "I", "Press"), [(t, 0, 98000.0) for t in stamps]),
        ("BAT", ("TimeUS", "I", "Curr"), [(t, 0, 7.5) for t in stamps]),
    ]
    dataflash(tmp_path / "a.bin", data, others=others)
    (recording,) = read_recordings(tmp_path / "a.bin")
    seen = np.flatnonzero(~np.isnan(recording.mag[:, 0]))
    np.testing.assert_array_equal(seen, np.arange(3, len(data["time"]), 20))
    # Differences of 32-bit numbers of some hundred mgauss, in T.
    np.testing.assert_allclose(
        recording.mag[seen], np.tile(1e-4 * FIELD, (len(seen), 1)), atol=1e-11
    )
    np.testing.assert_allclose(recording.pressure[seen], 98000.0, rtol=SINGLE)
    np.testing.assert_allclose(recording.current[seen], 7.5, rtol=SINGLE)


def test_bad_dataflash_logs_are_refused_in_one_line(tmp_path):
    path = tmp_path / "a.bin"
    data = made_up()
    dataflash(path, data)
    whole = path.read_bytes()
    say = lambda **k: refusal(read_recordings, path, layout=Layout(**k))
    assert say(instance=2) == "a.bin: instance 2 of IMU is missing; the log has [0]."
    path.write_bytes(b"\0\1no log")
    assert say() == "a.bin: not a dataflash log: it does not begin with its header."
    path.write_bytes(whole[:150])
    assert "no IMU messages" in say() or "damaged" in say()
    dataflash(path, data, columns=tuple(c for c in COLUMNS if c != "AccY"))
    assert say().startswith("a.bin: field 'AccY' is missing in IMU; it has ")
    dataflash(path, data | {"time": data["time"][::-1]})
    assert "time must increase strictly" in say()
    dataflash(path, data | {"accel": np.where(np.arange(400)[:, None] == 3, np.nan, data["accel"])})
    assert "first in row 3" in say()
    # What is not a message, in the middle of a log, is passed over.
    path.write_bytes(whole[:-41] + b"\xa3\x95\xa3garbage" + whole[-41:])
    (recording,) = read_recordings(path)
    assert recording.num_samples == 400


def test_dataflash_fields_are_scaled_as_pymavlink_scales_them(tmp_path):
    reader = pytest.importorskip("pymavlink.DFReader", reason="pymavlink is not installed")
    sizes = {"c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "d": "d", "q": "q", "h": "h"}
    names = tuple(f"F{k}" for k in range(len(sizes)))
    layout, packed = "".join(sizes), "<" + "".join(sizes.values())
    body = struct.pack(
        "<BB4s16s64s", 0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"
    )
    content = HEAD + b"\x80" + body
    length = 3 + struct.calcsize(packed)
    described = (0x85, length, b"IMU", layout.encode(), ",".join(names).encode())
    content += HEAD + b"\x80" + struct.pack("<BB4s16s64s", *described)
    for k in range(3):
        content += HEAD + b"\x85" + struct.pack(packed, -k, k, 7 * k, k, -k, 0.1 * k, k, -k)
    (tmp_path / "a.bin").write_bytes(content)
    log = reader.DFReader_binary(str(tmp_path / "a.bin"))
    theirs = [log.recv_match(type="IMU").to_dict() for _ in range(3)]
    log.close()
    ((name, ours),) = messages(content, ("IMU",))
    assert name == "IMU"
    for field in names:
        np.testing.assert_allclose(ours[field], [t[field] for t in theirs], rtol=1e-15)
