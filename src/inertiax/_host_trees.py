"""Records walked through without JAX: the few functions of `jax.tree` and `equinox` that the host needs.

Nodes are records, tuples, lists, dictionaries and what `labelled` has; all else but None is a leaf.
"""

import dataclasses
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np


def map(function: Callable[[Any], Any], tree: Any) -> Any:  # named as that of `jax.tree`
    """As `jax.tree.map` of one tree."""
    if tree is None:
        return None
    if dataclasses.is_dataclass(tree) and not isinstance(tree, type):
        return _with(tree, {n: map(function, getattr(tree, n)) for n in _leaves(tree)})
    if isinstance(tree, tuple) and hasattr(tree, "_fields"):
        return type(tree)(*(map(function, x) for x in tree))
    if isinstance(tree, (tuple, list)):
        return type(tree)(map(function, x) for x in tree)
    if isinstance(tree, dict):
        return {k: map(function, v) for k, v in tree.items()}
    return function(tree)


def leaves(tree: Any) -> list:
    """As `jax.tree.leaves`; those of a dictionary in its own order."""
    found = []
    map(found.append, tree)
    return found


LEAVES: dict[type, tuple[str, ...]] = {}  # fields of dataclasses of which others hold no leaves


def _leaves(record: Any) -> Iterable[str]:
    known = LEAVES.get(type(record))
    if known is not None:
        return known
    return [f.name for f in dataclasses.fields(record) if not f.metadata.get("static")]


def _with(record: Any, values: dict[str, Any]) -> Any:
    """A copy with other values in some fields, neither converted nor checked."""
    copy = object.__new__(type(record))
    for each in dataclasses.fields(record):
        value = values[each.name] if each.name in values else getattr(record, each.name)
        object.__setattr__(copy, each.name, value)
    return copy


class _Path:
    """Notes which attributes and items are asked of it."""

    def __init__(self, *names: str | int):
        self._names = names

    def __getattr__(self, name: str) -> "_Path":
        return _Path(*self._names, name)

    def __getitem__(self, place: int) -> "_Path":
        return _Path(*self._names, place)


def tree_at(where: Callable[[Any], Any], tree: Any, replace: Any, is_leaf: Any = None) -> Any:
    """As `equinox.tree_at` for `where` that names attributes of records or items of tuples, or theirs."""
    del is_leaf  # None is replaced as all else
    found = where(_Path())
    one = isinstance(found, _Path)
    for path, value in zip((found,) if one else found, (replace,) if one else replace, strict=True):
        tree = _replaced(tree, path._names, value)
    return tree


def _replaced(record: Any, names: tuple[str | int, ...], value: Any) -> Any:
    first, *rest = names
    if isinstance(first, int):
        new = _replaced(record[first], tuple(rest), value) if rest else value
        items = list(record)
        items[first] = new
        return type(record)(items)
    new = _replaced(getattr(record, first), tuple(rest), value) if rest else value
    return _with(record, {first: new})


def shape(value: Any) -> tuple[int, ...]:
    """As `jax.numpy.shape`."""
    return np.shape(value)


class Result:
    """How a solve on the host ended, which equals the item of `optimistix.RESULTS` of that name."""

    def __init__(self, name: str):
        self._name = name

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Result):
            return self._name == other._name
        import optimistix

        return bool(other == getattr(optimistix.RESULTS, self._name))

    def __hash__(self) -> int:
        return hash(self._name)


class Results:
    """As `optimistix.RESULTS`, of solves on the host."""

    successful = Result("successful")
    nonlinear_max_steps_reached = Result("nonlinear_max_steps_reached")
