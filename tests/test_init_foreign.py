"""Files as people publish them: what a draft makes of columns that nobody named, and of files that are no recording.

The contents are made here, after the forms of public logs.
"""

import struct
import subprocess
import sys
import tomllib

import numpy as np
import pytest
import scipy.io
from scipy.spatial.transform import Rotation

from command_runs import run
from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.campaign_draft import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, ModelChoice, Recording, Site


G = 9.80665
RATE, ROWS = 50.0, 2000
TIME = np.arange(ROWS) / RATE


def hand(seed=0):
    """Force (m/s²) and rate (rad/s) of a device that is laid down five times on its way."""
    rng = np.random.default_rng(seed)
    rate = np.zeros((ROWS, 3))
    for k in range(4):
        rate[400 * k + 300 : 400 * k + 360] = rng.choice([-1.0, 1.0], 3) * rng.uniform(0.5, 1.5, 3)
    attitude, force = Rotation.identity(), np.empty((ROWS, 3))
    for k in range(ROWS):
        force[k] = attitude.inv().apply([0.0, 0.0, G])
        attitude = attitude * Rotation.from_rotvec(rate[k] / RATE)
    force += 0.01 * rng.standard_normal(force.shape)
    return force, rate + 0.01 + 0.001 * rng.standard_normal(rate.shape)


FORCE, TURNS = hand()


def drafted(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    found = draft_campaign(path, path.parent)
    (path.parent / "campaign.toml").write_text(found.text)
    return found, tomllib.loads(found.text)


def lines(*columns, form="{:.6g}", end=""):
    rows = zip(*columns, strict=True)
    return (
        "\n".join(
            ",".join(x if isinstance(x, str) else form.format(x) for x in r) + end for r in rows
        )
        + "\n"
    )


def read(folder):
    (recording,) = load_campaign(folder).recordings
    np.testing.assert_allclose(recording.accel, FORCE, atol=2e-3)
    np.testing.assert_allclose(recording.gyro, TURNS, atol=2e-3)


def test_a_matrix_without_names_is_told_by_its_numbers(tmp_path):
    scipy.io.savemat(tmp_path / "log.mat", {"cal_data": np.column_stack([TIME, FORCE, TURNS])})
    found = draft_campaign(tmp_path / "log.mat", tmp_path)
    (tmp_path / "campaign.toml").write_text(found.text)
    columns = tomllib.loads(found.text)["columns"]
    assert columns["time"]["name"] == "cal_data_0"
    assert columns["accel"]["names"] == ["cal_data_1", "cal_data_2", "cal_data_3"]
    read(tmp_path)


def test_a_file_of_matlab_objects_is_refused_with_the_lines_that_write_it_as_text(tmp_path):
    """MATLAB Mobile's export: timetables, whose values MATLAB keeps in an array without a name."""
    element = lambda kind, data: (
        struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)
    )
    made = b""
    for name in (b"Acceleration", b"AngularVelocity"):
        inside = element(6, struct.pack("<II", 17, 0)) + element(1, name)
        inside += element(1, b"MCOS") + element(1, b"timetable")
        made += element(14, inside)
    values = element(6, struct.pack("<II", 9, 0)) + element(5, struct.pack("<ii", 1, 24))
    made += element(14, values + element(1, b"") + element(2, bytes(24)))
    head = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x01IM"
    path = tmp_path / "phone.mat"
    path.write_bytes(head + made)
    with pytest.raises(
        ValueError,
        match=r"objects alone \(Acceleration: timetable, Ang.*posixtime.*accelerometer.csv",
    ):
        draft_campaign(path, tmp_path)


@pytest.mark.parametrize(
    "unit, said, size", [("uT", "(uT)", 1.0), ("gauss", "(G)", 0.01), ("mgauss", "[mG]", 10.0)]
)
def test_the_file_s_word_counts_for_magnetometers_that_were_hardly_turned(
    tmp_path, unit, said, size
):
    noise = np.random.default_rng(6).standard_normal((ROWS, 3))
    field = size * ([18.0, -4.0, -42.0] + 0.05 * noise)
    names = [
        "t",
        *(f"Accelerometer {a} (g)" for a in "XYZ"),
        *(f"Magnetometer {a} {said}" for a in "XYZ"),
    ]
    content = (
        ",".join(names) + "\n" + lines(TIME, *(np.array([[0.0, 0.1, 1.0]]) + 0 * FORCE).T, *field.T)
    )
    _, tables = drafted(tmp_path / "log.csv", content)
    assert tables["columns"]["mag"]["unit"] == unit


def test_canonical_magnetometers_are_not_read_in_tesla_for_want_of_a_line(tmp_path):
    names = "t,accel_x,accel_y,accel_z,mag_x,mag_y,mag_z\n"
    field = np.tile([18.0, -4.0, -42.0], (ROWS, 1))
    found, tables = drafted(tmp_path / "log.csv", names + lines(TIME, *FORCE.T, *field.T))
    assert tables["columns"]["mag"]["unit"] == "uT" and "mag" in found.untold


@pytest.mark.parametrize("header", ["", "x,y,z\n"])
def test_three_columns_without_a_name_that_read_a_field_are_magnetometers(tmp_path, header):
    directions = Rotation.random(ROWS, random_state=2).apply([0.0, 0.0, 1.0])
    found, tables = drafted(
        tmp_path / "log.csv", header + lines(*(54.3 * directions + [11.0, 21.0, -20.0]).T)
    )
    assert tables["columns"]["mag"]["unit"] == "uT" and "accel" not in tables["columns"]
    assert "mag" in found.untold  # it is said that no name told it
    assert load_campaign(tmp_path).recordings[0].mag is not None


@pytest.mark.parametrize("renewals", [0, 30])
def test_the_system_s_estimate_of_a_bias_is_no_sensor(tmp_path, renewals):
    """As Android writes an uncalibrated sensor: x, y, z, and three that stand still until the system renews them."""
    rng = np.random.default_rng(4)
    directions = Rotation.random(ROWS, random_state=2).apply([0.0, 0.0, 1.0])
    estimate = np.tile([57.772, -73.669, 411.086], (ROWS, 1))
    for row in rng.integers(1, ROWS, renewals):
        estimate[row:] += rng.normal(0.0, 0.5, 3)
    field = 54.3 * directions + estimate[0]
    found, tables = drafted(tmp_path / "magnetometer.txt", lines(TIME, *field.T, *estimate.T))
    assert not {"accel", "gyro"} & set(tables["columns"]) and "system's estimate" in found.text
    np.testing.assert_allclose(load_campaign(tmp_path).recordings[0].mag, 1e-6 * field, rtol=1e-4)


def test_gyros_behind_accelerometers_are_no_estimate_though_they_rest_for_long(tmp_path):
    """Of a coarse converter: rates of 0.07 deg/s a step, which change while the device is turned alone."""
    step = np.radians(0.07)
    still = np.abs(TURNS - 0.01).max(axis=1) < 0.1
    gyro = np.where(still[:, None], step, step * np.round(TURNS / step))
    _, tables = drafted(tmp_path / "log.csv", lines(TIME, *FORCE.T, *gyro.T))
    assert {"accel", "gyro"} <= set(tables["columns"])


def test_seconds_since_1970_and_labels_are_no_outputs(tmp_path):
    label = np.arange(ROWS) % 3
    seconds = np.floor(1.7468e9 + TIME)
    content = lines(seconds, label, *FORCE.T, *TURNS.T, form="{:.12g}")
    _, tables = drafted(tmp_path / "log.csv", content)
    names = tables["recordings"]["names"]
    assert names[:3] == ["column_1", "column_2", "accel_x"] and names[-1] == "gyro_z"
    read(tmp_path)


def test_a_phone_app_s_marks_of_the_kind_of_sensor_and_its_blank_lines(tmp_path):
    """Time, 3, x, y, z, 4, x, y, z; between the rows a line of two blanks."""
    marks = [np.full(ROWS, k) for k in (3.0, 4.0)]
    content = lines(31.5 + TIME, marks[0], *FORCE.T, marks[1], *TURNS.T, form="{:.9g}", end="\n  ")
    _, tables = drafted(tmp_path / "log.csv", content)
    assert [n[:-2] for n in tables["recordings"]["names"]] == [
        "ti", "column", "accel", "accel", "accel", "column", "gyro", "gyro", "gyro",
    ]  # fmt: skip
    read(tmp_path)


def test_sentences_with_a_checksum(tmp_path):
    """Attitude, field, force and rates behind a word of text; the checksum is glued to the last number."""
    other = np.tile([175.9, -9.4, 19.8, -0.1, 0.2, 0.56], (ROWS, 1))
    rows = lines(["$VNYMR"] * ROWS, *other.T, *FORCE.T, *TURNS.T)
    content = "".join(f"{row}*{k % 256:02X}\r\n" for k, row in enumerate(rows.splitlines()))
    _, tables = drafted(tmp_path / "log.txt", content)
    assert tables["recordings"]["names"][7:] == [
        f"{k}_{a}" for k in ("accel", "gyro") for a in "xyz"
    ]
    read(tmp_path)


def test_stamps_that_begin_anew_keep_their_step(tmp_path):
    runs = np.tile(np.arange(200) / 200.0, 10)
    found, tables = drafted(tmp_path / "log.csv", "t,gx,gy,gz\n" + lines(runs, *TURNS.T))
    assert tables["columns"]["time"] == {"name": "t", "unit": "s", "mend": True}
    assert "begins anew at row 200, 400, 600, 800 …" in found.untold["time"]


@pytest.mark.parametrize(
    "names",
    [
        "Time (s),Linear Acceleration x (m/s^2),Linear Acceleration y (m/s^2),Linear Acceleration z (m/s^2)",
        "t,x,y,z",
    ],
)
def test_an_acceleration_without_gravity_is_refused_with_the_one_to_take(tmp_path, names):
    rng = np.random.default_rng(1)
    shaken = rng.standard_normal((ROWS, 3)) * rng.exponential(1.5, (ROWS, 1))
    path = tmp_path / "log.csv"
    path.write_text(f"{names}\n{lines(TIME, *shaken.T)}")
    with pytest.raises(
        ValueError, match="from which an app has taken gravity .* TotalAcceleration"
    ):
        draft_campaign(path, tmp_path)


def test_a_packed_file_is_to_be_unpacked(tmp_path):
    path = tmp_path / "log.gz"
    path.write_bytes(b"\x1f\x8b\x08\x00" + bytes(40))
    with pytest.raises(ValueError, match="it is packed; unpack it first"):
        draft_campaign(path, tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "cure"),
    [
        ("log.json", b'[\n {"t": 0.0, "ax": 1.0}]', r"DataFrame\(json.load\(open\('log.json'\)\)\)"),
        ("log.txt", b'{"t": [0.0, 0.1], "ax": [1.0, 1.0]}', r"DataFrame\(json.load\(open"),
        ("log.jsonl", b'{"t": 0.0, "ax": 1.0}\n{"t": 0.1, "ax": 1.0}\n', r"read_ndjson\('log.jsonl'\)"),
        ("log.tdms", b"TDSm\x0e\x00", r"TdmsFile.read\('log.tdms'\)"),
        ("log.mf4", b"MDF     4.10\x00", r"asammdf.MDF\('log.mf4'\)"),
        ("log.feather", b"ARROW1\x00\x00", r"read_ipc\('log.feather'\)"),
        ("log.gt3x", b"PK\x03\x04", r"ActiLife: Raw.*FileReader\('log.gt3x'\)"),
        ("log.bin", b"Device Identity\r\nDevice Type:GENEActiv\r\n", r"read.bin\('log.bin'\)"),
        ("log.pkl", b"\x80\x04\x95", "never opened here"),
    ],
)  # fmt: skip
def test_files_of_other_programs_are_refused_with_the_cure(tmp_path, name, content, cure):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"{name}: it is .*{cure}"):
        draft_campaign(path, tmp_path)


NESTED = {
    "records of lists in groups": (
        '{"emg": {"data": [[1, 2], [3, 4], [5, 6]]}, "imu": {"frequency": 50, "data": '
        '[{"acceleration": [1, 2, 3], "t": 0.0}, {"acceleration": [4, 5, 6], "t": 0.5}]}}',
        ["acceleration_0,acceleration_1,acceleration_2,t", "1,2,3,0.0", "4,5,6,0.5"],
    ),
    "records of records": (
        '[{"t": 0.0, "acc": {"x": 1, "y": 2}}, {"t": 0.5, "acc": {"x": 3, "y": 4}}]',
        ["t,acc_x,acc_y", "0.0,1,2", "0.5,3,4"],
    ),
    "columns in a group": (
        '{"name": "a", "imu": {"t": [0.0, 0.5], "ax": [1, 2]}}',
        ["t,ax", "0.0,1", "0.5,2"],
    ),
    "records": ('[{"t": 0.0, "ax": 1}, {"t": 0.5, "ax": 2}]', ["t,ax", "0.0,1", "0.5,2"]),
}


@pytest.mark.parametrize(("text", "table"), NESTED.values(), ids=NESTED)
def test_the_command_for_json_makes_a_table(tmp_path, text, table):
    """Of a public data set's files it ended in "CSV format does not support nested data"."""
    path = tmp_path / "good.json"
    path.write_text(text)
    with pytest.raises(ValueError, match="it is JSON") as refused:
        draft_campaign(path, tmp_path)
    command = str(refused.value).split("as text: python ")[1].removesuffix(".")
    subprocess.run(f"{sys.executable} {command}", shell=True, check=True, cwd=tmp_path)
    assert (tmp_path / "log.csv").read_text().split() == table


def test_json_without_a_table_is_told_so(tmp_path):
    path = tmp_path / "log.json"
    path.write_text('{"name": "a", "imu": {"acc": [[[1], 2]]}}')
    with pytest.raises(ValueError, match="write its samples as text, a row each"):
        draft_campaign(path, tmp_path)


def test_settings_in_brackets_are_no_json(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(f"[logger]\nrate,100\ntime,ax,ay,az\n{lines(TIME, *FORCE.T)}")
    assert draft_campaign(path, tmp_path).told["accel"]


def test_a_pointer_in_place_of_the_file_says_how_to_get_it(tmp_path):
    """What a clone without Git LFS has; its three lines would be a text of one column."""
    for name in ("log.csv", "log.parquet"):
        path = tmp_path / name
        path.write_text(
            f"version https://git-lfs.github.com/spec/v1\noid sha256:{64 * 'a'}\nsize 1048576\n"
        )
        with pytest.raises(ValueError, match=f"{name}: it is a pointer of Git LFS .*git lfs pull"):
            draft_campaign(path, tmp_path)


def test_a_calibration_that_holds_nothing_is_not_called_usable():
    force = np.array([0.1, -0.2, 9.8]) + 0.01 * np.random.default_rng(3).standard_normal((3000, 3))
    log = Recording(time=np.arange(3000) / 100.0, accel=force, name="table.csv")
    model = ModelChoice(accel_estimator="static")  # as the draft of a log of one pose has it
    campaign = Campaign((log,), Site(gravity=G), model=model)
    result = calibrate_device(campaign)
    quality = judge(result)
    assert result.calibration.accel is None
    assert quality.verdict == "doubtful" and "holds no parameter" in quality.answer


@pytest.mark.parametrize("sentence", ["$VNIMU", "$VNYMR"])
def test_sentences_of_vectornav_have_their_manuals_fields(tmp_path, sentence):
    """UM001, registers 54 and 27: the field, in gauss, stands before the force; of $VNIMU nothing else does."""
    rng = np.random.default_rng(2)
    field = 0.05 * FORCE + 0.001 * rng.standard_normal(FORCE.shape)  # as large as the Earth's
    angles, rest = np.zeros((ROWS, 3)), np.full((ROWS, 2), (24.3, 101.2))
    before, behind = ((), rest.T) if sentence == "$VNIMU" else (angles.T, ())
    rows = lines([sentence] * ROWS, *before, *field.T, *FORCE.T, *TURNS.T, *behind)
    content = "".join(f"{row}*{k % 256:02X}\r\n" for k, row in enumerate(rows.splitlines()))
    _, tables = drafted(tmp_path / "log.txt", content)
    first = 1 if sentence == "$VNIMU" else 4
    assert tables["recordings"]["names"][first : first + 9] == [
        f"{k}_{a}" for k in ("mag", "accel", "gyro") for a in "xyz"
    ]
    assert tables["columns"]["accel"] == {"unit": "m/s^2"}
    assert tables["columns"]["gyro"] == {"unit": "rad/s"}
    assert ("temperature" in tables["columns"]) == (sentence == "$VNIMU")
    assert ("own filter" in (tmp_path / "campaign.toml").read_text()) == (sentence == "$VNYMR")
    read(tmp_path)


def test_a_sentence_without_gravity_is_refused(tmp_path):
    content = lines(["$VNYBA"] * ROWS, *np.zeros((3, ROWS)), *FORCE.T, *TURNS.T)
    with pytest.raises(ValueError, match="VNYBA holds an acceleration from which .* log .VNIMU"):
        drafted(tmp_path / "log.txt", content)


def test_init_of_what_nothing_can_read_fails(tmp_path, capsys, monkeypatch):
    """It wrote a campaign and ended with 0."""
    (tmp_path / "log.ulg").write_bytes(bytes(range(256)) * 8)
    status, _, error = run(capsys, monkeypatch, "init", tmp_path / "log.ulg", "-o", tmp_path / "c")
    assert status == 1 and "not a ULog" in error
