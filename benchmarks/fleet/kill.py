"""Kill −9 at random moments, of the process and of Dask workers: is every device there once, as in an undisturbed run?

    pip install -e '.[fleet]'
    python benchmarks/fleet/kill.py [--kills 20] [--seed 1] [--json FILE]

The peer is an undisturbed run over the same files. *Process*: `run_fleet` is started as a process of its own and
killed after a time drawn evenly from the whole duration of the undisturbed one, imports included, and started again
in the same folder; where all parts were done or a run reached its end, the table is compared and the next run begins
afresh. *Worker*: the tasks go to two Dask workers, of which a random one is killed at random times, each
after further parts were done; it is started anew. Tables must be equal to the last bit, whatever was killed. A task
holds one device.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import polars as pl
from raw import campaign, device


DEVICES, FILES = 120, 2
PAUSE = 4.0  # s between two looks at the workers, at most

RUN = """
import sys
from inertiax.cli import environment
environment.prepare()
import inertiax.fleet.pipeline as run, inertiax.fleet.reduce.tasks as tasks
if __name__ == "__main__":
    whole = tasks.split
    run.split = lambda files, columns: whole(files, columns, rows=1)
    scheduler = sys.argv[3] if len(sys.argv) > 3 else None
    run.run_fleet(sys.argv[1], sys.argv[2], scheduler=scheduler)
"""


def line(base: Path) -> Path:
    rng = np.random.default_rng(11)
    (base / "line").mkdir()
    tables = [device(rng, f"SN{k:04d}") for k in range(DEVICES)]
    for k in range(FILES):
        pl.concat(tables[k::FILES]).write_parquet(
            base / f"line/line-{k}.parquet", row_group_size=50_000
        )
    return campaign(base / "campaign", base / "line", FILES)


def start(*arguments: Path | str) -> subprocess.Popen:
    command = [sys.executable, "-c", RUN, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def finish(*arguments: Path | str) -> None:
    process = start(*arguments)
    _, said = process.communicate(timeout=600)
    assert process.returncode == 0, said.decode()[-2000:]


def table(folder: Path) -> pl.DataFrame:
    parts = sorted((folder / "parts").glob("part-*.parquet"))
    return pl.concat([pl.read_parquet(p) for p in parts]).sort("device")


def check(folder: Path, undisturbed: pl.DataFrame) -> None:
    found = table(folder)
    assert found.get_column("device").is_unique().all(), "a device is there twice"
    assert found.height == DEVICES, "a device is missing"
    assert found.equals(undisturbed), "the table is not that of an undisturbed run"
    left = list((folder / "parts").glob(".part-*"))
    print(
        f"  {folder.name}: {found.height} devices once each, equal; {len(left)} files broken off lie beside"
    )


def kill_process(
    source: Path, base: Path, kills: int, duration: float, undisturbed: pl.DataFrame
) -> tuple[int, list[int]]:
    """Runs that ended, and at each kill the number of parts that were done."""
    done_at: list[int] = []
    runs, out = 1, base / "process-1"
    while len(done_at) < kills:
        process = start(source, out)
        try:
            process.wait(timeout=random.uniform(0.0, duration))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            done_at.append(len(list(out.glob("parts/part-*"))))
        if process.returncode == 0 or done_at[-1] == DEVICES or len(done_at) == kills:
            finish(source, out)
            check(out, undisturbed)
            shutil.rmtree(out)
            runs, out = runs + 1, base / f"process-{runs + 1}"
    return runs - 1, done_at


def kill_workers(
    source: Path, base: Path, kills: int, duration: float, undisturbed: pl.DataFrame
) -> tuple[int, list[int]]:
    """As `kill_process`, of Dask workers; a run that gave up (a task that lost four workers, no worker
    for a minute) is started again."""
    from dask.distributed import LocalCluster, Status

    del duration

    done_at: list[int] = []
    runs = 0
    while len(done_at) < kills:
        runs += 1
        out = base / f"workers-{runs}"
        # A cluster of its own for each run: a nanny whose worker is killed while it starts may give up for good.
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
            process = start(source, out, cluster.scheduler_address)
            before = 0
            while process.poll() is None:
                time.sleep(random.uniform(0.0, PAUSE))
                done = len(list(out.glob("parts/part-*")))
                alive = [
                    w for w in cluster.workers.values() if w.status == Status.running and w.pid
                ]
                if process.poll() is None and alive and done > before and len(done_at) < kills:
                    os.kill(random.choice(alive).pid, signal.SIGKILL)
                    done_at.append(done)
                    before = done
            process.communicate(timeout=600)
        if process.returncode:
            print(f"  {out.name}: gave up with {done_at[-1]} parts; started again")
            finish(source, out)
        check(out, undisturbed)
        shutil.rmtree(out)
    return runs, done_at


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--only", choices=("process", "workers"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    random.seed(chosen.seed)
    base = Path(tempfile.mkdtemp())
    try:
        source = line(base)
        finish(source, base / "first")  # compiles
        begin = time.perf_counter()
        finish(source, base / "whole")
        duration = time.perf_counter() - begin
        undisturbed = table(base / "whole")
        check(base / "first", undisturbed)
        result: dict[str, object] = {"devices": DEVICES, "undisturbed_s": duration}
        print(f"undisturbed: {DEVICES} devices in {duration:.1f} s")
        for what, kill in (("process", kill_process), ("workers", kill_workers)):
            if chosen.only in (None, what):
                runs, done_at = kill(source, base, chosen.kills, duration, undisturbed)
                result[what] = {"runs": runs, "parts_done": done_at}
                print(
                    f"{what}: {len(done_at)} kills over {runs} runs, parts done at each: {done_at}"
                )
    finally:
        shutil.rmtree(base)
    if chosen.json:
        chosen.json.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
