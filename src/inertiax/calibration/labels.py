"""Pytrees with labels that are no part of their structure.

A serial number tells two devices apart, but not two programs: were it part of a pytree's structure, every device
would be compiled anew and no two could be stacked. Labels are carried along by `jax.tree.map` and lost in traced
code, where one program serves all devices: a result of `jit` or `vmap` never bears another device's name.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from .. import _host_trees
from .._jax import jax
from .._records import when_loaded
from ..physics.leaves import as_leaf, is_traced


class Labels:
    """Values that every other `Labels` equals, so that structures compare without them."""

    __slots__ = ("values",)

    def __init__(self, values: Mapping[str, Any]):
        self.values = dict(values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Labels)

    def __hash__(self) -> int:
        return hash(Labels)

    def __repr__(self) -> str:
        return "Labels"


def register_labelled(
    cls: type, *, leaves: tuple[str, ...], structure: tuple[str, ...], labels: Mapping[str, Any]
) -> None:
    """Make a frozen dataclass a pytree.

    **Arguments:** `leaves` are fields that hold arrays or pytrees, `structure` fields that decide what is compiled,
    and `labels` fields for people, with the value each takes in traced code.
    """

    def flatten_with_keys(node: Any) -> tuple[list, tuple]:
        children = [(jax.tree_util.GetAttrKey(k), getattr(node, k)) for k in leaves]
        return children, _auxiliary(node)

    def _auxiliary(node: Any) -> tuple:
        own = Labels({k: getattr(node, k) for k in labels})
        return tuple(getattr(node, k) for k in structure), own

    def flatten(node: Any) -> tuple[list, tuple]:
        return [getattr(node, k) for k in leaves], _auxiliary(node)

    def unflatten(auxiliary: tuple, children: Iterable[Any]) -> Any:
        children = list(children)
        traced = any(is_traced(x) for x in jax.tree.leaves(children))
        said = labels if traced else auxiliary[1].values
        node = object.__new__(cls)
        named = (*zip(leaves, children), *zip(structure, auxiliary[0]), *said.items())
        for name, value in named:
            object.__setattr__(node, name, value)
        return node

    _host_trees.LEAVES[cls] = leaves
    when_loaded(
        lambda: jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, flatten)
    )


def pair(values: Any) -> Any:
    """Two numbers as leaves, or `None`."""
    return None if values is None else (as_leaf(values[0]), as_leaf(values[1]))


class Settings(tuple):
    """Pairs of a name and a value: a pytree whose leaves are the real numbers among the values.

    Whole numbers and text choose a form, so that they are part of the structure.
    """

    def __new__(cls, pairs: Iterable[tuple[str, Any]] = ()):
        return super().__new__(cls, ((k, v if _fixed(v) else as_leaf(v)) for k, v in pairs))


def _fixed(value: object) -> bool:
    return isinstance(value, (str, bool, int))


def _flatten_settings(settings: Settings) -> tuple[list, tuple]:
    fixed = tuple((k, v if _fixed(v) else None) for k, v in settings)
    return [v for _, v in settings if not _fixed(v)], fixed


def _unflatten_settings(fixed: tuple, children: Iterable[Any]) -> Settings:
    values = iter(list(children))
    return tuple.__new__(Settings, ((k, next(values) if v is None else v) for k, v in fixed))


when_loaded(
    lambda: jax.tree_util.register_pytree_node(Settings, _flatten_settings, _unflatten_settings)
)
