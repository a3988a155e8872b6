"""A run into a folder with results: files that differ by content are named; a new time stamp changes nothing."""

import os

import polars as pl
import pytest

from fleet_data import write_line
from inertiax.fleet import run_fleet


@pytest.mark.slow
def test_changed_new_and_lost_files_are_named_and_touched_ones_are_not(tmp_path):
    line, out = tmp_path / "line", tmp_path / "out"
    write_line(line, 4)
    first = run_fleet(line, out)
    for file in line.iterdir():
        os.utime(file, ns=(10**18, 10**18))
    again = run_fleet(line, out)
    assert (again.tasks_before, again.calibrated) == (1, first.calibrated)
    table = pl.read_parquet(line / "line-1.parquet")
    table.with_columns(pl.col("accel_x") + 1e-3).write_parquet(line / "line-1.parquet")
    table.head(0).write_parquet(line / "more.parquet")
    (line / "line-0.parquet").unlink()
    with pytest.raises(ValueError, match="holds a run over other files or settings: ") as caught:
        run_fleet(line, out)
    named = (
        "line/line-0.parquet (gone)",
        "line/line-1.parquet (changed)",
        "line/more.parquet (new)",
    )
    assert ": " + ", ".join(named) + "; choose another output folder" in str(caught.value)
