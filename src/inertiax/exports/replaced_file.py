"""Whether a file that an export would replace is one of its kind, by how it begins."""

import re


_KEY = re.compile(rb'^\s*\{\s*("schema"\s*:\s*"[^"]*"|"[^"]*")')
_COMMENT = b"#"


def is_of_kind(there: bytes, made: bytes) -> bool:
    """Whether a file holds what an export of this kind writes, or nothing.

    JSON has the first key of what is written (`schema` with its value); bytes that are no text, the first four; text
    that names the program in its first line, that name; and other text, as many words in its first line of data.
    """
    if not there.strip():
        return True
    if (key := _KEY.match(made)) is not None:
        return there.lstrip().startswith(b"{") and _plain(key[1]) in _plain(there)
    if b"\0" in made[:4096]:
        return there[:4] == made[:4]
    head, other = _lines(made)[0], _lines(there)[0]
    if b"inertiax" in head:
        return b"inertiax" in other and other[:1] == head[:1]
    return _shape(there) == _shape(made)


def _shape(text: bytes) -> list[bool]:
    """Of each word in the first line that is no comment, whether it is a number."""
    data = next((line for line in _lines(text) if not line.startswith(_COMMENT)), b"")
    return [word[:1] in b"-+.0123456789" for word in data.split()]


def _plain(text: bytes) -> bytes:
    return re.sub(rb"\s+", b"", text)


def _lines(text: bytes) -> list[bytes]:
    return text[:65536].strip().splitlines()
