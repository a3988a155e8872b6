"""What XLA compiles for processors: which results are kept, and what is one kernel.

XLA joins loops over arrays: where a result is used twice, it may be worked out anew in each place, and every loop
that is left is a kernel, whose call costs some 0.3 µs. For programs of many small arrays both cost more than the
arithmetic. `kept` and `one_kernel` say where the borders are, by attributes of a call: hints, without which results
are the same.
"""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from importlib.metadata import version
from typing import ParamSpec, TypeVar

import jax
from jax.experimental.xla_metadata import set_xla_metadata


# Versions of jaxlib of which it was tried that a call becomes one kernel: it is XLA's own device for small loops.
TRIED = ("0.10.",)
# Of a program with `one_kernel`, for `jax.jit`: loops of one kernel are not to be handed to several threads.
# Vectors as wide as the processor has them take a tenth less.
OPTIONS = {
    "xla_disable_hlo_passes": "cpu-parallel-task-assigner",
    "xla_cpu_prefer_vector_width": 512,
}

_KNOWN = version("jaxlib").startswith(TRIED)

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

_apart: ContextVar[bool] = ContextVar("apart", default=True)


def kept(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Work out `function` of arrays once, whatever uses its result: on processors a computation of its own."""
    compiled = jax.jit(function)

    @functools.wraps(function)
    def called(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        if not (_apart.get() and jax.default_backend() == "cpu"):
            return function(*args, **kwargs)
        with set_xla_metadata(inlineable="false"):
            return compiled(*args, **kwargs)

    return called


def one_kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Have all of `function` of arrays compiled as one kernel, loops of `jax.lax` included, on processors.

    Within it sums over an axis, sorting and products of matrices are not to be had.
    """
    compiled = jax.jit(function)

    @functools.wraps(function)
    def called(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        if not (_apart.get() and is_tried()):
            return function(*args, **kwargs)
        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            return compiled(*args, **kwargs)

    return called


def is_tried() -> bool:
    """Whether `one_kernel` makes one."""
    return _KNOWN and jax.default_backend() == "cpu"


@contextmanager
def joined() -> Iterator[None]:
    """Leave all of it to XLA: where a program is spread over several devices, say."""
    token = _apart.set(False)
    try:
        yield
    finally:
        _apart.reset(token)
