"""Rows that were printed for people or for a plotter, such as `ax: 0.1, ay: 0.2`: refused, with the command that makes
columns of them under the names that the labels say."""

import re
import shlex
from collections import Counter
from collections.abc import Collection
from pathlib import Path

from ..data.formats.text_layout import TextLayout
from ..storage.harmless_text import short


_LABELS = ("[A-Za-z][^,;=]*= *", "[A-Za-z][A-Za-z0-9_]*: *")  # before a number
_NUMBER = "[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?"
_UNIT = "[A-Za-z%°/]*"  # right behind a number, as in 12.3m
_ROW = "^[-+0-9.eE,;:/_TZ[:space:]]+$"  # of numbers and stamps alone
# Three numbers in brackets behind a label: `accel=(0.1, 0.2, 9.8)`.
_GROUP = re.compile(rf"([A-Za-z]\w*) *[=:]? *\( *{_NUMBER} *[,;] *{_NUMBER} *[,;] *{_NUMBER} *\)")
# A stamp in brackets, as a logger writes it in front of what a program prints, with labelled numbers behind.
_STAMPED = re.compile(
    rf"\s*\[\s*(?:\d{{4}}-\d\d-\d\d[T ])?(?:\d+:\d\d:)?\d+[.,]?\d*\s*\][^A-Za-z]*"
    rf"((?:[A-Za-z]\w* *[=:] *{_NUMBER}[\s,;]*){{3,}})"
)
_FIRST = 1 << 14  # bytes that hold as many lines
_LINES = 20  # that tell what rows are like
_MOST = 0.8  # of these; the others are what a program says as it starts
_IN_A_COMMAND = re.compile(r"[\w .:/()\[\]^-]+")  # what a name may hold that a user is asked to run
_AXIS = re.compile(r"(.*[^A-Za-z])?([xyz])", re.IGNORECASE)


def refuse_labels(
    texts: dict[str, tuple[str, ...]],
    columns: list[str],
    layout: TextLayout,
    path: Path,
    stamps: Collection[str] = (),
) -> None:
    """Raise `ValueError` where numbers stand behind labels in three columns or more.

    **Arguments:** `texts` are first words of those of the `columns` that are text; `stamps` are columns of dates
    and times.
    """
    for label in _LABELS:
        begins = re.compile(rf"{label}[-+]?\.?\d")
        labelled = [w for w in texts.values() if sum(map(bool, map(begins.match, w))) == len(w)]
        if len(labelled) < len("xyz"):
            continue
        whole = re.compile(rf"({label}){_NUMBER}({_UNIT})")
        told = [whole.fullmatch(w) for words in labelled for w in words]
        script = f"s/{label}//g"
        names = _names(texts, columns, whole, layout.delimiter, stamps)
        pure = all(m is not None and not m[2] for m in told)
        if pure and (names or layout.names is None):  # a status between the rows goes, too
            script += f"; /{_ROW}/!d"
        raise ValueError(
            f"{path.name}: numbers stand behind labels ('{short(labelled[0][0])}'); take those out: "
            + by_sed(script, path, names)
        )


def refuse_groups(text: bytes, path: Path) -> None:
    """Raise `ValueError` where rows hold numbers by threes in brackets, such as `RAW 0x68: accel=(…) gyro=(…)`."""
    first = text[:_FIRST].decode("utf-8", "replace").splitlines()
    lines = [line for line in first if line.strip()][:_LINES]
    found = [tuple(m[1] for m in _GROUP.finditer(line)) for line in lines]
    labels, count = Counter(found).most_common(1)[0] if found else ((), 0)
    if not labels or count < _MOST * len(lines):
        return
    comma = "," if "," in lines[found.index(labels)] else ";"
    names = comma.join(f"{label}_{axis}" for label in labels for axis in "xyz")
    script = f"s/\\)[^(]*\\(/{comma}/g; s/^[^(]*\\(//; s/\\).*$//; /{_ROW}/!d"
    raise ValueError(
        f"{path.name}: numbers stand in brackets ('{short(lines[found.index(labels)])}'); make columns of them: "
        + by_sed(script, path, names)
    )


def refuse_stamped(text: bytes, path: Path) -> None:
    """Raise `ValueError` where rows are labelled numbers behind a stamp in brackets, `[12:30:11.123] ax=0.1 ay=…`.

    The stamp stays, as the first column.
    """
    first = text[:_FIRST].decode("utf-8", "replace").splitlines()
    lines = [line for line in first if line.strip()][:_LINES]
    rows = [_STAMPED.fullmatch(line) for line in lines]
    found = [() if m is None else tuple(re.findall(r"([A-Za-z]\w*) *[=:]", m[1])) for m in rows]
    labels, count = Counter(found).most_common(1)[0] if found else ((), 0)
    if not labels or count < _MOST * len(lines):
        return
    script = (
        r"s/^ *\[ *([0-9-]+) +/[\1T/; s/([^0-9A-Za-z_])[A-Za-z][A-Za-z0-9_]* *[=:] */\1/g; "
        rf"s/[],;[:space:]]+/,/g; s/^,?\[//; s/,$//; /{_ROW}/!d"
    )
    raise ValueError(
        f"{path.name}: numbers stand behind labels and a stamp ('{short(lines[found.index(labels)])}'); make columns "
        f"of them: {by_sed(script, path, ','.join(('time', *labels)))}"
    )


def by_sed(script: str, path: Path, names: str = "") -> str:
    """The command that writes a file without what the script takes out, under a line of names."""
    command = f"sed -E '{script}' {shlex.quote(path.name)}"
    if names:
        command = f"(echo {shlex.quote(names)}; {command})"
    return f"{command} > {shlex.quote(f'numbers_{path.stem}.csv')}"


def _names(
    texts: dict[str, tuple[str, ...]],
    columns: list[str],
    whole: re.Pattern[str],
    delimiter: str,
    stamps: Collection[str],
) -> str:
    """The line of names that the labels say, of `Gyro X = 1, Y = 2` with the words before X; empty where columns have
    several labels, or none but blanks are between them. A column of other text keeps its own, and stamps are the
    time."""
    found, group = [], ""
    for column in columns:
        labels = {m[1].rstrip(" =:") for m in map(whole.fullmatch, texts.get(column, ())) if m}
        if len(labels) > 1:
            return ""
        own = "time" if column in stamps else _said_before(texts.get(column, ())) or column
        name = labels.pop() if labels else own
        axis = _AXIS.fullmatch(name)
        group = "" if axis is None else axis[1] or group
        found.append(name if axis is None else f"{group}{axis[2]}")
    plain = all(_IN_A_COMMAND.fullmatch(name) for name in found)
    return delimiter.join(found) if plain and delimiter != " " else ""


def _said_before(words: tuple[str, ...]) -> str | None:
    """The one label in front of words that are no numbers, as in `GPS: 3D_FIX`."""
    labels = {w.partition(":")[0] if ":" in w else "" for w in words}
    return labels.pop() or None if len(labels) == 1 else None
