"""What records of data on the host are made of: modules of equinox, which are pytrees.

A command that needs no JAX would wait longer for its import than it works. There they are frozen dataclasses instead,
with the same fields, converters and checks; should JAX be loaded all the same, they are pytrees from then on.
"""

import abc
import dataclasses
import importlib.abc
import importlib.util
import sys
from collections.abc import Callable, Iterable
from typing import Any, TYPE_CHECKING


# JAX that is loaded costs nothing more.
WITHOUT_JAX = f"{__package__}._without_jax" in sys.modules and "jax" not in sys.modules

if TYPE_CHECKING or not WITHOUT_JAX:
    from equinox import field as field, Module as Module

    def when_loaded(action: Callable[[], None]) -> None:
        """Have something done as soon as JAX is there: now."""
        action()

else:
    _waiting: list[Callable[[], None]] = []
    _loaded = False

    def when_loaded(action: Callable[[], None]) -> None:
        """Have something done as soon as JAX is there."""
        if _loaded:
            action()
        else:
            _waiting.append(action)

    class _Watch(importlib.abc.MetaPathFinder, importlib.abc.Loader):
        """Loads JAX as usual, and does then what waits for it."""

        def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
            if fullname != "jax":
                return None
            sys.meta_path.remove(self)
            found = importlib.util.find_spec("jax")
            assert found is not None and found.loader is not None
            self._usual = found.loader
            found.loader = self
            return found

        def create_module(self, spec: Any) -> Any:
            return self._usual.create_module(spec)

        def exec_module(self, module: Any) -> None:
            global _loaded
            module.__spec__.loader = module.__loader__ = self._usual
            self._usual.exec_module(module)
            _loaded = True
            for action in _waiting:
                action()
            _waiting.clear()

    sys.meta_path.insert(0, _Watch())

    def field(*, static: bool = False, converter: Any = None, **given: Any) -> Any:
        """As `equinox.field`; a `static` one is part of the pytree's structure."""
        return dataclasses.field(metadata={"static": static, "converter": converter}, **given)

    class Declared:
        """As `equinox.AbstractVar` and `AbstractClassVar`: what subclasses have, which is no field yet."""

        def __class_getitem__(cls, kind: Any) -> Any:
            return cls

    class Module(metaclass=abc.ABCMeta):  # noqa: B024, as equinox' are, for those below
        """As `equinox.Module`, of which subclasses are dataclasses and may have `__check_init__`."""

        def __init_subclass__(cls, **given: Any) -> None:
            super().__init_subclass__(**given)
            own_init = vars(cls).get("__init__")
            if own_init is not None:
                cls.__init__ = _open_while(own_init)
            own = vars(cls).get("__annotations__", {})
            for name in [n for n, kind in own.items() if kind is Declared]:
                del own[name]
            dataclasses.dataclass(frozen=True, eq=False)(cls)
            when_loaded(lambda: _register(cls))

        def __post_init__(self) -> None:
            for each in dataclasses.fields(self):
                converter = each.metadata.get("converter")
                if converter is not None:
                    object.__setattr__(self, each.name, converter(getattr(self, each.name)))
            for kind in reversed(type(self).__mro__):
                check = vars(kind).get("__check_init__")
                if check is not None:
                    check(self)

    def _open_while(init: Callable[..., None]) -> Callable[..., None]:
        """An own `__init__` may set the fields of what it makes."""

        def opened(self: Any, *args: Any, **given: Any) -> None:
            draft = _Draft()
            init(draft, *args, **given)
            for name, value in vars(draft).items():
                object.__setattr__(self, name, value)
            self.__post_init__()

        opened.__doc__, opened.__wrapped__ = init.__doc__, init
        return opened

    class _Draft:
        pass

    def _register(cls: type) -> None:
        import jax

        fields = dataclasses.fields(cls)
        leaves = [f.name for f in fields if not f.metadata.get("static")]
        fixed = [f.name for f in fields if f.metadata.get("static")]

        def flatten(node: Any) -> tuple[list, tuple]:
            return [getattr(node, n) for n in leaves], tuple(getattr(node, n) for n in fixed)

        def flatten_with_keys(node: Any) -> tuple[list, tuple]:
            children, structure = flatten(node)
            keys = map(jax.tree_util.GetAttrKey, leaves)
            return list(zip(keys, children, strict=True)), structure

        def unflatten(structure: tuple, children: Iterable[Any]) -> Any:
            node = object.__new__(cls)
            for name, value in (*zip(leaves, children), *zip(fixed, structure)):
                object.__setattr__(node, name, value)
            return node

        jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, flatten)
