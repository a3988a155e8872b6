"""Libraries that only some formats need, imported when such a file is read."""

import importlib
from pathlib import Path
from types import ModuleType


def load(module: str, extra: str, path: Path) -> ModuleType:
    """The module, or a `ValueError` that says which extra to install for this file."""
    try:
        return importlib.import_module(module)
    except ImportError:
        library = module.split(".")[0]
        raise ValueError(
            f"{path.name}: reading it needs the library {library}: pip install 'inertiax[{extra}]'."
        ) from None
