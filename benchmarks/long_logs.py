"""Seconds and peak memory of the commands over logs of one device of 10⁶ to 3.6·10⁷ rows, as Parquet and as CSV.

A log has 36 rests with turns between them, 100 rows a second, and columns time, accel, gyro and temperature; the log
for `noise` lies still. Rests are found in the data, for no column tells them. Each command is a process of its own;
its peak is what the system counts as resident, libraries included. `many` is one campaign of 500 files.

    python benchmarks/long_logs.py --rows 1e6 1e7 [--formats parquet csv] [--commands compensate noise calibrate]
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np


RATE = 100.0  # Hz
RESTS = 36
TURN = 200  # rows
SCALE = (1.01, 0.99, 1.005)
PIECE = 1 << 19  # rows that are written at a time
MANY = 500  # files
ROWS_OF_MANY = 1000  # of each file
COMMANDS = ("calibrate", "compensate", "noise")


def directions() -> np.ndarray:
    """Of the specific force in each rest, spread over the sphere."""
    k = np.arange(RESTS) + 0.5
    height, angle = 1.0 - 2.0 * k / RESTS, np.pi * (1.0 + 5.0**0.5) * k
    flat = np.sqrt(1.0 - height**2)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)


def rows_of(first: int, count: int, total: int, *, still: bool, rng: np.random.Generator) -> dict:
    """Columns of the rows from `first` on."""
    row = np.arange(first, first + count)
    length = max(total // RESTS, 2 * TURN)
    pose = np.minimum(row // length, RESTS - 1)
    places = directions()
    force, rate = places[pose], np.zeros((count, 3))
    share = (row - pose * length) / TURN  # of the turn into this pose
    turning = (share < 1.0) & (pose > 0)
    if still:
        force = np.broadcast_to([0.0, 0.0, 1.0], (count, 3))
    else:
        now, before = places[pose[turning]], places[pose[turning] - 1]
        axis = np.cross(now, before)
        size = np.linalg.norm(axis, axis=1)
        angle = np.arctan2(size, np.sum(now * before, axis=1))
        axis /= size[:, None]
        part = share[turning] - np.sin(2.0 * np.pi * share[turning]) / (2.0 * np.pi)
        speed = 1.0 - np.cos(2.0 * np.pi * share[turning])
        swept = (angle * part)[:, None]
        force = force.copy()
        force[turning] = before * np.cos(swept) - np.cross(axis, before) * np.sin(swept)
        rate[turning] = axis * (angle * speed * RATE / TURN)[:, None]
    accel = 9.81 * force * SCALE + [0.05, -0.03, 0.02]
    accel = accel + rng.normal(scale=0.01, size=(count, 3))
    gyro = rate * [1.002, 0.997, 1.004] + [0.002, -0.001, 0.003]
    gyro = gyro + rng.normal(scale=1e-3, size=(count, 3))
    made = {"time": row / RATE}
    made |= {f"accel_{axis}": accel[:, k] for k, axis in enumerate("xyz")}
    made |= {f"gyro_{axis}": gyro[:, k] for k, axis in enumerate("xyz")}
    return made | {"temperature": 25.0 + 0.5 * np.sin(row / total)}


def write(file: Path, total: int, *, still: bool) -> None:
    """A log of so many rows, written piece by piece."""
    import pyarrow as pa
    import pyarrow.csv as pc
    import pyarrow.parquet as pq

    rng, writer = np.random.default_rng(0), None
    for first in range(0, total, PIECE):
        count = min(PIECE, total - first)
        table = pa.table(rows_of(first, count, total, still=still, rng=rng))
        if writer is None:
            kind = pc.CSVWriter if file.suffix == ".csv" else pq.ParquetWriter
            writer = kind(str(file), table.schema)
        writer.write_table(table)
    assert writer is not None
    writer.close()


def write_many(folder: Path) -> None:
    """One campaign of many short files."""
    import polars as pl

    rng = np.random.default_rng(0)
    total = MANY * ROWS_OF_MANY
    for k in range(MANY):
        made = rows_of(k * ROWS_OF_MANY, ROWS_OF_MANY, total, still=False, rng=rng)
        pl.DataFrame(made).write_csv(folder / f"part{k}.csv")


def measured(command: list[str]) -> tuple[float, float, float]:
    """Wall and processor seconds and peak resident memory, GB, of a command as a process."""
    started = time.perf_counter()
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdout=said, stderr=said)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - started
        if process.returncode:
            said.seek(0)
            sys.exit(f"{command}: {said.read().decode()}")
    return wall, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6


def hold(result: Path) -> None:
    """Ends the run where a scale factor of the accelerometers is not the log's."""
    import inertiax

    triad = inertiax.read_calibration(result / "calibration.json").accel
    assert triad is not None
    told = dict(zip(triad.names, np.asarray(triad.curve.coefficients[0]).tolist()))
    off = max(abs(told[f"accel.matrix[{k},{k}]"] - (x - 1.0)) for k, x in enumerate(SCALE))
    if not off < 1e-4:  # ten times what the 36 rests of 10⁶ rows tell it to
        sys.exit(f"{result}: a scale factor is {off:.1e} off.")


def campaign(folder: Path, files: str) -> Path:
    """A `campaign.toml` over the files."""
    folder.mkdir()
    text = f'[site]\ngravity = 9.81\n[recordings]\nfiles = ["{files}"]\n'
    (folder / "campaign.toml").write_text(text)
    return folder


def written(arguments: list[str]) -> None:
    # Not in this process: a child's peak would begin at what its parent holds.
    subprocess.run([sys.executable, __file__, *arguments], check=True)


def over_rows(folder: Path, rows: int, suffix: str, chosen: list[str], calibration: Path) -> None:
    """The commands on logs of one length in one format."""
    run = [sys.executable, "-m", "inertiax"]
    home = campaign(folder / f"{rows}-{suffix}", f"log.{suffix}")
    log, out = home / f"log.{suffix}", folder / "out"
    for command in chosen:
        written(["--write", str(log), "--rows", str(rows), *["--still"] * (command == "noise")])
        if command == "calibrate":
            words = ["calibrate", str(home), "-o", str(out / "calibrate")]
        elif command == "noise":
            words = ["noise", str(log), "-o", str(out / "noise")]
        else:
            words = ["compensate", str(calibration), str(log), "-o", str(out / f"made.{suffix}")]
        wall, used, peak = measured([*run, *words])
        if command == "calibrate":
            hold(out / "calibrate")
        print(
            f"| `{command}` | {rows:.2g} | {suffix} | {wall:.1f} | {used:.1f} | {peak:.2f} |",
            flush=True,
        )
        log.unlink()
        (out / f"made.{suffix}").unlink(missing_ok=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=float, nargs="+", default=[1e6, 1e7])
    parser.add_argument("--formats", nargs="+", default=["parquet", "csv"])
    parser.add_argument("--commands", nargs="+", default=[*COMMANDS, "many"])
    parser.add_argument(
        "--folder", type=Path, help="Where the logs are written; default: temporary."
    )
    parser.add_argument("--write", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--still", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.write is not None and asked.write.is_dir():
        write_many(asked.write)
        return
    if asked.write is not None:
        write(asked.write, int(asked.rows[0]), still=asked.still)
        return
    run = [sys.executable, "-m", "inertiax"]
    with tempfile.TemporaryDirectory(dir=asked.folder) as name:
        folder = Path(name)
        (folder / "out").mkdir()
        print(
            "| command | rows | format | wall, s | processor, s | peak, GB |\n|---|---|---|---|---|---|"
        )
        small = campaign(folder / "small", "log.csv")
        written(["--write", str(small / "log.csv"), "--rows", "50000"])
        measured([*run, "calibrate", str(small), "-o", str(folder / "calibrated")])
        calibration = folder / "calibrated" / "calibration.json"
        chosen = [c for c in asked.commands if c != "many"]
        for rows in asked.rows:
            for suffix in asked.formats:
                over_rows(folder, int(rows), suffix, chosen, calibration)
        if "many" in asked.commands:
            many = campaign(folder / "many", "*.csv")
            written(["--write", str(many)])
            wall, used, peak = measured(
                [*run, "calibrate", str(many), "-o", str(folder / "out" / "many")]
            )
            print(
                f"| `calibrate`, {MANY} files | {MANY * ROWS_OF_MANY:.2g} | csv | {wall:.1f} | "
                f"{used:.1f} | {peak:.2f} |"
            )


if __name__ == "__main__":
    main()
