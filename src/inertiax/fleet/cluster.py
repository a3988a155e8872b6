"""The same tasks on Dask workers, here or on other machines."""

import time
from collections.abc import Callable, Iterator, Sequence

from .reduce.tasks import Task


RETRIES = 3  # of a task whose worker died
PATIENCE = 60.0  # seconds without a single worker, in which another may be started
LOOK = 5.0  # seconds between questions whether there are workers


def on_dask(
    run_task: Callable[[Task], int], tasks: Sequence[Task], scheduler: str, workers: int | None
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
    options: dict = {"address": scheduler}
    if scheduler == "local":
        options = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None}
    try:
        client = Client(**options, set_as_default=False)
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
