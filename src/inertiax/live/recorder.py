"""Keeps what came in: recordings as text, row for row as it was sent, and the campaign that reads them.

Rows are handed to the system as they come, so that a killed process loses none. A clock that begins anew, or leaps,
begins another recording (`stamp_order`); where a counter was full the recording goes on, and its campaign has such
stamps mended. What is no row, and rows out of order, are kept beside.
"""

import copy
import os
from pathlib import Path

from ..campaign_draft.toml_text import value_text
from ..data.settings import read_toml
from ..storage.whole_files import write_atomically


NAME = "recording-{}.csv"
FILES = "recording-*.csv"
LEFT_OUT = "left-out.txt"


class Recorder:
    """Writes into a folder that holds no campaign yet."""

    def __init__(self, folder: Path, campaign: Path):
        self.folder = folder
        self._header: list[bytes] = []
        self._part = 0
        self._file: int | None = None
        self._aside: int | None = None
        self._campaign: bytes | None = campaign_text(campaign).encode()  # `None`: written
        self._mended: bytes | None = campaign_text(campaign, mend=True).encode()

    def _make_folder(self) -> None:
        """The folder is there from the first line on: where none comes, nothing is left that blocks another run."""
        if self._campaign is not None:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_atomically(self.folder / "campaign.toml", self._campaign)
            self._campaign = None

    def begin(self, header: list[bytes]) -> None:
        """A new recording, under the lines that stand above the data of each."""
        self._make_folder()
        self._header = header
        self._part += 1
        if self._file is not None:
            os.close(self._file)
        self._file = _open(self.folder / NAME.format(self._part))
        _write(self._file, header)

    def again(self) -> None:
        """A new recording under the same lines: the clock leapt."""
        self.begin(self._header)

    def mend(self) -> None:
        """The stamps of a counter that was full stand as they came: whoever reads them is told to mend them."""
        if self._mended is not None:
            write_atomically(self.folder / "campaign.toml", self._mended)
            self._mended = None

    def rows(self, lines: list[bytes]) -> None:
        """Rows of the present recording."""
        assert self._file is not None
        _write(self._file, lines)

    def aside(self, lines: list[bytes]) -> None:
        """Lines that are no rows, or rows out of time."""
        if not lines:
            return
        self._make_folder()
        if self._aside is None:
            self._aside = _open(self.folder / LEFT_OUT)
        _write(self._aside, lines)

    def close(self) -> None:
        """Have everything on the disk."""
        for handle in (self._file, self._aside):
            if handle is not None:
                os.fsync(handle)
                os.close(handle)
        self._file = self._aside = None


def campaign_text(file: Path, *, mend: bool = False) -> str:
    """A `campaign.toml` with the same tables as `file`, for what `live` records; with `mend` its stamps are mended."""
    tables = copy.deepcopy(read_toml(file))
    recordings = tables["recordings"]
    recordings["files"] = [FILES]
    recordings["format"] = "csv"
    recordings.pop("start_row", None)  # those rows are not recorded
    if mend:
        columns = tables.setdefault("columns", {})
        said = columns.get("time", {})
        columns["time"] = ({"name": said} if isinstance(said, str) else said) | {"mend": True}
    parts = []
    for name, table in tables.items():
        keys = "\n".join(f"{key} = {value_text(value)}" for key, value in table.items())
        parts.append(f"[{name}]\n{keys}")
    return "# Recorded by `inertiax live`.\n\n" + "\n\n".join(parts) + "\n"


def _open(path: Path) -> int:
    as_sent = getattr(os, "O_BINARY", 0)  # Windows would change the line feeds
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | as_sent, 0o666)


def _write(handle: int, lines: list[bytes]) -> None:
    data = b"".join(line + b"\n" for line in lines)
    while data:
        data = data[os.write(handle, data) :]
