"""How a fleet's run ends and goes on: nothing calibrated is a failure, one run a folder, scores asked for again."""

import json
import subprocess
import sys

import numpy as np
import polars as pl
import pytest

from bad_inputs_cases import TABLE, TOML
from command_runs import run
from inertiax.fleet import read_parts
from inertiax.storage.ownership import owned


AXES = ("accel_x", "accel_y", "accel_z")


def line(folder, tables: dict[str, pl.DataFrame]):
    folder.mkdir()
    (folder / "campaign.toml").write_text(TOML)
    rng = np.random.default_rng(3)
    noise = lambda t: 1e-5 * rng.standard_normal(t.height)  # each device has its own
    own = [t.with_columns(pl.col(c) + noise(t) for c in AXES) for t in tables.values()]
    table = pl.concat([t.with_columns(device=pl.lit(n)) for n, t in zip(tables, own, strict=True)])
    table.write_parquet(folder / "a.parquet")
    return folder


@pytest.mark.slow
def test_a_fleet_of_which_nothing_was_calibrated_fails_and_says_why(tmp_path, capfd, monkeypatch):
    aside = lambda estimator, basis, fit, temperature, alone=True: (
        ("accel: 12 of 20 dwells disagree",) * len(fit.parameters)
    )
    monkeypatch.setattr("inertiax.fleet.rows.judge", aside)
    folder = line(tmp_path / "line", {f"D{k}": TABLE for k in range(3)})
    status, out, err = run(capfd, monkeypatch, "fleet", folder, "-o", tmp_path / "out", "--json")
    assert status == 1
    assert (
        err.startswith("inertiax: none of 3 devices was calibrated: 3 × ") and err.count("\n") == 1
    )
    assert json.loads(out)["calibrated"] == 0
    assert (tmp_path / "out" / "quarantine.parquet").exists()


@pytest.mark.slow
def test_scores_asked_for_a_second_time_are_those_of_the_first(tmp_path, capfd, monkeypatch):
    """Whole numbers of an effect's settings came back from the manifest as floats, which index nothing."""
    folder = line(tmp_path / "line", {f"D{k}": TABLE for k in range(9)})
    ask = ("fleet", folder, "-o", tmp_path / "out", "--explain", "-q")
    assert run(capfd, monkeypatch, *ask)[0] == 0
    first = read_parts(tmp_path / "out").collect()
    for file in (tmp_path / "out" / "parts").iterdir():
        file.unlink()
    status, _, err = run(capfd, monkeypatch, *ask)
    assert (status, err) == (0, "")
    assert read_parts(tmp_path / "out").collect().equals(first)
    assert (tmp_path / "out" / "line.json").exists()


@pytest.mark.slow
def test_of_two_fleets_into_one_folder_one_is_refused_in_a_line(tmp_path, capfd, monkeypatch):
    folder = line(tmp_path / "line", {"A": TABLE})
    code = (
        "import sys\nfrom pathlib import Path\nfrom inertiax.storage.ownership import owned\n"
        "with owned(Path(sys.argv[1])):\n    print('mine', flush=True)\n    sys.stdin.read()"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "out")], **pipes) as first:
        assert first.stdout.readline() == "mine\n"
        status, out, err = run(capfd, monkeypatch, "fleet", folder, "-o", tmp_path / "out")
        first.communicate("")
    assert (status, out) == (1, "")
    assert f"out: another run (process {first.pid} on " in err and err.count("\n") == 1
    with owned(tmp_path / "out"):
        pass
    assert sorted(p.name for p in tmp_path.iterdir()) == ["line"]
