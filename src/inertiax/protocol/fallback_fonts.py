"""Fonts of this machine for characters that the documents' own font lacks: Chinese, Japanese, Korean and others."""

import struct
from collections.abc import Iterable, Set
from pathlib import Path
from typing import NamedTuple

from fontTools.ttLib import TTLibError
from fpdf import FPDF
from fpdf.errors import FPDFException
from fpdf.fonts import TTFFont

from ..plots.style import characters_of, installed_fonts


# Parts of names of fonts with tens of thousands of characters: looked at first, so that few files are opened
_LARGE = (
    "cjk",
    "sourcehan",
    "wqy",
    "unifont",
    "unicode",
    "fallback",
    "gothic",
    "yahei",
    "hei",
    "sim",
    "ming",
    "sans",
)
# What the writer of the PDF and its reader of fonts end with on a font that is damaged or of a kind they do not take
_UNUSABLE = (
    FPDFException,
    TTLibError,
    RuntimeError,
    LookupError,
    ValueError,
    AssertionError,
    struct.error,
    OSError,
)
_NONE = "lastresort"  # shows boxes for all characters there are


class Fallback(NamedTuple):
    """Fonts that together have what was asked for, but for what is missing."""

    files: tuple[Path, ...]
    missing: frozenset[str]


def lacking(characters: Iterable[str], font: Path) -> frozenset[str]:
    """The printed characters that a font does not have."""
    return frozenset(c for c in characters if not c.isspace()) - _characters(font)


def fallback_fonts(characters: Set[str], among: Iterable[Path] | None = None) -> Fallback:
    """The fewest installed fonts that have the characters: that with most of those that are left, again and again.

    **Arguments:** `among` are font files, by default all that the system knows. One that cannot be read, or put into a
    PDF, is passed over.
    """
    left, chosen = set(characters), []
    covered: dict[Path, frozenset[str]] = {}
    for file in sorted(installed_fonts() if among is None else among, key=_order):
        own = _characters(file) & characters
        if own:
            covered[file] = own
        if own == characters:
            break
    while left:
        ranked = sorted(covered, key=lambda f: (-len(covered[f] & left), _order(f)))
        best = next((f for f in ranked if covered[f] & left and _can_be_used(f)), None)
        if best is None:
            break
        chosen.append(best)
        left -= covered[best]
    return Fallback(tuple(chosen), frozenset(left))


def close_fonts(document: FPDF) -> None:
    """Close the font files of a document that will not be written, which writing it would do."""
    for font in document.fonts.values():
        if isinstance(font, TTFFont):
            font.close()


def _order(file: Path) -> tuple[int, str]:
    name = file.name.lower().replace("-", "").replace("_", "")
    return next((k for k, part in enumerate(_LARGE) if part in name), len(_LARGE)), str(file)


def _characters(file: Path) -> frozenset[str]:
    if _NONE in file.name.lower().replace("-", "").replace("_", ""):
        return frozenset()
    return characters_of(file)


def _can_be_used(file: Path) -> bool:
    """Whether the writer of the PDF takes a font: collections and some outlines need a late version of it."""
    tried = FPDF()
    try:
        tried.add_font("tried", "", str(file))
    except _UNUSABLE:
        return False
    finally:
        close_fonts(tried)
    return True
