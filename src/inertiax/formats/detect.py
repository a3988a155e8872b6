"""Which format a file is in: by its suffix, confirmed by its first bytes."""

from pathlib import Path
from types import ModuleType

from ..recordings import Recording
from . import csv, imu_tk, parquet
from .columns import AS_FOUND, CANONICAL, ColumnMap, Layout


FORMATS: tuple[ModuleType, ...] = (csv, parquet, imu_tk)

_HDF5 = b"\x89HDF\r\n\x1a\n"


def read_recordings(
    path: Path,
    columns: ColumnMap = CANONICAL,
    layout: Layout = AS_FOUND,
    *,
    name: str | None = None,
) -> tuple[Recording, ...]:
    """Recordings in one file of any known format; several where a column `device` tells devices apart.

    **Arguments:** `name` is a format of `FORMATS`, where suffix and content do not tell.
    Raises `ValueError` in one line for anything missing or wrong in the file.
    """
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise ValueError(f"{path}: {what}; a recording file is needed.")
    chosen = detect(path) if name is None else by_name(name)
    return chosen.read(path, columns, layout)


def by_name(name: str) -> ModuleType:
    """The format of that name."""
    for module in FORMATS:
        if module.NAME == name:
            return module
    raise ValueError(f"format '{name}' is not known; one of {', '.join(m.NAME for m in FORMATS)}.")


def detect(path: Path) -> ModuleType:
    """The format of a file. Raises `ValueError` where suffix and content contradict each other."""
    with path.open("rb") as file:
        head = file.read(4096)
    _refuse_matlab(path, head)
    is_parquet = head.startswith(parquet.MAGIC)
    for module in FORMATS:
        if path.suffix.lower() in module.SUFFIXES:
            if is_parquet != (module is parquet) and head.strip():
                raise ValueError(_contradiction(path, is_parquet))
            return module
    if is_parquet:
        return parquet
    if head.strip() and b"\0" not in head:
        return csv
    known = ", ".join(s for m in FORMATS for s in m.SUFFIXES)
    raise ValueError(
        f"{path.name}: suffix '{path.suffix}' is not known and the content is "
        f"{'binary' if head else 'empty'}; one of {known} is needed."
    )


def _contradiction(path: Path, is_parquet: bool) -> str:
    if is_parquet:
        return (
            f"{path.name}: the content is Parquet but the suffix is '{path.suffix}'; rename it to "
            '.parquet or write [recordings] format = "parquet".'
        )
    return f"{path.name}: not a Parquet file: it does not begin with PAR1."


def _refuse_matlab(path: Path, head: bytes) -> None:
    if _HDF5 in head[:520] or head.startswith(b"MATLAB 7.3"):
        what = "an HDF5 file (MATLAB v7.3 is one too)"
    elif head.startswith(b"MATLAB 5.0"):
        what = "a MATLAB v5 file"
    else:
        return
    raise ValueError(
        f"{path.name}: {what}, which is not read yet; save the columns as CSV or Parquet "
        "(in MATLAB: writetable or parquetwrite)."
    )
