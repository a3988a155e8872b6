"""The package reads from the top down: a folder imports only from folders above it, and nothing in circles."""

import ast
from functools import cache
from pathlib import Path

import inertiax


SOURCE = Path(inertiax.__file__).parent

# Folders (and single modules) from the top down; `docs/explanation/design.md` says what each holds.
FOLDERS = """_without_jax _records _host_trees _jax _typing storage
physics numerics data reduction campaign_draft plausibility effects estimators procedure allan model_selection
calibration calibrate simulate analysis navigation design diagnose exports fleet live plots
report protocol cli __main__""".split()

# The same inside the folders that have stages of their own.
STAGES = {
    "diagnose": """observations candidates noise without_interference problem problem_of_motions element_temperature
selection plan residuals result estimates custom_model wording findings contradicted_gyros turned_mount late_elements
partial_lag degree_beside pipeline held_out_stretch learn_type_noise __init__""".split(),
    "fleet": """reduce magnetometers solve effects population model_choice store copies input_hashes
covariance_by_source lever_arms rows reuse one_by_one line_plausibility fit derivatives overview results verdicts
cluster task_runs pipeline __init__""".split(),
    "data": """moments frames plausible_units recording recording_order recorded stored_recording compensated formats
pairing pose_rows model_columns settings json_documents campaign inputs""".split(),
}


def _name(path: Path) -> str:
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {_name(p): p for p in sorted(SOURCE.rglob("*.py")) if p != SOURCE / "__init__.py"}


@cache
def _text(name: str) -> str:
    return FILES[name].read_text(encoding="utf-8")


@cache
def _tree(name: str) -> ast.AST:
    return ast.parse(_text(name))


@cache
def _imported(name: str) -> set[str]:
    """Modules of the package that a file imports, at import time or later."""
    path = FILES[name]
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    found: set[str] = set()
    for node in ast.walk(_tree(name)):
        if not isinstance(node, ast.ImportFrom):
            continue
        if node.level:
            base = package[: len(package) - (node.level - 1)]
            base = ".".join(base + (node.module.split(".") if node.module else []))
        elif node.module and node.module.split(".")[0] == "inertiax":
            base = node.module.removeprefix("inertiax").lstrip(".")
        else:
            continue
        for alias in node.names:
            module = f"{base}.{alias.name}" if base else alias.name
            found.add(module if module in FILES else base)
    return found - {name, ""}


def test_imports_only_from_folders_above():
    found = []
    for name in FILES:
        folder = name.split(".")[0]
        assert folder in FOLDERS, f"list '{folder}' in FOLDERS and in docs/explanation/design.md"
        allowed = FOLDERS[: FOLDERS.index(folder) + 1]
        found += [f"{name}: {m}" for m in _imported(name) if m.split(".")[0] not in allowed]
    assert not found


def _stage(name: str) -> str:
    return (name.split(".") + ["__init__"])[1]


def test_imports_only_from_stages_above():
    found = []
    for name in FILES:
        folder = name.split(".")[0]
        if folder not in STAGES or _stage(name) == "__init__":
            continue
        order = STAGES[folder]
        assert _stage(name) in order, f"list '{_stage(name)}' in STAGES['{folder}']"
        allowed = order[: order.index(_stage(name)) + 1]
        inside = [m for m in _imported(name) if m.split(".")[0] == folder]
        found += [f"{name}: {m}" for m in inside if _stage(m) not in allowed]
    assert not found


def test_no_module_is_imported_in_a_circle():
    done: set[str] = set()

    def visit(name: str, path: tuple[str, ...]) -> None:
        assert name not in path, " -> ".join((*path[path.index(name) :], name))
        if name not in done:
            for other in sorted(_imported(name) if name in FILES else ()):
                visit(other, (*path, name))
            done.add(name)

    for name in sorted(FILES):
        visit(name, ())


# What a folder above loads by its name, when it is first asked: results that draw themselves.
LOADED_LATER = {"calibration.drawn": "inertiax.plots.calibration"}


def test_only_what_is_listed_is_loaded_by_name():
    modules, found = {f"inertiax.{m}" for m in FILES}, {}
    for name in FILES:
        if "import_module" not in _text(name):
            continue
        constants = [n.value for n in ast.walk(_tree(name)) if isinstance(n, ast.Constant)]
        for loaded in modules & {c for c in constants if isinstance(c, str)}:
            found[name] = loaded
    assert found == LOADED_LATER


def test_every_listed_folder_is_described():
    design = (SOURCE.parents[1] / "docs" / "explanation" / "design.md").read_text(encoding="utf-8")
    for folder in {name.split(".")[0] for name in FILES}:
        assert f"| `{folder}`" in design or f"| `{folder}/`" in design, folder


def test_only_plots_import_matplotlib_and_only_cli_configures_jax():
    found = []
    for name in FILES:
        folder, absolute = name.split(".")[0], _absolute_imports(_tree(name))
        if folder != "plots" and "matplotlib" in {n.split(".")[0] for n in absolute}:
            found.append(f"{name} imports matplotlib")
        if folder != "cli" and "jax.config.update" in _text(name):
            found.append(f"{name} configures JAX")
    assert not found


def _absolute_imports(tree: ast.AST) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module)
    return names


def test_tests_do_not_import_each_other():
    """What several need stands beside them, in `*_cases.py`, `*_data.py` and the like."""
    here = Path(__file__).parent
    found = []
    for path in sorted(here.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            found += [f"{path.name}: {name}" for name in names if name.startswith("test_")]
    assert not found
