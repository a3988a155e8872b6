"""Which files a campaign is made of, with their SHA-256."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

import msgspec

from .campaign import find_files
from .formats import ros, ulog
from .formats.detect import format_of
from .settings import read_table


def imu_topic(campaign: Path | None) -> str | None:
    """The topic of the IMU in a campaign's ROS bags; `None` for other files, and where several are in them and none is
    said.

    Raises `ValueError` where a bag cannot be read.
    """
    if campaign is None:
        return None
    said = read_table(campaign).recordings
    files = find_files(campaign.parent, said.files)
    if said.format not in (None, ros.NAME) or any(format_of(f) is not ros for f in files):
        return None
    return said.topic or topic_of_bags(files)


def sensor_ids(campaign: Path | None, device: str) -> dict[str, int]:
    """PX4's numbers of a device's sensors, from a campaign's ULogs; none of other files, and where logs differ.

    Raises `ValueError` where a log cannot be read.
    """
    if campaign is None:
        return {}
    said = read_table(campaign).recordings
    files = find_files(campaign.parent, said.files)
    if not files or any(format_of(f) is not ulog for f in files):
        return {}
    found = []
    for file in files:
        by_imu = ulog.sensor_ids(file)
        alone = next(iter(by_imu.values())) if len(by_imu) == 1 else {}
        named = {f"imu{k}": ids for k, ids in by_imu.items()}
        asked = {} if said.instance is None else by_imu.get(said.instance, {})
        found.append(named.get(device) or asked or alone)
    return found[0] if all(ids == found[0] for ids in found) else {}


def topic_of_bags(files: Iterable[Path]) -> str | None:
    """The only topic of IMUs in ROS bags; `None` for other files and where there are several."""
    found: set[str] = set()
    for file in files:
        if format_of(file) is not ros:
            return None
        found |= set(ros.topics(file)[0])
    return next(iter(found)) if len(found) == 1 else None


class InputFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file that was read."""

    file: str  # relative to the campaign's folder where it lies in it
    sha256: str  # of its content, hexadecimal
    bytes: int  # of its content


def campaign_inputs(campaign: Path | None) -> tuple[InputFile, ...]:
    """The `campaign.toml` and every file that it names; none for a campaign that was made in memory.

    Raises `ValueError` for a file that cannot be read any more.
    """
    return () if campaign is None else hashed(campaign_files(campaign), campaign.parent)


def campaign_files(campaign: Path) -> tuple[Path, ...]:
    """A `campaign.toml` and the recordings that it names, files or folders.

    Raises `ValueError` where it cannot be read or names what is not there.
    """
    said = read_table(campaign).recordings
    named = find_files(campaign.parent, said.files)
    for key in ("gyro_files", "table_files", "temperature_files"):
        if getattr(said, key) is not None:
            named += find_files(campaign.parent, getattr(said, key), key)
    return campaign, *named


def hashed(paths: Iterable[Path], home: Path) -> tuple[InputFile, ...]:
    """Every file once, those of folders (a bag, an EuRoC sequence) too.

    Raises `ValueError` for a file that cannot be read.
    """
    files: dict[Path, None] = {}
    for path in paths:
        for file in sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]:
            files[file] = None
    return tuple(_hashed(file, home) for file in files)


def _hashed(file: Path, home: Path) -> InputFile:
    try:
        with file.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256")
            size = stream.tell()
    except OSError as error:
        raise ValueError(f"{file}: cannot be read ({error.strerror}).") from None
    name = file.relative_to(home).as_posix() if file.is_relative_to(home) else str(file)
    return InputFile(name, digest.hexdigest(), size)
