"""One recording under several serial numbers: all of these devices are set aside, wherever their rows lie."""

import numpy as np
import polars as pl
import pytest

from fleet_data import write_line
from inertiax.fleet import read_parts, run_fleet
from inertiax.fleet.copies import MARK, set_copies_aside
from inertiax.fleet.store import part_file, write_part


COPY, ORIGINAL = "SN0004", "SN0001"


@pytest.mark.slow
def test_devices_with_the_same_samples_are_set_aside_and_name_each_other(tmp_path):
    write_line(tmp_path / "line", 6)
    for file in (tmp_path / "line").glob("*.parquet"):
        table = pl.read_parquet(file).filter(pl.col("device") != COPY)
        again = table.filter(pl.col("device") == ORIGINAL).with_columns(device=pl.lit(COPY))
        pl.concat([table, again]).write_parquet(file)
    summary = run_fleet(tmp_path / "line", tmp_path / "out")
    said = dict(read_parts(tmp_path / "out").select("device", "reason").collect().iter_rows())
    assert (summary.devices, summary.set_aside) == (6, 2)
    assert said[COPY].startswith(f"its samples are those of {ORIGINAL}, to the last digit")
    assert said[ORIGINAL].startswith(f"its samples are those of {COPY}, to the last digit")
    assert [d for d, reason in said.items() if not reason] == [
        "SN0000",
        "SN0002",
        "SN0003",
        "SN0005",
    ]


def parts(folder, marks: list[list[str | None]]) -> list[str]:
    """Reasons of devices whose rows lie in several parts, by their marks."""
    (folder / "parts").mkdir(parents=True, exist_ok=True)
    (folder / "manifest.json").write_text("{}")
    names = iter("ABCDEFGH")
    for task, own in enumerate(marks):
        old = part_file(folder, task)
        kept = pl.read_parquet(old)["reason"].to_list() if old.exists() else [""] * len(own)
        columns = {"device": [next(names) for _ in own], "reason": kept, MARK: own}
        write_part(folder, task, pl.DataFrame(columns, schema_overrides={MARK: pl.String}))
    set_copies_aside(folder)
    return read_parts(folder).collect()["reason"].to_list()


def test_copies_are_found_across_tasks_and_forgotten_when_the_file_was_replaced(tmp_path):
    said = parts(tmp_path, [["a", "b"], ["a", None], [None, "c"]])
    assert [bool(r) for r in said] == [True, False, True, False, False, False]
    assert "those of C" in said[0] and "those of A" in said[2]
    assert parts(tmp_path, [["a", "b"], ["d", None], [None, "c"]]) == [""] * 6


def test_another_reason_is_kept(tmp_path):
    parts(tmp_path, [["a", "b"]])
    file = part_file(tmp_path, 0)
    table = pl.read_parquet(file).with_columns(reason=pl.lit("accel: too few positions"))
    write_part(tmp_path, 0, table)
    assert parts(tmp_path, [["a", "a"]]) == ["accel: too few positions"] * 2


def test_five_copies_are_told_by_three_names_and_a_number(tmp_path):
    said = parts(tmp_path, [["a"] * 6])
    assert "those of B, C, D and 2 more, to the last digit" in said[0]
    assert np.all([len(r) > 0 for r in said])
