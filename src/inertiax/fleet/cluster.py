"""The same tasks on Dask workers, here or on other machines."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from .tasks import Task


if TYPE_CHECKING:
    from .run import Context

RETRIES = 3  # of a task whose worker died


def on_dask(
    tasks: Sequence[Task], context: "Context", scheduler: str, workers: int | None
) -> Iterator[int]:
    """Numbers of tasks as they are done. Workers write the parts themselves, so they need the same file
    system. Raises `ValueError` where Dask is not installed or no scheduler answers."""
    try:
        from dask.distributed import as_completed, Client
    except ImportError:
        raise ValueError(
            "a scheduler needs Dask: install it with `pip install 'inertiax[fleet]'`, or leave "
            "--scheduler out."
        ) from None
    from .run import run_task

    options: dict = {"address": scheduler}
    if scheduler == "local":
        options = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None}
    try:
        client = Client(**options, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ValueError(f"no Dask scheduler answers at '{scheduler}': {error}.") from None
    with client:
        futures = client.map(run_task, tasks, context=context, retries=RETRIES, pure=False)
        for _, number in as_completed(futures, loop=client.loop, with_results=True):
            yield number
