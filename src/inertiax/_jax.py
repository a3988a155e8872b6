"""JAX and what stands on it, by the names under which code knows them.

    from .._jax import eqx, jnp

In a command that works on the host (`_without_jax`) each is loaded when something of it is first needed. What records
need is there without: `eqx.Module`, `eqx.tree_at`, `jax.tree`.
"""

import contextlib
import functools
import importlib
import sys
from collections.abc import Callable
from typing import Any, TYPE_CHECKING

from . import _host_trees
from ._records import field, Module, when_loaded, WITHOUT_JAX


if TYPE_CHECKING or not WITHOUT_JAX:
    import equinox as eqx
    import jax
    import jax.numpy as jnp
    from jax import Array as Array
    from jaxtyping import PyTree as PyTree

    if TYPE_CHECKING:
        import lineax as lx
        import optimistix as optx
    else:

        def __getattr__(name: str) -> Any:
            names = {
                "lx": "lineax",
                "optx": "optimistix",
            }  # which not all that is made of JAX needs
            if name not in names:
                raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
            return importlib.import_module(names[name])

else:
    from ._records import Declared

    Array = PyTree = Any

    class _Later:
        """A module that is loaded with the first name that is asked of it, of which some are known without."""

        def __init__(self, name: str, always: dict[str, Any], until_loaded: dict[str, Any]):
            self._name, self._always, self._until_loaded = name, always, until_loaded

        def __getattr__(self, name: str) -> Any:
            if name in self._always:
                return self._always[name]
            if name in self._until_loaded and self._name not in sys.modules:
                return self._until_loaded[name]
            return getattr(importlib.import_module(self._name), name)

    def _later(module: str, name: str) -> Callable[..., Any]:
        """A decorator that is applied when what it decorates is first called."""

        def decorate(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
            @functools.cache
            def decorated() -> Callable[..., Any]:
                return getattr(importlib.import_module(module), name)(function, **options)

            return functools.wraps(function)(lambda *args, **given: decorated()(*args, **given))

        return decorate

    class _NoArray:
        """`Array`, of which nothing is one yet."""

    jax = _Later(
        "jax",
        {},
        {
            "Array": _NoArray,
            "enable_x64": lambda new_val: contextlib.nullcontext(),  # `JAX_ENABLE_X64` says so
            "jit": _later("jax", "jit"),
            "tree": _host_trees,
        },
    )
    jnp = _Later("jax.numpy", {}, {"shape": _host_trees.shape})
    eqx = _Later(
        "equinox",
        {
            "AbstractClassVar": Declared,
            "AbstractVar": Declared,
            "field": field,
            "Module": Module,
        },
        {
            "filter_jit": _later("equinox", "filter_jit"),
            "is_array": lambda value: isinstance(value, jax.Array),
            "tree_at": _host_trees.tree_at,
        },
    )
    lx = _Later("lineax", {}, {})

    def _register() -> None:
        sys.modules["jax"].tree_util.register_static(_host_trees.Result)

    when_loaded(_register)
    optx = _Later("optimistix", {}, {"RESULTS": _host_trees.Results})
