"""The claims of speed, measured in one run and added to a table, so that a slower revision shows.

Each claim is a number with a bound: a ratio to a peer that the same script runs in the same minute, or seconds and
megabytes. Seconds are of the processor, which other work on a machine changes by a fifth; beside them stands their
ratio to a yardstick, a fixed job of NumPy and Python that is timed before and after the claim's script, and which such
work changes alike. Compare that ratio between rows, and seconds on one machine alone.

    INERTIAX_RECORDINGS=... python benchmarks/speed_history.py [--claims diagnose ...] [--table FILE] [--note TEXT]

The table is `benchmarks/speed_history.csv`: one line a claim and run. The script ends with status 1 where a bound that
the last run of that claim on this kind of processor reached is missed now.
"""

import argparse
import csv
import datetime
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np


HERE = Path(__file__).parent
TABLE = HERE / "speed_history.csv"


@dataclass(frozen=True)
class Figure:
    """One measured number and its bound; `at_least` turns the bound round."""

    claim: str
    value: float
    unit: str
    bound: float
    at_least: bool = False

    @property
    def reached(self) -> bool:
        """Whether the bound holds."""
        return self.value >= self.bound if self.at_least else self.value <= self.bound


@dataclass(frozen=True)
class Line:
    """One line of the table."""

    date: str
    revision: str
    processor: str
    cores: int
    claim: str
    value: float
    unit: str
    bound: float
    reached: bool
    yardsticks: float  # seconds in yardsticks; NaN for ratios and megabytes
    note: str


def yardstick() -> float:
    """Processor seconds of a fixed job like the toolkit's own: small factorisations, products, and Python."""
    rng = np.random.default_rng(0)
    matrix = rng.standard_normal((32, 32))
    matrix = matrix @ matrix.T + 32.0 * np.eye(32)
    wide = rng.standard_normal((1000, 300))
    began, kept = time.process_time(), 0.0
    for _ in range(40):
        for _ in range(200):
            kept += float((np.linalg.cholesky(matrix) @ matrix)[0, 0])
        kept += sum(float(k) for k in range(20_000))
        kept += float((wide.T @ wide)[0, 0])
    assert kept > 0.0
    return time.process_time() - began


def of_diagnosis(found: list[dict]) -> list[Figure]:
    """Of `diagnose_speed.py`."""
    (one,) = found
    return [
        Figure("diagnose, 40 000 rows, later runs", one["wall_s"], "s", 8.0),
        Figure("diagnose, 40 000 rows, first run", one["cold_s"], "s", 15.0),
        Figure("diagnose, 40 000 rows, memory", one["memory_mb"], "MB", 600.0),
    ]


def of_commands(found: dict) -> list[Figure]:
    """Of `command_times.py`, by the clock: peer and commands take turns."""
    warm = lambda name: statistics.median(wall for wall, _ in found[name]["warm"])
    used = lambda name: statistics.median(cpu for _, cpu in found[name]["warm"])
    return [
        Figure("calibrate of the Xsens log", used("calibrate Xsens"), "s", 2.0),
        Figure(
            "calibrate of the Xsens log, beside SciPy",
            warm("calibrate Xsens") / warm("SciPy script"), "ratio", 2.0,
        ),
        Figure("compensate", used("compensate"), "s", 1.5),
        Figure("noise", used("noise"), "s", 1.5),
        Figure("design --audit", used("design --audit"), "s", 6.0),
        Figure("demo", used("demo"), "s", 8.0),
    ]  # fmt: skip


def of_small_calibration(found: dict) -> list[Figure]:
    """Of `scipy_calibration.py`."""
    used = {name: statistics.median(cpu for _, cpu in runs) for name, runs in found["rows"].items()}
    ratio = used["inertiax, later runs"] / used["SciPy script"]
    return [Figure("calibrate, 63 parameters, beside SciPy", ratio, "ratio", 2.0)]


def of_fleet(found: dict) -> list[Figure]:
    """Of `fleet/solve.py`, core for core; Ceres only where pyceres is installed."""
    nine, many = found["on_one_core"]["constant"], found["on_one_core"]["thermal"]
    made = [
        Figure(
            "63 parameters a device, SciPy over ours",
            many["scipy_us"][1] / many["ours_us"][1], "ratio", 50.0, at_least=True,
        ),
        Figure(
            "9 parameters a device, beside C by hand",
            nine["ours_us"][1] / nine["bound_us"][1], "ratio", 2.0,
        ),
    ]  # fmt: skip
    ceres = nine["ceres_us"][1] / nine["ours_us"][1]
    if np.isfinite(ceres):
        name = "9 parameters a device, Ceres over ours"
        made.append(Figure(name, ceres, "ratio", 250.0, at_least=True))
    return made


SCRIPTS: dict[str, tuple[list[str], Callable[..., list[Figure]]]] = {
    "diagnose": (["diagnose_speed.py", "--rows", "40000", "--runs", "3"], of_diagnosis),
    "commands": (["command_times.py", "--runs", "3"], of_commands),
    "small": (["scipy_calibration.py", "--repeats", "3"], of_small_calibration),
    "fleet": (["fleet/solve.py"], of_fleet),
}


def measured(name: str) -> list[tuple[Figure, float]]:
    """The figures of one script, and their seconds in yardsticks."""
    command, read = SCRIPTS[name]
    before = yardstick()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "found.json"
        run = [sys.executable, str(HERE / command[0]), *command[1:], "--json", str(out)]
        subprocess.run(run, check=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})
        found = read(json.loads(out.read_text("utf-8")))
    unit = 0.5 * (before + yardstick())
    return [(f, f.value / unit if f.unit == "s" else float("nan")) for f in found]


def processor() -> str:
    """The processor's name."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text("utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def revision() -> str:
    """The commit that was measured, with `+` where files differ from it."""
    ask = ["git", "-C", str(HERE), "describe", "--always", "--dirty=+"]
    return subprocess.run(ask, check=True, capture_output=True, text=True).stdout.strip()


def lost(past: list[dict[str, str]], now: Line) -> bool:
    """Whether the last run of a claim on this kind of processor reached the bound that is missed now."""
    same = [p for p in past if (p["claim"], p["processor"]) == (now.claim, now.processor)]
    return bool(same) and same[-1]["reached"] == "True" and not now.reached


def main() -> None:
    """Measure, print and add to the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--claims", nargs="+", choices=list(SCRIPTS), default=list(SCRIPTS))
    parser.add_argument("--table", type=Path, default=TABLE)
    parser.add_argument("--note", default="", help="Such as what else the machine did.")
    asked = parser.parse_args()
    past = []
    if asked.table.exists():
        with asked.table.open(newline="", encoding="utf-8") as file:
            past = list(csv.DictReader(file))
    about = (datetime.date.today().isoformat(), revision(), processor(), os.cpu_count() or 1)
    lines = []
    for name in asked.claims:
        for f, yardsticks in measured(name):
            value = float(f"{f.value:.4g}"), f.unit, f.bound, f.reached, float(f"{yardsticks:.4g}")
            lines.append(Line(*about, f.claim, *value, asked.note))
    with asked.table.open("a", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [f.name for f in fields(Line)], lineterminator="\n")
        if not past:
            table.writeheader()
        table.writerows(map(asdict, lines))
    for line in lines:
        said = "reached" if line.reached else "MISSED"
        said += ", and was reached before" if lost(past, line) else ""
        print(f"{line.claim:44}{line.value:10.4g} {line.unit:6}{line.bound:8g}  {said}")
    if any(lost(past, line) for line in lines):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
