"""LabVIEW measurement files, as National Instruments specifies them and as such files look in public repositories."""

import tomllib

import numpy as np
import pytest

from inertiax.campaign_draft import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.lvm import as_rows, is_lvm


G = 9.80665
ROWS = 400
UP = np.repeat([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]], ROWS // 2, axis=0)
FORCE = UP + 2e-3 * np.random.default_rng(5).standard_normal((ROWS, 3))
TIME = 0.02 * np.arange(ROWS)


def lvm(rows, *, separator="Tab", decimal=".", columns="One", names="X_Value,ax,ay,az,Comment"):
    """A file with both headers; `rows` are lines without their comment."""
    s = {"Tab": "\t", "Comma": ","}[separator]
    first = {
        "Writer_Version": "2", "Reader_Version": "2", "Separator": separator, "Decimal_Separator": decimal,
        "Multi_Headings": "No", "X_Columns": columns, "Time_Pref": "Relative", "Operator": "lab",
        "Date": "2026/03/02", "Time": "17:18:18,9389457",
    }  # fmt: skip
    step = "0,02" if decimal == "," else "0.02"
    second = [
        s.join(["Channels", "3"]), s.join(["Samples", *["400"] * 3]), s.join(["Y_Unit_Label", *"ggg"]),
        s.join(["X_Dimension", *["Time"] * 3]), s.join(["Delta_X", *[step] * 3]),
    ]  # fmt: skip
    text = [
        "LabVIEW Measurement\t",
        *(s.join(kv) for kv in first.items()),
        "***End_of_Header***",
        s,
    ]
    text += [*second, f"***End_of_Header***{s}{s}", names.replace(",", s), *rows]
    return "\r\n".join(text) + "\r\n"


def lines(decimal=".", *, time=True, s="\t"):
    table = [[f"{t:.3f}" if time else "", *(f"{v:.6f}" for v in f)] for t, f in zip(TIME, FORCE)]
    return [s.join(v.replace(".", decimal) for v in row) for row in table]


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ({"separator": "Tab"}, {}),
        ({"separator": "Comma"}, {"s": ","}),
        ({"separator": "Tab", "decimal": ","}, {"decimal": ","}),
        ({"separator": "Tab", "decimal": ",", "columns": "No"}, {"decimal": ",", "time": False}),
    ],
)
def test_it_is_drafted_and_read(tmp_path, given, kept):
    """Both separators, decimal commas, and a column of times that stays empty."""
    path = tmp_path / "table.lvm"
    path.write_bytes(lvm(lines(**kept), **given).encode())
    draft = draft_campaign(path, tmp_path)
    columns = tomllib.loads(draft.text)["columns"]
    assert columns["accel"]["unit"] == "g"
    if kept.get("time", True):
        assert columns["time"] == {"name": "X_Value [s]", "unit": "s"}
    else:
        assert columns["time"] == {"rate": 50.0}
    (tmp_path / "campaign.toml").write_text(draft.text)
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.accel, G * FORCE, atol=1e-5)
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)


def test_rows_may_end_with_a_comment_and_the_second_header_may_be_missing():
    rows = lines()
    rows[3] += "\tknocked"
    text = as_rows(lvm(rows).replace("\r\n", "\n").encode(), "a.lvm").decode().splitlines()
    assert text[0] == "X_Value [s]\tax [g]\tay [g]\taz [g]" and text[4].count("\t") == 3
    plain = "LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\nTime\tA\n0.0\t1\n0.1\t2\n"
    assert is_lvm(plain.encode())
    assert as_rows(plain.encode(), "a.lvm") == b"Time\tA\n0.0\t1\n0.1\t2\n"


def test_several_segments_are_refused():
    twice = lvm(lines()) + "\t\r\nChannels\t3\r\n***End_of_Header***\r\nX_Value\tax\r\n0\t1\r\n"
    with pytest.raises(ValueError, match="a LabVIEW measurement of 2 segments; one is read"):
        as_rows(twice.encode(), "a.lvm")
    with pytest.raises(ValueError, match="a LabVIEW measurement without a row"):
        as_rows(lvm([]).split("X_Value")[0].encode(), "a.lvm")
    with pytest.raises(ValueError, match="a LabVIEW measurement of 0 segments"):
        as_rows(b"LabVIEW Measurement\nSeparator\tTab\n", "a.lvm")
