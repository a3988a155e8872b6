"""Fields of a class as its source declares them; the comment on a field's line says its unit."""

import ast
import importlib
import inspect
import re
from pathlib import Path

from table_rows import table


def field_table(cls: type) -> str:
    """Fields as the source declares them; the comment on a field's line says its unit."""
    rows: dict[str, tuple[str, ...]] = {}  # a class says again what its interface left open
    for base in reversed(cls.__mro__):
        if base.__module__.partition(".")[0] == "inertiax":
            rows |= _declared(base)
    if not rows:
        return ""
    return table(("field", "type and shape", "unit, meaning"), rows.values())


def _declared(cls: type) -> dict[str, tuple[str, ...]]:
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
        kind = ast.unparse(node.annotation).replace("'", '"').replace(" | msgspec.UnsetType", "")
        kind = re.sub(r"\b_(?=[A-Z])", "", kind)  # structures of one file have private names
        kind = kind.replace('" ', '"')  # of a single axis, which jaxtyping wants so
        rows[name] = (f"`{name}`", f"`{kind}`", said)
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
