"""JSON files decoded into fixed structures: whatever is wrong with one is a line that begins with the file."""

from typing import TypeVar

import msgspec

from ..storage.harmless_text import one_line
from ..storage.validation_words import validation_words


Document = TypeVar("Document")


class _Head(msgspec.Struct):
    schema: str


def decode(content: bytes, kind: type[Document], where: str, what: str, schema: str) -> Document:
    """The structure `kind` in a JSON document; `what` names it, such as "a calibration".

    The key `schema` is looked at first, since another schema has other keys. Raises `ValueError`, one
    line beginning with `where`, for anything that is not exactly this.
    """
    said = _decode(content, _Head, where, f"{what} of schema {schema}").schema
    if said != schema:
        raise ValueError(
            f"{where}: not {what}: schema is {said[:60]!r}; this version reads {schema!r}."
        )
    return _decode(content, kind, where, f"{what} of schema {schema}")


def encode(document: msgspec.Struct, where: str, *, indent: int | None = None) -> bytes:
    """A document as JSON that `decode` reads.

    Raises `ValueError`, one line beginning with `where`, for numbers that are not finite where the document must
    have a number: JSON has none of them, and what is written must be read again.
    """
    content = msgspec.json.encode(document)
    try:
        msgspec.json.decode(content, type=type(document))
    except msgspec.ValidationError as error:
        raise ValueError(
            f"{where}: not written, for a number is not finite or out of range: {validation_words(error)}."
        ) from None
    return content if indent is None else msgspec.json.format(content, indent=indent) + b"\n"


def _decode(content: bytes, kind: type[Document], where: str, what: str) -> Document:
    try:
        return msgspec.json.decode(content, type=kind)
    except msgspec.ValidationError as error:
        raise ValueError(f"{where}: not {what}: {validation_words(error)}.") from None
    # UnicodeDecodeError: msgspec checks text only where it decodes it; RecursionError: brackets in brackets.
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{where}: not valid JSON: {_one_line(error)}.") from None


def _one_line(error: Exception) -> str:
    return one_line(str(error))[:300].rstrip(".")
