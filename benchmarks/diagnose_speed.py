"""Claims: a diagnosis of both triads takes at most 8 s and 600 MB for 40 000 rows, 20 s for 300 000, and no more than
in proportion to rows: processor seconds grow with a power of 1.05 of them at most.

A rate table in plain NumPy, over temperature: rests in 18 positions, plateaus of both signs about three axes between
them, K2 on one accelerometer, white noise and a random walk. Each number of rows is a process of its own with a filled
cache of compiled programs, from the start of Python to its end: seconds of the clock, which the bounds are of, on two
cores without other work; processor seconds with those of its twin (`numerics.forked_work`), which other work changes
little; and the largest resident memory of either.

    python benchmarks/diagnose_speed.py [--rows 10000 40000 ...] [--runs 3] [--json FILE]
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np


RATE = 10.0  # Hz
GRAVITY = 9.81
CYCLE = 20.0  # s: two to turn, twelve at rest, six on a plateau
SECONDS = {40_000: 8.0, 300_000: 20.0}  # of the clock
MEMORY = 600.0  # MB, of 40 000 rows
EXPONENT = 1.05


def campaign(rows: int, seed: int):
    """Both triads on a rate table over temperature with K2 of 300 µg/g² on y."""
    from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site

    rng = np.random.default_rng(seed)
    seconds = np.arange(rows) / RATE
    grid = np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)], float)
    poses = grid[(np.abs(grid).sum(axis=1) > 0) & (np.abs(grid).sum(axis=1) < 3)]
    poses /= np.linalg.norm(poses, axis=1, keepdims=True)
    cycle, within = (seconds // CYCLE).astype(int), seconds % CYCLE
    number = rng.integers(0, len(poses), cycle[-1] + 1)[cycle]
    turning = within >= 14.0
    axis = np.eye(3)[cycle % 3] * np.where(cycle // 3 % 2, 1.0, -1.0)[:, None]
    rate = axis * np.where(turning, 0.5 + 0.5 * (cycle // 6 % 2), 0.0)[:, None]
    force = GRAVITY * poses[number]
    part = seconds / seconds[-1]
    knots = (0.0, 0.1, 0.3, 0.4, 0.6, 0.7, 0.9, 1.0)
    probe = np.interp(part, knots, (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0)) * 60.0 - 10.0
    warm = (probe[:, None] - 20.0) / 30.0
    matrix = np.array([[1.001, 0, 0], [2e-4, 0.999, 0], [-1e-4, 3e-4, 1.0005]])
    accel = force @ matrix.T + [0.01, -0.02, 0.005] + warm * [0.01, 0.004, -0.006]
    accel[:, 1] += 300e-6 * GRAVITY * (force[:, 1] / GRAVITY) ** 2
    gyro = rate @ matrix.T + [1e-3, -2e-3, 5e-4] + warm * [1e-4, 3e-4, -2e-4]
    walk = lambda size: size * np.cumsum(rng.standard_normal((rows, 3)), axis=0)
    recording = Recording(
        time=seconds,
        accel=accel + 1e-3 * rng.standard_normal((rows, 3)) + walk(1e-6),
        gyro=gyro + 1e-4 * rng.standard_normal((rows, 3)) + walk(1e-7),
        reference_gyro=rate,
        temperature=probe[:, None] + 0.004 * rng.standard_normal((rows, 1)),
        experiment=(part * 4).clip(0, 3).astype(int),
        position=np.where(turning | (within < 2.0), -1, number),
    )
    model = ModelChoice(
        accel_estimator="invariant", gyro_estimator="reference", temperature_degree=3
    )
    return Campaign((recording,), Site(GRAVITY), Rig(), model, "tactical")


def measure(rows: int) -> dict:
    """Of this process, from its start."""
    from inertiax.cli import environment

    environment.prepare_without_jax()  # as the command does
    from inertiax.diagnose.pipeline import diagnose_campaign

    began = time.perf_counter()
    found, _ = diagnose_campaign(campaign(rows, 1))
    diagnosis = time.perf_counter() - began
    used = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # of `ru_maxrss`, bytes
    return {
        "rows": rows,
        "processor_s": sum(u.ru_utime + u.ru_stime for u in used),
        "diagnosis_s": diagnosis,
        "memory_mb": max(u.ru_maxrss for u in used) * unit / 1e6,
        "named": [f"{e.name} on {', '.join(e.channels)}" for e in found.effects],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rows", type=int, nargs="+", default=[10_000, 40_000, 300_000, 1_000_000])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--here", type=int, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.here:
        print(json.dumps(measure(asked.here)))
        return
    results = []
    with tempfile.TemporaryDirectory() as cache:
        # As the command line sets it before NumPy is loaded: products of small matrices gain nothing from threads.
        environment = {**os.environ, "XDG_CACHE_HOME": cache, "OPENBLAS_NUM_THREADS": "1"}
        environment.pop("JAX_COMPILATION_CACHE_DIR", None)
        heads = ("cold, s", "warm, s", "diagnosis", "processor")
        print(f"{'rows':>9}{''.join(f'{h:>11}' for h in heads)}{'MB':>7}   named")
        for rows in asked.rows:
            runs = []
            for _ in range(asked.runs + 1):  # the first one compiles
                command = [sys.executable, __file__, "--here", str(rows)]
                began = time.perf_counter()
                done = subprocess.run(command, env=environment, capture_output=True, text=True)
                wall = time.perf_counter() - began
                if done.returncode:
                    raise SystemExit(done.stderr)
                runs.append({"wall_s": wall, **json.loads(done.stdout.splitlines()[-1])})
            told = ("wall_s", "diagnosis_s", "processor_s", "memory_mb")
            warm = {k: statistics.median(r[k] for r in runs[1:]) for k in told}
            results.append({"rows": rows, "cold_s": runs[0]["wall_s"], **warm})
            shown = (runs[0]["wall_s"], *(warm[k] for k in told[:3]))
            print(
                f"{rows:9d}{''.join(f'{x:11.1f}' for x in shown)}{warm['memory_mb']:7.0f}"
                f"   {'; '.join(runs[0]['named'])}",
                flush=True,
            )
            if rows in SECONDS:
                bound = SECONDS[rows]
                said = "reached" if warm["wall_s"] <= bound else "MISSED"
                print(f"          {bound:.0f} s: {said}")
            if rows == 40_000:
                said = "reached" if warm["memory_mb"] <= MEMORY else "MISSED"
                print(f"          {MEMORY:.0f} MB: {said}")
    if len(results) > 1:
        logs = np.log([[r["rows"], r["processor_s"]] for r in results])  # of all the work
        power = (logs[-1] - logs[0])[1] / (logs[-1] - logs[0])[0]
        print(
            f"power of rows from {results[0]['rows']} to {results[-1]['rows']}: {power:.2f}, "
            f"{'reached' if power <= EXPONENT else 'MISSED'}"
        )
    if asked.json is not None:
        asked.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
