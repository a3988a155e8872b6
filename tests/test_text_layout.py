"""Logs in the dress in which loggers and programs write them give the numbers that were logged."""

# pyright: reportOptionalSubscript=false

import numpy as np
import pytest

from inertiax.data.campaign import load_campaign
from inertiax.data.formats import ColumnMap, Layout, read_recordings
from inertiax.data.formats.columns import TimeColumn, TriadColumns


RNG = np.random.default_rng(7)
COUNT = 40
TIME = np.arange(COUNT) / 50.0
ACCEL = np.round(np.array([0.5, -0.2, 9.8]) + 0.01 * RNG.standard_normal((COUNT, 3)), 4)
GYRO = np.round(0.01 * RNG.standard_normal((COUNT, 3)), 5)
NAMES = ("t", "ax", "ay", "az", "gx", "gy", "gz")
COLUMNS = ColumnMap(
    time=TimeColumn(name="t"),
    accel=TriadColumns(names=NAMES[1:4]),
    gyro=TriadColumns(names=NAMES[4:]),
)


def rows(delimiter=",", end="", time=TIME):
    values = zip(time, ACCEL.tolist(), GYRO.tolist(), strict=True)
    return "".join(delimiter.join(map(str, (t, *a, *g))) + end + "\n" for t, a, g in values)


def header(delimiter=","):
    return delimiter.join(NAMES) + "\n"


def read(tmp_path, text, columns=COLUMNS, name="log.csv", **layout):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    (recording,) = read_recordings(path, columns, Layout(**layout))
    return recording


def check(recording, first=0):
    np.testing.assert_array_equal(recording.accel, ACCEL[first:])
    np.testing.assert_array_equal(recording.gyro, GYRO[first:])


DRESSES = {
    "settings before the header": "rate,50\nmode,0\nsettle,36.5\n" + header() + rows(),
    "settings of more lines than data in the first lines": "".join(
        f"key{i},{i}\n" for i in range(30)
    )
    + header()
    + rows(),
    "Gyroflow": "GYROFLOW IMU LOG\nversion,1.3\nid,test\norientation,XYZ\ntscale,0.001\n"
    + header()
    + rows(),
    "sep=,": "sep=,\n" + header() + rows(),
    "sep=; in quotes": '"sep=;"\r\n' + header(";") + rows(";"),
    "Movella DOT": "sep=,\nDeviceTag:,D422CD00\nFirmwareVersion:,1.6.0\nAppVersion:,2021.0\n\n"
    + header()
    + rows(),
    "settings padded by a spreadsheet": "rate,50,,,,,\nmode,0,,,,,\n" + header() + rows(),
    "settings of many fields padded by a spreadsheet": "Board;EVK;SN;417;;;\nFS_A;4g;FS_G;500dps;ODR;50Hz;\n"
    + header(";")
    + rows(";"),
    "numbers among settings padded by a spreadsheet": "FS_A,4,FS_G,500,ODR,50,\n"
    + header()
    + rows(),
    "Xsens": "// Start Time: 0\n// Sample rate: 50.0Hz\n" + header("\t") + rows("\t", "\t"),
    "rows and header end with a delimiter": "t,ax,ay,az,gx,gy,gz,\n" + rows(",", ","),
    "rows end with two delimiters": header() + rows(",", ",,"),
    "rows and header end with a delimiter and a blank": ",  ".join(NAMES)
    + ", \n"
    + rows(", ", ", "),
    "rostopic echo -p": "%" + header() + rows(),
    "names in a comment": "# by logger 3\n# t ax ay az gx gy gz\n" + rows(" "),
    "blanks in runs": "  ".join(NAMES) + "\n" + rows("    ", "  "),
    "tabs between blanks": header(" \t  ") + rows(" \t  ", "  "),
    "decimal commas between tabs": header("\t") + rows("\t").replace(".", ","),
    "a row of devices above the names": "IMU,IMU,IMU,IMU,IMU,IMU,IMU\n" + header() + rows(),
    "a line of zeros first": b"\0" * 64 + b"\n" + (header() + rows()).encode(),
    "zeros first": b"\0" * 64 + (header() + rows()).encode(),
    "zeros of a preallocated file last": (header() + rows()).encode() + b"\0" * 512,
}


@pytest.mark.parametrize("text", DRESSES.values(), ids=DRESSES)
def test_the_numbers_come_out_of_every_dress(tmp_path, text):
    recording = read(tmp_path, text)
    check(recording)
    np.testing.assert_array_equal(recording.time, TIME)


@pytest.mark.parametrize(
    ("groups", "names", "line"),
    [
        ("t,Force,,,Rate,,", ",x,y,z,x,y,z", 2),  # RepoIMU: a group stands once
        ("n,Force,Force,Force,Rate,Rate,Rate", "t,x,y,z,x,y,z", 2),  # pandas: over each column
        ("n,Force,Force,Force,Rate,Rate,Rate", "t,x,y,z,x,y,z", None),
    ],
)
def test_names_in_two_lines_are_told_apart_by_their_group(tmp_path, groups, names, line):
    columns = ColumnMap(
        time=TimeColumn(name="t" if groups[0] == "t" else "n t"),
        accel=TriadColumns(names=("Force x", "Force y", "Force z")),
        gyro=TriadColumns(names=("Rate x", "Rate y", "Rate z")),
    )
    check(read(tmp_path, f"{groups}\n{names}\n{rows()}", columns, header_line=line))


def test_text_columns_beside_the_numbers_are_left_alone(tmp_path):
    # `rostopic echo -p` repeats the frame's name in every row.
    lines = rows().splitlines()
    text = "%t,frame,ax,ay,az,gx,gy,gz\n" + "".join(
        x.replace(",", ",imu_link,", 1) + "\n" for x in lines
    )
    check(read(tmp_path, text))


@pytest.mark.parametrize("note", ["ok;warm", '"ok; warm"', "0;1", "ok\twarm"])
def test_another_delimiter_in_a_text_does_not_take_the_file_apart(tmp_path, note):
    text = "t,note,ax,ay,az,gx,gy,gz\n" + "".join(
        x.replace(",", f",{note},", 1) + "\n" for x in rows().splitlines()
    )
    check(read(tmp_path, text))


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_commas_split_no_fields_that_others_part(tmp_path, delimiter):
    check(read(tmp_path, header(delimiter) + rows(delimiter).replace(".", ",")))


def test_a_row_of_units_is_left_out_by_start_row(tmp_path):
    text = header() + "s,g,g,g,rad/s,rad/s,rad/s\n" + rows()
    check(read(tmp_path, text, start_row=1))


def test_the_header_is_where_the_campaign_says(tmp_path):
    # Two lines that could both be it: the wider rule would take the first.
    text = "T,AX,AY,AZ,GX,GY,GZ\n" + header() + rows()
    check(read(tmp_path, text, header_line=2))
    with pytest.raises(ValueError, match="column 't' is missing"):
        read(tmp_path, text)


@pytest.mark.parametrize(
    "line, message",
    [
        (5, r"header_line = 5 holds numbers, \['0\.0,0"),
        (1000, "header_line = 1000 is blank or after the end"),
    ],
)
def test_a_line_that_cannot_be_the_header_is_refused(tmp_path, line, message):
    text = "rate,50\nmode,0\nsettle,36.5\n" + header() + rows()
    with pytest.raises(ValueError, match=message):
        read(tmp_path, text, header_line=line)


def test_names_may_repeat_the_header(tmp_path):
    text = "rate,50\nmode,0\n" + header() + rows()
    check(read(tmp_path, text, names=NAMES))
    with pytest.raises(ValueError, match=r"this one has \['t', 'ax'.* in line 3; map those"):
        read(tmp_path, text, names=("time", *NAMES[1:]))


def test_settings_before_data_without_a_header(tmp_path):
    check(read(tmp_path, "rate,50\nmode,0\n" + rows(), names=NAMES))


def test_a_device_column_in_a_file_without_a_header(tmp_path):
    # The first line holds a word, but it is a row all the same.
    text = "".join(x + ",A7\n" for x in rows().splitlines())
    check(read(tmp_path, text, names=(*NAMES, "device")))


def test_zeros_within_the_text_are_refused_with_their_place(tmp_path):
    text = (header() + rows()).encode()
    third = [i for i, b in enumerate(text) if b == 10][1]
    with pytest.raises(ValueError, match=rf"byte {third + 1} \(line 3\) is zero"):
        read(tmp_path, text[: third + 1] + b"\0\0" + text[third + 1 :])


STAMPS = {
    "Z": (lambda t: f"2026-03-01T10:00:{t:09.6f}Z", 0.0),
    "blank": (lambda t: f"2026-03-01 10:00:{t:09.6f}", 0.0),
    "slashes, milliseconds behind a colon": (
        lambda t: f"2026/03/01 10:00:{t:06.3f}".replace(".", ":"),
        0.0,
    ),
    "underscores": (lambda t: f"2026_03_01_10_00_{t:06.3f}", 0.0),
    "offset": (lambda t: f"2026-03-01T12:00:{t:09.6f}+02:00", 0.0),
    "offset behind Greenwich": (lambda t: f"2026-03-01T06:30:{t:09.6f}-0330", 0.0),
    "whole seconds without a fraction": (
        lambda t: f"2026-03-01T10:00:{t:09.6f}".removesuffix(".000000"),
        0.0,
    ),
}


@pytest.mark.parametrize("write, zero", STAMPS.values(), ids=STAMPS)
def test_iso_8601_stamps_are_seconds(tmp_path, write, zero):
    recording = read(tmp_path, header() + rows(time=[write(t) for t in TIME]))
    # 2026-03-01T10:00Z by hand: 20513 days (56 · 365 + 14 leap days + 59) of 86400 s, and 10 h.
    np.testing.assert_allclose(recording.time, 20513 * 86400.0 + 36000.0 + TIME, atol=2.4e-7)
    check(recording)


def test_a_time_of_day_passes_midnight(tmp_path):
    clock = [
        f"23:59:59.{int(100 * t):02d}" if t < 0.4 else f"00:00:00.{round(100 * (t - 0.4)):02d}"
        for t in TIME
    ]
    recording = read(tmp_path, header() + rows(time=clock))
    assert recording.time[0] == 86399.0
    # 23:59:59.38 is followed by midnight, 0.62 s later.
    np.testing.assert_allclose(np.diff(recording.time)[19], 0.62, atol=1e-9)
    np.testing.assert_allclose(np.diff(recording.time)[20:], 0.02, atol=1e-9)


def test_a_row_that_is_no_stamp_is_named(tmp_path):
    stamps = [f"2026-03-01T10:00:{t:06.3f}" for t in TIME]
    stamps[5] = "10:00:01"
    with pytest.raises(
        ValueError, match="time holds '10:00:01' in row 5, where a stamp like '2026-03"
    ):
        read(tmp_path, header() + rows(time=stamps))


CAMPAIGN = """[site]
gravity = 9.80665
[recordings]
files = ["log.csv"]
{recordings}
[columns]
time = {{ rate = 50.0 }}
accel = {{ names = ["ax", "ay", "az"] }}
gyro = {{ names = ["gx", "gy", "gz"] }}
"""


def test_a_campaign_says_the_header_line(tmp_path):
    (tmp_path / "log.csv").write_text("T,AX,AY,AZ,GX,GY,GZ\n" + header() + rows())
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.format(recordings="header_line = 2"))
    check(load_campaign(tmp_path).recordings[0])
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.format(recordings="header_line = 0"))
    with pytest.raises(ValueError, match="header_line = 0 must be 1 or more"):
        load_campaign(tmp_path)
