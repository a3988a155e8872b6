"""How a delimited text is laid out: what stands between fields, where the column names stand, where data begin.

The first lines decide. The data are the lines that share the greatest number of fields; what stands above them
without as many fields is a preamble (settings of a logger, `sep=,`, comments). Comment lines start with `#`, `%` or
`//`; a comment with as many names as the data have fields is the header (EuRoC's `#timestamp [ns],...`, `%time,...`
of `rostopic echo -p`). A line that names all columns but one is the header, too (`unnamed_column`). Names that stand
twice in their line are told apart by the line of groups above it. Rows may
end with a delimiter: an empty last field is no column.
"""

import csv
import itertools
import re
from collections import Counter
from collections.abc import Callable, Iterable
from typing import NamedTuple

from ...storage.harmless_text import short
from .code_pages import code_page
from .columns import shown
from .time_stamps import is_stamp
from .unnamed_column import names_axes, with_unnamed


COMMENTS = ("#", "%", "//")
_DELIMITERS = ("\t", ";", ",", " ")
FIRST_LINES = 300  # lines that are looked at: the longest preambles have some dozens
UTF8_MARK = b"\xef\xbb\xbf"  # at the start of a text
FIRST_BYTES = 1 << 20  # and no more bytes than this, once there are two lines
_FOR_VALUES = 20  # lines that tell whether a delimiter stands between values
_SEPARATOR = re.compile(r'"?sep=(.)"?', re.IGNORECASE)


class TextLayout(NamedTuple):
    """What the first lines of a text say about all of it."""

    delimiter: str
    names: tuple[str, ...] | None  # `None`: no line of the file holds column names
    header_line: int | None  # counted from 1, as editors do
    start: int  # byte at which the data begin
    width: int  # fields of a row of data without empty last ones
    preamble: tuple[str, ...]  # the lines above header and data
    page: str = "utf-8"  # code page of the lines that are no UTF-8


class _Line(NamedTuple):
    text: str
    number: int  # counted from 1
    start: int  # byte

    @property
    def is_comment(self) -> bool:
        return self.text.startswith(COMMENTS)


def find_layout(data: bytes, where: str, header_line: int | None = None) -> TextLayout:
    """The layout of a text with line feeds alone at its lines' ends.

    **Arguments:** `header_line` is the line that holds the column names, counted from 1, where the campaign says it.
    Raises `ValueError` where nothing but comments is there, or the line that was named cannot be the header.
    """
    page = code_page(data)
    lines = _first_lines(data, header_line or 0, page)
    if not lines:
        raise ValueError(f"{where}: the file has no rows of data, only blank lines.")
    separator = _SEPARATOR.fullmatch(lines[0].text)
    below = lines[1:] if separator else lines
    if header_line is not None and all(x.number != header_line for x in lines):
        raise ValueError(
            f"{where}: [recordings] header_line = {header_line} is blank or after the end; give the line that "
            "holds the column names, counted from 1."
        )
    body = [x for x in below if not x.is_comment and x.number > (header_line or 0)]
    if not body:
        raise ValueError(f"{where}: the file has no rows of data, only comments.")
    delimiter = separator[1] if separator else _delimiter(body)
    split = {x.number: fields(x.text, delimiter) for x in body}
    width = _usual_width([len(row) for row in split.values()])
    if header_line is not None:
        names, number, top = _said(lines, header_line, body, delimiter, where)
    else:
        names, number, top = _header(below, body, split, delimiter, width)
    data_lines = [x for x in body if x.number >= top]
    while len(data_lines) > 1 and _is_remark(split[data_lines[0].number], width):
        data_lines = data_lines[1:]  # what a sketch says before it prints
    start = data_lines[0].start if data_lines else len(data)
    above = top if number is None else number
    preamble = tuple(x.text for x in lines if x.number < above)
    rows = [split[x.number] for x in data_lines]
    filled = width - _empty_ends([r for r in rows if len(r) == width])
    short = _one_short(names, number, [x for x in lines if x.number < top], delimiter, filled)
    if short is not None:
        named, number = short
        data_rows = [r[:filled] for r in rows if len(r) == width]
        names = with_unnamed(named, data_rows, number, where)
        preamble = tuple(x.text for x in lines if x.number < number)
    return TextLayout(delimiter, names, number, start, filled, preamble, page)


def _one_short(
    names: tuple[str, ...] | None,
    number: int | None,
    above: list[_Line],
    delimiter: str,
    width: int,
) -> tuple[tuple[str, ...], int] | None:
    """The line that names all columns but one, and its number; `None` where there is none: the line that the campaign
    says, else the last one above the data if it names axes."""
    if names is None and above:
        line = above[-1]
        names, number = _named(fields(line.text.lstrip("#%/ "), delimiter)), line.number
        if any(map(is_value, names)) or not _are_names(list(names)) or not names_axes(names):
            return None
    if names is None or number is None or len(names) != width - 1:
        return None
    return names, number


def _is_remark(row: list[str], width: int) -> bool:
    """Whether a line is none of data: too few fields, and none is a value."""
    return len(row) < width and not any(f and is_value(f) for f in row)


def as_utf8(text: bytes, page: str) -> bytes:
    """Text in UTF-8; what is none is in the code page that the file's first lines tell (`code_pages.code_page`)."""
    if text.isascii():
        return text
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        page = code_page(text) if page == "utf-8" else page
        return text.decode("cp1252" if page == "utf-8" else page, "replace").encode()
    return text


def fields(line: str, delimiter: str) -> list[str]:
    """The fields of one line, without the blanks around them."""
    if delimiter == " ":
        return line.split()
    if line and '"' not in line:  # without quotes a reader of CSV does the same, ten times slower
        return [f.strip() for f in line.split(delimiter)]
    try:
        return [f.strip() for f in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:  # a quoted field of a length that no log has
        return [f.strip() for f in line.split(delimiter)]


def _number_of_fields(line: str, delimiter: str) -> int:
    """As many as `fields` gives, counted without making them where that is the same."""
    if delimiter == " " or '"' in line:
        return len(fields(line, delimiter))
    return line.count(delimiter) + 1


def is_number(field: str) -> bool:
    """Whether a field holds a number or nothing."""
    try:
        float(field.replace(",", "."))
    except ValueError:
        return not field
    return True


def is_value(field: str) -> bool:
    """Whether a field can be a value of a time or sensor column: a number, nothing, or a stamp."""
    return is_number(field) or is_stamp(field)


def _first_lines(data: bytes, wanted: int, page: str) -> list[_Line]:
    """The first lines that are not blank, line `wanted` among them."""
    lines: list[_Line] = []
    position = number = 0
    while position < len(data):
        end = data.find(b"\n", position)
        end = len(data) if end < 0 else end
        number += 1
        # Tabs at a line's end are fields that are empty in this row.
        text = as_utf8(data[position:end], page).decode("utf-8", "replace").lstrip().rstrip(" \r")
        if text and (len(lines) < FIRST_LINES or number >= wanted):
            lines.append(_Line(text, number, position))
        position = end + 1
        seen = len(lines) >= FIRST_LINES or (position > FIRST_BYTES and len(lines) > 1)
        if seen and number >= wanted + (FIRST_LINES if wanted else 0):
            break
    return lines


def _usual_width(counts: list[int]) -> int:
    """The number of fields in which most fields stand: rows of data outweigh lines of settings."""
    lines = Counter(counts)
    return max(lines, key=lambda c: (c * lines[c], c))


def _delimiter(body: list[_Line]) -> str:
    """The first of tab, semicolon, comma and blank that splits most lines of data into equally many fields.

    One whose fields are mostly no values (it stands within a text) gives way to a later one whose fields are.
    """
    tail = body[len(body) // 2 :] or body  # settings stand at the start
    first, fewest = None, 0
    for delimiter in _DELIMITERS:
        counts = [_number_of_fields(x.text, delimiter) for x in tail]
        usual = _usual_width(counts)
        if usual < 2 or 2 * counts.count(usual) <= len(counts):
            continue
        alike = [x for x, count in zip(tail, counts, strict=True) if count == usual]
        values, filled = _values(alike, delimiter)
        if 2 * values > filled and values > fewest:
            return delimiter
        if first is None:
            first, fewest = delimiter, values
    return first or ","


def _values(lines: list[_Line], delimiter: str) -> tuple[int, int]:
    """How many fields of some of the lines are values, and how many hold anything."""
    filled = [f for x in lines[:_FOR_VALUES] for f in fields(x.text, delimiter) if f]
    return sum(map(is_value, filled)), len(filled)


def _header(
    lines: list[_Line], body: list[_Line], split: dict[int, list[str]], delimiter: str, width: int
) -> tuple[tuple[str, ...] | None, int | None, int]:
    """Column names with their line's number (`None` where there are none), and the number of the first line of data."""
    fewest = width - _empty_ends([f for f in split.values() if len(f) == width])
    fits = lambda named: fewest <= len(_named(named)) <= width
    padded = _padded_above(body, split, fits)
    if padded is not None:
        return _named(split[padded.number]), padded.number, padded.number + 1
    full = lambda row: len(row) == width and 2 * sum(map(bool, row)) > width
    wide = (x for x in body if full(split[x.number]) or fits(split[x.number]))
    top = next(wide, None)
    if top is None:
        top, wide = body[0], iter(body[1:])
    above = [x for x in lines if x.number < top.number]
    first = split[top.number]
    values = sum(map(is_value, first))
    if above and above[-1].is_comment and (values or fits(first)):
        comment = fields(above[-1].text.lstrip("#%/ "), delimiter)
        if fits(comment) and not any(map(is_value, _named(comment))) and values:
            return _named(comment), above[-1].number, top.number
    if 2 * values > len(first):
        return None, None, top.number
    rows = _text_rows(itertools.chain([top], wide), split)
    header = next((x for x in rows if _are_names(split[x.number])), None)
    if header is None:
        groups = [x for x in above[-1:] if not x.is_comment]
        for group, line in itertools.pairwise([*groups, *rows]):
            names = _grouped(group, line, delimiter)
            if _are_names(list(names)):
                return names, line.number, line.number + 1
        header = top
    return _named(split[header.number]), header.number, header.number + 1


def _padded_above(
    body: list[_Line], split: dict[int, list[str]], fits: Callable[[list[str]], bool]
) -> _Line | None:
    """The names under settings that a spreadsheet or a logger filled up to the data's width (`FS;4g;;;`); `None`
    without such settings."""
    for k, line in enumerate(body):
        row = split[line.number]
        if fits(row):
            named = _named(row)
            words = not any(f and is_value(f) for f in named)
            return line if k and words and _are_names(list(named)) else None
    return None


def _grouped(group: _Line, line: _Line, delimiter: str) -> tuple[str, ...]:
    """Names in two lines: a group stands once over its columns (`Gyroscope,,,` over `X,Y,Z`) or over each of them."""
    above, names, last = fields(group.text, delimiter), [], ""
    for k, name in enumerate(_named(fields(line.text, delimiter))):
        last = (above[k] if k < len(above) else "") or last
        names.append(f"{last} {name}".strip())
    return tuple(names)


def _text_rows(wide: Iterable[_Line], split: dict[int, list[str]]) -> list[_Line]:
    """The lines at the top without any value: names, and with some loggers devices and units."""
    rows = []
    for line in wide:
        if any(f and is_value(f) for f in split[line.number]):
            break
        rows.append(line)
    return rows


def _are_names(row: list[str]) -> bool:
    named = [f for f in _named(row) if f]
    return len(set(named)) == len(named)


def _empty_ends(rows: list[list[str]]) -> int:
    """How many last fields hold nothing in any row but the first (which may name them)."""
    below = rows[1:] or rows or [[""]]
    ends = 0
    while ends < len(below[0]) - 1 and all(not row[-1 - ends] for row in below):
        ends += 1
    return ends


def _named(row: list[str]) -> tuple[str, ...]:
    """Names without quotes, comment signs and empty last fields."""
    names = [f.strip().strip('"').strip() for f in row]
    while len(names) > 1 and not names[-1]:
        names.pop()
    return tuple(names)


def _said(
    lines: list[_Line], number: int, body: list[_Line], delimiter: str, where: str
) -> tuple[tuple[str, ...], int, int]:
    """The header that the campaign names by its line."""
    line = next(x for x in lines if x.number == number)
    named = _named(fields(line.text.lstrip("#%/ "), delimiter))
    if 2 * sum(map(is_value, named)) > len(named):
        raise ValueError(
            f"{where}: [recordings] header_line = {number} holds numbers, {shown([short(line.text)])}; give the "
            "line that holds the column names, counted from 1."
        )
    above = [x for x in lines if x.number < number and not x.is_comment]
    if above and not _are_names(list(named)):
        named = _grouped(above[-1], line, delimiter)
    return named, number, body[0].number
