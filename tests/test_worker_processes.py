"""Worker processes of a fleet: they survive their deaths, and end with the process that started them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from inertiax.fleet import cluster
from inertiax.fleet.cluster import on_dask, on_processes
from inertiax.fleet.reduce.tasks import Task


def killed_once(task: Task) -> int:
    """A task during which the worker dies, the first time."""
    mark = Path(task.devices[0][0])
    if task.number == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return task.number


def killed_always(task: Task) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return task.number


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_tasks_of_a_worker_that_died_are_done_again(tmp_path):
    tasks = [Task(k, ((str(tmp_path / "mark"), ()),)) for k in range(4)]
    assert sorted(on_processes(killed_once, tasks, 1)) == [0, 1, 2, 3]
    assert (tmp_path / "mark").exists()


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_task_that_always_kills_its_worker_ends_in_one_line(monkeypatch):
    monkeypatch.setattr(cluster, "RETRIES", 1)
    with pytest.raises(ValueError, match="died 2 times with 1 of 1 tasks left") as caught:
        list(on_processes(killed_always, [Task(0, ())], 1))
    assert "\n" not in str(caught.value)


ORPHANS = """
import sys, time
from inertiax.fleet.cluster import on_processes
from inertiax.fleet.reduce.tasks import Task
from long_task import wait
if __name__ == "__main__":
    list(on_processes(wait, [Task(0, ((sys.argv[1], ()),))], 1))
"""
LONG_TASK = """
import os, time
from pathlib import Path
def wait(task):
    Path(task.devices[0][0]).write_text(str(os.getpid()))
    time.sleep(120)
    return 0
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_workers_end_with_a_process_that_is_killed(tmp_path):
    (tmp_path / "long_task.py").write_text(LONG_TASK)
    (tmp_path / "main.py").write_text(ORPHANS)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    mark = tmp_path / "pid"
    process = subprocess.Popen(
        [sys.executable, tmp_path / "main.py", str(mark)], env={**os.environ, "PYTHONPATH": path}
    )
    until(lambda: mark.exists() and mark.read_text() != "")
    worker = int(mark.read_text())
    process.kill()
    process.wait()
    until(lambda: gone(worker))


def until(condition, limit: float = 60.0) -> None:
    end = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z"
    except OSError:
        return True


def test_dask_is_for_addresses():
    with pytest.raises(ValueError, match="no Dask scheduler answers at 'nowhere"):
        list(on_dask(killed_always, [Task(0, ())], "nowhere://"))


def test_a_run_whose_tasks_are_all_done_needs_no_worker():
    assert list(on_processes(killed_always, [], 1)) == []
