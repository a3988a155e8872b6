"""What holds for every command: JSON for scripts, nothing on a pipe but the result, completion, quick help."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

from bad_inputs_cases import CSV, FLEET, good_calibration, TOML
from command_runs import place, run, run_in, UNDRAWN
from hand_log_data import G, hand_log
from inertiax.cli.app import app
from inertiax.plots.style import both_forms


COMMANDS = [c.name for c in app.registered_commands]
SCENARIO = '[plan]\nprogramme = "8"\ntemperatures = [20.0]\ndwell_time = 5.0\nslew_time = 2.0\n'
FILES = {
    "good/campaign.toml": TOML,
    "good/a.csv": CSV,
    "good.csv": CSV,
    "good.json": good_calibration(thermal=False),
    "s.toml": SCENARIO,
    "rest.csv": "time,accel_x,accel_y,accel_z\n"
    + "".join(f"{0.01 * k:.2f},0.0{k % 7},0.0{k % 5},9.8{k % 3}\n" for k in range(600)),
    **FLEET,
}
QUICK = {
    "calibrate": "calibrate @good -o @out",
    "compensate": "compensate @good.json @good.csv -o @out.csv",
    "design": "design --optimise --positions 12 --experiments 3 --degree 1",
    "export": "export @good.json --to inertiax -o @out.json",
    "fleet": "fleet @c -o @out --workers 1",
    "init": "init @rest.csv -o @out --replace",
    "noise": "noise @rest.csv -o @out",
    "simulate": "simulate @s.toml -o @out",
}


def python(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", "import sys; from inertiax.cli import main; main(sys.argv[1:])", *arguments],
        capture_output=True, text=True, timeout=60, env={**os.environ, **environment},
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("command", QUICK)
def test_json_is_all_that_a_pipe_gets(command, tmp_path, capfd, monkeypatch):
    place(tmp_path, FILES)
    status, out, err = run_in(f"{QUICK[command]} --json", tmp_path, capfd, monkeypatch)
    assert status == 0, err
    assert isinstance(json.loads(out), dict)
    assert err == ""


@pytest.mark.parametrize("header", ["millis,ax,ay,az", "time,ax,ay,az"])
def test_noise_of_a_log_with_other_names_says_how_to_go_on(header, tmp_path, capfd, monkeypatch):
    log = FILES["rest.csv"].replace("time,accel_x,accel_y,accel_z", header)
    place(tmp_path, {"raw.csv": log})
    status, _, err = run_in("noise @raw.csv -o @out", tmp_path, capfd, monkeypatch)
    assert status == 1 and err.count("\n") == 1
    assert "`inertiax init raw.csv -o DIR` writes a campaign.toml" in err
    assert "then `inertiax noise DIR`" in err


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_offers_json_and_quiet_and_says_what_it_does(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    status, out, err = run(capsys, monkeypatch, command, "--help")
    assert status == 0 and err == ""
    assert "--json" in out and "--quiet" in out
    assert len(out.splitlines()) > 10


def test_the_catalogue_of_effects_is_printed_without_a_campaign(capsys, monkeypatch):
    from inertiax.effects import CATALOGUE

    status, out, _ = run(capsys, monkeypatch, "diagnose", "--list")
    assert status == 0
    names = [line.partition(":")[0] for line in out.splitlines() if not line.startswith(" ")]
    assert names == [effect.name for effect in CATALOGUE]
    for effect in CATALOGUE:
        assert effect.equation in out and effect.needs in out and effect.separating in out


@pytest.mark.slow
def test_calibration_and_diagnosis_load_nothing_large_that_they_seldom_need():
    modules = "inertiax.calibrate.pipeline, inertiax.diagnose.pipeline, inertiax.report.calibration"
    said = subprocess.run(
        [sys.executable, "-c", f"import sys, {modules}\nprint(*sorted(sys.modules))"],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    loaded = set(said.stdout.split())
    assert "scipy.optimize" in loaded  # what was loaded is seen
    # A fifth of the imports' time is spared.
    assert not loaded & {
        "scipy.signal",
        "scipy.stats",
        "pandas",
        "dask",
        "bokeh",
        "matplotlib.pyplot",
    }


def test_help_loads_nothing_large():
    said = subprocess.run(
        [sys.executable, "-c", "import sys; from inertiax.cli import main\ntry: main(['--help'])\n"
         "except SystemExit: print(*sorted(m.split('.')[0] for m in sys.modules), file=sys.stderr)"],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert "Usage" in said.stdout and "calibrate" in said.stdout
    loaded = set(said.stderr.split())
    assert "typer" in loaded  # what was loaded is seen
    assert not loaded & {
        "jax",
        "numpy",
        "scipy",
        "polars",
        "matplotlib",
        "equinox",
        "dask",
        "jinja2",
    }


ALONE = """
import json, sys
from inertiax.cli import main
for command in json.loads(sys.argv[1]):
    sys.argv = ["inertiax", *command]
    try:
        main(command)
    except SystemExit as end:
        assert not end.code, command
    print("---")
print(*sorted(sys.modules), file=sys.stderr)
"""


@pytest.mark.slow
def test_commands_of_the_host_load_no_jax_and_find_the_same(tmp_path, capsys, monkeypatch):
    time, accel, gyro = hand_log(rate=100.0)
    names = "time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z"
    table = np.column_stack([time, accel, gyro])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=names, comments="")
    (tmp_path / "campaign.toml").write_text(
        f'[site]\ngravity = {G}\n[recordings]\nfiles = ["log.csv"]\n'
    )
    made = tmp_path / "out" / "calibration.json"
    commands = [
        [*command.split(), "--json", "-q"]
        for command in (
            f"noise {tmp_path} -o {tmp_path / 'noise'}",
            f"check {tmp_path}",
            f"calibrate {tmp_path} -o {tmp_path / 'out'}",
            f"compensate {made} {tmp_path / 'log.csv'} -o {tmp_path / 'rows.csv'}",
            f"export {made} --to imucal -o {tmp_path / 'imucal.json'}",
        )
    ]
    alone = subprocess.run(
        [sys.executable, "-c", ALONE, json.dumps(commands)],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert alone.returncode == 0, alone.stderr
    loaded = set(alone.stderr.split())
    assert "inertiax.data.recording" in loaded  # what was loaded is seen
    assert not loaded & {"jax", "equinox", "optimistix"}
    files = [made, tmp_path / "rows.csv", tmp_path / "imucal.json"]
    there = [f.read_bytes() for f in files]
    # Its figures are drawn above; here they are left out.
    draw = lambda form, *_: UNDRAWN if form is both_forms else UNDRAWN.png
    monkeypatch.setattr("inertiax.plots.figure_workers._draw", draw)
    for command, told in zip(commands, alone.stdout.split("---\n"), strict=False):
        _, out, _ = run(capsys, monkeypatch, *command)  # where the tests loaded JAX
        assert json.loads(told) == json.loads(out)
    assert [f.read_bytes() for f in files] == there


def test_shells_complete_commands_and_options():
    asked = {"_INERTIAX_COMPLETE": "complete_bash", "COMP_CWORD": "1", "COMP_WORDS": "inertiax cal"}
    assert python(**asked).stdout.split() == ["calibrate"]
    asked |= {"COMP_CWORD": "2", "COMP_WORDS": "inertiax calibrate --js"}
    assert python(**asked).stdout.split() == ["--json"]


def test_terminal_codes_in_a_message_are_made_harmless(tmp_path, capfd, monkeypatch):
    (tmp_path / "\x1b[2Jx").mkdir()
    status, _, err = run_in("calibrate \x1b[2Jx -o @out", tmp_path, capfd, monkeypatch)
    assert status == 2
    assert re.fullmatch(r"inertiax: [^\x00-\x1f]*\n", err)
