"""What became of the corrections that a flight controller made to a log, as remarks of the draft."""

from pathlib import Path

from ..data.formats import dataflash, read_recordings, ulog
from ..data.formats.detect import format_of
from .toml_text import CHECK


def correction_remarks(log: Path) -> tuple[str, ...]:
    """What the reader of a flight controller's log took away, and what it could not, marked CHECK; none of other logs.

    A log that cannot be read says so where it is calibrated.
    """
    if format_of(log) not in (dataflash, ulog):
        return ()
    try:
        found = read_recordings(log)
    except ValueError:
        return ()
    notes = dict.fromkeys(note for r in found for note in r.notes)
    doubts = dict.fromkeys(f"{CHECK} {doubt}" for r in found for doubt in r.reservations)
    return (*doubts, *notes)
