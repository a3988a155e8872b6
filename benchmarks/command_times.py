"""How long a user waits: wall time of each command as a process of its own, cold and warm, beside a SciPy script.

The commands run on imu_tk's Xsens recording (51 175 rows of both triads) and on 24 poses of simulated white noise. The
peer reads the same Xsens files, finds the rests and fits both triads with `scipy.optimize.least_squares`; it judges
nothing and writes no page. "Cold" has an empty cache of compiled programs, as a first run has. Peer and commands take
turns, so that both meet the same machine.

    INERTIAX_RECORDINGS=... python benchmarks/command_times.py [--runs 5] [--only NAME ...] [--json FILE]
"""

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np


CAMPAIGN = """
[site]
gravity = 9.81744
[recordings]
files = ["xsens_acc.mat"]
gyro_files = ["xsens_gyro.mat"]
[columns]
accel = { unit = "count", offset = 32768, scale = [415, 413, 415], scale_unit = "count per m/s^2" }
gyro = { unit = "count", offset = 32768, scale = [4778, 4758, 4766], scale_unit = "count per rad/s" }
"""
GRAVITY = 9.81744


def peer(folder: Path) -> None:
    """Both triads by SciPy: |a| = g at rest, and gravity's rotation between rests."""
    from scipy.optimize import least_squares

    # The files are text: time and three counts a row.
    accel, gyro = (np.loadtxt(folder / f"xsens_{k}.mat") for k in ("acc", "gyro"))
    force = (accel[:, 1:] - 32768) / [415.0, 413.0, 415.0]
    rate = (gyro[:, 1:] - 32768) / [4778.0, 4758.0, 4766.0]
    stamps = accel[:, 0]
    width = int(round(1.0 / np.median(np.diff(stamps))))
    means = np.lib.stride_tricks.sliding_window_view(force, width, axis=0)
    spread = np.zeros(len(force))
    spread[width // 2 : width // 2 + len(means)] = means.var(axis=-1).sum(axis=-1)
    still = (spread > 0) & (spread < 6.0 * np.percentile(spread[spread > 0], 10))
    edges = np.flatnonzero(np.diff(np.r_[0, still.astype(int), 0]))
    rests = [(a, b) for a, b in zip(edges[::2], edges[1::2]) if b - a > width]
    outputs = np.array([force[a:b].mean(axis=0) for a, b in rests])

    def compensated(p):
        matrix = np.eye(3)
        matrix[np.tril_indices(3)] += p[3:]
        return (outputs - p[:3]) @ np.linalg.inv(matrix).T

    found = least_squares(
        lambda p: np.linalg.norm(compensated(p), axis=1) - GRAVITY, np.zeros(9), x_scale="jac"
    )
    up = compensated(found.x)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    bias = rate[rests[0][0] : rests[0][1]].mean(axis=0)
    longest = max(b[0] - a[1] for a, b in zip(rests, rests[1:])) + 2
    index = np.array(
        [np.minimum(a[1] - 1 + np.arange(longest), b[0]) for a, b in zip(rests, rests[1:])]
    )
    step = np.diff(stamps[index], axis=1)[:, :, None]

    def tilts(p):
        refine = np.linalg.inv(np.eye(3) + p.reshape(3, 3)).T
        turned = (rate[index] - bias) @ refine
        angle = -0.5 * (turned[:, 1:] + turned[:, :-1]) * step
        u = up[:-1]
        for k in range(angle.shape[1]):
            once = np.cross(angle[:, k], u)
            u = u + once + 0.5 * np.cross(angle[:, k], once)
        return np.cross(u, up[1:]).ravel()

    matrix = least_squares(tilts, np.zeros(9), x_scale="jac").x
    numbers = {"accel": found.x.tolist(), "gyro": [*bias.tolist(), *matrix.tolist()]}
    (folder / "peer.json").write_text(json.dumps(numbers))


def timed(command: list[str], cache: Path) -> tuple[float, float]:
    """Wall and processor seconds of a process from start to exit."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, env=environment)
    wall = time.perf_counter() - started
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, used


def commands(folder: Path) -> dict[str, list[str]]:
    """What is timed, by name; each may use what those before it wrote."""
    xsens, table, out = (str(folder / name) for name in ("xsens", "table", "out"))
    calibration = f"{out}/xsens/calibration.json"
    run = [sys.executable, "-m", "inertiax"]
    return {
        "SciPy script": [sys.executable, __file__, "--peer", xsens],
        "--help": [*run, "--help"],
        "calibrate Xsens": [*run, "calibrate", xsens, "-o", f"{out}/xsens"],
        "check Xsens": [*run, "check", xsens],
        "compensate": [
            *run,
            "compensate",
            calibration,
            f"{xsens}/xsens_acc.mat",
            "-o",
            f"{out}/c.csv",
        ],
        "export": [*run, "export", calibration, "--to", "imu_tk", "-o", f"{out}/export"],
        "noise": [*run, "noise", f"{table}/still.csv", "-o", f"{out}/noise"],
        "design --audit": [*run, "design", "--audit", table],
        "demo": [*run, "demo", "-o", f"{out}/demo"],
    }


def prepare(folder: Path) -> None:
    """The recordings that the commands read."""
    xsens = folder / "xsens"
    xsens.mkdir()
    source = Path(os.environ["INERTIAX_RECORDINGS"]) / "imu_tk-xsens"
    for file in ("xsens_acc.mat", "xsens_gyro.mat"):
        shutil.copy(source / file, xsens)
    (xsens / "campaign.toml").write_text(CAMPAIGN)
    table = folder / "table"
    table.mkdir()
    rng = np.random.default_rng(0)
    poses = np.array([s * np.eye(3)[k] for k in range(3) for s in (1, -1)] * 3)
    poses = np.concatenate([poses, rng.normal(size=(6, 3))])
    poses /= np.linalg.norm(poses, axis=1, keepdims=True)
    rows, rate = 800, 100.0
    reading = np.repeat(9.81 * poses, rows, axis=0) + rng.normal(
        scale=0.01, size=(len(poses) * rows, 3)
    )
    still = rng.normal(scale=1e-3, size=(len(reading), 3))
    numbers = np.column_stack(
        [np.arange(len(reading)) / rate, reading, still, np.repeat(np.arange(len(poses)), rows)]
    )
    names = "time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,position"
    np.savetxt(table / "log.csv", numbers, delimiter=",", header=names, comments="", fmt="%.8g")
    kept = ",".join(names.split(",")[:-1])
    tilt = reading - np.repeat(9.81 * poses, rows, axis=0) + [0.0, 0.0, 9.81]
    alone = np.column_stack([numbers[:, 0], tilt, still])
    np.savetxt(table / "still.csv", alone, delimiter=",", header=kept, comments="", fmt="%.8g")
    (table / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["log.csv"]\n'
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="such as 'SciPy script' noise")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--peer", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.peer is not None:
        peer(asked.peer)
        return
    found: dict[str, dict[str, list[tuple[float, float]]]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        for _ in range(asked.runs):
            shutil.rmtree(folder / "cache", ignore_errors=True)
            for kind in ("cold", "warm"):
                shutil.rmtree(folder / "out", ignore_errors=True)
                (folder / "out").mkdir()
                for label, command in commands(folder).items():
                    if asked.only and label not in asked.only:
                        continue
                    now = timed(command, folder / "cache")
                    found.setdefault(label, {}).setdefault(kind, []).append(now)
    wall, used = (
        {
            label: {k: statistics.median(run[n] for run in runs) for k, runs in kinds.items()}
            for label, kinds in found.items()
        }
        for n in (0, 1)
    )
    print(f"{'':18}{'wall, s':>16}{'processor, s':>18}{'× SciPy':>16}")
    print(f"{'':18}" + f"{'cold':>8}{'warm':>8}{'':2}" * 2 + f"{'wall':>8}{'used':>8}")
    for label in found:
        row = "".join(f"{x[label]['cold']:8.2f}{x[label]['warm']:8.2f}  " for x in (wall, used))
        peers = [x.get("SciPy script", {}).get("warm") for x in (wall, used)]
        ratios = "".join(
            f"{x[label]['warm'] / peer:8.2f}" for x, peer in zip((wall, used), peers) if peer
        )
        print(f"{label:18}{row}{ratios}")
    if asked.json is not None:
        asked.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
