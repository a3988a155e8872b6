"""Files of each format become the same recording, in SI."""

# Columns are optional in the types, and these recordings have them:
# pyright: reportOptionalSubscript=false, reportOptionalMemberAccess=false
# pyright: reportOptionalOperand=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportOperatorIssue=false

import datetime

import numpy as np
import polars as pl
import pytest

from inertiax.data.formats import ColumnMap, FORMATS, Layout, read_recordings
from inertiax.data.formats.columns import LabelColumn, ProbeColumns, TimeColumn, TriadColumns


STANDARD_GRAVITY = 9.80665
COUNT = 50


def _columns():
    rng = np.random.default_rng(0)
    columns = {"time": np.arange(COUNT) / 100}
    for triad in ("accel", "gyro", "reference_accel", "reference_gyro"):
        columns |= {f"{triad}_{axis}": rng.standard_normal(COUNT) for axis in "xyz"}
    columns |= {"temperature": 20 + rng.standard_normal(COUNT)}
    columns |= {"temperature_2": 30 + rng.standard_normal(COUNT)}
    columns |= {"experiment": np.repeat([1, 2], COUNT // 2), "position": np.arange(COUNT) - 1}
    return columns


def _check(recording, columns, rtol=1e-15):
    np.testing.assert_allclose(recording.time, columns["time"], rtol=rtol)
    for triad in ("accel", "gyro", "reference_accel", "reference_gyro"):
        for axis, name in enumerate("xyz"):
            values = getattr(recording, triad)[:, axis]
            np.testing.assert_allclose(values, columns[f"{triad}_{name}"], rtol=rtol)
    np.testing.assert_allclose(recording.temperature[:, 0], columns["temperature"], rtol=rtol)
    np.testing.assert_allclose(recording.temperature[:, 1], columns["temperature_2"], rtol=rtol)
    np.testing.assert_array_equal(recording.experiment, columns["experiment"])
    np.testing.assert_array_equal(recording.position, columns["position"])


def _text(columns, delimiter):
    rows = zip(*(v.tolist() for v in columns.values()), strict=True)
    lines = [delimiter.join(columns), *(delimiter.join(map(repr, row)) for row in rows)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", "   ", ", "])
def test_text_comes_back_to_the_last_digit(tmp_path, delimiter):
    columns = _columns()
    path = tmp_path / "a.csv"
    path.write_text(_text(columns, delimiter))
    (recording,) = read_recordings(path)
    _check(recording, columns)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: "\n\n" + text + "\n\n",
        lambda text: "# a log\n% of today\n" + text,
        lambda text: text.rstrip("\n"),
        lambda text: (
            '"' + text.split("\n", 1)[0].replace(",", '","') + '"\n' + text.split("\n", 1)[1]
        ),
    ],
    ids=["BOM", "CRLF", "CR", "blank lines", "comments", "no last newline", "quoted names"],
)
def test_the_dress_of_a_text_file_does_not_matter(tmp_path, change):
    columns = _columns()
    path = tmp_path / "a.csv"
    path.write_bytes(change(_text(columns, ",")).encode())
    (recording,) = read_recordings(path)
    _check(recording, columns)


def test_decimal_commas_are_read_between_semicolons(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time;accel_x;accel_y;accel_z\n0,0;-1,5;2;3,25\n0,5;1,5;2;,25\n")
    (recording,) = read_recordings(path)
    np.testing.assert_array_equal(recording.accel, [[-1.5, 2, 3.25], [1.5, 2, 0.25]])
    np.testing.assert_array_equal(recording.time, [0, 0.5])


def test_a_comment_with_the_names_is_the_header(tmp_path):
    # The first line of a EuRoC imu0/data.csv.
    path = tmp_path / "data.csv"
    names = ("w_RS_S_x [rad s^-1]", "w_RS_S_y [rad s^-1]", "w_RS_S_z [rad s^-1]")
    accel = ("a_RS_S_x [m s^-2]", "a_RS_S_y [m s^-2]", "a_RS_S_z [m s^-2]")
    path.write_text(
        f"#timestamp [ns],{','.join(names)},{','.join(accel)}\n"
        "1403636579758555392,-0.0991,0.1473,0.0279,8.1764,-0.4413,-2.5525\n"
        "1403636579763555584,-0.0994,0.1431,0.0281,8.1973,-0.4413,-2.5034\n"
    )
    columns = ColumnMap(
        time=TimeColumn(name="timestamp [ns]", unit="ns"),
        accel=TriadColumns(names=accel),
        gyro=TriadColumns(names=names),
    )
    (recording,) = read_recordings(path, columns)
    np.testing.assert_array_equal(recording.gyro[1], [-0.0994, 0.1431, 0.0281])
    # Doubles near 1.4e9 s are 2.4e-7 s apart.
    np.testing.assert_allclose(np.diff(recording.time), 0.005000192, atol=2.4e-7)


def test_parquet_comes_back_exactly(tmp_path):
    columns = _columns()
    path = tmp_path / "a.parquet"
    pl.DataFrame(columns).write_parquet(path)
    (recording,) = read_recordings(path)
    _check(recording, columns, rtol=0)


def test_parquet_of_single_precision_and_time_stamps(tmp_path):
    path = tmp_path / "a.parquet"
    start = datetime.datetime(2026, 1, 1)
    stamps = [start + datetime.timedelta(milliseconds=10 * i) for i in range(4)]
    frame = pl.DataFrame(
        {"time": stamps} | {f"accel_{a}": np.arange(4, dtype=np.float32) for a in "xyz"}
    )
    frame.write_parquet(path)
    (recording,) = read_recordings(path)
    np.testing.assert_allclose(np.diff(recording.time), 0.01, atol=3e-7)
    assert recording.accel.dtype == np.float64


@pytest.mark.parametrize("delimiter", [" ", "   ", ","])
def test_imu_tk_text_has_its_columns_by_position(tmp_path, delimiter):
    path = tmp_path / "acc.mat"
    path.write_text(
        "\n".join(delimiter.join(map(str, (0.01 * i, i, 2 * i, 9.8))) for i in range(5))
    )
    (accel,) = read_recordings(path)
    np.testing.assert_array_equal(accel.accel[:, 1], 2.0 * np.arange(5))
    assert accel.gyro is None
    (gyro,) = read_recordings(path, layout=Layout(triad="gyro"))
    np.testing.assert_array_equal(gyro.gyro, accel.accel)
    assert gyro.accel is None


def test_text_without_a_header_takes_its_names_from_the_campaign(tmp_path):
    path = tmp_path / "a.log"
    path.write_text("0 0 9.8 0 0 0\n0 0 9.9 0 0 0\n")
    names = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")
    (recording,) = read_recordings(path, ColumnMap(time=TimeColumn(rate=50.0)), Layout(names=names))
    np.testing.assert_array_equal(recording.time, [0, 0.02])
    np.testing.assert_array_equal(recording.accel[:, 2], [9.8, 9.9])


def test_rows_at_the_start_can_be_left_out(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(_text(_columns(), ","))
    (recording,) = read_recordings(path, layout=Layout(start_row=5))
    assert recording.num_samples == COUNT - 5 and recording.time[0] == 0.05


@pytest.mark.parametrize(
    "unit, scale",
    [("m/s^2", 1), ("m/s2", 1), ("m/s²", 1), ("g", STANDARD_GRAVITY), ("mg", 9.80665e-3)],
)
def test_accelerometer_units(tmp_path, unit, scale):
    path = tmp_path / "a.csv"
    path.write_text(_text(_columns(), ","))
    (recording,) = read_recordings(path, ColumnMap(accel=TriadColumns(unit=unit)))
    np.testing.assert_allclose(recording.accel[:, 0], _columns()["accel_x"] * scale, rtol=1e-15)


@pytest.mark.parametrize(
    "unit, scale", [("rad/s", 1), ("deg/s", np.pi / 180), ("deg/h", np.pi / 648000)]
)
def test_gyro_units(tmp_path, unit, scale):
    path = tmp_path / "a.csv"
    path.write_text(_text(_columns(), ","))
    (recording,) = read_recordings(path, ColumnMap(gyro=TriadColumns(unit=unit)))
    np.testing.assert_allclose(recording.gyro[:, 2], _columns()["gyro_z"] * scale, rtol=1e-14)


@pytest.mark.parametrize(
    "unit, value, celsius",
    [("degC", 25, 25), ("K", 293.15, 20), ("degF", 212, 100), ("°F", -40, -40)],
)
def test_temperature_units(tmp_path, unit, value, celsius):
    path = tmp_path / "a.csv"
    path.write_text(f"time,accel_x,accel_y,accel_z,T\n0,0,0,9.8,{value}\n")
    columns = ColumnMap(temperature=ProbeColumns(name="T", unit=unit))
    (recording,) = read_recordings(path, columns)
    np.testing.assert_allclose(recording.temperature, [[celsius]], atol=1e-12)


@pytest.mark.parametrize("unit, scale", [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_time_units(tmp_path, unit, scale):
    path = tmp_path / "a.csv"
    path.write_text("t,accel_x,accel_y,accel_z\n0,0,0,9.8\n" + f"{round(2 * scale)},0,0,9.8\n")
    (recording,) = read_recordings(path, ColumnMap(time=TimeColumn(name="t", unit=unit)))
    np.testing.assert_allclose(recording.time, [0, 2], rtol=1e-15)


@pytest.mark.parametrize(
    "scale, scale_unit",
    [
        ((415.0, 413.0, 415.0), "count per m/s^2"),
        ((1 / 415, 1 / 413, 1 / 415), "m/s^2 per count"),
        ((1 / 415, 1 / 413, 1 / 415), None),
        tuple([(tuple(s * STANDARD_GRAVITY for s in (415.0, 413.0, 415.0)), "count per g")])[0],
    ],
)
def test_raw_counts_are_offset_first_and_then_scaled(tmp_path, scale, scale_unit):
    path = tmp_path / "a.csv"
    path.write_text("time,x,y,z\n0,33183,32355,32768\n")
    triad = TriadColumns(
        names=("x", "y", "z"), unit="count", scale=scale, scale_unit=scale_unit, offset=32768.0
    )
    (recording,) = read_recordings(path, ColumnMap(accel=triad))
    np.testing.assert_allclose(recording.accel, [[1.0, -1.0, 0.0]], rtol=1e-14)


def test_gyro_counts_and_a_flipped_axis(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,x,y,z\n0,100,100,100\n")
    triad = TriadColumns(
        names=("y", "x", "z"),
        unit="count",
        scale=(16.4, -16.4, 16.4),
        scale_unit="count per deg/s",
        offset=(0.0, 0.0, 50.0),
    )
    (recording,) = read_recordings(path, ColumnMap(gyro=triad))
    expected = np.radians([100 / 16.4, -100 / 16.4, 50 / 16.4])
    np.testing.assert_allclose(recording.gyro, [expected], rtol=1e-14)


def test_one_file_of_many_devices_gives_a_recording_each(tmp_path):
    path = tmp_path / "fleet.parquet"
    frame = pl.DataFrame(
        {
            "time": [0.0, 0.0, 1.0, 1.0],
            "sn": [17, 4, 17, 4],
            "accel_x": [1.0, 2.0, 3.0, 4.0],
            "accel_y": 0.0,
            "accel_z": 9.8,
        }
    )
    frame.write_parquet(path)
    first, second = read_recordings(path, ColumnMap(device=LabelColumn(name="sn")))
    assert (first.device, second.device) == ("17", "4")
    assert first.name == "fleet.parquet (device 17)"
    np.testing.assert_array_equal(first.accel[:, 0], [1, 3])
    np.testing.assert_array_equal(second.accel[:, 0], [2, 4])
    # Without a usable clock each device counts its own rows.
    columns = ColumnMap(device="sn", time=TimeColumn(rate=10.0))
    np.testing.assert_array_equal(read_recordings(path, columns)[1].time, [0, 0.1])


def test_labels_under_other_names(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,accel_x,accel_y,accel_z,run,pose\n0,0,0,9.8,3,1.0\n1,0,0,9.8,3,-1\n")
    columns = ColumnMap(experiment="run", position=LabelColumn(name="pose"))
    (recording,) = read_recordings(path, columns)
    np.testing.assert_array_equal(recording.experiment, [3, 3])
    np.testing.assert_array_equal(recording.position, [1, -1])


def test_an_unknown_suffix_is_judged_by_the_content(tmp_path):
    (tmp_path / "a.imu").write_text(_text(_columns(), ","))
    _check(read_recordings(tmp_path / "a.imu")[0], _columns())
    pl.DataFrame(_columns()).write_parquet(tmp_path / "b.imu")
    _check(read_recordings(tmp_path / "b.imu")[0], _columns())


@pytest.mark.parametrize("module", FORMATS, ids=lambda m: m.NAME)
def test_every_format_says_what_it_is(module):
    assert module.NAME and module.__doc__
    assert all(s.startswith(".") and s == s.lower() for s in module.SUFFIXES)
    assert module.read.__doc__


def test_formats_do_not_claim_the_same_suffix():
    # imu_tk's text and MATLAB's own files are both `.mat`; their first bytes tell them apart.
    suffixes = [s for m in FORMATS for s in m.SUFFIXES if m.NAME != "matlab"]
    assert len(suffixes) == len(set(suffixes))


def test_a_row_of_infinities_is_left_out_and_counted(tmp_path):
    """A public log of a filter that failed once has NaN and Infinity in one of 14 461 rows, which was refused."""
    rows = [f"{0.01 * k:.2f},0.1,0.2,9.8,0.01,0.02,0.03" for k in range(20)]
    rows[7] = "0.07, NaN, NaN, NaN, Infinity, -Infinity, inf"
    header = "time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z"
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    (found,) = read_recordings(path)
    assert (found.num_samples, found.empty_rows) == (19, 1)
    path.write_text(path.read_text().replace("0.07, NaN", "0.07, 0.1"))
    with pytest.raises(ValueError, match="no finite number in 1 of 20 rows, first in row 7"):
        read_recordings(path)
