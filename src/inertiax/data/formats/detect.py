"""Which format a file is in: by its first bytes, else by its suffix."""

import re
from pathlib import Path
from types import ModuleType

from ..recording import Recording
from . import csv, dataflash, euroc, hdf5, imu_tk, imucal, json_cure, matlab, parquet, ros, ulog
from .columns import AS_FOUND, CANONICAL, ColumnMap, Layout
from .temperature_at_stamps import with_temperatures


FORMATS: tuple[ModuleType, ...] = (
    csv,
    parquet,
    imu_tk,
    euroc,
    imucal,
    hdf5,
    matlab,
    ulog,
    dataflash,
    ros,
)

_SPECIAL_KEYS = (
    *("group", "topic", "temperature_topic", "instance", "sections", "turn_angle"),
    "header_line",
)
# First bytes that leave no doubt, with the format's name in words.
_MAGIC: tuple[tuple[bytes, ModuleType, str], ...] = (
    (parquet.MAGIC, parquet, "Parquet"),
    (hdf5.MAGIC, hdf5, "HDF5"),
    (b"MATLAB 5.0", matlab, "a MATLAB file"),
    (b"MATLAB 7.3", matlab, "a MATLAB file"),
    (ulog.MAGIC, ulog, "a ULog"),
    (dataflash.MAGIC, dataflash, "a dataflash log"),
    *((magic, ros, "a bag") for magic in ros.MAGICS),
)


def read_recordings(
    path: Path,
    columns: ColumnMap = CANONICAL,
    layout: Layout = AS_FOUND,
    *,
    name: str | None = None,
) -> tuple[Recording, ...]:
    """Recordings in one file of any known format; several where the file tells devices apart.

    **Arguments:** `name` is a format of `FORMATS`, where suffix and content do not tell.
    Raises `ValueError` in one line for anything missing or wrong in the file.
    """
    if not is_recording(path):
        what = "is a folder" if path.is_dir() else "does not exist"
        raise ValueError(f"{path}: {what}; a recording file is needed.")
    chosen = format_of(path, layout) if name is None else by_name(name)
    if path.is_dir() and chosen not in (euroc, ros):
        raise ValueError(f"{path}: is a folder; format {chosen.NAME} needs a file.")
    for key in special_keys(chosen, layout):
        known = ", ".join(m.NAME for m in FORMATS if key in m.KEYS)
        raise ValueError(
            f"{path.name}: [recordings] {key} is for {known}, but this file is {chosen.NAME}."
        )
    found = chosen.read(path, columns.of_files(layout), layout)
    return tuple(with_temperatures(r, layout.temperature_log) for r in found)


def special_keys(chosen: ModuleType, layout: Layout) -> tuple[str, ...]:
    """Keys of the layout that are said, and are another format's."""
    said = [key for key in _SPECIAL_KEYS if getattr(layout, key) is not None]
    return tuple(key for key in said if key not in chosen.KEYS)


def is_recording(path: Path) -> bool:
    """Whether a path can be read: any file, or a folder that is a bag or of EuRoC's layout."""
    return path.is_file() or (path.is_dir() and (ros.is_bag(path) or _is_euroc(path)))


def _is_euroc(folder: Path) -> bool:
    return euroc.data_file(folder) is not None


def format_of(path: Path, layout: Layout = AS_FOUND) -> ModuleType:
    """The format that a file, or a folder that `is_recording`, is read in. Raises as `detect` does."""
    if path.is_dir():
        return ros if ros.is_bag(path) else euroc
    if layout.sections is not None:
        return imucal
    chosen = detect(path)
    if chosen is csv:
        with path.open("rb") as file:
            if euroc.is_euroc(file.read(512)):
                return euroc
    return chosen


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
    if head.startswith(_POINTER):
        raise ValueError(
            f"{path.name}: it is a pointer of Git LFS to the file, not the file; run `git lfs pull` in its repository."
        )
    if _JSON.match(head):
        lines = re.search(rb"\}\s*\n\s*\{", head) is not None
        raise ValueError(f"{path.name}: it is JSON; {json_cure.cure(path, lines=lines)}.")
    if head.startswith(_GENEACTIV):
        raise ValueError(
            f"{path.name}: it is GENEActiv's own format; write it as CSV (its PC software: Data Analysis, or R: "
            f"write.csv(GENEAread::read.bin('{path.name}')$data.out, 'log.csv')) and give that."
        )
    by_suffix = [m for m in FORMATS if path.suffix.lower() in m.SUFFIXES]
    for magic, module, words in _MAGIC:
        if head.startswith(magic):
            if by_suffix and module not in by_suffix:
                raise ValueError(_contradiction(path, by_suffix[0], module, words))
            return module
    if by_suffix:
        if by_suffix[0] is dataflash and _is_text(head):
            return csv
        # Parquet is told by its first bytes and no others.
        if by_suffix[0] is parquet and head.strip():
            raise ValueError(f"{path.name}: not a Parquet file: it does not begin with PAR1.")
        return by_suffix[0]
    cure = _CURES.get(path.suffix.lower())
    if cure is not None:
        raise ValueError(f"{path.name}: {cure}.")
    if _is_text(head):
        return csv
    if path.suffix.lower() in _SPREADSHEETS:
        raise ValueError(f"{path.name}: it is a spreadsheet; save its sheet as CSV and give that.")
    if head.startswith(_PACKED):
        raise ValueError(f"{path.name}: it is packed; unpack it first and give the file inside.")
    known = ", ".join(dict.fromkeys(s for m in FORMATS for s in m.SUFFIXES))
    raise ValueError(
        f"{path.name}: suffix '{path.suffix}' is not known and the content is "
        f"{'binary' if head else 'empty'}; one of {known} is needed."
    )


def _is_text(head: bytes) -> bool:
    """Whether first bytes are text, zeros before it aside (see `csv.text_of`)."""
    text = head.strip(b"\0")
    return bool(text.strip()) and not (_CONTROLS & set(text))


_JSON = re.compile(
    rb"(?:\xef\xbb\xbf)?\s*[\[{]\s*[\"\[{]"
)  # not the `[name]` of settings above a table
_POINTER = b"version https://git-lfs.github.com/spec/"
_GENEACTIV = b"Device Identity"  # the first line of its files
_SPREADSHEETS = (".xlsx", ".xlsm", ".xls", ".ods")
_PACKED = (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ", b"7z\xbc\xaf", b"\x28\xb5\x2f\xfd")
# Of binary files that other programs write as text.
_CURES = {
    ".npy": "it is a NumPy array; write its columns as text: numpy.savetxt('log.csv', array, delimiter=',')",
    ".npz": "it holds NumPy arrays; write the columns as text: numpy.savetxt('log.csv', columns, delimiter=',')",
    ".cwa": "it is Axivity's own format; export it as CSV (OmGui: Export, Raw CSV) and give that",
    ".gt3x": "it is ActiGraph's own format; export it as CSV (ActiLife: Raw), or with the package pygt3x: "
    "python -c \"from pygt3x.reader import FileReader; FileReader('log.gt3x').__enter__().to_pandas()"
    ".to_csv('log.csv')\"",
    ".tdms": 'it is a TDMS file; write its channels as text: python -c "import nptdms; '
    "nptdms.TdmsFile.read('log.tdms').as_dataframe().to_csv('log.csv')\"",
    ".mf4": 'it is an MDF file; write its channels as text: python -c "import asammdf; '
    "asammdf.MDF('log.mf4').to_dataframe().to_csv('log.csv')\"",
    ".feather": 'it is an Arrow file; write it as Parquet: python -c "import polars; '
    "polars.read_ipc('log.feather').write_parquet('log.parquet')\"",
    ".pkl": "it is a pickle, never opened here, for it can hold a program; write its table as CSV where it was made",
    ".tlog": "it is a telemetry log; give the vehicle's own log (.bin, .ulg), or write it as CSV (mavlogdump.py)",
}
_CONTROLS = frozenset(range(32)) - set(b"\t\n\r\f\x1b")


def _contradiction(path: Path, by_suffix: ModuleType, found: ModuleType, words: str) -> str:
    if by_suffix is parquet:
        return f"{path.name}: not a Parquet file: it does not begin with PAR1."
    suffix = found.SUFFIXES[0]
    return (
        f"{path.name}: the content is {words} but the suffix is '{path.suffix}'; rename it to "
        f'{suffix} or write [recordings] format = "{found.NAME}".'
    )
