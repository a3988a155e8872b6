"""What msgspec finds wrong in a document, in words for people who do not know it."""

import re

import msgspec

from .harmless_text import one_line


_TYPES = {
    "float": "a number", "int": "a whole number", "str": "text", "bool": "true or false",
    "array": "a list", "object": "a table", "null": "nothing",
}  # fmt: skip
_UNKNOWN = re.compile(r"Object contains unknown field `(.*?)`")
_MISSING = re.compile(r"Object missing required field `(.*?)`")
_WRONG = re.compile(r"Expected `(.*?)`, got `(.*?)`")


def validation_words(error: msgspec.ValidationError) -> str:
    """One line that says which key is wrong, where it stands, and what would be right; without a full stop.

    `Object contains unknown field 'serial' - at '$.device'` is "unknown key 'serial' in 'device'".
    """
    said, _, place = one_line(str(error))[:300].rstrip(".").partition(" - at `$")
    where = place.rstrip("`").lstrip(".")
    inside = f" in '{where}'" if where else ""
    if found := _UNKNOWN.fullmatch(said):
        return f"unknown key '{found[1]}'{inside}"
    if found := _MISSING.fullmatch(said):
        return f"key '{found[1]}' is missing{inside}"
    if found := _WRONG.fullmatch(said):
        expected, got = (
            " or ".join(_TYPES.get(kind, kind) for kind in text.split(" | "))
            for text in found.groups()
        )
        said = f"expected {expected}, found {got}"
    return f"'{where}': {said.replace('`', '')}" if where else said.replace("`", "")
