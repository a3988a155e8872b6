"""The reference of the first layer: every name of `import inertiax`, its fields with types, shapes and units."""

import inspect
import re
import textwrap
from typing import Any

from declared_fields import field_table
from table_rows import table

import inertiax


def page() -> str:
    """A section for each name, in alphabetical order."""
    return "\n\n".join(_section(n) for n in dir(inertiax) if not n.startswith("_"))


def _section(name: str) -> str:
    value = getattr(inertiax, name)
    if inspect.ismodule(value):
        return f"## inertiax.{name}\n\n{_words(value).partition(chr(10) * 2)[0]}"
    parts = [f"## {name}", f"```text\n{_call(name, value)}\n```", _words(value)]
    if inspect.isclass(value):
        parts += [field_table(value), _methods(value)]
    return "\n\n".join(p for p in parts if p)


def _words(value: Any) -> str:
    """The docstring, with the headings of its sections as they are written there."""
    return inspect.getdoc(value) or ""


def _call(name: str, value: Any) -> str:
    """`name(arguments)` without annotations, which the fields and the docstring give with units."""
    try:
        parameters = inspect.signature(value).parameters.values()
    except ValueError:
        return name
    bare = [p.replace(annotation=inspect.Parameter.empty) for p in parameters]
    text = str(inspect.Signature(bare))
    text = re.sub(r"<(?:function|class) '?([\w.]+)[^>]*>", r"\1", text)
    return "\n".join(textwrap.wrap(f"{name}{text}", 84, subsequent_indent="    "))


def _methods(cls: type) -> str:
    """Public methods and properties that the package itself defines, each with the start of its docstring."""
    rows = []
    for name in dir(cls):
        member = inspect.getattr_static(cls, name)
        if name.startswith("_") and name != "__call__":
            continue
        if not (
            inspect.isfunction(member) or isinstance(member, property | classmethod | staticmethod)
        ):
            continue
        said = (inspect.getdoc(getattr(cls, name)) or "").partition("\n\n")[0]
        if said:
            call = name if isinstance(member, property) else _call(name, getattr(cls, name))
            call = " ".join(call.split()).replace("(self, ", "(").replace("(self)", "()")
            rows.append((f"`{call}`", " ".join(said.split())))
    return table(("method", "what it gives"), rows) if rows else ""
