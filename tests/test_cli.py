"""The command line: what it writes, prints and returns. Commands run in this process, except where
the claim is about a fresh one."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from command_runs import run
from inertiax.calibration.calibration import read_calibration
from inertiax.campaign_draft.toml_text import Line, Table, toml_text
from inertiax.cli import main
from inertiax.cli.environment import cache_folder
from inertiax.cli.outputs import folder_names, staged_folder
from inertiax.data.campaign import load_campaign
from inertiax.physics.error_model import AccelerometerErrors, distort_accel


GRAVITY = 9.81
_AXES = "xyz"


def _directions() -> np.ndarray:
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    corners = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]) / 3**0.5
    return np.concatenate([faces, corners])


ERRORS = AccelerometerErrors(
    np.array([0.1, -0.2, 0.05]),
    np.array([[1e-3, 0.0, 0.0], [2e-3, -3e-3, 0.0], [-1e-3, 4e-3, 5e-3]]),
)


def rests_table(seed: int, *, noise: float = 1e-4, positions: int = 14) -> pl.DataFrame:
    """Fourteen rests of 20 samples each of a triad with `ERRORS`, in SI."""
    rng = np.random.default_rng(seed)
    force = np.repeat(GRAVITY * _directions()[:positions], 20, axis=0)
    outputs = np.stack([np.asarray(distort_accel(ERRORS, f)) for f in force])
    outputs += noise * rng.standard_normal(outputs.shape)
    columns = {f"accel_{a}": outputs[:, k] for k, a in enumerate(_AXES)}
    number = np.repeat(np.arange(positions), 20)
    time = 0.1 * np.arange(len(force)) + number  # a pause of a second between rests
    return pl.DataFrame({"time": time, **columns, "position": number})


def write_campaign(folder: Path, tables: dict[str, pl.DataFrame]) -> Path:
    """A campaign of CSV files; a key that is not empty becomes the column `device`."""
    folder.mkdir()
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ["*.csv"]\n'
    )
    for number, (device, table) in enumerate(tables.items()):
        if device:
            table = table.with_columns(pl.lit(device).alias("device"))
        table.write_csv(folder / f"{number}.csv")
    return folder


@pytest.fixture(scope="module")
def campaign(tmp_path_factory) -> Path:
    return write_campaign(tmp_path_factory.mktemp("campaign") / "one", {"": rests_table(1)})


@pytest.fixture(scope="module")
def calibrated(campaign, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("calibrated") / "out"
    with pytest.raises(SystemExit) as exit, pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAX_COMPILATION_CACHE_DIR", "")
        main(["calibrate", str(campaign), "-o", str(folder), "--quiet"])
    assert not exit.value.code
    return folder


@pytest.mark.slow
def test_calibrate_writes_the_true_parameters_and_a_report(calibrated):
    calibration = read_calibration(calibrated / "calibration.json")
    errors = calibration.accel_errors(0.0)
    # 20 samples of 1e-4 m/s² in 14 positions: 1 sigma is near 1e-5 m/s² and 2e-6; 6 sigma.
    np.testing.assert_allclose(errors.bias, ERRORS.bias, atol=6e-5)
    np.testing.assert_allclose(errors.matrix, ERRORS.matrix, atol=2e-5)
    assert (calibrated / "report.html").stat().st_size < 1e6
    names = {p.name for p in (calibrated / "figures").iterdir()}
    assert {"curves-accel.png", "curves-accel.svg", "misfit-accel.png", "coverage.png"} <= names


def test_nothing_but_the_result_is_left_beside_it(calibrated):
    assert [p.name for p in calibrated.parent.iterdir()] == ["out"]
    assert not [p for p in calibrated.rglob("*") if p.name.startswith(".")]


@pytest.mark.slow
def test_json_is_one_document_on_stdout(campaign, tmp_path, capsys, monkeypatch):
    code, out, err = run(capsys, monkeypatch, "calibrate", campaign, "-o", tmp_path / "o", "--json")
    assert code == 0, err
    document = json.loads(out)
    device = document["devices"][0]
    assert device["status"] == "calibrated"
    by_name = {p["name"]: p for p in device["accel"]["parameters"]}
    bias = by_name["accel.bias[1]"]
    assert abs(bias["value"] - ERRORS.bias[1]) < 6 * bias["std"]
    assert bias["unit"] == "m/s^2"


def test_the_table_gives_value_sigma_and_unit(campaign, tmp_path, capsys, monkeypatch):
    code, out, err = run(capsys, monkeypatch, "calibrate", campaign, "-o", tmp_path / "o")
    assert code == 0, err
    row = next(line for line in out.splitlines() if line.startswith("scale factor z")).split()
    assert row[-1] == "ppm"
    assert abs(float(row[3]) - 5000.0) < 20.0
    assert "invariant" in out and str(tmp_path / "o" / "calibration.json") in out


def test_what_the_campaign_still_marks_is_said_again(campaign, tmp_path, capsys, monkeypatch):
    guess = Line("gravity", GRAVITY, "standard, not where it was recorded", certain=False)
    text = toml_text(
        ("A log.",), (Table("site", (guess,)), Table("recordings", (Line("files", ["*.csv"]),)))
    )
    copy = shutil.copytree(campaign, tmp_path / "copy")
    file = copy / "campaign.toml"
    for content in (text, text.replace("CHECK ", "")):
        file.write_text(content)
        code, out, err = run(capsys, monkeypatch, "calibrate", copy, "-o", tmp_path / "o")
        assert code == 0, err
        assert ("campaign.toml still marks CHECK: gravity. " in out) == ("CHECK" in content)


@pytest.mark.slow
def test_one_bad_device_does_not_stop_the_others(tmp_path, capsys, monkeypatch):
    tables = {"good": rests_table(2), "../<b>bad</b>": rests_table(3, positions=4)}
    folder = write_campaign(tmp_path / "many", tables)
    code, out, err = run(
        capsys, monkeypatch, "calibrate", folder, "-o", tmp_path / "out", "--json", "--quiet"
    )
    assert code == 1
    assert err.count("\n") == 1 and "1 of 2 devices failed" in err
    status = {d["device"]: d["status"] for d in json.loads(out)["devices"]}
    assert status == {"good": "calibrated", "../<b>bad</b>": "failed"}
    assert (tmp_path / "out" / "good" / "calibration.json").is_file()
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["num_failed"] == 1
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<b>bad</b>" not in page and "&lt;b&gt;bad&lt;/b&gt;" in page
    # The serial number's ".." must not lead out of the folder.
    assert {p.name for p in tmp_path.iterdir()} == {"many", "out"}


def test_a_failure_is_one_line_and_leaves_the_folder_alone(tmp_path, capsys, monkeypatch):
    folder = write_campaign(tmp_path / "few", {"": rests_table(4, positions=3)})
    target = tmp_path / "out"
    target.mkdir()
    (target / "calibration.json").write_text("of an earlier run")
    code, out, err = run(capsys, monkeypatch, "calibrate", folder, "-o", target)
    assert code == 1
    assert err.count("\n") == 1 and "Traceback" not in err
    assert "too few positions" in err
    assert [p.name for p in target.iterdir()] == ["calibration.json"]
    assert (target / "calibration.json").read_text() == "of an earlier run"


def test_bad_content_is_status_1(tmp_path, capsys, monkeypatch):
    folder = write_campaign(tmp_path / "bad", {"": rests_table(5)})
    (folder / "campaign.toml").write_text("[site]\ngravitation = 9.81\n")
    code, _, err = run(capsys, monkeypatch, "calibrate", folder, "-o", tmp_path / "out")
    assert code == 1
    assert err.count("\n") == 1 and "gravit" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["calibrate", "{missing}", "-o", "{out}"],
        ["calibrate", "{empty}", "-o", "{out}"],
        ["calibrate", "{campaign}"],
        ["calibrate", "{campaign}", "-o", "{file}"],
        ["calibrate", "{campaign}", "-o", "{file}/below"],
        ["calibrate", "{campaign}", "-o", "{out}", "--method", "magic"],
        ["calibrate", "{campaign}", "-o", "{out}", "--robust", "-1"],
        ["compensate", "{missing}", "{file}", "-o", "{out}.csv"],
        ["compensate", "{file}", "{file}", "-o", "{out}.xlsx"],
        ["simulate", "no-such-scenario", "-o", "{out}"],
        ["simulate", "paper-check", "-o", "{campaign}"],
        ["frobnicate"],
        ["calibrate", "{campaign}", "-o", "{out}", "--unknown"],
    ],
)
def test_wrong_usage_is_status_2(arguments, campaign, tmp_path, capsys, monkeypatch):
    (tmp_path / "file").write_text("text")
    (tmp_path / "empty").mkdir()
    places = {name: str(tmp_path / name) for name in ("missing", "empty", "file", "out")}
    filled = [a.format(campaign=campaign, **places) for a in arguments]
    code, out, err = run(capsys, monkeypatch, *filled)
    assert code == 2
    assert out == "" and err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["empty", "file"]


def test_compensate_gives_back_what_was_felt(calibrated, tmp_path, capsys, monkeypatch):
    table = rests_table(6, noise=0.0).with_columns(pl.lit("kept").alias("remark"))
    table.write_csv(tmp_path / "raw.csv")
    target = tmp_path / "clean.parquet"
    code, _, err = run(
        capsys,
        monkeypatch,
        "compensate",
        calibrated / "calibration.json",
        tmp_path / "raw.csv",
        "-o",
        target,
    )
    assert code == 0, err
    done = pl.read_parquet(target)
    force = done.select("accel_x", "accel_y", "accel_z").to_numpy()
    # The frame is the accelerometers' own, so the truth is known as it stands; see `calibrate`.
    np.testing.assert_allclose(force, np.repeat(GRAVITY * _directions(), 20, axis=0), atol=5e-4)
    assert done["remark"].to_list() == table["remark"].to_list()
    assert done["position"].to_list() == table["position"].to_list()
    assert not done["extrapolated"].any()
    assert done.columns == [*table.columns, "extrapolated"]


def test_compensate_reads_units_from_a_campaign(calibrated, tmp_path, capsys, monkeypatch):
    table = rests_table(7, noise=0.0)
    raw = pl.DataFrame(
        {"t": table["time"] * 1e3, **{f"a{a}": table[f"accel_{a}"] / 9.80665 for a in _AXES}}
    )
    raw.write_parquet(tmp_path / "raw.parquet")
    (tmp_path / "campaign.toml").write_text(
        '[columns]\ntime = { name = "t", unit = "ms" }\n'
        'accel = { names = ["ax", "ay", "az"], unit = "g" }\n'
    )
    code, _, err = run(
        capsys,
        monkeypatch,
        "compensate",
        calibrated / "calibration.json",
        tmp_path / "raw.parquet",
        "-o",
        tmp_path / "clean.csv",
        "--campaign",
        tmp_path / "campaign.toml",
    )
    assert code == 0, err
    done = pl.read_csv(tmp_path / "clean.csv")
    force = done.select("accel_x", "accel_y", "accel_z").to_numpy()
    np.testing.assert_allclose(force, np.repeat(GRAVITY * _directions(), 20, axis=0), atol=5e-4)
    np.testing.assert_allclose(done["ax"], raw["ax"])


def test_compensate_takes_the_campaign_that_names_the_recording(
    calibrated, tmp_path, capsys, monkeypatch
):
    table = rests_table(7, noise=0.0)
    raw = {"t": table["time"], **{f"a{a}": table[f"accel_{a}"] / 9.80665 for a in _AXES}}
    for name in ("named.csv", "other.csv"):
        pl.DataFrame(raw).write_csv(tmp_path / name)
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["n*.csv"]\n[columns]\ntime = "t"\n'
        'accel = { names = ["ax", "ay", "az"], unit = "g" }\n'
    )
    command = lambda name: (
        *("compensate", calibrated / "calibration.json"),
        *(tmp_path / name, "-o", tmp_path / "clean.csv"),
    )
    code, _, err = run(capsys, monkeypatch, *command("named.csv"))
    assert code == 0, err
    force = pl.read_csv(tmp_path / "clean.csv").select("accel_x", "accel_y", "accel_z").to_numpy()
    np.testing.assert_allclose(force, np.repeat(GRAVITY * _directions(), 20, axis=0), atol=5e-4)
    code, _, err = run(capsys, monkeypatch, *command("other.csv"))
    assert code == 1 and "column 'time' is missing" in err


@pytest.mark.slow
def test_compensate_refuses_a_recording_of_another_device(tmp_path, capsys, monkeypatch):
    folder = write_campaign(tmp_path / "c", {"A": rests_table(8)})
    out = tmp_path / "out"
    assert run(capsys, monkeypatch, "calibrate", folder, "-o", out, "-q")[0] == 0
    rests_table(9).with_columns(pl.lit("B").alias("device")).write_csv(tmp_path / "b.csv")
    arguments = [
        "compensate",
        out / "calibration.json",
        tmp_path / "b.csv",
        "-o",
        tmp_path / "c.csv",
    ]
    code, _, err = run(capsys, monkeypatch, *arguments)
    assert code == 1 and "'B'" in err and "'A'" in err and err.count("\n") == 1
    assert not (tmp_path / "c.csv").exists()
    assert run(capsys, monkeypatch, *arguments, "--any-device")[0] == 0


def test_simulate_writes_a_campaign_that_calibrate_reads(tmp_path, capsys, monkeypatch):
    folder = tmp_path / "check"
    code, out, err = run(capsys, monkeypatch, "simulate", "paper-check", "-o", folder, "--json")
    assert code == 0, err
    assert {"campaign.toml", "truth.json"} <= set(json.loads(out)["files"])
    assert len(load_campaign(folder).recordings) == 1


def test_a_run_replaces_its_own_files_and_leaves_others(tmp_path):
    target = tmp_path / "out"
    (target / "figures").mkdir(parents=True)
    for name in ("mine.txt", "calibration.json", "figures/stale.png"):
        (target / name).write_text("old")
    with staged_folder(target, replaces=("figures/stale.png",)) as staging:
        (staging / "calibration.json").write_text("new")
    assert (target / "calibration.json").read_text() == "new"
    assert (target / "mine.txt").read_text() == "old"
    assert not (target / "figures" / "stale.png").exists()
    assert not [p for p in target.iterdir() if p.name.startswith(".")]


def test_an_interrupted_run_leaves_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), staged_folder(tmp_path / "out") as staging:
        (staging / "calibration.json").write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_folder_names_are_harmless_and_different():
    devices = ("A/1", "A_1", "a_1", "..", "", "../../etc", "x" * 300, "с-1")
    names = folder_names(devices)
    assert list(names) == list(devices)
    for name in names.values():
        assert re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._-]*", name) and len(name) < 100
    assert len({n.casefold() for n in names.values()}) == len(devices)


def test_the_cache_follows_the_platform_rules(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert cache_folder() == Path("/somewhere/inertiax")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # invalid by the specification
    assert cache_folder() == Path.home() / ".cache" / "inertiax"


def test_a_cache_that_cannot_be_written_fails_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    code = (
        "from inertiax.cli.environment import prepare\nprepare()\n"
        "import jax.numpy as jnp\nprint(jnp.ones(3).sum(), jnp.ones(1).dtype)"
    )
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "file")}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "3.0 float64\n", "")


@pytest.mark.slow
@pytest.mark.skipif(
    "INERTIAX_RECORDINGS" not in os.environ,
    reason="needs the imu_tk recording (set INERTIAX_RECORDINGS)",
)
def test_the_xsens_recording_gives_imu_tks_result(tmp_path, capsys, monkeypatch):
    source = Path(os.environ["INERTIAX_RECORDINGS"]) / "imu_tk-xsens"
    (tmp_path / "campaign.toml").write_text(
        "[site]\ngravity = 9.81744\n[recordings]\n"
        f'files = ["{source}/xsens_acc.mat"]\ngyro_files = ["{source}/xsens_gyro.mat"]\n'
        'format = "imu_tk"\n[columns]\n'
        'accel = { unit = "count", scale = 415.0, scale_unit = "count per m/s^2", offset = 32768 }\n'
        'gyro = { unit = "count", scale = 4778.0, scale_unit = "count per rad/s", offset = 32768 }\n'
    )
    code, out, err = run(
        capsys, monkeypatch, "calibrate", tmp_path, "-o", tmp_path / "out", "--json"
    )
    assert code == 0, err
    values = {p["name"]: p["value"] for p in json.loads(out)["devices"][0]["accel"]["parameters"]}
    # The bias by Ceres on imu_tk's own intervals is 33123.83 counts, 1 sigma 0.25; rests that were
    # found a little longer or shorter move it by about as much.
    counts = 32768 + 415.0 * values["accel.bias[0]"]
    assert abs(counts - 33123.83) < 1.0
    assert (tmp_path / "out" / "figures" / "rests.png").is_file()
