"""Parquet files wherever they are: paths, and addresses such as `s3://bucket/line/*.parquet`.

Polars reads object stores and web addresses itself; what it does not know is opened through fsspec and
held in memory while a task is read. Addresses need fsspec, which Dask brings along, to be listed.
"""

import functools
import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

import polars as pl

from ...data.campaign import find_files


_POLARS = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "adl", "http", "https", "hf", "file")


class Source(NamedTuple):
    """A file, and what changes when it is written to."""

    address: str
    state: str


def is_address(pattern: str) -> bool:
    """Whether a pattern of `[recordings] files` is an address rather than a path."""
    return "://" in pattern


def find_sources(folder: Path, patterns: Sequence[str]) -> tuple[Source, ...]:
    """All files of `[recordings] files`, each once; raises `ValueError` as `find_files` does."""
    found: dict[str, Source] = {}
    for pattern in patterns:
        path = _on_this_machine(pattern)
        for source in _remote(pattern) if path is None else _local(folder, path):
            found[source.address] = source
    if not patterns:
        find_files(folder, ())
    return tuple(found.values())


def _on_this_machine(pattern: str) -> str | None:
    """The path of a pattern, `None` where it is an address of another place; `file://…` is a path, and for its globs
    the rules of all paths hold."""
    protocol, _, rest = pattern.partition("://")
    if not is_address(pattern):
        return pattern
    if protocol.lower().rpartition("::")[2] not in ("file", "local"):
        return None
    return unquote(rest.removeprefix("localhost")) or "/"


def _local(folder: Path, pattern: str) -> list[Source]:
    return [Source(str(f), local_state(f)) for f in find_files(folder, (pattern,))]


def local_state(file: Path) -> str:
    """Name, size and time of change."""
    state = file.stat()
    return f"{file.name}\0{state.st_size}\0{state.st_mtime_ns}"


def _remote(pattern: str) -> list[Source]:
    try:
        import fsspec
    except ImportError:
        raise ValueError(
            f"[recordings] files: '{pattern}' is an address; listing it needs fsspec: install it with "
            "`pip install 'inertiax[fleet]'`."
        ) from None
    try:
        system, path = fsspec.core.url_to_fs(pattern)
        paths = sorted(system.glob(path))
        infos = [system.info(p) for p in paths]
    except (ImportError, OSError, ValueError, RuntimeError) as error:
        raise ValueError(
            f"[recordings] files: '{pattern}' cannot be listed: {' '.join(str(error).split())}."
        ) from None
    if not paths:
        raise ValueError(f"[recordings] files: '{pattern}' matches nothing.")
    addresses = [system.unstrip_protocol(p) for p in paths]
    return [Source(a, _remote_state(a, info)) for a, info in zip(addresses, infos, strict=True)]


def _remote_state(address: str, info: dict) -> str:
    # Stores name it differently; whichever there is changes with the content.
    marks = ("ETag", "etag", "LastModified", "last_modified", "mtime", "created", "md5Hash")
    known = [f"{m}={info[m]}" for m in marks if info.get(m) is not None]
    return f"{address}\0{info.get('size')}\0{' '.join(known)}"


def scan(address: str) -> pl.LazyFrame:
    """A Parquet file's columns, unread. Raises `ValueError` where it is not there or not Parquet."""
    try:
        protocol = address.partition("://")[0]
        if not is_address(address) or protocol in _POLARS:
            frame = pl.scan_parquet(address, hive_partitioning=False, glob=False)
        else:
            frame = _opened(address)
        frame.collect_schema()
    except (pl.exceptions.PolarsError, OSError, ImportError) as error:
        said = (str(error).splitlines() or [type(error).__name__])[0]
        raise ValueError(f"{address}: not a readable Parquet file: {said}.") from None
    return frame


@functools.lru_cache(maxsize=4)
def _opened(address: str) -> pl.LazyFrame:
    import fsspec

    with fsspec.open(address, "rb") as stream:
        return pl.scan_parquet(io.BytesIO(stream.read()))  # pyright: ignore[reportAttributeAccessIssue]
