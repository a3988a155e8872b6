"""Numbers as leaves of pytrees: 64 bits are kept whatever JAX is set to."""

import sys
from typing import Any

import numpy as np


def as_leaf(value: Any) -> Any:
    """Arrays as they are, Python's numbers as 64-bit scalars."""
    return value if hasattr(value, "dtype") else np.float64(value)


def as_array(value: Any) -> Any:
    """Arrays as they are, Python's numbers and lists as 64-bit arrays."""
    return value if hasattr(value, "dtype") else np.asarray(value, float)


def real_numbers(argument: str, values: Any) -> np.ndarray:
    """Given numbers as an array of 64 bits. Raises `ValueError` for what holds others, and for masked elements, and
    `TypeError` for complex numbers, whose imaginary part NumPy would leave out."""
    refuse_masked(argument, values)
    if np.iscomplexobj(values):
        raise TypeError(f"`{argument}`: holds complex numbers; it must be an array of real ones.")
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise ValueError(f"`{argument}`: must be an array of real numbers.") from None


def refuse_masked(argument: str, values: Any) -> None:
    """Raise `ValueError` for masked elements: an array of NumPy or JAX would hold what is behind the mask."""
    if np.ma.is_masked(values):
        raise ValueError(
            f"`{argument}`: holds masked elements; leave their rows out, or fill them by `.filled(np.nan)` and, of "
            f"dwells, give `valid=~mask.any(axis=-1)`."
        )


def is_traced(value: Any) -> bool:
    """Whether a value is not known, because a program is being made."""
    jax = sys.modules.get("jax")  # where it is not loaded, there is nothing that it traces
    return jax is not None and isinstance(value, jax.core.Tracer)


def as_plain(value: Any) -> Any:
    """A number of NumPy's or JAX's as Python's, which a pytree's structure may hold; what is none, as it is."""
    single = hasattr(value, "dtype") and np.ndim(value) == 0 and not is_traced(value)
    return value.item() if single else value


def own_object(value: Any) -> Any:
    """A NumPy array's numbers as another object, without a copy; anything else as it is.

    JAX keeps what it made of an array that a program of 32 bits captured, by the object, and takes it for the array
    where a program of 64 bits is given the same one: that fails, or computes in 32 bits (JAX 0.10.2).
    """
    return value.view() if isinstance(value, np.ndarray) else value
