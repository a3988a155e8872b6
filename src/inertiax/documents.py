"""JSON files decoded into fixed structures: whatever is wrong with one is a line that begins with the file."""

from typing import TypeVar

import msgspec


Document = TypeVar("Document")


def decode(content: bytes, kind: type[Document], where: str, what: str) -> Document:
    """The structure `kind` in a JSON document; `what` names it, such as "a calibration of schema …".

    Raises `ValueError`, one line beginning with `where`, for anything that is not exactly this.
    """
    try:
        return msgspec.json.decode(content, type=kind)
    except msgspec.ValidationError as error:
        raise ValueError(f"{where}: not {what}: {_one_line(error)}.") from None
    # UnicodeDecodeError: msgspec checks text only where it decodes it; RecursionError: brackets in brackets.
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{where}: not valid JSON: {_one_line(error)}.") from None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300].rstrip(".")
