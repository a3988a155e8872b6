"""Names in scripts that the PDF's own font does not have: fonts made here, and what the PDF then maps its glyphs to."""

import logging
import re

import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen

from inertiax.plots.style import font_files
from inertiax.protocol import fallback_fonts as fonts, pdf
from inertiax.protocol.station import StationTable
from protocol_effect_cases import protocol


NAME = "北京计量实验室"
KANA = "テスト"


def made_font(path, characters):
    """A TrueType font of squares."""
    names = [".notdef", *(f"u{ord(c):04X}" for c in characters)]
    pen = TTGlyphPen(None)
    pen.moveTo((100, 0))
    for corner in ((100, 800), (900, 800), (900, 0)):
        pen.lineTo(corner)
    pen.closePath()
    square = pen.glyph()
    builder = FontBuilder(1000, isTTF=True)
    builder.setupGlyphOrder(names)
    builder.setupCharacterMap({ord(c): f"u{ord(c):04X}" for c in characters})
    builder.setupGlyf(dict.fromkeys(names, square))
    builder.setupHorizontalMetrics(dict.fromkeys(names, (1000, 100)))
    builder.setupHorizontalHeader(ascent=800, descent=-200)
    builder.setupNameTable({"familyName": path.stem, "styleName": "Regular"})
    builder.setupOS2(sTypoAscender=800, usWinAscent=800, usWinDescent=200)
    builder.setupPost()
    builder.save(path)
    return path


def shown(file):
    """Characters that glyphs of a PDF stand for, by its ToUnicode maps."""
    found = set()
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", file.read_bytes(), re.DOTALL):
        if b"beginbfchar" in stream:
            found |= {chr(int(u, 16)) for u in re.findall(rb"<[0-9A-F]+> <([0-9A-F]{4})>", stream)}
    return found


def written(tmp_path, monkeypatch, installed, name):
    monkeypatch.setattr(fonts, "installed_fonts", lambda: installed)
    made = protocol(station=StationTable(name=name))
    return pdf.write_pdf(made, tmp_path, "inertiax protocol", [])


def test_an_installed_font_brings_the_names_in(tmp_path, monkeypatch, caplog):
    installed = [made_font(tmp_path / "a-cjk.ttf", NAME), made_font(tmp_path / "b.ttf", KANA)]
    with caplog.at_level(logging.WARNING):
        assert written(tmp_path, monkeypatch, installed, NAME + KANA) == frozenset()
    assert set(NAME + KANA) <= shown(tmp_path / "protocol.pdf")
    assert not caplog.records


def test_what_no_font_has_is_a_box_and_told(tmp_path, monkeypatch, caplog):
    installed = [made_font(tmp_path / "a.ttf", NAME[:3]), tmp_path / "none.ttf"]
    (tmp_path / "none.ttf").write_bytes(b"no font")
    with caplog.at_level(logging.WARNING):
        assert written(tmp_path, monkeypatch, installed, NAME) == frozenset(NAME[3:])
    inside = shown(tmp_path / "protocol.pdf")
    assert set(NAME[:3]) <= inside and "□" in inside and not set(NAME[3:]) & inside
    assert not caplog.records  # no line of the library's


def test_a_name_that_the_own_font_has_asks_for_no_other(tmp_path, monkeypatch):
    monkeypatch.setattr(fonts, "installed_fonts", lambda: pytest.fail("looked for fonts"))
    made = protocol(station=StationTable(name="Łódź Ψ Ж\x07"))
    assert pdf.write_pdf(made, tmp_path, "inertiax protocol", []) == frozenset()
    assert set("ŁódźΨЖ") <= shown(tmp_path / "protocol.pdf")


def test_the_fewest_fonts_are_taken(tmp_path):
    few, most = made_font(tmp_path / "a.ttf", NAME[:2]), made_font(tmp_path / "b.ttf", NAME)
    other = made_font(tmp_path / "c.ttf", NAME[1:] + KANA)
    assert fonts.fallback_fonts(set(NAME), [few, most, other]).files == (most,)
    found = fonts.fallback_fonts(set(NAME + KANA + "龍"), [few, most, other])
    assert found.files == (other, few) and found.missing == {"龍"}
    # A font that shows boxes for whatever there is has none.
    boxes = made_font(tmp_path / "Last Resort-LastResort.ttf", NAME)
    assert fonts.fallback_fonts(set(NAME), [boxes]) == fonts.Fallback((), frozenset(NAME))
    assert fonts.lacking("aé 北", font_files()[""]) == {"北"}
