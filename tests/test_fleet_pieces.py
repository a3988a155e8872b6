"""Columns that lie in several pieces, as they were decoded, and serial numbers that lie in dictionaries."""

import math

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from inertiax.data.formats import ColumnMap
from inertiax.fleet.reduce.blocks import Blocks
from inertiax.fleet.reduce.serial_numbers import runs_of
from inertiax.fleet.reduce.single_devices import changes
from inertiax.fleet.reduce.tasks import split


def _in_pieces(values, lengths) -> pl.Series:
    ends = np.cumsum(lengths)
    parts = [pl.Series("x", values[e - n : e]) for n, e in zip(lengths, ends, strict=True)]
    return pl.concat(parts, rechunk=False)


@pytest.mark.parametrize("gap", [0, 7])
@pytest.mark.parametrize("lengths", [(5, 3, 640, 1, 101, 250), (250, 250, 250, 250), (10,) * 100])
def test_means_of_a_column_in_pieces_are_those_of_the_whole_one(gap, lengths):
    rng = np.random.default_rng(0)
    values = rng.normal(size=sum(lengths))
    start = np.arange(0, 900, 100 + gap)
    blocks = Blocks.cut(np.repeat(np.arange(3), 3)[: len(start)], start, start + 100)
    end = blocks.edge + blocks.count.astype(int)
    exact = [math.fsum(values[a:b]) / (b - a) for a, b in zip(blocks.edge, end, strict=True)]
    pieces = _in_pieces(values, lengths)
    found = blocks.means(pieces)
    assert pieces.n_chunks() == len(lengths)
    np.testing.assert_allclose(
        found, exact, rtol=0, atol=1e-15
    )  # some roundings of numbers of size 1
    np.testing.assert_array_equal(found, blocks.means(pieces.rechunk()))


def test_a_gap_in_one_piece_leaves_the_other_blocks_as_they_are():
    values = np.ones(200)
    values[150] = np.nan
    blocks = Blocks.cut(np.zeros(2, int), np.array([0, 100]), np.array([100, 200]))
    found = blocks.means(_in_pieces(values, (130, 70)))
    assert np.flatnonzero(~np.isfinite(found)).tolist() == [24]  # row 50 of 100 in 16 blocks


@pytest.mark.parametrize("lengths", [(9,), (3, 6), (1,) * 9, (4, 5)])
def test_changes_of_a_label_are_found_across_pieces(lengths):
    series = _in_pieces(np.array([1, 1, 1, 2, 2, 2, 2, -1, 2]), lengths)
    assert np.sort(changes(series)).tolist() == [3, 7, 8]


SERIALS = ["A"] * 7 + ["B"] * 2 + ["A-long-serial-number"] * 6 + ["B"]
RUNS = [("A", 0, 7), ("B", 7, 2), ("A-long-serial-number", 9, 6), ("B", 15, 1)]


@pytest.mark.parametrize("dictionary", [True, False])
@pytest.mark.parametrize("rows", [4, 5, 100])
def test_serial_numbers_are_the_same_by_dictionary_and_by_text(tmp_path, dictionary, rows):
    file = tmp_path / "line.parquet"
    pq.write_table(
        pa.table({"device": SERIALS}), file, use_dictionary=dictionary, row_group_size=rows
    )
    assert list(runs_of(str(file), "device", len(SERIALS))) == RUNS


def test_serial_numbers_that_are_numbers_are_read_as_texts(tmp_path):
    file = tmp_path / "line.parquet"
    pq.write_table(pa.table({"device": [7, 7, 8]}), file, row_group_size=1)
    assert list(runs_of(str(file), "device", 3)) == [("7", 0, 2), ("8", 2, 1)]


@pytest.mark.parametrize("dictionary", [True, False])
def test_a_row_without_a_serial_number_is_named(tmp_path, dictionary):
    file = tmp_path / "line.parquet"
    table = pa.table({"device": ["A", "A", "A", None, "A"], "position": [0] * 5})
    pq.write_table(table, file, use_dictionary=dictionary, row_group_size=2)
    with pytest.raises(ValueError, match="line.parquet: column 'device' is empty in row 3"):
        split([file], ColumnMap())


def test_blanks_around_a_serial_number_are_none_of_it(tmp_path):
    file = tmp_path / "line.parquet"
    pq.write_table(pa.table({"device": [" A7", "A7", "B ", "  "], "position": [0] * 4}), file)
    with pytest.raises(ValueError, match="line.parquet: column 'device' is empty in row 3"):
        split([file], ColumnMap())
    pq.write_table(pa.table({"device": [" A7", "A7", "B "], "position": [0] * 3}), file)
    devices = [name for task in split([file], ColumnMap()) for name, _ in task.devices]
    assert devices == ["A7", "B"]
