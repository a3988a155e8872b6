"""Many devices of one model as one pytree, for `vmap`."""

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from .._jax import jax, jnp


Tree = TypeVar("Tree")


def stack(trees: Sequence[Tree]) -> Tree:
    """One pytree whose leaves have a leading axis of devices, to `jax.vmap` over.

    **Arguments:** calibrations (or any pytrees) of one model: the same parameters, temperature basis, effects and
    shapes. Serial numbers and notes are dropped. NumPy leaves stay NumPy.

    Raises `ValueError` that names the first that differs, and in what.
    """
    trees = list(trees)
    if not trees:
        raise ValueError("`stack(trees)`: nothing to stack; give at least one.")
    first = jax.tree.structure(trees[0])
    shapes = _shapes(trees[0])
    for k, tree in enumerate(trees[1:], 1):
        if jax.tree.structure(tree) != first:
            raise ValueError(
                f"`stack(trees)`: number {k} differs from the first in its {_where(trees[0], tree)}."
            )
        for path, shape in _shapes(tree).items():
            if shape != shapes[path]:
                raise ValueError(
                    f"`stack(trees)`: {path} of number {k} has shape {shape}, that of the first {shapes[path]}."
                )
    many = jax.tree.map(_stacked, *trees)
    return many.changed(device="", notes=()) if hasattr(many, "changed") else many


def unstack(tree: Tree) -> list[Tree]:
    """The devices of a stacked pytree, one by one.

    Serial numbers and notes, which `stack` drops, are set by `one.changed(device="SN 12")`. Raises `ValueError` where
    leaves differ in their first axis.
    """
    lengths = {np.shape(x)[:1] for x in jax.tree.leaves(tree)}
    if len(lengths) != 1 or () in lengths:
        raise ValueError(
            f"`unstack(tree)`: leaves begin with axes {sorted(lengths)}; they must share one, as `stack` makes it."
        )
    (count,) = lengths.pop()
    return [jax.tree.map(lambda x, k=k: x[k], tree) for k in range(count)]


def repeated(tree: Tree, lead: tuple[int, ...]) -> Tree:
    """The pytree with leading axes, along which its leaves are the same."""
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (*lead, *jnp.shape(x))), tree)


def _stacked(*leaves: Any) -> Any:
    return jnp.stack(leaves) if any(isinstance(x, jax.Array) for x in leaves) else np.stack(leaves)


def _shapes(tree: Any) -> dict[str, tuple[int, ...]]:
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return {jax.tree_util.keystr(path).lstrip("."): np.shape(x) for path, x in leaves}


def _where(one: Any, other: Any, path: str = "") -> str:
    """The first place where two structures differ, in words."""
    if type(one) is not type(other):
        return f"{path or 'kind'}: {type(other).__name__} instead of {type(one).__name__}"
    if dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            here, there = getattr(one, field.name), getattr(other, field.name)
            inner = f"{path}.{field.name}" if path else field.name
            if field.metadata.get("static") and here != there:
                return f"{inner}: {_short(there)} instead of {_short(here)}"
            if jax.tree.structure(here) != jax.tree.structure(there):
                return _where(here, there, inner)
    if isinstance(one, tuple | list) and len(one) == len(other):
        for k, (here, there) in enumerate(zip(one, other)):
            if jax.tree.structure(here) != jax.tree.structure(there):
                return _where(here, there, f"{path}[{k}]")
    return f"{path or 'structure'}: {_short(other)} instead of {_short(one)}"


def _short(value: Any) -> str:
    text = " ".join(str(value).split())
    return text if len(text) < 80 else f"{text[:77]}…"
