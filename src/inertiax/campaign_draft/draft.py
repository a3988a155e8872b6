"""A `campaign.toml` that was made of a log, and what could not be told from it."""

from pathlib import Path
from typing import NamedTuple

from .toml_text import CHECK, Line, Table, toml_text


class Draft(NamedTuple):
    """A `campaign.toml`, and what a user should know of it."""

    text: str
    told: dict[str, str]  # key: reason
    untold: dict[str, str]  # key: why it could not be told from the log
    log: Path
    tables: tuple[Table, ...]

    @property
    def unread(self) -> tuple[str, ...]:
        """Remarks on what of the log no line reads."""
        return tuple(remark for table in self.tables for remark in table.unread)


def draft_of(log: Path, tables: tuple[Table, ...]) -> Draft:
    """The file that these tables are."""
    lines = [line for table in tables for line in table.lines if line.why]
    untold = {line.key: line.why for line in lines if not line.certain}
    title = [f"Written by `inertiax init` from {log.name}."]
    if untold:
        title.append(f"Lines marked {CHECK} could not be told from the log: {', '.join(untold)}.")
    told = {line.key: line.why for line in lines if line.certain}
    return Draft(toml_text(tuple(title), tables), told, untold, log, tables)


def with_line(draft: Draft, line: Line) -> Draft:
    """The same with another line in the place of that with its key."""
    renewed = lambda table: table._replace(
        lines=tuple(line if old.key == line.key else old for old in table.lines)
    )
    return draft_of(draft.log, tuple(map(renewed, draft.tables)))
