"""What docstrings and pages name as `module.name`, `Class.member` or `object.member` is there."""

import ast
import importlib
import re
from functools import cache
from pathlib import Path

import inertiax


SOURCE = Path(inertiax.__file__).parent
DOCS = Path(__file__).parents[1] / "docs"
NAMED = re.compile(r"`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+)(?:\([^`]*\))?`")
FILE = re.compile(r".*\.(cpp|csv|h|hpp|html|json|log|md|parquet|pdf|png|py|toml|txt|xml|xsd|yaml)")
PARAMETER = re.compile(r"(accel|gyro|mag)\.(bias|matrix|scale|misalignment|g_sensitivity|current)")
OUTSIDE = {"np": "numpy", "eqx": "equinox", "ix": "inertiax", "nav": "inertiax.navigation"}
OUTSIDE |= {n: n for n in ("numpy", "scipy", "jax", "equinox", "lineax", "optimistix", "typer")}
# What examples call an object, and its class.
OBJECTS = {
    "basis": "AbstractBasis",
    "calibration": "Calibration",
    "filter_": "Filter",
    "fit": "Fit",
    "layout": "Layout",
    "one": "Calibration",
    "result": "DeviceResult",
    "settings": "OneTemperature",
    "solution": "ThermalSolution Solution",
    "track": "Track",
    "twin": "Twin",
}
# Members of other libraries' objects, and keys of files.
ELSEWHERE = {"Exported.serialize", "figure.savefig", "header.stamp", "blackjax.window_adaptation"}
ELSEWHERE |= {f"discrete.{key}" for key in ("white", "sample", "random_walk_step")}


def _dotted(file: Path) -> str:
    parts = file.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(p for p in parts if p != "__init__")


MODULES = {_dotted(f): f for f in SOURCE.rglob("*.py")}


@cache
def _homes() -> dict[str, list[str]]:
    """Modules that a class is made in, by its name."""
    found: dict[str, list[str]] = {}
    for module, file in MODULES.items():
        for name in re.findall(r"^class (\w+)", file.read_text("utf-8"), re.M):
            found.setdefault(name, []).append(module)
    return found


def _classes(name: str) -> list[object]:
    return [getattr(importlib.import_module(home), name) for home in _homes().get(name, [])]


def _has(home: object, names: list[str]) -> bool:
    """Whether names lead from a module or a class on to something."""
    for name in names:
        if name in getattr(home, "__dataclass_fields__", ()):
            return True  # what a field holds is not known
        if not hasattr(home, name):
            return False
        home = getattr(home, name)
    return True


def _resolves(named: str) -> bool:
    if named in ELSEWHERE or FILE.fullmatch(named) or PARAMETER.fullmatch(named):
        return True
    head, *rest = named.split(".")
    if head in OUTSIDE:
        return _has(importlib.import_module(OUTSIDE[head]), rest)
    kinds = OBJECTS.get(head, head).split()
    if any(_has(c, rest) for kind in kinds for c in _classes(kind)):
        return True
    for module in MODULES:
        own, parts = module.split("."), [head, *rest]
        for k in range(1, len(parts) + 1):
            if own[-k:] == parts[:k] and _has(importlib.import_module(module), parts[k:]):
                return True
    return False


def _docstrings(file: Path) -> str:
    nodes = ast.walk(ast.parse(file.read_text("utf-8")))
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    return "\n".join(ast.get_docstring(n) or "" for n in nodes if isinstance(n, kinds))


def _prose(page: Path) -> str:
    return re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.M | re.S)


def test_what_docstrings_and_pages_name_is_there():
    texts = {f: _docstrings(f) for f in MODULES.values()}
    texts |= {p: _prose(p) for p in (*DOCS.rglob("*.md"), DOCS.parent / "README.md")}
    named = {(name, file) for file, text in texts.items() for name in NAMED.findall(text)}
    known = {name: _resolves(name) for name in {name for name, _ in named}}
    assert len(known) > 200
    assert not sorted(f"{file.name}: {name}" for name, file in named if not known[name])
