"""What `inertiax live` costs while a recording is made: its start, its load, and how soon it says where to turn.

A device is turned and laid down every 6.5 s; its rows are written to the command's standard input at their own pace.
The delay is from the moment when the first row of a turn was written to the `next` that answers the rest before it:
what the finder must see to know that a rest has ended is part of it. The load is the process's own time over the
wall's, without start and without the calibration at the end.

    python benchmarks/live_command.py [--rate 1000] [--seconds 90]
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np


GRAVITY = 9.80665
REST, TURN = 5.0, 1.5  # s


def rows(rate: float, seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, list[float]]:
    """Stamps, forces and rates, and when each turn begins."""
    up, parts, begins, start = np.array([0.0, 0.0, 1.0]), [], [], 0.0
    while start < seconds:
        count = round(REST * rate)
        parts.append(np.hstack([np.tile(GRAVITY * up, (count, 1)), np.zeros((count, 3))]))
        begins.append(start + REST)
        axis = np.cross(up, rng.standard_normal(3))
        axis, count = axis / np.linalg.norm(axis), round(TURN * rate)
        share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count + 1) / count)
        angle = rng.uniform(0.7, 1.6) * share[:, None]
        ups = up * np.cos(-angle) + np.cross(axis, up) * np.sin(-angle)
        parts.append(
            np.hstack([GRAVITY * ups, np.gradient(angle[:, 0], 1.0 / rate)[:, None] * axis])
        )
        up, start = ups[-1], start + REST + TURN
    made = np.concatenate(parts)
    made[:, :3] += [0.1, -0.2, 0.05] + 0.01 * rng.standard_normal((len(made), 3))
    made[:, 3:] += [0.01, -0.02, 0.03] + 1e-3 * rng.standard_normal((len(made), 3))
    return np.column_stack([np.arange(len(made)) / rate, made]), begins


def used(process: int) -> float:
    """Processor time of a running process, s (Linux)."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Print start, load and delays."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--seconds", type=float, default=90.0)
    asked = parser.parse_args()
    made, begins = rows(asked.rate, asked.seconds, np.random.default_rng(3))
    lines = [",".join(f"{x:.6f}" for x in row) + "\n" for row in made]
    header = "time," + ",".join(f"{t}_{a}" for t in ("accel", "gyro") for a in "xyz") + "\n"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "campaign.toml").write_text(
            f"[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ['log.csv']\n"
        )
        command = [sys.executable, "-m", "inertiax", "live", folder, "-", "--json"]
        command += ["-o", f"{folder}/out", "--target", "accel.bias=0.001 mg"]
        begin = time.monotonic()
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        events: list[tuple[float, dict]] = []

        def listen() -> None:
            for line in process.stdout:
                events.append((time.monotonic(), json.loads(line)))

        listener = threading.Thread(target=listen)
        listener.start()
        process.stdin.write(header)
        process.stdin.flush()
        while not events:
            time.sleep(0.01)
        print(f"start to first event: {events[0][0] - begin:.2f} s")
        before, zero, sent = used(process.pid), time.monotonic(), 0
        while sent < len(lines):
            due = min(int((time.monotonic() - zero) * asked.rate), len(lines))
            process.stdin.write("".join(lines[sent:due]))
            process.stdin.flush()
            sent = due
            time.sleep(0.005)
        load = (used(process.pid) - before) / (time.monotonic() - zero)
        process.stdin.close()
        listener.join()
        process.wait()
    told = [at - zero for at, e in events if e["event"] == "next" and not e["provisional"]]
    delays = [min(t - b for t in told if t > b) for b in begins if any(t > b for t in told)]
    delays = [d for d in delays if d < REST]
    print(f"{asked.rate:.0f} rows a second for {made[-1, 0]:.0f} s: {100 * load:.0f} % of a core")
    print(
        f"`next` after the turn's first row, {len(delays)} of {len(begins)} rests: "
        f"median {np.median(delays):.2f} s, greatest {max(delays):.2f} s"
    )


if __name__ == "__main__":
    main()
