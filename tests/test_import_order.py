"""The package reads top to bottom: a module imports only from modules above it."""

import ast
from pathlib import Path

import pytest

import inertiax


# Files, or folders taken as one; `docs/design.md` says what each holds.
ORDER = """_typing documents earth rotation temperature model alignment compose solve recordings formats screening
settings campaign motions dwells noise covariances hand_turns rests intervals allan estimators procedure convergence
one_device turns scatter effects
augmentation calibration uncertainty results together sources sensitivity approaches navigation choose calibrate
simulate design diagnose compensation exports fleet demo quantities quality plots
report cli __main__""".split()

SOURCE = Path(inertiax.__file__).parent


def _module(path: Path) -> str:
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


def _imported(path: Path) -> set[str]:
    """Top-level modules of the package that a file imports at import time or later."""
    depth = len(path.relative_to(SOURCE).parts) - 1
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            if node.level == depth + 1:
                names |= (
                    {node.module.split(".")[0]} if node.module else {a.name for a in node.names}
                )
            elif node.level == 0 and node.module and node.module.split(".")[0] == "inertiax":
                names |= {node.module.split(".")[1]} if "." in node.module else set()
    return names


FILES = sorted(p for p in SOURCE.rglob("*.py") if p != SOURCE / "__init__.py")


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_imports_only_from_above(path):
    module = _module(path)
    assert module in ORDER, f"list '{module}' in ORDER and in docs/design.md"
    allowed = set(ORDER[: ORDER.index(module) + 1])
    assert not (_imported(path) - allowed)


def test_every_listed_module_is_described():
    design = (SOURCE.parents[1] / "docs" / "design.md").read_text(encoding="utf-8")
    present = {_module(p) for p in FILES}
    for module in present:
        assert f"| `{module}`" in design or f"| `{module}/`" in design, module


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_only_plots_import_matplotlib_and_only_cli_configures_jax(path):
    text = path.read_text(encoding="utf-8")
    if _module(path) != "plots":
        assert "matplotlib" not in {n.split(".")[0] for n in _absolute_imports(text)}
    if _module(path) != "cli":
        assert "jax.config.update" not in text


def _absolute_imports(text: str) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module)
    return names
