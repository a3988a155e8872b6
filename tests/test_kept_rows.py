"""Rows of a file that are no samples: of another sensor, or written again by the logger."""

import numpy as np
import polars as pl
import pytest

from bad_inputs_cases import good_calibration
from hand_log_data import draft, hand_log
from inertiax.calibration.calibration import read_calibration
from inertiax.data.campaign import load_campaign
from inertiax.data.formats import ColumnMap, csv, Layout
from inertiax.data.formats.columns import TimeColumn
from inertiax.data.formats.kept_rows import kept_rows
from inertiax.exports.compensated_recording import compensate_file
from inertiax.exports.compensated_stream import write_compensated
from inertiax.live.text_rows import TextRows


TIME, ACCEL, GYRO = hand_log()
HEADER = "time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,roll"
FEW = 400


def line(k):
    return f"{TIME[k]:.3f},{','.join(f'{v:.6f}' for v in (*ACCEL[k], *GYRO[k]))},"


def log(path, count=None, doubled=(), filtered=()):
    """Each row of `doubled` is written again, and a filter's row follows each of `filtered`."""
    rows = [HEADER]
    for k in range(count or len(TIME)):
        rows += [line(k)] * (1 + (k in doubled))
        rows += [f"{TIME[k] - 0.004:.3f},,,,,,,0.5"] * (k in filtered)
    path.write_text("\n".join(rows) + "\n")
    return path


DOUBLED, FILTERED = (3, 4, 50, 399), tuple(range(10, FEW, 5))


def test_samples_are_what_the_log_held_before_rows_were_added(tmp_path):
    plain = csv.read(log(tmp_path / "a.csv", FEW), ColumnMap(), Layout())[0]
    added = csv.read(log(tmp_path / "b.csv", FEW, DOUBLED, FILTERED), ColumnMap(), Layout())[0]
    for name in ("time", "accel", "gyro"):
        np.testing.assert_array_equal(getattr(added, name), getattr(plain, name))
    assert (added.empty_rows, added.repeated_rows) == (len(FILTERED), len(DOUBLED))


def test_counted_rows_are_samples_each(tmp_path):
    path = log(tmp_path / "a.csv", FEW, DOUBLED)
    counted = csv.read(path, ColumnMap(time=TimeColumn(rate=50.0)), Layout())[0]
    assert counted.num_samples == FEW + len(DOUBLED)


def test_an_output_that_differs_is_a_sample(tmp_path):
    path = log(tmp_path / "a.csv", 20)
    path.write_text(path.read_text() + line(19).replace("-", "-1") + "\n")
    with pytest.raises(ValueError, match="time must increase strictly"):
        csv.read(path, ColumnMap(), Layout())


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("pieces", [False, True], ids=["whole", "in pieces"])
def test_compensated_rows_stand_where_they_stood(tmp_path, monkeypatch, suffix, pieces):
    """All rows of the file are kept; those that are no samples have no compensated output."""
    calibration = tmp_path / "c.json"
    calibration.write_bytes(good_calibration(thermal=False))
    known = read_calibration(calibration)
    plain = compensate_file(known, log(tmp_path / "a.csv", FEW)).table
    path = log(tmp_path / "b.csv", FEW, DOUBLED, FILTERED)
    if suffix == ".parquet":
        pl.read_csv(path).write_parquet(tmp_path / "b.parquet")
        path = tmp_path / "b.parquet"
    if pieces:
        output = tmp_path / f"out{suffix}"
        notes = write_compensated(known, path, output, rows=90, size=5000).notes
        made = pl.read_csv(output) if suffix == ".csv" else pl.read_parquet(output)
    else:
        found = compensate_file(known, path)
        made, notes = found.table, found.notes
    assert made.height == FEW + len(DOUBLED) + len(FILTERED)
    sampled = made.filter(pl.col("extrapolated").is_not_null())
    for name in ("accel_x", "accel_z", "gyro_y"):
        np.testing.assert_allclose(sampled[name].to_numpy(), plain[name].to_numpy(), rtol=1e-12)
    assert made.filter(pl.col("extrapolated").is_null())["accel_x"].null_count() == len(
        DOUBLED
    ) + len(FILTERED)
    assert made["roll"].drop_nulls().to_list() == [0.5] * len(FILTERED)
    assert f"{path.name}: {len(DOUBLED)} rows with the stamp and outputs" in " ".join(notes)


def test_a_live_stream_puts_rows_without_a_value_aside(tmp_path):
    """Rows written again it tells by their stamps, as `follow` has it."""
    lines = log(tmp_path / "b.csv", FEW, (), FILTERED).read_bytes().splitlines()
    rows = TextRows(ColumnMap(), Layout(), "b.csv")
    chunks = [rows.read(lines[:150]), rows.read(lines[150:], last=True)]
    times = [c.time for c in chunks if c is not None]
    np.testing.assert_allclose(np.concatenate(times), TIME[:FEW], atol=1e-9)
    assert sum(len(c.skipped) for c in chunks if c is not None) == len(FILTERED)
    for chunk in chunks:
        assert chunk is not None
        assert len(chunk.lines) == len(chunk.time) == chunk.rows.num_samples


def test_a_live_stream_may_begin_with_the_mark_of_utf_8(tmp_path):
    lines = log(tmp_path / "b.csv", FEW).read_bytes().splitlines()
    for first in (lines, [b"\xef\xbb\xbf" + lines[0], *lines[1:]]):
        rows = TextRows(ColumnMap(), Layout(), "b.csv")
        chunk = rows.read(first, last=True)
        assert chunk is not None and rows.take_header() == lines[:1]
        np.testing.assert_allclose(chunk.time, TIME[:FEW], atol=1e-9)


def test_init_and_the_reader_agree_on_a_log_with_a_doubled_part(tmp_path):
    """900 rows written twice, and a pause: rows were counted at their mean rate, 24 % off."""
    doubled = tuple(range(200, 300))
    path = log(tmp_path / "log.csv", doubled=doubled)
    text = path.read_text().replace("time,", "t,", 1)
    path.write_text(text)
    assert draft(path)["columns"]["time"] == {"name": "t", "unit": "s"}
    loaded = load_campaign(tmp_path)
    np.testing.assert_allclose(loaded.recordings[0].time, TIME, atol=1e-9)
    assert (
        "log.csv: 100 rows with the stamp and outputs of the row before are left out."
        in loaded.notes
    )


def test_a_coarse_clock_has_equal_rows_that_are_samples(tmp_path):
    """Whole seconds at 50 Hz, and a converter so coarse that rests read one number: no row was written again."""
    path = tmp_path / "log.csv"
    rows = [
        f"{int(t)},{','.join(f'{v:.1f}' for v in (*a, *w))}"
        for t, a, w in zip(TIME, ACCEL, GYRO, strict=True)
    ]
    path.write_text("\n".join(["t,ax,ay,az,gx,gy,gz", *rows]) + "\n")
    assert draft(path)["columns"]["time"] == {"rate": 50.0}
    assert load_campaign(tmp_path).recordings[0].num_samples == len(TIME)


def test_nothing_is_left_out_of_a_log_without_such_rows():
    table = pl.DataFrame({"time": [0.0, 1.0], "accel_x": [1.0, 1.0]})
    found = kept_rows(table, ColumnMap(), Layout())
    assert found.mask is None and found.table is table
    assert found.among(table, table) is table


def test_a_live_stream_leaves_out_names_that_stand_again(tmp_path):
    lines = log(tmp_path / "b.csv", FEW).read_bytes().splitlines()
    rows = TextRows(ColumnMap(), Layout(), "b.csv")
    chunk = rows.read([*lines[:250], lines[0], *lines[250:]], last=True)
    assert chunk is not None and chunk.garbled == [lines[0]]
    np.testing.assert_allclose(chunk.time, TIME[:FEW], atol=1e-9)
