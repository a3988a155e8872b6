"""The text of a `campaign.toml`: keys with the reason for each above it."""

import json
from typing import NamedTuple


CHECK = "CHECK"  # marks what could not be told from the log


class Line(NamedTuple):
    """One key of a table."""

    key: str
    value: object  # str, float, int, list or dict
    why: str = ""
    certain: bool = True


class Table(NamedTuple):
    """A table of the file, and remarks that stand in it without a key."""

    name: str
    lines: tuple[Line, ...]
    remarks: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()  # remarks that `init` prints, too: what of the log goes unused


def toml_text(title: tuple[str, ...], tables: tuple[Table, ...]) -> str:
    """The whole file. Tables without a key are left out, their remarks are not."""
    parts = ["\n".join(f"# {_plain(line)}" for line in title)]
    for table in tables:
        rows = [f"[{table.name}]"] if table.lines else []
        for line in table.lines:
            mark = "" if line.certain else f"{CHECK} "
            rows += [f"# {mark}{line.key}: {_plain(line.why)}"] if line.why else []
            rows.append(f"{line.key} = {value_text(line.value)}")
        rows += [f"# {_plain(remark)}" for remark in (*table.remarks, *table.unread)]
        if rows:
            parts.append("\n".join(rows))
    return "\n\n".join(parts) + "\n"


def value_text(value: object) -> str:
    """A value in TOML. JSON's strings are TOML's basic strings."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {value_text(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value) if not value.is_integer() or abs(value) > 1e15 else f"{value:.1f}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _plain(text: str) -> str:
    """Words from a file as a comment: one line, nothing that a terminal or TOML could take amiss."""
    return "".join(c if c.isprintable() else "�" for c in " ".join(text.split()))[:400]
