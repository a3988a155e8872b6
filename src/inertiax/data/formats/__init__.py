"""Recording formats: one file each, listed in `detect.FORMATS`.

A format is a module with `NAME`, `SUFFIXES` and `read(path, columns, layout) -> tuple[Recording, ...]`.
"""

from .columns import ColumnMap as ColumnMap, Layout as Layout
from .detect import FORMATS as FORMATS, read_recordings as read_recordings
