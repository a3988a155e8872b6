"""A delimited text as tables of some lines each, for logs that are larger than the memory.

Only texts that can be cut at any line are read so: with line feeds, without bytes of zero, without line breaks inside
quotes. For any other, and for one that is wrong, `ValueError` is raised, sooner or later; `csv.read_table` then reads
the text, or says in its line what is wrong.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import polars as pl

from .csv import column_names, parse_rows, with_line_feeds
from .text_layout import find_layout, FIRST_BYTES, FIRST_LINES, UTF8_MARK


_HEAD = 2 * FIRST_BYTES  # bytes that tell the layout, more than are looked at


def batches(
    path: Path, names: tuple[str, ...] | None, *, header_line: int | None, size: int
) -> Iterator[pl.DataFrame]:
    """The table of `csv.read_table`, all fields as text, in pieces of about `size` bytes of the file.

    Raises `ValueError` where the text cannot be cut into lines; what was yielded before is right all the same.
    """
    with path.open("rb") as file:
        head = _cut_at_line(file.read(_HEAD), whole=path.stat().st_size <= _HEAD)
        text = with_line_feeds(_checked(head.removeprefix(UTF8_MARK)))
        if header_line is not None and text.count(b"\n") < header_line + FIRST_LINES:
            raise ValueError(f"{path.name}: the header is too far down to read the text in pieces.")
        layout = find_layout(text, path.name, header_line)
        known = column_names(layout, names, path.name)
        file.seek(0)
        skipped = layout.start  # of what is left when the mark is away and lines end in line feeds
        for block in _blocks(file, size):
            rows = block[skipped:]
            skipped = max(skipped - len(block), 0)
            if rows.strip():
                yield parse_rows(rows, layout, known, path.name)


def _blocks(file: BinaryIO, size: int) -> Iterator[bytes]:
    """Whole lines, about `size` bytes at a time."""
    left, first = b"", True
    while data := file.read(size):
        cut = _cut_at_line(data)
        block = left + cut
        left = data[len(cut) :]
        yield with_line_feeds(_checked(block.removeprefix(UTF8_MARK) if first else block))
        first = False
    if left:
        yield with_line_feeds(_checked(left.removeprefix(UTF8_MARK) if first else left))


def _cut_at_line(data: bytes, *, whole: bool = False) -> bytes:
    """The bytes up to the end of their last line."""
    end = len(data) if whole else data.rfind(b"\n") + 1
    if not end:
        raise ValueError("no line ends within the bytes that are read at a time.")
    return data[:end]


def _checked(block: bytes) -> bytes:
    if b"\0" in block or block.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ValueError("bytes of zero in a text.")
    if block.count(b'"') % 2:
        raise ValueError("a line ends within quotes.")
    return block
