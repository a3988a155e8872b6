"""A line of names that is one short of its data is the header all the same, or it is refused."""

import numpy as np
import pytest

from hand_log_data import draft, hand_log, written
from inertiax.data.formats.text_layout import find_layout


TIME, ACCEL, GYRO = hand_log()
RNG = np.random.default_rng(11)
COUNT = 60
OUTPUTS = np.round(RNG.normal(0.0, 300.0, (COUNT, 6)))


def layout(names, rows, delimiter="\t"):
    lines = [delimiter.join(map(str, row)) for row in rows]
    return find_layout("\n".join([names, *lines, ""]).encode(), "log.txt")


def test_a_stamp_of_two_parts_that_is_named_once():
    """A public log's `GyrX … timestamp` above `[seconds] !nanoseconds!`: accel_x was GyrCount."""
    names = "GyrX\tGyrY\tGyrZ\tGyrCount\tAccX\tAccY\tAccZ\ttimestamp "
    rows = [
        (*r[:3], (k + 250) % 256, *r[3:], "[-708706303]", f"!{11 * k}000000!")
        for k, r in enumerate(OUTPUTS)
    ]
    found = layout("Logging of raw data started at 0 seconds \n" + names, rows)
    assert found.header_line == 2
    assert found.names is not None
    assert found.names[:4] == ("GyrX", "GyrY", "GyrZ", "GyrCount") and found.names[-1] == ""


def test_row_numbers_of_r_have_no_name():
    rows = [(k + 1, k / 100.0, *r) for k, r in enumerate(OUTPUTS)]
    found = layout('"time" "ax" "ay" "az" "gx" "gy" "gz"', rows, " ")
    assert found.names == ("", "time", "ax", "ay", "az", "gx", "gy", "gz")


def test_a_clock_under_its_name_leaves_the_last_field_unnamed():
    rows = [(k / 100.0, *r, 7 + r[0]) for k, r in enumerate(OUTPUTS)]
    found = layout("time,ax,ay,az,gx,gy,gz", rows, ",")
    assert found.names == ("time", "ax", "ay", "az", "gx", "gy", "gz", "")


def test_what_nothing_tells_is_refused():
    rows = [(*r, r[0] + 1.0) for r in OUTPUTS]
    with pytest.raises(ValueError, match="line 1 names 6 columns but the rows have 7 fields"):
        layout("ax,ay,az,gx,gy,gz", rows, ",")


def test_a_sentence_of_as_many_words_is_no_header():
    found = layout("six words of what was logged", [(*r, 1.0) for r in OUTPUTS], " ")
    assert found.names is None


def test_init_reads_the_columns_that_are_named(tmp_path):
    rows = np.arange(len(TIME))
    path = written(tmp_path / "log.csv", (rows, TIME, ACCEL, GYRO), "time,ax,ay,az,gx,gy,gz")
    found = draft(path)["columns"]
    assert found["time"]["name"] == "time" and found["accel"]["names"] == ["ax", "ay", "az"]
    assert (found["accel"]["unit"], found["gyro"]["unit"]) == ("m/s^2", "rad/s")
