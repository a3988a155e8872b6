"""From raw Parquet to calibrations, beside only reading and grouping the same columns with polars, and hashing too.

    pip install -e .
    python benchmarks/fleet/raw.py [--gigabytes 2] [--folder DIR] [--json FILE]

A line of devices, 18 positions × 500 samples each, float64 with noise (so that the files do not compress), is written
in eight files. Each measured run is a process of its own: `inertiax.fleet.run_fleet` into a fresh folder, and the
peer `scan_parquet → group_by(device, position) → mean` of clock and measured columns. A second peer does besides what a
run has to do for its protocol: SHA-256 of the same files, side by side in threads; and ours is run without that, too.
Peak memory is that of the process, for one, two, four and all eight files. Medians of five, alternating; compile time
is inside ours. Processor time is told beside the clock's, which other work on the machine lengthens.
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

import numpy as np
import polars as pl
from problem import COLUMNS, directions, GRAVITY, ROWS


NOISE, SAMPLES, FILES, REPEATS = 2e-3, 500, 8, 5
MEASURED = ("accel_x", "accel_y", "accel_z", "temperature")


def device(rng: np.random.Generator, name: str) -> pl.DataFrame:
    u = directions() * GRAVITY
    matrix = np.zeros((3, 3))
    matrix[ROWS, COLUMNS] = rng.normal(0, 3e-3, 6)
    outputs = np.repeat(u + u @ matrix.T + rng.normal(0, 0.03, 3), SAMPLES, axis=0)
    outputs = outputs + rng.normal(0, NOISE, outputs.shape)
    num = len(outputs)
    return pl.DataFrame(
        {
            "device": pl.Series([name]).new_from_index(0, num),
            "position": np.repeat(np.arange(len(u), dtype=np.int32), SAMPLES),
            "time": np.arange(num) * 0.01,
            "temperature": 20.0 + rng.normal(0, 0.01, num),
            **{f"accel_{c}": outputs[:, i] for i, c in enumerate("xyz")},
        }
    )


def write(folder: Path, gigabytes: float) -> tuple[int, float]:
    """The line's files; returns the number of devices and the size in GB."""
    rng = np.random.default_rng(7)
    folder.mkdir(parents=True, exist_ok=True)
    per_file = max(int(gigabytes * 1e9 / FILES / (18 * SAMPLES * 8 * 3.6)), 8)
    for k in range(FILES):
        tables = [device(rng, f"SN{k * per_file + d:06d}") for d in range(per_file)]
        pl.concat(tables).write_parquet(folder / f"line-{k}.parquet", row_group_size=250_000)
    size = sum(f.stat().st_size for f in folder.glob("*.parquet")) / 1e9
    return per_file * FILES, size


def campaign(folder: Path, source: Path, files: int) -> Path:
    """A campaign of the first so many files, as links."""
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(files):
        link = folder / f"line-{k}.parquet"
        if not link.exists():
            os.link(source / f"line-{k}.parquet", link)
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ["*.parquet"]\n'
        '[model]\naccel_estimator = "invariant"\ntemperature_degree = 0\n'
    )
    return folder


# The kernel's high-water mark of this program alone (getrusage would count the parent's before it).
PEAK = """
def peak():
    line = next(x for x in open("/proc/self/status") if x.startswith("VmHWM"))
    return int(line.split()[1]) / 1e6
"""
OURS = (
    PEAK
    + """
import sys, time
from inertiax.cli import environment
environment.prepare()
from inertiax.fleet import pipeline, run_fleet
if sys.argv[3] == "unhashed":
    pipeline.hashes_of = lambda files: {}
start, used = time.perf_counter(), time.process_time()
summary = run_fleet(sys.argv[1], sys.argv[2])
print(time.perf_counter() - start, time.process_time() - used, peak(), summary.calibrated)
"""
)
PEER = (
    PEAK
    + """
import hashlib, os, sys, time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
import polars as pl
start, used = time.perf_counter(), time.process_time()
def digest(file):
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
if sys.argv[2] == "hashed":
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        assert all(pool.map(digest, Path(sys.argv[1]).glob("*.parquet")))
table = pl.scan_parquet(sys.argv[1] + "/*.parquet").group_by("device", "position").agg(
    pl.col("time", "accel_x", "accel_y", "accel_z", "temperature").mean()).collect(engine="streaming")
print(time.perf_counter() - start, time.process_time() - used, peak(), table.height)
"""
)


def measured(script: str, *arguments: Path | str) -> tuple[float, float, float, int]:
    """Seconds, processor seconds, GB and count of one process."""
    run = subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
    )
    seconds, processor, memory, count = run.stdout.split()
    return float(seconds), float(processor), float(memory), int(count)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gigabytes", type=float, default=2.0)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    base = chosen.folder or Path(tempfile.mkdtemp())
    source = base / "line"
    start = time.perf_counter()
    devices, size = write(source, chosen.gigabytes)
    print(f"{devices} devices, {size:.2f} GB written in {time.perf_counter() - start:.0f} s")
    full = campaign(base / "full", source, FILES)
    ours, unhashed, read, hashed = [], [], [], []
    for _ in range(REPEATS):
        shutil.rmtree(base / "results", ignore_errors=True)
        ours.append(measured(OURS, full, base / "results", "hashed"))
        shutil.rmtree(base / "results")
        unhashed.append(measured(OURS, full, base / "results", "unhashed"))
        read.append(measured(PEER, full, "read"))
        hashed.append(measured(PEER, full, "hashed"))
        assert ours[-1][3] == unhashed[-1][3] == devices, "every device must be calibrated"
        assert read[-1][3] == hashed[-1][3] == devices * 18
    memory = {}
    for files in (1, 2, 4, 8):
        part = campaign(base / f"part-{files}", source, files)
        shutil.rmtree(base / "results", ignore_errors=True)
        memory[files] = measured(OURS, part, base / "results", "hashed")[2]
    result = {
        "devices": devices,
        "gigabytes": size,
        "ours_s": statistics.median(x[0] for x in ours),
        "unhashed_s": statistics.median(x[0] for x in unhashed),
        "polars_s": statistics.median(x[0] for x in read),
        "hashed_s": statistics.median(x[0] for x in hashed),
        "ours_processor_s": statistics.median(x[1] for x in ours),
        "unhashed_processor_s": statistics.median(x[1] for x in unhashed),
        "polars_processor_s": statistics.median(x[1] for x in read),
        "hashed_processor_s": statistics.median(x[1] for x in hashed),
        "ours_gb": statistics.median(x[2] for x in ours),
        "polars_gb": statistics.median(x[2] for x in read),
        "load": os.getloadavg()[0],
        "memory_gb_by_files": memory,
    }
    for what, key in (("time", "s"), ("processor time", "processor_s")):
        ours_s, unhashed_s, polars_s, hashed_s = (
            result[f"{k}_{key}"] for k in ("ours", "unhashed", "polars", "hashed")
        )
        result[f"ratio_{key}"], result[f"ratio_hashed_{key}"] = ours_s / polars_s, ours_s / hashed_s
        result[f"ratio_unhashed_{key}"] = unhashed_s / polars_s
        print(
            f"{what}: ours {ours_s:.2f} s; polars {polars_s:.2f} s, ratio {ours_s / polars_s:.2f}; "
            f"polars and SHA-256 {hashed_s:.2f} s, ratio {ours_s / hashed_s:.2f}; ours without SHA-256 "
            f"{unhashed_s:.2f} s, ratio to polars {unhashed_s / polars_s:.2f}"
        )
    print(f"load of the machine at the end: {result['load']:.1f}")
    print("peak memory, GB: " + ", ".join(f"{k} files {v:.2f}" for k, v in memory.items()))
    if chosen.json:
        chosen.json.write_text(json.dumps(result, indent=1))
    if chosen.folder is None:
        shutil.rmtree(base)


if __name__ == "__main__":
    main()
