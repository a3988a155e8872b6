"""Small TOML files that a protocol is given, decoded into fixed structures."""

import tomllib
from pathlib import Path
from typing import TypeVar

import msgspec

from ..data.settings import check_keys
from ..storage.harmless_text import one_line
from ..storage.validation_words import validation_words


Document = TypeVar("Document", bound=msgspec.Struct)


def read_tables(path: Path, kind: type[Document], tables: str) -> Document:
    """The structure `kind` in a TOML file; `tables` says in words which tables it may have.

    Raises `ValueError`, one line that begins with the file, for a file that cannot be read or is not of this kind.
    """
    try:
        content = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror}).") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path}: not valid TOML: {_said(error)}.") from None
    check_keys(content, kind, path)
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        raise ValueError(
            f"{path}: {validation_words(error)}; the file has the tables {tables}."
        ) from None


def _said(error: Exception) -> str:
    return one_line(str(error))[:200].rstrip(".")
