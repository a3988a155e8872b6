"""Every public name has documentation, and every picture in the pages a script that makes it."""

import importlib
import inspect
import re
from pathlib import Path

import pytest

import inertiax


DOCS = Path(__file__).parents[1] / "docs"
BENCHMARKS = DOCS.parent / "benchmarks"
SOURCE = Path(inertiax.__file__).parent
INNER = {
    "_typing",
    "_host_trees",
    "_jax",
    "_records",
    "_without_jax",
    "plots",
    "report",
    "cli",
    "__main__",
}  # nobody builds on these
PICTURES = sorted(p for p in DOCS.rglob("*") if p.suffix in (".png", ".svg", ".jpg", ".gif"))


def _modules() -> list[str]:
    names = []
    for file in sorted(SOURCE.rglob("*.py")):
        parts = file.relative_to(SOURCE).with_suffix("").parts
        # A folder's own page is where it gives names of its own.
        bare = parts[-1] == "__init__" and "import" not in file.read_text(encoding="utf-8")
        if parts[0] not in INNER and parts != ("__init__",) and not bare:
            names.append(".".join(("inertiax", *(p for p in parts if p != "__init__"))))
    return names


def test_every_module_is_on_one_page_of_the_api():
    pages = "".join(p.read_text("utf-8") for p in (DOCS / "api").glob("*.md"))
    listed = re.findall(r"^::: (\S+)$", pages, flags=re.MULTILINE)
    assert len(listed) == len(set(listed))
    assert set(listed) == {*_modules(), "inertiax"}


def test_every_public_name_has_a_docstring():
    assert not [name for module in _modules() for name in _bare(module)]


def _bare(module: str) -> list[str]:
    """Names of a module without one."""
    home = importlib.import_module(module)
    bare = [] if home.__doc__ else [module]
    for name, value in vars(home).items():
        if name.startswith("_") or getattr(value, "__module__", "") != module:
            continue
        if inspect.isclass(value):
            own = [n for n, m in vars(value).items() if inspect.isfunction(m) or _descriptor(m)]
            # A method that stands in for its base's has the base's words.
            said = {n: inspect.getdoc(getattr(value, n)) for n in own if not n.startswith("_")}
            bare += [f"{name}.{n}" for n, text in said.items() if not text]
        if (inspect.isclass(value) or inspect.isfunction(value)) and not value.__doc__:
            bare.append(name)
    return [f"{module}: {name}" for name in bare]


def _descriptor(member: object) -> bool:
    return isinstance(member, property | classmethod | staticmethod)


def test_every_name_of_the_package_resolves_and_is_documented():
    for name in dir(inertiax):
        if not name.startswith("_"):
            assert inspect.getdoc(getattr(inertiax, name)), name


def test_there_are_pictures_to_check():
    assert len(PICTURES) >= 10


@pytest.mark.parametrize("picture", PICTURES, ids=lambda p: p.name)
def test_every_picture_is_shown_and_made_by_a_script(picture):
    pages = "".join(p.read_text("utf-8") for p in DOCS.rglob("*.md"))
    assert f"/{picture.name})" in pages
    # A tutorial's pictures lie in a folder of its name; the others are made by benchmarks.
    tutorial = picture.parent.with_name(picture.parent.name.replace("-", "_") + ".py")
    scripts = [tutorial] if tutorial.is_file() else sorted(BENCHMARKS.glob("*.py"))
    stem = re.escape(picture.stem.removeprefix("paper-"))  # which `paper_tables.py` puts before all
    named = re.compile(rf"""["'/]{stem}(?:{picture.suffix})?["']""")
    assert any(named.search(s.read_text("utf-8")) for s in scripts)
