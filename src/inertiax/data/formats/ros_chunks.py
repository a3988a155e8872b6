"""Packed parts of bags, unpacked no further than a recording packs: rosbags itself unpacks a bomb to its end."""

import bz2
import contextlib
import importlib
from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace
from typing import BinaryIO, Protocol

from .expansion import limit


class _Stream(Protocol):
    @property
    def eof(self) -> bool: ...

    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """While this lasts, rosbags' unpacking raises `ValueError` at a bomb."""
    lz4 = importlib.import_module("lz4.frame").LZ4FrameDecompressor
    one = importlib.import_module("rosbags.rosbag1.reader")
    mcap = importlib.import_module("rosbags.rosbag2.storage_mcap")
    two = importlib.import_module("rosbags.rosbag2.reader")
    zstd = mcap.zstd
    of_mcap = {"lz4": _sized(lz4), "zstd": _sized(zstd.ZstdDecompressor)}
    with (
        _entries(one.decompressors, {"bz2": _whole(bz2.BZ2Decompressor), "lz4": _whole(lz4)}),
        _entries(mcap.DECOMPRESSORS, of_mcap),
        _entries(vars(two), {"zstd": _files(zstd)}),
    ):
        yield


@contextlib.contextmanager
def _entries(table: dict, changed: dict) -> Iterator[None]:
    before = {k: table[k] for k in changed}
    table.update(changed)
    try:
        yield
    finally:
        table.update(before)


def _whole(stream: Callable[[], _Stream]) -> Callable[[bytes], bytes]:
    def unpack(data: bytes) -> bytes:
        opened = stream()
        unpacked = opened.decompress(data, max_length=limit(len(data)))
        if not opened.eof:
            raise ValueError(f"{len(data)} packed bytes are cut off, or hold more than a recording")
        return unpacked

    return unpack


def _sized(stream: Callable[[], _Stream]) -> Callable[[bytes, int], bytes]:
    unpack = _whole(stream)
    return lambda data, _: unpack(data)


def _files(zstd: ModuleType) -> SimpleNamespace:
    """What rosbags uses of zstd for messages and for files that are packed as a whole."""

    def open_file(file: BinaryIO, mode: str) -> "_Bounded":
        here = file.tell()
        size = file.seek(0, 2) - here
        file.seek(here)
        return _Bounded(zstd.open(file, mode), limit(size))

    return SimpleNamespace(decompress=_whole(zstd.ZstdDecompressor), open=open_file)


class _Bounded:
    def __init__(self, file: BinaryIO, most: int):
        self._file, self._left = file, most

    def read(self, count: int = -1) -> bytes:
        data = self._file.read(count)
        self._left -= len(data)
        if self._left < 0:
            raise ValueError("the packed file holds more than a recording")
        return data

    def __enter__(self) -> "_Bounded":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
