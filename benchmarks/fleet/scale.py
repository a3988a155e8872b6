"""How the cost of a fleet grows with its devices, and how soon the command shows a first result.

    pip install -e .
    python benchmarks/fleet/scale.py [--threads N] [--json FILE]

1. `fit_fleet` from dwell means, 100 to 100 000 devices × 18 positions, nine parameters with weights estimated from
   the misfit; medians of five after one run that compiles, by the clock and of processor time, which other work on the
   machine changes less; the exponent is the slope of log time over log devices. `--threads 1`, and the process on
   one core, tell how the work itself grows.
2. `inertiax fleet` as a command on 50 and 1000 devices of raw samples: seconds until the first part is on disk and
   until it ends, with an empty compilation cache and with a filled one; medians of five.
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np
import polars as pl
from raw import campaign, device, directions, FILES, GRAVITY

from inertiax.estimators import Invariant
from inertiax.fleet import fit_fleet
from inertiax.physics.temperature import Constant
from inertiax.reduction.dwells import Dwells


SIZES = (100, 300, 1000, 3000, 10_000, 30_000, 100_000)
SIGMA = 1e-4
REPEATS = 5


def dwell_means(devices: int) -> Dwells:
    rng = np.random.default_rng(3)
    u = directions() * GRAVITY
    outputs = u + u @ np.tril(rng.normal(0, 3e-3, (devices, 3, 3))).transpose(0, 2, 1)
    outputs += rng.normal(0, 0.03, (devices, 1, 3)) + rng.normal(0, SIGMA, outputs.shape)
    shape = outputs.shape[:2]
    row = np.arange(shape[1])
    return Dwells(
        time=np.broadcast_to(row * 20.0, shape), duration=np.full(shape, 10.0),
        count=np.full(shape, 1000.0), temperature=np.full(shape, 20.0),
        experiment=np.zeros(shape, int), position=np.broadcast_to(row, shape), valid=np.ones(shape, bool),
        accel=outputs, accel_covariance=np.broadcast_to(np.eye(3) * SIGMA**2, (*shape, 3, 3)),
    )  # fmt: skip


def growth(threads: int) -> dict[int, tuple[float, float]]:
    seconds: dict[int, tuple[float, float]] = {}
    estimator, basis = Invariant(GRAVITY), Constant()
    for devices in SIZES:
        dwells = dwell_means(devices)
        times = []
        for _ in range(REPEATS + 1):
            start, used = time.perf_counter(), time.process_time()
            fit = fit_fleet(estimator, basis, dwells, threads=threads)
            times.append((time.perf_counter() - start, time.process_time() - used))
        assert fit.converged.all()
        clock, cores = (statistics.median(t) for t in zip(*times[1:], strict=True))
        seconds[devices] = clock, cores
        print(
            f"{devices:7d} devices  {clock:8.4f} s  {clock / devices * 1e6:7.2f} µs each by the clock, "
            f"{cores / devices * 1e6:7.2f} of processor time"
        )
    return seconds


def latency(devices: int) -> dict[str, float]:
    """Seconds until the first part of the command's results is on disk, and until it ends."""
    rng = np.random.default_rng(5)
    base = Path(tempfile.mkdtemp())
    (base / "line").mkdir()
    each = -(-devices // FILES)
    for file in range(FILES):
        names = [f"SN{k}" for k in range(file * each, min((file + 1) * each, devices))]
        rows = pl.concat([device(rng, name) for name in names])
        rows.write_parquet(base / f"line/line-{file}.parquet", row_group_size=250_000)
    folder = campaign(base / "campaign", base / "line", FILES)
    found: dict[str, list[tuple[float, float]]] = {"cold": [], "warm": []}
    for k in range(REPEATS):
        for state in ("cold", "warm"):
            environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(base / f"cache-{k}")}
            results = base / f"results-{k}-{state}"
            command = [sys.executable, "-m", "inertiax", "fleet", str(folder), "-o", str(results)]
            found[state].append(_first_and_last([*command, "--quiet"], results, environment))
    shutil.rmtree(base)
    return {
        f"{state}, {what}": statistics.median(times)
        for state, pairs in found.items()
        for what, times in zip(("first part", "all"), zip(*pairs, strict=True), strict=True)
    }


def _first_and_last(
    command: list[str], results: Path, environment: dict[str, str]
) -> tuple[float, float]:
    start, first = time.perf_counter(), None
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    while process.poll() is None:
        if first is None and any((results / "parts").glob("*.parquet")):
            first = time.perf_counter() - start
        time.sleep(0.01)
    assert process.returncode == 0 and first is not None
    return first, time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    seconds = growth(chosen.threads)
    x, y = np.log(list(seconds)), np.log(list(seconds.values()))
    exponent = {
        f"{name}, {clock}": float(np.polyfit(x[kept], y[kept, k], 1)[0])
        for name, kept in (("all", x > 0), ("from 1000", x > np.log(999)))
        for k, clock in enumerate(("clock", "processor time"))
    }
    print("exponent " + "; ".join(f"{k}: {v:.3f}" for k, v in exponent.items()))
    first = {number: latency(number) for number in (50, 1000)}
    for number, found in first.items():
        print(
            f"command on {number} devices: " + ", ".join(f"{k} {s:.2f} s" for k, s in found.items())
        )
    if chosen.json:
        chosen.json.write_text(
            json.dumps(
                {"seconds": seconds, "exponent": exponent, "first_result_s": first}, indent=1
            )
        )


if __name__ == "__main__":
    main()
