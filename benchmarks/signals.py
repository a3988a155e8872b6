"""Signals at random moments: the same command again completes, equals an undisturbed run, and leaves nothing behind.

    python benchmarks/signals.py --rounds 1 --limit 1200 [--seed 0] [--commands calibrate,fleet]

Every command runs undisturbed once, on a campaign of a few hundred rows. In a round each command is then started five
times into the same place, and each of the signals (INT, TERM, KILL, HUP, PIPE), in random order, ends one of these
runs at a moment that is uniform over 1.1 times the undisturbed duration; the same command is at last left alone. A
run that was done before its signal is not the beginning of the next one. Checked each time:

* a run that INT, TERM or HUP ended has its status and one line, and left nothing that begins with `.inertiax-`, nor
  anything among the temporary files; PIPE ends none;
* the last run ends with status 0, what it wrote and said equals the undisturbed run's (dates and
  pictures aside), and nothing is left behind, among the temporary files neither;
* `live`, for which Ctrl-C is the end of the input: what it recorded before is a beginning of the log, row for row, and
  the same command makes another folder beside it.

`--limit` seconds bound the whole; run it in parts with different seeds. Ends with status 1 if anything was found.
"""

import argparse
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl


SIGNALS = {n: getattr(signal, f"SIG{n}") for n in ("INT", "TERM", "KILL", "HUP", "PIPE")}
STATUS = {"INT": 130, "TERM": 143, "HUP": 129}
GRAVITY = 9.815
RATE = 20.0  # Hz
TOML = f'[site]\ngravity = {GRAVITY}\n\n[recordings]\nfiles = ["log.parquet"]\n'
# Dates, and what contains them: the protocol's, and the sums of its files.
PATIENCE = 900.0  # s; a busy machine is no hang
WHEN = re.compile(rb"\d{4}-\d{2}-\d{2}([T ]\d{2}:\d{2}(:\d{2})?)?|live-\d{8}-\d{6}|[0-9a-f]{64}")
PICTURES = (".html", ".svg", ".png", ".pdf")  # with random marks or dates: only that they are there


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
        "time": np.arange(len(accel)) / RATE, **columns, "position": np.repeat(np.arange(positions), samples)
    })  # fmt: skip


def prepare(home: Path) -> None:
    """Two devices, a line of twelve, a log at rest, one for `live`, a calibration."""
    for name in ("one", "two", "line", "lively"):
        (home / name).mkdir(parents=True)
        (home / name / "campaign.toml").write_text(TOML)
    (home / "temporary").mkdir()
    for seed, name in enumerate(("one", "two")):
        rests(seed).write_parquet(home / name / "log.parquet")
    line = [rests(k).with_columns(device=pl.lit(f"D{k}")) for k in range(12)]
    pl.concat(line).write_parquet(home / "line" / "log.parquet")
    still = rests(3, positions=1, samples=600).drop("position")
    still.write_parquet(home / "still.parquet")
    # Rests of 5 s, longer than the 4 s that `live` holds one; it finds them by itself.
    (home / "lively" / "campaign.toml").write_text(TOML.replace("log.parquet", "log.csv"))
    rests(1, samples=100).drop("position").write_csv(home / "lively" / "log.csv")
    subprocess.run(command(["calibrate", "one", "-o", "known", "-q"]), cwd=home, check=True)


COMMANDS = {
    "calibrate": "calibrate one -o out -q",
    "check": "check one",
    "compensate": "compensate known/calibration.json one/log.parquet -o out/c.csv -q",
    "demo": "demo -o out -q",
    "design": "design --audit one",
    "design-scenario": "design --audit gyro-table",
    "design-optimise": "design --optimise --positions 9",
    "diagnose": "diagnose one -o out -q",
    "export": "export known/calibration.json --to c -o out/c.h -q",
    "fleet": "fleet line -o out -q",
    "fleet-dask": "fleet line -o out -q --scheduler {dask}",
    "fleet-explain": "fleet line -o out -q --explain",
    "fleet-local": "fleet line -o out -q --scheduler local --workers 1",
    "init": "init one/log.parquet -o out --replace -q",
    "learn-noise": "learn-noise one two --consistent -o out/noise.json -q",
    "live": "live lively --idle 0.2 -q",
    "noise": "noise still.parquet -o out -q",
    "protocol": "protocol known -o out -q",
    "simulate": "simulate gyro-table -o out -q",
}

# A scheduler of Dask's with a worker on this machine, as an operator would have them.
DASK = """
import sys
from dask.distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


class Undisturbed(NamedTuple):
    """How long a command takes, and what it writes and says."""

    seconds: float
    files: dict[str, object]
    said: bytes


class Bench:
    """Runs commands in one folder, disturbed and not."""

    def __init__(self, home: Path, dask: str):
        self.home = home
        self._dask = dask
        self._known: dict[str, Undisturbed] = {}

    def undisturbed(self, name: str) -> Undisturbed:
        """The first run of a command; kept."""
        if name not in self._known:
            self.clear()
            start = time.monotonic()
            done = self._run(name)
            seconds = time.monotonic() - start
            if done.returncode != 0:
                raise RuntimeError(f"{name}: {done.stderr.decode()}")
            self._known[name] = Undisturbed(seconds, self.contents(), neutral(done.stdout))
        return self._known[name]

    def several(self, name: str, sent: list[tuple[str, float]]) -> list[str]:
        """Send signals, each to a run of its own at a moment of it, and let the last run be.

        **Returns** what was wrong.
        """
        expected = self.undisturbed(name)
        done, wrong = True, []
        for number, moment in sent:
            if done:
                self.clear()
            done, found = self._disturb(name, number, moment)
            found += self._recorded() if name == "live" else []
            wrong += [f"{number} after {moment:.2f} s: {w}" for w in found]
        if name == "simulate" and (self.home / "out").exists():
            # It was done before the signal, and refuses what is there.
            done, files = None, self.contents()
        else:
            done = self._run(name)
            files = self.contents()
        if done is not None and done.returncode != 0:
            wrong.append(f"again: status {done.returncode}: {done.stderr.decode()[:300]}")
        elif files != expected.files:
            differ = [k for k in files.keys() | expected.files.keys()
                      if files.get(k) != expected.files.get(k)]  # fmt: skip
            wrong.append(f"again: {differ} differ from the undisturbed run's")
        elif done is not None and neutral(done.stdout) != expected.said:
            wrong.append("again: it says something else than the undisturbed run")
        left = self.left_behind()
        return [*wrong, f"again: left {left}"] if left else wrong

    def _disturb(self, name: str, sent: str, moment: float) -> tuple[bool, list[str]]:
        """Whether the run was done before the signal, and what was wrong."""
        wrong = []
        run = subprocess.Popen(
            self._command(name), cwd=self.home, env=self._environment(), text=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        )  # fmt: skip
        time.sleep(moment)
        run.send_signal(SIGNALS[sent])
        _, said = run.communicate(timeout=PATIENCE)
        status, left = run.returncode, self.left_behind()
        ends_input = name == "live" and sent == "INT" and status == 1 and said.count("\n") == 1
        if sent in STATUS and status not in (0, -SIGNALS[sent], STATUS[sent]):
            if not early(said) and not ends_input:
                wrong.append(f"status {status}: {said[:300]}")
        if status == STATUS.get(sent) and (said.count("\n") != 1 or left):
            wrong.append(f"said {said[:300]!r}, left {left}")
        if sent == "PIPE" and status != 0:
            wrong.append(f"PIPE ended it with {status}: {said[:300]}")
        return status == 0 or (name == "simulate" and (self.home / "out").exists()), wrong

    def _recorded(self) -> list[str]:
        """Whether a session that was disturbed kept rows as they came; it is put aside."""
        log, wrong = (self.home / "lively" / "log.csv").read_bytes(), []
        for folder in (self.home / "lively").glob("live-*"):
            for file in folder.glob("recording-*.csv"):
                if not log.startswith(file.read_bytes()):
                    wrong.append(f"{file.name} is no beginning of the log")
            shutil.rmtree(folder)
        return wrong

    def contents(self) -> dict[str, object]:
        """What a run found: its tables and documents; of pages and figures that they are there."""
        found: dict[str, object] = {}
        sessions = sorted((self.home / "lively").glob("live-*"))
        for folder in (self.home / "out", *sessions):
            for path in sorted(p for p in folder.rglob("*") if p.is_file()):
                found[str(path.relative_to(folder))] = content(path)
        return found

    def left_behind(self) -> list[str]:
        """Unfinished files, locks, and what is among the temporary files."""
        found = [p for p in self.home.rglob("*") if p.name.startswith(".inertiax-")]
        found += (self.home / "temporary").iterdir()
        return sorted({str(p.relative_to(self.home)) for p in found})

    def clear(self) -> None:
        for folder in (self.home / "out", *(self.home / "lively").glob("live-*")):
            shutil.rmtree(folder, ignore_errors=True)

    def _run(self, name: str) -> subprocess.CompletedProcess[bytes]:
        return subprocess.run(
            self._command(name), cwd=self.home, env=self._environment(), capture_output=True, timeout=PATIENCE
        )  # fmt: skip

    def _command(self, name: str) -> list[str]:
        return command(COMMANDS[name].format(dask=self._dask).split())

    def _environment(self) -> dict[str, str]:
        return {**os.environ, "TMPDIR": str(self.home / "temporary")}


def command(arguments: list[str]) -> list[str]:
    """A command line of this interpreter."""
    return [sys.executable, "-m", "inertiax", *arguments]


def content(path: Path) -> object:
    """What of a file must be equal."""
    if path.suffix == ".parquet":
        return repr(pl.read_parquet(path).to_dicts())  # as text NaN equals itself
    if path.suffix in PICTURES:
        return path.stat().st_size > 0
    found = neutral(path.read_bytes())
    return json.loads(found) if path.suffix == ".json" else found


def neutral(said: bytes) -> bytes:
    """Text without what says when."""
    return WHEN.sub(b"WHEN", said)


def early(said: str) -> bool:
    """Whether Python itself had not begun our code: Ctrl-C is then told in its own words."""
    return "inertiax/cli" not in said and "KeyboardInterrupt" in said


def main() -> None:
    """Run as many as the time allows, and say the figures."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--rounds", type=int, default=2)
    asked.add_argument("--limit", type=float, default=420.0, help="seconds")
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--commands", default=",".join(COMMANDS))
    asked.add_argument("--signals", default=",".join(SIGNALS))
    options = asked.parse_args()
    # A shell ignores it for what runs in the background, and a command leaves ignored signals so.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    end, rng = time.monotonic() + options.limit, random.Random(options.seed)
    names, signals = options.commands.split(","), options.signals.split(",")
    order = [n for _ in range(options.rounds) for n in rng.sample(names, len(names))]
    sent, problems = Counter(), []
    with ExitStack() as stack:
        home = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        prepare(home)
        bench = Bench(home, dask_of(stack) if "fleet-dask" in names else "")
        for name in order:
            seconds = bench.undisturbed(name).seconds
            drawn = rng.sample(signals, len(signals))
            chosen = [(number, rng.uniform(0.0, 1.1 * seconds)) for number in drawn]
            found = bench.several(name, chosen)
            problems += [f"{name} of {seconds:.2f} s: {wrong}" for wrong in found]
            told = ", ".join(f"{n} {m:.1f}" for n, m in chosen)
            print(f"{name} of {seconds:.1f} s, {told}: {'; '.join(found) or 'well'}", flush=True)
            sent.update((name, number) for number in drawn)
            if time.monotonic() > end:
                break
    for by, k in (("command", 0), ("signal", 1)):
        counts = Counter()
        for key, times in sent.items():
            counts[key[k]] += times
        print(f"by {by}: " + ", ".join(f"{n} {c}" for n, c in sorted(counts.items())))
    print(f"{sum(sent.values())} signals, {len(problems)} problems")
    sys.exit(1 if problems else 0)


def dask_of(stack: ExitStack) -> str:
    """The address of a scheduler that lives as long as the stack."""
    cluster = stack.enter_context(
        subprocess.Popen(
            [sys.executable, "-c", DASK], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
    )
    assert cluster.stdin is not None and cluster.stdout is not None
    stack.callback(cluster.stdin.close)
    return cluster.stdout.readline().strip()


if __name__ == "__main__":
    main()
