"""Shapes of what the formulas take, said in one line; leading axes are devices or samples."""

from typing import Any

import numpy as np

from .._jax import jax, jnp
from .._typing import AnyArray
from .leaves import is_traced


def check_one(call: str, **vectors: Any) -> None:
    """Raise `ValueError` for a vector that is not one sample of three axes."""
    for name, vector in vectors.items():
        if jnp.shape(vector) != (3,):
            raise ValueError(
                f"`{call}`: {name} has shape {jnp.shape(vector)}, but one sample has (3,); `jax.vmap` it over samples."
            )


def check_given(call: str, **values: Any) -> None:
    """Raise `ValueError` for a vector, temperature or current of one sample that is `None`, `TypeError` where it is
    complex."""
    for name, value in values.items():
        if value is None:
            zeros = "zeros for a triad that the device lacks"
            cure = {"temperature": "°C", "current": "A"}.get(name, zeros)
            raise ValueError(f"`{call}`: {name} is None; give {cure}.")
        if jnp.iscomplexobj(value):
            raise TypeError(f"`{call}`: {name} is complex; give real numbers.")


def check_ends(call: str, value: Any, inner: tuple[int, ...]) -> None:
    """Raise `ValueError` where a value's last axes are not `inner`. What is no array is let through: pytrees are
    built of other things, too."""
    shape = getattr(value, "shape", None)
    if shape is not None and tuple(shape[-len(inner) :]) != inner:
        raise ValueError(f"`{call}`: shape {tuple(shape)}; it must end with {inner}.")


def check_key(call: str, key: Any) -> None:
    """Raise `ValueError` for what is no one key of `jax.random`, of the old kind (two words) or the new."""
    kind = getattr(key, "dtype", None)
    if kind is not None and jnp.issubdtype(kind, jax.dtypes.prng_key) and key.shape == ():
        return
    if kind == jnp.uint32 and key.ndim == 1:
        return
    raise ValueError(
        f"`{call}`: key is {key if jnp.ndim(key) == 0 else 'an array'}; make one by `jax.random.PRNGKey(0)`."
    )


# Of a covariance's element in standard deviations: more is no rounding, in 32 bits either.
ROUNDING = 1e-3


def check_covariance(call: str, covariance: AnyArray) -> None:
    """Raise `ValueError` for known matrices that are no covariances: a variance below zero, not symmetric, or a
    correlation beyond one. What is no number passes: nothing was found there."""
    if is_traced(covariance):
        return
    c = np.asarray(covariance)
    variances = np.diagonal(c, axis1=-2, axis2=-1)
    if np.any(variances < 0.0):
        raise ValueError(f"`{call}`: a variance is {np.nanmin(variances):g}; none is below 0.")
    sigma = np.sqrt(variances)
    size = sigma[..., :, None] * sigma[..., None, :]
    if np.any(np.abs(c - np.swapaxes(c, -1, -2)) > ROUNDING * size):
        raise ValueError(f"`{call}`: the matrix is not symmetric.")
    if np.any(np.abs(c) > (1.0 + ROUNDING) * size):
        raise ValueError(f"`{call}`: an element is larger than its two standard deviations allow.")
