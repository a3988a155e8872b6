"""Files that `inertiax compensate` wrote, told from recordings by their own column.

Compensated outputs are no raw ones: fitted as a recording they would say that the sensor has no errors, and
compensated again they would be wrong by the errors' size.
"""

from collections.abc import Collection, Sequence
from pathlib import Path


COLUMN = "extrapolated"  # of every compensated table; no recording's column has this name in the formats that are read
# Ends what a reader says of a flight controller's log whose values it corrected, and nothing takes that away
WRONG_PARAMETERS = "parameters for the flight controller that are made of them are wrong"
_WRITTEN = {f"{triad}_{axis}" for triad in ("accel", "gyro") for axis in "xyz"}
_HEADER = 1 << 16  # bytes of a CSV's first line that are looked at


def is_compensated(path: Path) -> bool:
    """Whether a CSV or Parquet file has the column that compensation adds; looks at its header alone."""
    return has_column(path, COLUMN)


def has_column(path: Path, column: str) -> bool:
    """Whether a CSV or Parquet file has a column of that name; looks at its header alone."""
    try:
        if path.suffix.lower() in (".parquet", ".pq"):
            import pyarrow.parquet as pq

            return column in pq.read_schema(path).names
        if path.suffix.lower() != ".csv" or not path.is_file():
            return False
        with path.open("rb") as file:
            line = file.read(_HEADER).split(b"\n", 1)[0]
    except Exception:  # whatever is wrong with a file is said by its reader
        return False
    return column.encode() in {name.strip(b' "\r') for name in line.split(b",")}


def reads_compensated(path: Path, named: Collection[str]) -> bool:
    """Whether the columns that a campaign names for its triads (none: the canonical ones) are what compensation wrote
    into a file: it gives them the canonical names, beside outputs of other names."""
    return _WRITTEN.issuperset(named) and is_compensated(path)


def note_on(skipped: Sequence[Path], named: Sequence[Path]) -> tuple[str, ...]:
    """In words: files of globs that were skipped, and files that were named and read all the same."""
    notes: list[str] = []
    for files, said in (
        (skipped, "skipped, for `inertiax compensate` wrote {}: not a recording"),
        (named, "`inertiax compensate` wrote {}: what is found are errors that were left"),
    ):
        if files:
            names = ", ".join(f.name for f in files[:3]) + (", …" if len(files) > 3 else "")
            notes.append(f"{names}: {said.format('it' if len(files) == 1 else 'them')}")
    return tuple(notes)
