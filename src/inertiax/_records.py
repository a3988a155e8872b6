"""What records of data on the host are made of: modules of equinox, which are pytrees.

A command that needs no JAX would wait longer for its import than it works. There they are frozen dataclasses instead,
with the same fields, converters and checks.
"""

import dataclasses
import sys
from typing import Any, TYPE_CHECKING


# JAX that is loaded costs nothing more.
WITHOUT_JAX = f"{__package__}._without_jax" in sys.modules and "jax" not in sys.modules

if TYPE_CHECKING or not WITHOUT_JAX:
    from equinox import field as field, Module as Module
else:

    def field(*, static: bool = False, converter: Any = None, **given: Any) -> Any:
        """As `equinox.field`; `static` says something to JAX only."""
        return dataclasses.field(metadata={"converter": converter}, **given)

    class Module:
        """As `equinox.Module`, of which subclasses are dataclasses and may have `__check_init__`."""

        def __init_subclass__(cls, **given: Any) -> None:
            super().__init_subclass__(**given)
            dataclasses.dataclass(frozen=True, eq=False)(cls)

        def __post_init__(self) -> None:
            for each in dataclasses.fields(self):
                converter = each.metadata.get("converter")
                if converter is not None:
                    object.__setattr__(self, each.name, converter(getattr(self, each.name)))
            for kind in reversed(type(self).__mro__):
                check = vars(kind).get("__check_init__")
                if check is not None:
                    check(self)
