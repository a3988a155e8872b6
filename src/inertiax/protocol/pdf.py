"""`protocol.pdf`: the protocol on A4, to print and sign."""

import datetime
from collections.abc import Sequence
from pathlib import Path

from fpdf import FPDF
from fpdf.enums import TableBordersLayout
from fpdf.fonts import FontFace
from PIL import Image

from ..plots.style import font_files
from ..report.page import Link, Section, Table
from ..storage.whole_files import write_atomically
from . import content
from .fallback_fonts import close_fonts, Fallback, fallback_fonts, lacking
from .figures import Drawn
from .identity import identity
from .protocol import Protocol


_FONT, _SIZE, _SMALL = "dejavu", 8.0, 6.6  # points
_MARGIN = 15.0  # mm
_FIGURE_HEIGHT = 80.0  # mm, at most
_PAGES = 4  # figures that would take more are left to the page
_LAST = 12.0  # mm for the lines below the figures
_TO_SIGN = 1.5  # mm for each point of the letters' size, in rows that people write into
_FILES = 12  # inputs that are listed; the JSON has all
_BOX = "□"
_INK, _SOFT, _LINE = (29, 35, 43), (85, 96, 110), (200, 205, 212)
_TONES = {"good": (0, 115, 79), "attention": (156, 74, 0), "bad": (168, 35, 28)}


class _Sheet(FPDF):
    """A4 with the page's number and the title at the foot."""

    def __init__(self, title: str, fonts: Fallback):
        super().__init__(format="A4")
        self.seen: set[str] = set()  # characters that were shown
        self._missing = fonts.missing
        self._title = title = self.printable(title)
        for style, file in font_files().items():
            self.add_font(_FONT, style, str(file))
        for k, file in enumerate(fonts.files):
            self.add_font(f"{_FONT}{k}", "", str(file))
        self.set_fallback_fonts([f"{_FONT}{k}" for k in range(len(fonts.files))], exact_match=False)
        self.set_margins(_MARGIN, _MARGIN)
        self.set_auto_page_break(True, margin=_MARGIN)
        self.set_title(title)
        self.set_text_color(*_INK)
        self.set_draw_color(*_LINE)

    def printable(self, text: str) -> str:
        """Without characters that no page shows; a box for those that no font has."""
        self.seen.update(filter(str.isprintable, text))
        return "".join(_BOX if c in self._missing else c if c.isprintable() else " " for c in text)

    def footer(self) -> None:
        """Called by FPDF at the end of every page."""
        self.set_y(-11.0)
        self.set_font(_FONT, size=_SMALL)
        self.set_text_color(*_SOFT)
        half = self.epw / 2
        self.cell(half, 4, self._title[:90])
        self.cell(half, 4, f"page {self.page_no()} of {{nb}}", align="R")
        self.set_text_color(*_INK)


def write_pdf(
    protocol: Protocol, folder: Path, command: str, figures: Sequence[Drawn]
) -> frozenset[str]:
    """Write the document; characters that no font of this machine has are shown as □, and returned."""
    sheet = _filled(protocol, command, figures, Fallback((), frozenset()))
    lack = lacking(sheet.seen, font_files()[""]) | lacking(sheet.seen, font_files()["B"])
    fonts = fallback_fonts(lack) if lack else Fallback((), frozenset())
    if lack:  # only a filled document says what it shows
        close_fonts(sheet)
        sheet = _filled(protocol, command, figures, fonts)
    write_atomically(folder / "protocol.pdf", bytes(sheet.output()))
    return fonts.missing


def _filled(protocol: Protocol, command: str, figures: Sequence[Drawn], fonts: Fallback) -> _Sheet:
    """The document."""
    sheet = _Sheet(content.title(protocol), fonts)
    sheet.set_creation_date(datetime.datetime.fromisoformat(protocol.created))
    sheet.add_page()
    _head(sheet, protocol)
    needed, beside = content.requirements(protocol), content.effects(protocol)
    first = [identity(protocol), *([] if needed is None else [needed])]
    then = [
        *([] if beside is None else [beside]),
        *content.budgets(protocol),
        content.procedure(protocol),
        *content.limits_of_knowledge(protocol),
        content.inputs(protocol, _FILES),
    ]
    for section in (*first, *content.results(protocol), *then):
        _section(sheet, section)
    to_sign = content.signatures(protocol)
    # All who sign do so on one page.
    room = 12.0 + sum(len(t.rows) + 1 for t in to_sign.tables) * (_TO_SIGN * _SMALL + 0.6)
    for drawn in figures:
        if not _figure(sheet, drawn, room + _LAST):
            _text(sheet, "Further figures are in protocol.html.", _SIZE, _INK)
            break
    _section(sheet, to_sign, line=_TO_SIGN, room=room)
    _text(sheet, f"Written by: {command}", _SMALL, _SOFT)
    if fonts.missing:
        said = (
            "stands for characters that no font had where this was written; protocol.html has them."
        )
        _text(sheet, f"{_BOX} {said}", _SMALL, _SOFT)
    return sheet


def _head(sheet: _Sheet, protocol: Protocol) -> None:
    said = content.verdict(protocol)
    _text(sheet, content.title(protocol), 15.0, _INK, bold=True)
    _text(sheet, content.under(protocol), _SIZE, _SOFT)
    sheet.ln(1.0)
    _text(sheet, said.headline, 10.5, _TONES[said.tone], bold=True)
    for line in said.lines:
        _text(sheet, line, _SIZE, _INK)


def _section(sheet: _Sheet, section: Section, line: float = 0.5, room: float = 22.0) -> None:
    """A section that begins where `room` mm are left: a heading stays with what it heads."""
    sheet.ln(2.2)
    if sheet.will_page_break(room):
        sheet.add_page()
    _text(sheet, section.title, 10.0, _INK, bold=True)
    for sentence in section.lines:
        _text(sheet, sentence, _SIZE, _INK)
    for item in section.items:
        _text(sheet, f"• {item}", _SIZE, _INK)
    for table in section.tables:
        _table(sheet, table, line)


def _text(
    sheet: _Sheet, text: str, size: float, colour: tuple[int, int, int], *, bold: bool = False
) -> None:
    sheet.set_font(_FONT, "B" if bold else "", size)
    sheet.set_text_color(*colour)
    sheet.multi_cell(
        0, 0.49 * size, sheet.printable(text), align="L", new_x="LMARGIN", new_y="NEXT"
    )
    sheet.set_text_color(*_INK)


def _table(sheet: _Sheet, table: Table, line: float) -> None:
    """The table, with rows of `line` mm for each point of the letters' size."""
    if table.caption:
        _text(sheet, table.caption, _SMALL, _SOFT)
    cells = [tuple(c.text if isinstance(c, Link) else c for c in row) for row in table.rows]
    sheet.set_font(_FONT, size=_SMALL)
    with sheet.table(
        borders_layout=TableBordersLayout.HORIZONTAL_LINES,
        col_widths=_widths(sheet, table.head, cells),
        line_height=line * _SMALL,
        padding=(0.3, 2.0, 0.3, 0.0),
        text_align=tuple("RIGHT" if k in table.numeric else "LEFT" for k in range(len(table.head))),
        headings_style=FontFace(emphasis="BOLD", color=_SOFT),
    ) as made:
        for row in (table.head, *cells):
            made.row([sheet.printable(c) for c in row])
    sheet.ln(0.8)


def _widths(sheet: _Sheet, head: Sequence[str], rows: Sequence[Sequence[str]]) -> tuple[float, ...]:
    """In proportion to each column's longest text; none takes more than half of the width."""
    longest = [
        max(sheet.get_string_width(sheet.printable(row[k])) for row in (head, *rows)) + 3.0
        for k in range(len(head))
    ]
    most = max(0.5 * sheet.epw, sheet.epw - sum(sorted(longest)[:-1]))
    return tuple(min(width, most) for width in longest)


def _figure(sheet: _Sheet, drawn: Drawn, after: float) -> bool:
    """The figure, unless it and the `after` mm that follow would begin another page than the last that is wanted."""
    with Image.open(drawn.png) as image:
        shape = image.width / image.height
    height = min(_FIGURE_HEIGHT, sheet.epw / shape)
    if sheet.page_no() >= _PAGES and sheet.will_page_break(height + 10.0 + after):
        return False
    if sheet.will_page_break(height + 10.0):
        sheet.add_page()
    sheet.image(str(drawn.png), w=height * shape, h=height)
    _text(sheet, drawn.picture.caption, _SMALL, _SOFT)
    sheet.ln(1.5)
    return True
