"""Changes to files: of bytes, and of the values in JSON and TOML, which random bytes seldom reach."""

import copy
import json
import random
import re


ODD = [
    None, True, -1, 0, 3, 10**6, 10**30, -0.0, 1e-320, 1e308, "", "x", "nan", "../../etc/passwd", "<b>x</b>",
    "a\nb", "\x1b[2J", "\u0000", "ж" * 300, [], {}, [[]], [None], [1.0, "x"], [[1.0], [1.0, 2.0]], {"x": {}},
]  # fmt: skip
WORDS = (
    b"\xff" * 4,
    b"\0" * 8,
    b"nan",
    b"1e999",
    b'"',
    b"[" * 500,
    b"{" * 500,
    b"-1",
    b"\n",
    b"\x1b[2J",
)
_VALUE = re.compile(rb"=\s*([^\n#]+)")
_TOML = [
    b"-1", b"0", b"1e400", b"nan", b"inf", b"99999999999999999999", b'""', b'"x"', b"[]", b"{}", b"true",
    b"1979-05-27", b"07:32:00", b'["a", 1]', b'["../*"]', b'["**/*"]', b'["[", "*"]', b'["\\u0000"]',
]  # fmt: skip


def of_bytes(content: bytes, chance: random.Random) -> bytes:
    """Cut, change, insert or repeat a few bytes."""
    changed = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 8, 40))):
        at = chance.randrange(len(changed) or 1)
        match chance.randrange(5):
            case 0:
                del changed[at : at + chance.choice((1, 4, 100, 10**6))]
            case 1:
                changed[at : at + 1] = bytes([chance.randrange(256)])
            case 2:
                changed[at:at] = chance.choice(WORDS)
            case 3:
                changed[at:at] = changed[at // 2 : at // 2 + 64]
            case _:
                changed[at : at + 4] = chance.randbytes(4)
    return bytes(changed)


def of_json(content: bytes, chance: random.Random) -> bytes:
    """One to three values of a document replaced, left out or put under another name; of bytes if it is none."""
    try:
        document = json.loads(content)
        for _ in range(chance.choice((1, 1, 1, 2, 3))):
            document = _changed(document, chance)
        return json.dumps(document).encode("utf-8", "replace")
    except (ValueError, RecursionError, OverflowError):
        return of_bytes(content, chance)


def _changed(document: object, chance: random.Random) -> object:
    places = list(_places(document))
    if not places or chance.random() < 0.02:
        return copy.deepcopy(chance.choice(ODD))
    parent, key = chance.choice(places)
    match chance.randrange(6):
        case 0:
            del parent[key]
        case 1 if isinstance(parent, dict):
            parent[chance.choice(("x", "", key.upper(), "schema"))] = parent.pop(key)
        case 2 if isinstance(parent, list):
            parent.append(copy.deepcopy(parent[key]))
        case 3 if isinstance(parent[key], float | int):
            parent[key] = parent[key] * chance.choice((-1, 0, 1e300, 1e-300, 2)) + chance.choice(
                (0, 1)
            )
        case _:
            parent[key] = copy.deepcopy(chance.choice(ODD))
    return document


def _places(document: object):
    """Every container in a document with each of its keys."""
    if isinstance(document, dict | list):
        for key in [*document] if isinstance(document, dict) else range(len(document)):
            yield document, key
            yield from _places(document[key])


def of_toml(content: bytes, chance: random.Random) -> bytes:
    """One to three values replaced."""
    for _ in range(chance.choice((1, 1, 2, 3))):
        found = list(_VALUE.finditer(content))
        if not found:
            return of_bytes(content, chance)
        at = chance.choice(found)
        content = content[: at.start(1)] + chance.choice(_TOML) + content[at.end(1) :]
    return content


def change_of(file: str):
    """The change that goes deepest into files of that name."""
    if file.endswith(".toml"):
        return of_toml
    readable = (".json", ".imucal", ".azure", ".aria", ".basalt", ".realsense")
    return of_json if file.endswith(readable) else of_bytes
