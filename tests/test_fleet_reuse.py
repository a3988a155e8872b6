"""A run over changed files into a folder with results keeps those of devices whose files and settings are the same."""

import json
import shutil

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from command_runs import draw_nothing, run
from fleet_data import write_line
from inertiax.fleet import run_fleet
from inertiax.fleet.store import read_manifest, read_parts
from protocol_cases import write_campaign


def rows(folder):
    return read_parts(folder).collect().sort("device")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Six devices in three files, and their results, with a copy of both."""
    home = tmp_path_factory.mktemp("line")
    write_line(home / "line", 6, files=3, experiments=2)
    run_fleet(home / "line", home / "out")
    shutil.copytree(home, home / "first")
    return home


@pytest.fixture
def line(made):
    """As they were first, where they were first: the plan names files by their place."""
    for name in ("line", "out"):
        shutil.rmtree(made / name)
        shutil.copytree(made / "first" / name, made / name)
    return made / "line", made / "out"


@pytest.mark.slow
def test_devices_of_other_files_keep_their_results(line, tmp_path):
    source, out = line
    before = rows(out)
    table = pl.read_parquet(source / "line-1.parquet")
    changed = table.get_column("device").unique().to_list()
    table.with_columns(pl.col("accel_x") + 1e-3).write_parquet(source / "line-1.parquet")
    found = run_fleet(source, out)
    assert (found.devices_before, found.devices, found.calibrated) == (4, 6, 6)
    assert read_manifest(out).kept == 4
    after = rows(out)
    same = pl.col("device").is_in(changed)
    assert_frame_equal(after.filter(~same), before.filter(~same), check_exact=True)
    # As of a run that knows nothing of the first one, up to how many devices are solved side by side.
    run_fleet(source, tmp_path / "fresh")
    fresh = rows(tmp_path / "fresh")
    # Slow noise is read off residuals, which are those of where a batch's steps end: some 1e-6 of a sigma apart.
    for column, near in (("accel_parameters", 1e-9), ("accel_sigma", 1e-6)):
        columns = ["device", column]
        assert_frame_equal(
            after.select(columns), fresh.select(columns), rel_tol=near, abs_tol=1e-15
        )
    now, then = (x.filter(same)["accel_parameters"].to_list() for x in (after, before))
    moved = [x[0] - y[0] for x, y in zip(now, then, strict=True)]
    assert moved == pytest.approx([1e-3, 1e-3], rel=1e-2)
    # A third time nothing is left to do.
    again = run_fleet(source, out)
    assert (again.devices_before, again.tasks_before) == (4, 2)


@pytest.mark.slow
def test_new_devices_are_added_and_those_that_are_gone_are_left_out(line, tmp_path):
    source, out = line
    (source / "line-2.parquet").rename(tmp_path / "line-2.parquet")
    found = run_fleet(source, out)
    assert (found.devices_before, found.devices) == (4, 4)
    (tmp_path / "line-2.parquet").rename(source / "line-2.parquet")
    found = run_fleet(source, out)
    assert (found.devices_before, found.devices, found.calibrated) == (4, 6, 6)


@pytest.mark.slow
def test_other_settings_keep_nothing(line):
    source, out = line
    before = rows(out)
    text = (source / "campaign.toml").read_text()
    (source / "campaign.toml").write_text(f"{text}\n[rig]\ntemperature_uncertainty = 0.5\n")
    with pytest.raises(
        ValueError, match="holds a run over other files or settings: line/campaign.toml"
    ):
        run_fleet(source, out)
    assert_frame_equal(rows(out), before)


@pytest.mark.slow
def test_a_folder_of_campaigns_is_calibrated_anew_where_it_changed_and_says_so(
    tmp_path, capsys, monkeypatch
):
    draw_nothing(monkeypatch)
    for k in range(3):
        write_campaign(tmp_path / "line" / f"unit-{k}")
        table = pl.read_csv(tmp_path / "line" / f"unit-{k}" / "0.csv")
        shifted = table.with_columns(
            pl.col("accel_x") + 1e-3 * k + 1e-4 * pl.Series(range(840)) % (k + 2)
        )
        shifted.write_csv(tmp_path / "line" / f"unit-{k}" / "0.csv")
    command = ["fleet", tmp_path / "line", "-o", tmp_path / "out"]
    run_fleet(tmp_path / "line", tmp_path / "out")
    before = rows(tmp_path / "out")
    file = tmp_path / "line" / "unit-1" / "0.csv"
    table = pl.read_csv(file)
    table.with_columns(pl.col("accel_y") - 2e-3).write_csv(file)
    status, said, err = run(capsys, monkeypatch, *command)
    assert status == 0, err
    assert "(results of 2 kept, whose files and settings are unchanged)" in said
    after, other = rows(tmp_path / "out"), pl.col("device") != "unit-1"
    assert_frame_equal(after.filter(other), before.filter(other), check_exact=True)
    assert after["accel_parameters"][1][1] != before["accel_parameters"][1][1]
    status, said, _ = run(capsys, monkeypatch, *command, "--json")
    assert json.loads(said)["kept"] == 2
