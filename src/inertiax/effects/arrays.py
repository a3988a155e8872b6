"""Operations on arrays by the library that the arrays are of: NumPy's, or JAX's where any is one of JAX's.

A shape is one formula. In a compiled program, under a derivative or on an accelerator it is JAX; for one campaign,
where a hundred shapes are asked for once each, compiling them would take most of the time, and NumPy evaluates them as
they are. The names are those that both libraries have.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .._jax import jax, jnp
from .._typing import AnyArray


pi = np.pi


def of_jax(*values: Any) -> bool:
    """Whether any of the values, or of the members of a list of them, is an array of JAX or traced by it."""
    return any(
        of_jax(*v) if isinstance(v, (list, tuple)) else isinstance(v, jax.Array) for v in values
    )


def _either(name: str) -> Callable[..., Any]:
    host = getattr(np, name)

    def call(*arguments: Any, **options: Any) -> Any:
        if of_jax(*arguments):
            return getattr(jnp, name)(*arguments, **options)
        made = host(*arguments, **options)
        # Of Python's numbers alone comes one again: beside an array of JAX it does not widen the array's type.
        plain = all(isinstance(a, (bool, float, int)) for a in arguments)
        return made.item() if plain and not options else made

    call.__name__ = call.__qualname__ = name
    call.__doc__ = f"`numpy.{name}`, or `jax.numpy.{name}`."
    return call


def _new(name: str) -> Callable[..., Any]:
    host = getattr(np, name)

    def call(*arguments: Any, **options: Any) -> Any:
        return (getattr(jnp, name) if of_jax(*arguments) else host)(*arguments, **options)

    call.__name__ = call.__qualname__ = name
    call.__doc__ = f"`numpy.{name}`, or `jax.numpy.{name}`."
    return call


# By the names of both libraries, those of Python's own functions among them.
zeros, zeros_like, ones_like, full, eye = map(
    _new, ("zeros", "zeros_like", "ones_like", "full", "eye")
)
asarray, broadcast_to, concatenate, roll, where = map(
    _either, ("asarray", "broadcast_to", "concatenate", "roll", "where")
)
abs, clip, maximum, minimum, sign, logical_not = map(
    _either, ("abs", "clip", "maximum", "minimum", "sign", "logical_not")
)
cos, exp, expm1, log1p, sin, sqrt, square = map(
    _either, ("cos", "exp", "expm1", "log1p", "sin", "sqrt", "square")
)
max, mean, min, sum = map(_either, ("max", "mean", "min", "sum"))
diff, einsum, gradient, searchsorted = map(_either, ("diff", "einsum", "gradient", "searchsorted"))


def stack(arrays: Sequence[AnyArray], axis: int = 0) -> Any:
    """As `numpy.stack`; each array stays together in memory, whatever the axis, and what follows is quicker."""
    if of_jax(*arrays):
        return jnp.stack(arrays, axis=axis)
    return np.moveaxis(np.stack(arrays), 0, axis)


def cross(a: AnyArray, b: AnyArray) -> Any:
    """Cross products along the last axis, of three; NumPy's own takes three times as long over many rows."""
    (a0, a1, a2), (b0, b1, b2) = ([x[..., k] for k in range(3)] for x in (a, b))
    return stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)


def norm(values: AnyArray, axis: int | None = None) -> Any:
    """Euclidean length along an axis."""
    library = jnp if of_jax(values) else np
    return library.linalg.norm(values, axis=axis)
