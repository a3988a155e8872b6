"""`inertiax init` tells columns, units, clock and layout of logs that nobody described.

Logs are made here with NumPy and SciPy's rotations; the right units are the ones that were written.
"""

# pyright: reportOptionalSubscript=false, reportOptionalMemberAccess=false

import json
import re
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from scipy.spatial.transform import Rotation

from hand_log_data import ACCEL_BIAS, DEGREE, G, hand_log
from inertiax.calibrate.pipeline import calibrate
from inertiax.campaign_draft import draft_campaign
from inertiax.campaign_draft.column_triads import triads_by_name
from inertiax.campaign_draft.converters import TEMPERATURE_SCALES
from inertiax.campaign_draft.scale_notes import temperature_note, TemperatureNote
from inertiax.cli import main
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.gravity_turns import gravity_turns
from inertiax.reduction.rests import find_rests
from magnetometer_cases import field_of, HARD, slow_turns, SOFT


LOG = hand_log()
TIME, ACCEL, GYRO = LOG


def text(columns, delimiter=",", end="", digits=7):
    """A table of named columns; whole numbers are written as such."""
    written = [
        [
            str(int(v)) if np.issubdtype(np.asarray(x).dtype, np.integer) else f"{v:.{digits}g}"
            for v in x
        ]
        for x in columns.values()
    ]
    rows = (delimiter.join(row) + end for row in zip(*written, strict=True))
    return "\n".join([delimiter.join(columns), *rows]) + "\n"


def table(time, accel, gyro, names=("t", "ax", "ay", "az", "gx", "gy", "gz")):
    values = [time, *accel.T, *gyro.T] if time is not None else [*accel.T, *gyro.T]
    return dict(zip(names if time is not None else names[1:], values, strict=True))


def counts(values, scale):
    return np.round(values * scale).astype(int)


def drafted(tmp_path, content, name="log.csv", **settings):
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    found = draft_campaign(path, tmp_path, **settings)
    (tmp_path / "campaign.toml").write_text(found.text)
    return found, tomllib.loads(found.text)


def check(tmp_path, accel=ACCEL, gyro=GYRO, rtol=1e-3, count=0.0):
    """The written campaign reads the log in SI, to half of a gyro's `count` (rad/s)."""
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.accel, accel, rtol=rtol, atol=2e-3)
    np.testing.assert_allclose(recording.gyro, gyro, rtol=rtol, atol=2e-4 + 0.5 * count)
    return recording


UNITS = {
    "SI": (1.0, "m/s^2", 1.0, "rad/s"),
    "g and deg/s": (1 / G, "g", 1 / DEGREE, "deg/s"),
    "mg and rad/s": (1000 / G, "mg", 1.0, "rad/s"),
}


@pytest.mark.parametrize("accel, accel_unit, gyro, gyro_unit", UNITS.values(), ids=UNITS)
def test_gravity_tells_the_units(tmp_path, accel, accel_unit, gyro, gyro_unit):
    # No name says a unit.
    found, toml = drafted(tmp_path, text(table(TIME, accel * ACCEL, gyro * GYRO)))
    assert toml["columns"]["accel"] == {"names": ["ax", "ay", "az"], "unit": accel_unit}
    assert toml["columns"]["gyro"] == {"names": ["gx", "gy", "gz"], "unit": gyro_unit}
    assert toml["columns"]["time"] == {"name": "t", "unit": "s"}
    assert set(found.untold) == {"gravity"}
    check(tmp_path)


@pytest.mark.parametrize("per_g, per_degree", [(16384, 131.0), (4096, 65.5), (2048, 16.4)])
def test_counts_of_usual_converters(tmp_path, per_g, per_degree):
    log = table(None, counts(ACCEL / G, per_g), counts(GYRO / DEGREE, per_degree))
    _, toml = drafted(tmp_path, "Fs,50\nLogging Type,1\nWaiting time,3\n" + text(log))
    assert toml["recordings"]["header_line"] == 4
    assert toml["columns"]["time"] == {"rate": 50.0}
    assert toml["columns"]["accel"]["scale"] == per_g
    assert toml["columns"]["gyro"]["scale"] == per_degree
    check(tmp_path, rtol=0.01, count=DEGREE / per_degree)


def test_an_unknown_unsigned_converter_is_measured(tmp_path):
    # An Xsens MTi's raw data: 32768 means zero, 415 counts per m/s², 4775 counts per rad/s.
    log = table(TIME, counts(ACCEL, 415) + 32768, counts(GYRO, 4775) + 32768)
    _, toml = drafted(tmp_path, text(log))
    accel, gyro = toml["columns"]["accel"], toml["columns"]["gyro"]
    assert accel["offset"] == gyro["offset"] == 32768
    assert accel["scale"] == pytest.approx(415 * G, rel=0.01)
    assert gyro["scale"] == pytest.approx(4775 * DEGREE, rel=0.02)


@pytest.mark.parametrize(
    "name, factor, unit",
    [
        ("t", 1e3, "ms"),
        ("t_us", 1e6, "us"),
        ("SampleTimeFine", 1e6, "us"),
        ("stamp", 1e9, "ns"),
        ("Time (s)", 1, "s"),
    ],
)
def test_the_clock_s_unit(tmp_path, name, factor, unit):
    names = (name, "ax", "ay", "az", "gx", "gy", "gz")
    whole = np.round(TIME * factor).astype(int) if factor > 1 else TIME
    _, toml = drafted(tmp_path, text(table(whole, ACCEL, GYRO, names)))
    assert toml["columns"]["time"] == {"name": name, "unit": unit}
    np.testing.assert_allclose(np.diff(check(tmp_path).time), 0.02, atol=1e-6)


def test_a_log_without_a_clock_gets_its_rate_from_gravity(tmp_path):
    found, toml = drafted(tmp_path, text(table(None, ACCEL, GYRO / DEGREE)))
    assert toml["columns"]["time"] == {"rate": 50.0} and "time" in found.untold
    assert toml["columns"]["gyro"]["unit"] == "deg/s"


def test_stamps_in_bursts_become_a_rate(tmp_path):
    bunched = np.floor(np.arange(len(TIME)) / 20) * 0.4 + 0.002 * (np.arange(len(TIME)) % 20)
    _, toml = drafted(tmp_path, text(table(bunched, ACCEL, GYRO)))
    assert toml["columns"]["time"] == {"rate": 50.0}
    check(tmp_path)


def test_stamps_that_repeat_become_a_rate(tmp_path):
    coarse = np.floor(TIME * 10) / 10
    _, toml = drafted(tmp_path, text(table(coarse, ACCEL, GYRO)))
    assert toml["columns"]["time"] == {"rate": 50.0}


def test_iso_stamps_units_below_the_header_and_other_delimiters(tmp_path):
    stamps = [f"2026-03-01T10:{int(t // 60):02d}:{t % 60:06.3f}Z" for t in TIME]
    rows = text(table(TIME, ACCEL, GYRO), "\t", "\t").splitlines()
    body = "\n".join(
        s + "\t" + row.split("\t", 1)[1] for s, row in zip(stamps, rows[1:], strict=True)
    )
    units = "ISO\tm/s^2\tm/s^2\tm/s^2\trad/s\trad/s\trad/s\t"
    content = f"// Start Time: 0\n// Update Rate: 50.0Hz\n{rows[0]}\n{units}\n{body}\n"
    _, toml = drafted(tmp_path, content, "log.txt")
    assert toml["recordings"] == {"files": ["log.txt"], "header_line": 3, "start_row": 1}
    assert toml["columns"]["time"] == {"name": "t"}
    check(tmp_path)


def test_a_file_without_names_is_told_by_its_numbers(tmp_path):
    # Gyros before accelerometers, as some loggers write.
    names = ("t", "gx", "gy", "gz", "ax", "ay", "az")
    content = text(table(TIME, GYRO, ACCEL, names), " ").split("\n", 1)[1]
    _, toml = drafted(tmp_path, content, "log.txt")
    assert toml["recordings"]["names"] == [
        "time",
        "gyro_x",
        "gyro_y",
        "gyro_z",
        "accel_x",
        "accel_y",
        "accel_z",
    ]
    check(tmp_path)


@pytest.mark.parametrize("named", [False, True])
def test_a_flight_controller_s_two_files_are_one_log(tmp_path, named):
    """As `ulog2csv` writes them, twelve columns each; the second one given like a further log, or left out."""
    rows = {"accel": ACCEL, "gyro": GYRO}
    files = {t: tmp_path / f"hand_sensor_{t}_0.csv" for t in rows}
    for triad, values in rows.items():
        stamps = 1e6 * TIME + 1300.0 * (triad == "gyro")
        columns = np.column_stack([stamps + 620.0, stamps, np.full(len(TIME), 2490378), values])
        body = "".join(",".join(f"{v:.10g}" for v in row) + ",41.5,0,0,0,0,8\n" for row in columns)
        files[triad].write_text(
            "timestamp,timestamp_sample,device_id,x,y,z,temperature,error_count,clip_counter[0],clip_counter[1],"
            f"clip_counter[2],samples\n{body}"
        )
    others = [files["gyro"]] if named else []
    toml = tomllib.loads(draft_campaign(files["accel"], tmp_path, others=others).text)
    assert toml["recordings"]["files"] == ["hand_sensor_accel_0.csv"]
    assert toml["recordings"]["gyro_files"] == ["hand_sensor_gyro_0.csv"]
    assert toml["columns"]["gyro"] == {"names": ["x", "y", "z"], "unit": "rad/s"}


def test_triads_apart_are_found_beside_each_other(tmp_path):
    sparse = slice(0, None, 2)
    accel = np.column_stack([TIME, ACCEL])[sparse]
    gyro = np.column_stack([TIME + 0.003, GYRO / DEGREE])
    for name, values in (("gyroscope.txt", gyro), ("accelerometer.txt", accel)):
        rows = "".join(" ".join(f"{v:.7g}" for v in row) + "\n" for row in values)
        (tmp_path / name).write_text(rows)
    found = draft_campaign(tmp_path / "accelerometer.txt", tmp_path)
    toml = tomllib.loads(found.text)
    assert toml["recordings"]["gyro_files"] == ["gyroscope.txt"]
    assert toml["columns"]["gyro"] == {"unit": "deg/s"}
    (tmp_path / "campaign.toml").write_text(found.text)
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.gyro, GYRO[: recording.num_samples], atol=2e-6)


def test_poses_of_raw_counts(tmp_path):
    ups = np.random.default_rng(5).standard_normal((30, 3))
    ups = 4096 * ups / np.linalg.norm(ups, axis=1, keepdims=True) + [33100.5, 33270.25, 32360.75]
    rows = "".join(" ".join(f"{v:.6f}" for v in row) + "\n" for row in ups)
    _, toml = drafted(tmp_path, rows, "means.txt")
    assert toml["columns"]["position"] == {"row_index": True} and "time" not in toml["columns"]
    assert toml["columns"]["accel"]["offset"] == 32768
    assert toml["columns"]["accel"]["scale"] == pytest.approx(4096, rel=0.01)


@pytest.mark.parametrize(
    "values, unit",
    [
        (25 + TIME / 50, "degC"),
        (298 + TIME / 50, "K"),
        (np.round(340 * (28 - 36.53 + TIME / 50)).astype(int), "count"),
        (np.full(len(TIME), 5000.0) + TIME, None),
    ],
)
def test_the_temperature_s_unit(tmp_path, values, unit):
    found, toml = drafted(tmp_path, text(table(TIME, ACCEL, GYRO) | {"temp": values}))
    assert toml["columns"].get("temperature", {}).get("unit") == unit
    if unit is None:
        assert "CHECK temperature: temp reads 5000" in found.text
    if unit == "count":
        (recording,) = load_campaign(tmp_path).recordings
        np.testing.assert_allclose(recording.temperature[:, 0], 28 + TIME / 50, atol=0.01)
        assert (340.0, 36.53, "MPU-6050") in TEMPERATURE_SCALES


@pytest.mark.parametrize(
    "line, per_degree, zero",
    [
        ("# acc 4096 LSB/g, gyro 16.4 LSB/dps, temp 256 LSB/K, 0 = 23 degC", 256, 23),
        ("# Temperature: 0.0078125 °C/LSB, zero at 25 °C", 128, 25),
        ("// die temp 132,48 counts per °C (25 °C at 0)", 132.48, 25),
        ("# temp scale 64 LSB/degC; -5.5 degC at 0 LSB", 64, -5.5),
    ],
)
def test_a_scale_of_the_temperature_above_the_names(tmp_path, line, per_degree, zero):
    """No data sheet that is known here; the lines are written as firmware prints its settings."""
    celsius = 28 + TIME / 50
    counts = np.round(per_degree * (celsius - zero)).astype(int)
    found, _ = drafted(tmp_path, line + "\n" + text(table(TIME, ACCEL, GYRO) | {"temp": counts}))
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.temperature[:, 0], celsius, atol=0.51 / per_degree)
    assert "CHECK temperature" not in found.text


def test_a_scale_with_its_zero_goes_before_one_without():
    without = ["# temp 256 LSB/K", "# acc 16384 LSB/g, 0 = 23 mg, temp in counts"]
    assert temperature_note(without) == TemperatureNote(256.0, None)
    assert temperature_note([*without, "T: 128 LSB/K, 0 = 25 degC"]) == TemperatureNote(128.0, 25.0)
    assert temperature_note(["# acc 16384 LSB/g, 0 = 23 mg", "# started at 10:00"]) is None


def test_inav_logs_tenths_of_a_degree(tmp_path):
    """409 was 37.7 °C by another sensor's data sheet, and a warm-up of 5 °C one of 0.15 °C."""
    tenths = np.round(10.0 * (38.0 + TIME / TIME[-1] * 5.0)).astype(int)
    found, _ = drafted(tmp_path, text(table(TIME, ACCEL, GYRO) | {"imuTemperature": tenths}))
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.temperature[:, 0], tenths / 10.0, rtol=1e-12)
    assert "CHECK temperature" not in found.text


def test_gravity_of_the_place(tmp_path):
    # WGS 84 at 45.5° by Somigliana's closed form, less the free-air gradient of 3.0855e-6 per s² at this latitude.
    _, toml = drafted(tmp_path, text(table(TIME, ACCEL, GYRO)), latitude=45.5, height=300.0)
    sine = np.sin(np.radians(45.5)) ** 2
    on_ellipsoid = (
        9.7803253359 * (1 + 0.00193185265241 * sine) / np.sqrt(1 - 0.00669437999013 * sine)
    )
    assert toml["site"]["gravity"] == pytest.approx(on_ellipsoid - 3.0855e-6 * 300, abs=2e-5)
    assert toml["site"]["latitude"] == 45.5


def test_gyros_alone_at_rest_are_a_guess_and_said_to_be_one(tmp_path):
    still = {k: v for k, v in table(TIME, ACCEL, GYRO / DEGREE).items() if k[0] != "a"}
    rest = {k: v[:200] for k, v in still.items()}
    found, toml = drafted(tmp_path, text(rest))
    assert toml["columns"]["gyro"]["unit"] == "deg/s" and "gyro" in found.untold


def test_what_contradicts_gravity_is_said(tmp_path):
    mirrored = GYRO * [1.0, -1.0, 1.0]
    found, _ = drafted(tmp_path, text(table(TIME, ACCEL, mirrored)))
    assert "exchanged or mirrored" in found.untold["gyro"]
    names = ("t", "ax", "ay", "az", "gx [deg/s]", "gy [deg/s]", "gz [deg/s]")
    found, toml = drafted(tmp_path, text(table(TIME, ACCEL, GYRO, names)))
    assert toml["columns"]["gyro"]["unit"] == "rad/s"
    assert "but the file says deg/s" in found.untold["gyro"]


def test_two_poses_are_said_to_be_too_few(tmp_path):
    rows = slice(0, 400)
    found, _ = drafted(tmp_path, text(table(TIME[rows], ACCEL[rows], GYRO[rows])))
    assert "2 poses: bias, scale and misalignments" in found.text


def test_one_pose_gets_the_estimator_that_it_allows(tmp_path):
    rows = slice(0, 200)
    _, toml = drafted(tmp_path, text(table(TIME[rows], ACCEL[rows], GYRO[rows])))
    assert toml["model"] == {"accel_estimator": "static"}


@pytest.mark.parametrize(
    "names, triads",
    [
        (("Acc_X", "Acc_Y", "Acc_Z", "Mag_X"), [("Acc_X", "Acc_Y", "Acc_Z")]),
        (("xacc", "yacc", "zacc"), [("xacc", "yacc", "zacc")]),
        (("a1", "a2", "a3", "g1"), [("a1", "a2", "a3")]),
        (("t", "exact", "x"), []),
    ],
)
def test_triads_are_names_that_differ_in_their_axis(names, triads):
    assert triads_by_name(names) == triads


def test_gravity_s_turn_agrees_with_scipy_s_rotations():
    rests = find_rests(Recording(time=TIME, accel=ACCEL), window=1.0)
    means = np.array(
        [
            (ACCEL - ACCEL_BIAS)[a:b].mean(axis=0)
            for a, b in zip(rests.start, rests.stop, strict=True)
        ]
    )
    up = means / np.linalg.norm(means, axis=1, keepdims=True)
    turns = gravity_turns(TIME, GYRO, up, rests.start, rests.stop)
    left = []
    for steps, before, after in zip(turns.output, turns.before, turns.after, strict=True):
        turned = before
        for step in steps:
            turned = Rotation.from_rotvec(-0.9 * step).apply(turned)
        left.append(np.arccos(np.clip(turned @ after, -1, 1)))
    assert turns.misfit(0.9) == pytest.approx(np.median(left), rel=1e-9)
    assert turns.best([1.0, DEGREE])[0] == pytest.approx(1.0, rel=0.01)


def test_a_log_of_its_rests_alone_says_nothing_of_the_gyros_turns(tmp_path):
    """The rows of the motions are missing, as where each position is recorded by itself."""
    still = np.arange(len(TIME)) % 275 < 200  # 4 s at rest, 1.5 s of turning, at 50 Hz
    rests = find_rests(Recording(time=TIME, accel=ACCEL), window=1.0)
    edges = np.searchsorted(np.flatnonzero(still), [rests.start, rests.stop])
    up = np.array([ACCEL[a:b].mean(axis=0) for a, b in zip(rests.start, rests.stop)])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    assert gravity_turns(TIME[still], GYRO[still], up, *edges) is None


def run(arguments, capfd):
    with pytest.raises(SystemExit) as ended:
        main([str(a) for a in arguments])
    return int(ended.value.code or 0), capfd.readouterr()


def test_the_command_writes_a_campaign_that_reads_the_log(tmp_path, capfd):
    log = tmp_path / "logs" / "hand.csv"
    log.parent.mkdir()
    log.write_text("rate,50\nmode,0\n" + text(table(TIME, ACCEL, GYRO)))
    status, said = run(["init", log, "-o", tmp_path / "campaign", "--json"], capfd)
    assert status == 0
    told = json.loads(said.out)
    assert told["schema"] == "inertiax.init/1" and told["problem"] is None
    assert list(told["untold"]) == ["gravity"]
    (recording,) = load_campaign(Path(told["campaign"])).recordings
    np.testing.assert_allclose(recording.accel, ACCEL, atol=1e-5)


def test_the_command_prints_which_columns_no_line_reads(tmp_path, capfd):
    """A table's rate that was joined wrongly and stays at one number: the campaign is one without a table."""
    log = tmp_path / "hand.csv"
    head, rows = text(table(TIME, ACCEL, GYRO)).split("\n", 1)
    log.write_text(f"{head},table_rate\n" + "".join(f"{r},-0.004\n" for r in rows.splitlines()))
    status, said = run(["init", log, "--latitude", "50"], capfd)
    assert status == 0 and said.out.startswith('Not read: "table_rate".\nwritten: ')
    assert json.loads(run(["init", log, "--replace", "--json"], capfd)[1].out)["unread"] == [
        'Not read: "table_rate".'
    ]


def test_the_command_replaces_nothing_unasked(tmp_path, capfd):
    log = tmp_path / "hand.csv"
    log.write_text(text(table(TIME, ACCEL, GYRO)))
    assert run(["init", log], capfd)[0] == 0
    first = (tmp_path / "campaign.toml").read_text()
    status, said = run(["init", log], capfd)
    assert status == 2 and "is there already; --replace replaces it" in said.err
    assert run(["init", log, "--replace", "--latitude", "50"], capfd)[0] == 0
    assert (tmp_path / "campaign.toml").read_text() != first


SERIAL = {  # a line, and what the refusal says
    "labels": ("{:.2f},ACCEL: X={:.4f},Y={:.4f},Z={:.4f}", "behind labels ('ACCEL: X="),
    "plotter": ("{:.2f},ax:{:.4f},ay:{:.4f},az:{:.4f}", "behind labels ('ax:"),
    "monitor": ("12:00:{:06.3f} -> {:.4f},{:.4f},{:.4f}", "a serial monitor's stamps"),
    "cut": ("{:.2f},{:.4f},{:.4f},{:.4f}", "1 of 1001 lines are cut off ('1.98,"),
}


@pytest.mark.parametrize("line, reason", SERIAL.values(), ids=SERIAL)
def test_a_serial_port_s_text_is_refused_with_a_cure_that_works(tmp_path, capfd, line, reason):
    rows = [line.format(*values) for values in np.column_stack([TIME, ACCEL])[:1000]]
    if "cut" in reason:
        rows[99] = rows[99].rpartition(",")[0]
        rows = ["t,ax,ay,az", *rows]
    (tmp_path / "a.log").write_text("\n".join(rows) + "\n")
    status, said = run(["init", tmp_path / "a.log"], capfd)
    assert status == 1 and reason in said.err
    cure = re.search(r"(?:\(echo|sed|awk) .* > (\S+)", said.err)
    subprocess.run(cure[0], shell=True, cwd=tmp_path, check=True)
    assert run(["init", tmp_path / cure[1]], capfd)[0] == 0
    (recording,) = load_campaign(tmp_path).recordings
    kept = np.delete(ACCEL[:1000], 99, axis=0) if "cut" in reason else ACCEL[:1000]
    np.testing.assert_allclose(recording.accel, kept, atol=1e-4)


def test_a_log_that_is_none_is_refused_in_a_line(tmp_path, capfd):
    (tmp_path / "a.csv").write_text("colour,shape\nred,round\nblue,square\n")
    status, said = run(["init", tmp_path / "a.csv"], capfd)
    assert status == 1 and said.err.count("\n") == 1 and "no column of numbers" in said.err
    assert not (tmp_path / "campaign.toml").exists()


def test_gravity_tells_the_accelerometers_where_their_names_do_not(tmp_path):
    """`tx ty tz` of a public log over ROS; a magnetometer's and a quaternion's columns stand beside it."""
    field = Rotation.from_rotvec(np.linspace(0, 3, len(TIME))[:, None] * [0.2, 1.0, 0.3]).as_quat()
    columns = table(TIME, ACCEL, GYRO, ("time", "tx", "ty", "tz", "wx", "wy", "wz"))
    columns |= dict(zip(("mx", "my", "mz"), 0.4 * field[:, :3].T, strict=True))
    columns |= dict(zip(("qx", "qy", "qz", "qw"), field.T, strict=True))
    _, tables = drafted(tmp_path, text(columns))
    assert tables["columns"]["accel"] == {"names": ["tx", "ty", "tz"], "unit": "m/s^2"}
    assert tables["columns"]["gyro"] == {"names": ["wx", "wy", "wz"], "unit": "rad/s"}


def test_a_folder_that_is_no_recording_is_refused_with_its_logs(tmp_path, capfd):
    folder = tmp_path / "A"
    folder.mkdir()
    (folder / "notes.md").write_text("of a day")
    status, said = run(["init", folder], capfd)
    assert status == 1 and "A: is a folder" in said.err and "name a recording" in said.err
    (folder / "log.csv").write_text("time,accel_x\n")
    status, said = run(["init", folder], capfd)
    assert status == 1 and f"inertiax init {folder / 'log.csv'}" in said.err
    assert said.err.count("\n") == 1 and not (tmp_path / "campaign.toml").exists()


def test_signed_readings_written_as_unsigned_are_refused_with_the_cure(tmp_path):
    accel, gyro = counts(ACCEL / G, 16384), counts(GYRO / DEGREE, 131.0)
    log = tmp_path / "log.csv"
    log.write_text(text(table(TIME, accel % 65536, gyro % 65536)))
    with pytest.raises(
        ValueError, match="accelerometers are whole .* 65536 from every value above 32767"
    ):
        draft_campaign(log, tmp_path)
    log.write_text(text(table(TIME, accel, gyro)))
    assert "count" in draft_campaign(log, tmp_path).text  # signed, they are read
    middle = 32768 + counts(
        GYRO, DEGREE / 131.0
    )  # an unsigned converter with its zero in the middle
    log.write_text(text(table(TIME, 32768 + accel, middle)))
    assert "offset = 32768.0" in draft_campaign(log, tmp_path).text


@pytest.mark.parametrize("suffix", [".mat", ".h5"])
def test_matrices_under_a_users_own_names(tmp_path, suffix):
    """A struct-free MATLAB file, or an HDF5 file, with a matrix for each triad and a vector of stamps."""
    arrays = {
        "t_ms": 1e3 * TIME,
        "static_acc": ACCEL / G,
        "omega": GYRO / DEGREE,
        "fs": np.array([50.0]),
    }
    if suffix == ".mat":
        scipy.io.savemat(tmp_path / "log.mat", arrays)
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(tmp_path / "log.h5", "w") as file:
            for name, values in arrays.items():
                file[name] = values
    found = draft_campaign(tmp_path / f"log{suffix}", tmp_path)
    (tmp_path / "campaign.toml").write_text(found.text)
    toml = tomllib.loads(found.text)
    assert toml["columns"]["accel"]["unit"] == "g" and toml["columns"]["gyro"]["unit"] == "deg/s"
    assert toml["columns"]["time"] == {"name": "t_ms", "unit": "ms"}
    check(tmp_path)


def test_means_of_poses_of_a_consumer_sensor_are_taken_as_such(tmp_path):
    """24 rows a pose with biases of 0.03 g: their norms differ by 8 %, and no name says what they are."""
    rng = np.random.default_rng(4)
    up = rng.standard_normal((24, 3))
    poses = up / np.linalg.norm(up, axis=1, keepdims=True) * [1.01, 0.99, 1.0] + [0.03, -0.03, 0.02]
    assert 0.06 < np.ptp(np.linalg.norm(poses, axis=1)) < 0.12
    scipy.io.savemat(tmp_path / "log.mat", {"LowCostSensors": poses.T})
    found = tomllib.loads(draft_campaign(tmp_path / "log.mat", tmp_path).text)
    assert found["columns"]["position"] == {"row_index": True}
    assert found["columns"]["accel"]["unit"] == "g"
    assert found["columns"]["accel"]["names"][0] == "LowCostSensors_x"


def test_a_device_that_never_rested_has_the_unit_of_its_samples(tmp_path):
    """Turned slowly throughout: the mean over a turn is far shorter than 1 g."""
    t = np.arange(4000) / 100.0
    pitch, yaw = 0.5 * t, 0.31 * t
    force = np.stack(
        [np.sin(pitch), np.cos(pitch) * np.sin(yaw), np.cos(pitch) * np.cos(yaw)], axis=1
    )
    log = tmp_path / "log.csv"
    log.write_text(text(dict(zip(("ax", "ay", "az"), force.T, strict=True))))
    found = tomllib.loads(draft_campaign(log, tmp_path).text)
    assert found["columns"]["accel"] == {"names": ["ax", "ay", "az"], "unit": "g"}
    assert "accel_estimator" not in found.get("model", {})  # it is no log of one pose
    about_one_axis = np.stack([np.sin(pitch), np.cos(pitch), np.zeros_like(t)], axis=1)
    tilted = Rotation.from_euler("xyz", [0.3, 0.5, 0.0]).apply(about_one_axis)
    tumbled = Recording(time=t, accel=G * tilted)
    with pytest.raises(ValueError, match="the device moves all the time; even in the quietest"):
        reduce_to_dwells([tumbled])
    seen = check_campaign(Campaign((tumbled,), Site(gravity=G)))
    assert [(f.kind, f.what) for f in seen.findings] == [("no_rest", "accel")]


def slowly_turned(rows=4000, seed=3):
    """Outputs of magnetometers with hard and soft iron in µT while the device turns all ways, T turned to µT."""
    rng = np.random.default_rng(seed)
    field = 1e6 * field_of(slow_turns(rows, rng, 0.03))
    return field @ (np.eye(3) + SOFT).T + 1e6 * HARD + 0.05 * rng.standard_normal((rows, 3))


@pytest.mark.parametrize("unit, size", [("uT", 1.0), ("mgauss", 10.0), ("nT", 1000.0)])
def test_magnetometers_alone_and_turned_slowly_have_a_campaign(tmp_path, unit, size):
    log = tmp_path / "log.csv"
    values = size * slowly_turned()
    columns = {"t": np.arange(len(values)) / 50.0, **dict(zip(("mx", "my", "mz"), values.T))}
    log.write_text(text(columns))
    made = draft_campaign(log, tmp_path)
    found = tomllib.loads(made.text)
    assert found["columns"]["mag"] == {"names": ["mx", "my", "mz"], "unit": unit}
    assert "accel" not in found["columns"] and "model" not in found
    (tmp_path / "campaign.toml").write_text(made.text)
    (result,) = calibrate(load_campaign(tmp_path / "campaign.toml"))
    mag = result.calibration.mag
    # Frame and scale are its own; the hard iron is in neither. Half a µT is a hundredth of the field.
    assert np.abs(np.asarray(mag.errors(25.0).bias) - HARD).max() < 5e-7


def test_magnetometers_that_were_hardly_turned_are_refused_in_a_line(tmp_path):
    log, still = tmp_path / "log.csv", slowly_turned(400)[:20].repeat(20, axis=0)
    log.write_text(text(dict(zip(("mx", "my", "mz"), still.T))))
    with pytest.raises(ValueError, match="mx, my, mz do not tell their unit, for the device"):
        draft_campaign(log, tmp_path)


STATION = {
    "g, deg/s": (1 / G, 1 / DEGREE, "g", "deg/s", ("ref_a{}_g", "ref_g{}_dps")),
    "SI": (1.0, 1.0, "m/s^2", "rad/s", ("table_acc_{}", "cmd_gyro_{}")),
    "mg, deg/h": (1000 / G, 3600 / DEGREE, "mg", "deg/h", ("ACC_REF_{}", "rate_ref_{}")),
}


@pytest.mark.parametrize("per_force, per_rate, force, rate, names", STATION.values(), ids=STATION)
@pytest.mark.parametrize("moving", [0, -1])
def test_a_station_s_references_and_its_label_for_moving(
    tmp_path, per_force, per_rate, force, rate, names, moving
):
    rng = np.random.default_rng(21)
    up = rng.standard_normal((12, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    ideal, turn, label = [], [], []
    for number in range(1, 16):
        spin = 0.7 * np.eye(3)[number % 3] if number > 12 else np.zeros(3)
        at = G * (up[number - 1] if number <= 12 else np.array([0.0, 0.0, 1.0]))
        for rows, told in ((20, 0.0), (80, 1.0)):
            ideal += [told * at] * rows
            turn += [told * spin] * rows
            label += [number if told else moving] * rows
    ideal, turn, label = np.array(ideal), np.array(turn), np.array(label)
    accel = ideal * 1.004 + 0.02 + 0.01 * rng.standard_normal(ideal.shape)
    gyro = turn * 0.997 + 1e-3 + 1e-4 * rng.standard_normal(turn.shape)
    columns = {"time": np.arange(len(label)) / 50.0}
    columns |= {f"a{a}": accel[:, k] * per_force for k, a in enumerate("xyz")}
    columns |= {f"gyro_{a}_{rate}": gyro[:, k] * per_rate for k, a in enumerate("xyz")}
    columns |= {names[0].format(a): ideal[:, k] * per_force for k, a in enumerate("xyz")}
    columns |= {names[1].format(a): turn[:, k] * per_rate for k, a in enumerate("xyz")}
    content = text(columns | {"pose": label})
    (tmp_path / "again.csv").write_text(content)
    found, made = drafted(tmp_path, content, others=[tmp_path / "again.csv"])
    assert made["recordings"]["files"] == ["log.csv", "again.csv"]
    told = made["columns"]
    assert told["reference_accel"] == {"names": [names[0].format(a) for a in "xyz"], "unit": force}
    assert told["reference_gyro"] == {"names": [names[1].format(a) for a in "xyz"], "unit": rate}
    assert told["position"] == ({"name": "pose", "moving": 0} if moving == 0 else "pose")
    assert made["site"]["gravity"] == pytest.approx(G, rel=1e-5) and "gravity" not in found.untold
    assert "gyro" not in found.untold and "# [rig]\n# position_uncertainty" in found.text
    first, second = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(first.reference_accel, ideal, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(second.reference_gyro, turn, rtol=1e-6, atol=1e-9)
    assert np.all(first.position[label == moving] == -1)


def test_positions_are_told_by_the_reference_where_their_name_is_not(tmp_path):
    rng = np.random.default_rng(22)
    label = np.repeat([999, 1, 999, 2, 999, 3, 999, 4], 60)
    up = np.array([[0, 0, 1.0], [0, 1, 0], [1, 0, 0], [0, 0, -1], [0, -0.6, 0.8]])
    force = G * up[np.where(label == 999, 0, label)]
    told = np.where((label == 999)[:, None], "", np.round(force, 6).astype(str))
    accel = force + 0.01 * rng.standard_normal(force.shape)
    head = "t,counter,fx,fy,fz,T_imu,step,true_fx,true_fy,true_fz"
    rows = [
        ",".join(
            [
                f"{0.02 * k:.2f}",
                str(k),
                *(f"{v:.5f}" for v in accel[k]),
                "21.5",
                str(label[k]),
                *told[k],
            ]
        )
        for k in range(len(label))
    ]
    found, made = drafted(tmp_path, "\n".join([head, *rows]) + "\n")
    assert made["columns"]["position"] == {"name": "step", "moving": 999}, found.text
    assert made["columns"]["temperature"]["name"] == "T_imu"
    (recording,) = load_campaign(tmp_path).recordings
    assert np.all(recording.position[label == 999] == -1) and recording.position.max() == 4
    (tmp_path / "campaign.toml").write_text(
        "\n".join(x for x in found.text.splitlines() if not x.startswith("position"))
    )
    with pytest.raises(
        ValueError, match=r"may be empty while the table moves: \[columns\] position"
    ):
        load_campaign(tmp_path)


def test_logs_of_other_columns_are_no_campaign_together(tmp_path):
    (tmp_path / "b.csv").write_text("t,ax,ay,az\n0,0,0,9.8\n0.01,0,0,9.8\n")
    with pytest.raises(
        ValueError, match=r"b.csv: has no column 'gx', 'gy', 'gz', which log.csv has"
    ):
        drafted(tmp_path, text(table(TIME, ACCEL, GYRO)), others=[tmp_path / "b.csv"])
