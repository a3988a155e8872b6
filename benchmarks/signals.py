"""Signals at random moments: the same command again completes, equals an undisturbed run, and leaves nothing behind.

    python benchmarks/signals.py --count 40 --limit 300 [--seed 0] [--commands calibrate,fleet]

Every command runs undisturbed once, on a campaign of a few hundred rows. Then a command is drawn, and a signal (INT,
TERM, KILL, HUP, PIPE) is sent at a moment that is uniform over 1.1 times its undisturbed duration. Checked each time:
a run that INT, TERM or HUP ended has its status and one line, and left nothing that begins with `.inertiax-`; the
earlier results, where there were any, are whole; the same command then ends with status 0, its results equal those of
the undisturbed run (what says when or in how many tasks aside), and nothing is left behind. `--limit` seconds bound the
whole; run it in parts with different seeds. Ends with status 1 if anything was found.
"""

import argparse
import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import polars as pl


SIGNALS = {n: getattr(signal, f"SIG{n}") for n in ("INT", "TERM", "KILL", "HUP", "PIPE")}
STATUS = {"INT": 130, "TERM": 143, "HUP": 129}
GRAVITY = 9.815
TOML = f'[site]\ngravity = {GRAVITY}\n\n[recordings]\nfiles = ["log.parquet"]\n'


def rests(seed: int, positions: int = 14, samples: int = 40) -> pl.DataFrame:
    """Rests at random attitudes with a bias of 0.1 m/s² and white noise."""
    rng = np.random.default_rng(seed)
    up = rng.standard_normal((positions, 3))
    up *= GRAVITY / np.linalg.norm(up, axis=1, keepdims=True)
    accel = (
        np.repeat(up, samples, axis=0) + 0.1 + 1e-3 * rng.standard_normal((positions * samples, 3))
    )
    columns = {f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}
    return pl.DataFrame({
        "time": 0.05 * np.arange(len(accel)), **columns, "position": np.repeat(np.arange(positions), samples)
    })  # fmt: skip


def prepare(home: Path) -> None:
    """A device, a line of twelve, a calibration."""
    (home / "one").mkdir(parents=True)
    (home / "one" / "campaign.toml").write_text(TOML)
    rests(0).write_parquet(home / "one" / "log.parquet")
    (home / "line").mkdir()
    (home / "line" / "campaign.toml").write_text(TOML)
    line = [rests(k).with_columns(device=pl.lit(f"D{k}")) for k in range(12)]
    pl.concat(line).write_parquet(home / "line" / "log.parquet")
    subprocess.run(command(["calibrate", "one", "-o", "known", "-q"]), cwd=home, check=True)


COMMANDS = {
    "calibrate": ["calibrate", "one", "-o", "out", "-q"],
    "diagnose": ["diagnose", "one", "-o", "out", "-q"],
    "noise": ["noise", "one", "-o", "out", "-q"],
    "compensate": [
        "compensate",
        "known/calibration.json",
        "one/log.parquet",
        "-o",
        "out/c.csv",
        "-q",
    ],
    "export": ["export", "known/calibration.json", "--to", "c", "-o", "out/c.h", "-q"],
    "simulate": ["simulate", "gyro-table", "-o", "out", "-q"],
    "learn-noise": ["learn-noise", "one", "--consistent", "-o", "out/noise.json", "-q"],
    "fleet": ["fleet", "line", "-o", "out", "-q"],
    "fleet-explain": ["fleet", "line", "-o", "out", "-q", "--explain"],
    "fleet-local": ["fleet", "line", "-o", "out", "-q", "--scheduler", "local", "--workers", "1"],
}


def command(arguments: list[str]) -> list[str]:
    """A command line of this interpreter."""
    return [sys.executable, "-m", "inertiax", *arguments]


def contents(folder: Path) -> dict[str, object]:
    """What a run found: its tables and documents; of pages and figures that they are there."""
    found: dict[str, object] = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        name = str(path.relative_to(folder))
        if path.suffix == ".parquet":
            found[name] = pl.read_parquet(path).to_dicts()
        elif path.suffix == ".json":
            found[name] = json.loads(path.read_text("utf-8"))
        elif path.suffix in (".html", ".svg", ".png"):  # matplotlib's pictures have random marks
            found[name] = path.stat().st_size > 0
        else:
            found[name] = path.read_bytes()
    return found


def left_behind(home: Path) -> list[str]:
    """Unfinished files, and locks."""
    return [str(p.relative_to(home)) for p in home.rglob("*") if p.name.startswith(".inertiax-")]


def once(home: Path, name: str, sent: str, moment: float, expected: dict) -> list[str]:
    """Send one signal at one moment; **returns** what was wrong."""
    wrong: list[str] = []
    shutil.rmtree(home / "out", ignore_errors=True)
    run = subprocess.Popen(
        command(COMMANDS[name]),
        cwd=home,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(moment)
    run.send_signal(SIGNALS[sent])
    _, said = run.communicate(timeout=120)
    status = run.returncode
    if sent in STATUS and status not in (0, -SIGNALS[sent], STATUS[sent]) and not early(said):
        wrong.append(f"status {status}: {said[:300]}")
    if status == STATUS.get(sent) and (said.count("\n") != 1 or left_behind(home)):
        wrong.append(f"said {said[:300]!r}, left {left_behind(home)}")
    if sent == "PIPE" and status != 0:
        wrong.append(f"PIPE ended it with {status}: {said[:300]}")
    if (
        name == "simulate" and (home / "out").exists()
    ):  # done before the signal: it refuses a second time
        again_status, said = 0, ""
    else:
        again = subprocess.run(
            command(COMMANDS[name]), cwd=home, capture_output=True, text=True, timeout=240
        )
        again_status, said = again.returncode, again.stderr
    if again_status != 0:
        wrong.append(f"again: status {again_status}: {said[:300]}")
    elif contents(home / "out") != expected:
        wrong.append("again: results differ from the undisturbed run's")
    if left_behind(home):
        wrong.append(f"again: left {left_behind(home)}")
    return wrong


def early(said: str) -> bool:
    """Whether Python itself had not begun our code: Ctrl-C is then told in its own words."""
    return "inertiax/cli" not in said and "KeyboardInterrupt" in said


def main() -> None:
    """Run as many as the time allows, and say the figures."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--count", type=int, default=200)
    asked.add_argument("--limit", type=float, default=420.0, help="seconds")
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--commands", default=",".join(COMMANDS))
    options = asked.parse_args()
    end, rng = time.monotonic() + options.limit, random.Random(options.seed)
    names = options.commands.split(",")
    sent, problems = Counter(), []
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        prepare(home)
        known: dict[str, tuple[float, dict]] = {}
        for _ in range(options.count):
            name, number = rng.choice(names), rng.choice(list(SIGNALS))
            if name not in known:
                shutil.rmtree(home / "out", ignore_errors=True)
                start = time.monotonic()
                subprocess.run(
                    command(COMMANDS[name]), cwd=home, check=True, stdout=subprocess.DEVNULL
                )
                known[name] = time.monotonic() - start, contents(home / "out")
            duration, expected = known[name]
            moment = rng.uniform(0.0, 1.1 * duration)
            wrong = once(home, name, number, moment, expected)
            problems += [
                f"{name} {number} after {moment:.2f} of {duration:.2f} s: {w}" for w in wrong
            ]
            sent[name, number] += 1
            if time.monotonic() > end:
                break
    for by, k in (("command", 0), ("signal", 1)):
        counts = Counter()
        for key, times in sent.items():
            counts[key[k]] += times
        print(f"by {by}: " + ", ".join(f"{n} {c}" for n, c in sorted(counts.items())))
    print(f"{sum(sent.values())} signals, {len(problems)} problems")
    for line in problems:
        print("  " + line)
    sys.exit(1 if problems else 0)


if __name__ == "__main__":
    main()
