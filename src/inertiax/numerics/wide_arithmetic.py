"""64 bits for what needs them, whatever JAX is set to."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from .._jax import jax, jnp
from .._records import WITHOUT_JAX
from ..physics.leaves import is_traced, own_object


Result = TypeVar("Result")


def in_64_bits(call: str, function: Callable[..., Result], *args: Any) -> Result:
    """`function(*args)` in 64 bits, with NumPy results where JAX is set to 32.

    Arguments of fewer bits are widened, which they cannot be in traced code: there 64 bits must have been there from
    the start. Raises `ValueError` for traced arguments of fewer than 64 bits; the message begins with `call`.
    """
    if any(is_traced(x) and _narrow(x) for x in jax.tree.leaves(args)):
        raise ValueError(
            f"`{call}` needs 64 bits and was traced in 32; trace it inside `with jax.enable_x64(True):`, with arrays "
            f"of 64 bits, or call it outside of traced code."
        )
    if jnp.result_type(float) == np.float64:
        return function(*jax.tree.map(_widened, args))
    with jax.enable_x64(True):
        return jax.tree.map(_on_host, function(*jax.tree.map(_widened, args)))


def whole_in_64_bits(function: Callable[..., Result]) -> Callable[..., Result]:
    """The function in 64 bits, for one whose arguments are on the host and of their own precision, such as files' rows.

    Arrays of JAX in what it returns become NumPy's where JAX is set to 32 bits, which would warn of every use of them.
    """

    @wraps(function)
    def run(*args: Any, **settings: Any) -> Result:
        # A command of the host has 64 bits from the start (`_without_jax`), and asking JAX would load it.
        if WITHOUT_JAX or jnp.result_type(float) == np.float64:
            return function(*args, **settings)
        with jax.enable_x64(True):
            made = function(*args, **settings)
            return jax.tree.map(lambda x: np.asarray(x) if isinstance(x, jax.Array) else x, made)

    return run


def _narrow(value: Any) -> bool:
    """Whether a value holds real numbers of fewer than 64 bits."""
    kind = getattr(value, "dtype", None)
    return kind is not None and jnp.issubdtype(kind, jnp.floating) and kind.itemsize < 8


def _widened(value: Any) -> Any:
    return np.asarray(value, np.float64) if _narrow(value) else own_object(value)


def _on_host(value: Any) -> Any:
    return value if is_traced(value) or not hasattr(value, "dtype") else np.asarray(value)
