"""One BLAS thread for many small matrix products.

Products of some hundred rows and columns do not pay for waking other threads, which then wait for work at full speed:
a diagnosis by library call took three times the processor time, and as much longer. The command line asks for one
thread before NumPy starts (`cli/environment.py`); in somebody else's process the number is lowered for the call alone.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """A context, or a decorator by `@one_blas_thread()`, in which NumPy's and SciPy's BLAS has one thread.

    ```python
    with one_blas_thread():
        ...
    ```
    """
    with threadpool_limits(limits=1, user_api="blas"):
        yield
