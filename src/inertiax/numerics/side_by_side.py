"""The same work on several long arrays at once."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar


_T = TypeVar("_T")
_R = TypeVar("_R")
WORTH = 400_000  # rows in all, from which threads gain more than they cost
MOST = 4  # threads: each has the arrays of its item in memory


def side_by_side(function: Callable[[_T], _R], items: Iterable[_T], *, rows: int) -> list[_R]:
    """`[function(item) for item in items]`, in threads where the items have `WORTH` rows or more in all.

    NumPy leaves the interpreter to others while it works on a long array. `function` must not change what another call
    reads, nor use what JAX keeps for each thread, such as its precision. The first exception of the items' order is
    raised, when those that have begun have ended.

    ```python
    spreads = side_by_side(lambda x: x.std(axis=0), parts, rows=sum(map(len, parts)))
    ```
    """
    given = list(items)
    count = min(os.cpu_count() or 1, MOST, len(given))
    if rows < WORTH or count < 2:
        return [function(item) for item in given]
    pool = ThreadPoolExecutor(count)
    try:
        return list(pool.map(function, given))
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
