"""The same tasks in worker processes: here, without a port, or on other machines by Dask.

Whoever reaches a port of Dask's runs code as its user, unless it is protected by TLS. Processes here are
spoken to through pipes that they inherit, so nobody else can.
"""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker

from .reduce.tasks import Task


RETRIES = 3  # of a task whose worker died
PATIENCE = 60.0  # seconds without a single worker, in which another may be started
LOOK = 5.0  # seconds between questions whether there are workers


def on_processes(
    run_task: Callable[[Task], int], tasks: Sequence[Task], workers: int | None
) -> Iterator[int]:
    """Numbers of tasks as `run_task` is done with them, in processes of this machine.

    Raises `ValueError` where the processes die of the same tasks again and again.
    """
    left = list(tasks)
    for _ in range(1 + RETRIES):
        if not left:  # an earlier run was broken off after its last task
            return
        done: set[int] = set()
        try:
            for task in _in_pool(run_task, left, workers or os.cpu_count() or 1):
                done.add(task.number)
                yield task.number
        except BrokenProcessPool:
            pass
        left = [t for t in left if t.number not in done]
        if not left:
            return
    raise ValueError(
        f"worker processes died {1 + RETRIES} times with {len(left)} of {len(tasks)} tasks left, perhaps for lack "
        "of memory: give fewer with --workers; the same command goes on with what is left."
    )


def _in_pool(
    run_task: Callable[[Task], int], tasks: Sequence[Task], workers: int
) -> Iterator[Task]:
    """Tasks as they are done. Processes are spawned: a fork of one with JAX's threads may hang."""
    spawn = multiprocessing.get_context("spawn")
    _start_tracker()
    with ProcessPoolExecutor(min(workers, len(tasks)), spawn, initializer=_as_worker) as pool:
        futures: dict[Future[int], Task] = {pool.submit(run_task, t): t for t in tasks}
        try:
            for future in as_completed(futures):
                future.result()
                yield futures[future]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _start_tracker() -> None:
    """Python's process that removes semaphores of a run which was ended: it does, and need not say so beside the
    run's one line."""
    before = os.environ.get("PYTHONWARNINGS")
    quiet = "ignore:resource_tracker"
    os.environ["PYTHONWARNINGS"] = quiet if not before else f"{before},{quiet}"
    try:
        resource_tracker.ensure_running()
    finally:
        if before is None:
            del os.environ["PYTHONWARNINGS"]
        else:
            os.environ["PYTHONWARNINGS"] = before


def _as_worker() -> None:
    """Ctrl-C is the main process's affair; a worker ends when that does, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def on_dask(
    run_task: Callable[[Task], int], tasks: Sequence[Task], scheduler: str
) -> Iterator[int]:
    """Numbers of tasks as `run_task` is done with them. Workers write the parts themselves, so they need the same file
    system. Raises `ValueError` where Dask is not installed, no scheduler answers or it has had no worker
    for a minute."""
    try:
        from dask.distributed import as_completed, Client
    except ImportError:
        raise ValueError(
            "a scheduler needs Dask: install it with `pip install 'inertiax[fleet]'`, or leave "
            "--scheduler out."
        ) from None
    try:
        client = Client(scheduler, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ValueError(f"no Dask scheduler answers at '{scheduler}': {error}.") from None
    with client:
        futures = client.map(run_task, tasks, retries=RETRIES, pure=False)
        done = as_completed(futures, loop=client.loop, with_results=True)
        asked = seen = time.monotonic()
        while not done.is_empty():
            if done.has_ready():
                _, number = next(done)
                seen = time.monotonic()
                yield number
                continue
            time.sleep(0.02)
            # Dask itself waits for workers for ever and says nothing.
            if time.monotonic() - asked > LOOK:
                asked = time.monotonic()
                seen = asked if client.nthreads() else seen
                if asked - seen > PATIENCE:
                    raise ValueError(_deserted(scheduler, done.count(), len(futures)))


def _deserted(scheduler: str, left: int, total: int) -> str:
    return (
        f"the Dask scheduler '{scheduler}' has had no workers for {PATIENCE:.0f} s, with {left} of {total} "
        "tasks left: start some (`dask worker ADDRESS`), and the same command goes on with what is left."
    )
