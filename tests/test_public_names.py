"""The package's public names are those of `public_names.txt`; `python tests/test_public_names.py` rewrites it."""

import inspect
from pathlib import Path

import inertiax as ix


LIST = Path(__file__).with_name("public_names.txt")


def _names() -> list[str]:
    """Names at the top, with the parameters of functions and the public members of classes."""
    lines = []
    for name in dir(ix):
        if name.startswith("_"):
            continue
        value = getattr(ix, name)
        if inspect.isclass(value):
            members = sorted(m for m in dir(value) if not m.startswith("_"))
            fields = getattr(value, "__dataclass_fields__", {})
            lines.append(f"{name}: {' '.join(sorted({*members, *fields}))}")
        elif inspect.isfunction(value):
            lines.append(f"{name}({', '.join(inspect.signature(value).parameters)})")
        else:
            lines.append(name)
    return lines


def test_public_names_are_those_of_the_list():
    # A name that goes away breaks somebody's script; a new one is to be documented in docs/api/library.md.
    assert _names() == LIST.read_text(encoding="utf-8").splitlines()


def test_first_layer_is_documented():
    page = (Path(__file__).parents[1] / "docs" / "api" / "library.md").read_text(encoding="utf-8")
    missing = [n for n in dir(ix) if not n.startswith("_") and f"`{n}" not in page]
    assert not missing


if __name__ == "__main__":
    LIST.write_text("\n".join(_names()) + "\n", encoding="utf-8")
