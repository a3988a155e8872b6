"""No command but `live --page` listens on a port, whoever could reach it."""

import os
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest

from bad_inputs_cases import CSV, good_calibration, rests, TOML
from fleet_data import write_line
from inertiax.cli.app import app


linux = pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="sockets as Linux shows them")

COMMANDS = [
    "init a/a.csv -o drafted",
    "check a",
    "calibrate a -o a-out",
    "compensate good.json a/a.csv -o compensated.csv",
    "noise still.csv -o noise",
    "export a-out/calibration.json --to c -o c.h",
    "protocol a-out -o protocol",
    "design --optimise --positions 9 --experiments 2 --degree 1",
    "design --audit a",
    "simulate station.toml -o simulated",
    "learn-noise a b --consistent -o noise.json",
    "live a --follow a/a.csv --idle 0.2 -o lively",
    "diagnose a -o diagnosis",
    "fleet line -o fleet",
    "fleet line -o fleet-of-processes --scheduler local --workers 1",
    "demo -o demo",
]
STATION = """
[plan]
programme = "8"
temperatures = [20]
dwell_time = 2.0

[recording]
rate = 10.0
"""
# All in one process, which imports and compiles once. Python tells of every socket that is bound through it, however
# short it lives; those that libraries of C or children open are seen in /proc. The demo draws and writes a made-up
# result: what it would simulate and calibrate for half a minute, `simulate` and `calibrate` do here for two seconds.
RUN = """
import sys
from demo_data import demo_result
import inertiax.analysis.paper_experiment as experiment
from inertiax.cli import main
from listening_sockets import Watch

experiment.run_demo = lambda **_: demo_result()

bound = []
sys.addaudithook(lambda event, _: bound.append(event) if event in ("socket.bind", "socket.listen") else None)
if __name__ == "__main__":
    watch = Watch()
    for command in sys.argv[1:]:
        try:
            main(command.split())
        except SystemExit as end:
            print(f"{command} | {end.code or 0} {len(bound)} {len(watch.found)}", flush=True)
    print(watch.looks > 20, watch.most_processes > 1)
"""


def beside_tests(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A process of Python that finds the tests' own modules."""
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder, capture_output=True, text=True, timeout=600,
        env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip


@linux
def test_the_look_at_sockets_sees_a_port(tmp_path):
    code = "import socket\nfrom listening_sockets import listening\n"
    code += "s = socket.create_server(('127.0.0.1', 0))\nprint(len(listening()[0]))"
    assert beside_tests("-c", code, folder=tmp_path).stdout == "1\n"


@pytest.mark.slow
@linux
def test_commands_open_no_port(tmp_path):
    for seed, name in enumerate("ab", start=1):
        (tmp_path / name).mkdir()
        (tmp_path / name / "campaign.toml").write_text(TOML)
        (tmp_path / name / "a.csv").write_text(CSV if name == "a" else rests(seed=seed).write_csv())
    (tmp_path / "station.toml").write_text(STATION)
    (tmp_path / "good.json").write_bytes(good_calibration(thermal=False))
    still = pl.concat([rests(1, seed=k) for k in range(30)]).with_columns(
        time=0.1 * pl.int_range(pl.len())
    )
    still.drop("position").write_csv(tmp_path / "still.csv")
    write_line(tmp_path / "line", 3, files=1, experiments=1, degree=0)
    done = beside_tests("-c", RUN, *(f"{c} -q" for c in COMMANDS), folder=tmp_path)
    *told, last = done.stdout.splitlines()
    assert [line for line in told if " | " in line] == [f"{c} -q | 0 0 0" for c in COMMANDS], (
        done.stderr
    )
    assert last == "True True"


def test_every_command_is_looked_at():
    names = {c.name or c.callback.__name__.replace("_", "-") for c in app.registered_commands}
    assert names == {c.split()[0] for c in COMMANDS}
