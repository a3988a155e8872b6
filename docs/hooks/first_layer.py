"""The reference of the first layer: every name of `import inertiax`, its fields with types, shapes and units."""

import ast
import importlib
import inspect
import re
import textwrap
from pathlib import Path
from typing import Any

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
        parts += [_fields(value), _methods(value)]
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
    return "\n".join(textwrap.wrap(f"{name}{text}", 100, subsequent_indent="    "))


def _fields(cls: type) -> str:
    """Fields as the source declares them; the comment on a field's line says its unit."""
    rows: dict[str, str] = {}  # a class says again what its interface left open
    for base in reversed(cls.__mro__):
        if base.__module__.partition(".")[0] == "inertiax":
            rows |= _declared(base)
    if not rows:
        return ""
    return "\n".join(
        ["| field | type and shape | unit, meaning |", "|---|---|---|", *rows.values()]
    )


def _declared(cls: type) -> dict[str, str]:
    module = importlib.import_module(cls.__module__)
    lines = Path(inspect.getfile(module)).read_text(encoding="utf-8").splitlines()
    (tree,) = [
        node
        for node in ast.walk(ast.parse("\n".join(lines)))
        if isinstance(node, ast.ClassDef) and node.name == cls.__name__
    ]
    rows = {}
    for node in tree.body:
        if not (isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)):
            continue
        name = node.target.id
        if name.startswith("_") or "ClassVar" in ast.unparse(node.annotation):
            continue
        said = _comment(lines, node.lineno, node.end_lineno or node.lineno)
        kind = ast.unparse(node.annotation).replace("'", '"')
        cells = (f"`{name}`", f"`{kind}`", said)
        rows[name] = "| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |"
    return rows


def _comment(lines: list[str], first: int, last: int) -> str:
    """The comment beside a field, on any line of its declaration, or else on the lines above it."""
    beside = [line.partition("  # ")[2] for line in lines[first - 1 : last] if "  # " in line]
    inside = [line.strip()[2:] for line in lines[first - 1 : last] if line.strip().startswith("# ")]
    if beside or inside:
        return " ".join([*beside, *inside])
    above = []
    for line in reversed(lines[: first - 1]):
        if not line.strip().startswith("# "):
            break
        above.append(line.strip()[2:])
    return " ".join(reversed(above))


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
            rows.append(f"| `{call}` | {' '.join(said.split())} |".replace("||", "\\|\\|"))
    return "\n".join(["| method | what it gives |", "|---|---|", *rows]) if rows else ""
