"""The files of an app that logs each sensor into one of its own: which are the accelerometers' and the gyros'."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ..data.formats.detect import FORMATS
from .column_words import FILES, means, plain


_LEAST = ("uncal", "raw")  # beside the output that the system corrects, another of the same sensor


class SensorFiles(NamedTuple):
    """What of several files is one recording's."""

    accel: Path
    gyro: Path
    aside: tuple[Path, ...]  # other sensors' files

    @property
    def remark(self) -> str:
        """What is said of the files that are left aside; empty where none is."""
        names = ", ".join(f'"{p.name}"' for p in self.aside)
        return f"Not read, files of other sensors: {names}." if names else ""


def sensor_files(paths: Sequence[Path]) -> SensorFiles | None:
    """One file of accelerometers and one of gyros among files that are called after sensors, else `None`.

    Of several of accelerometers the one with gravity is taken (`TotalAcceleration` beside `Accelerometer`), and the
    corrected output beside `Uncalibrated`, which stands for one sensor twice.
    """
    kinds = {p: _kind(p) for p in paths}
    accels = _preferred([p for p in paths if kinds[p] == "accel"])
    gyros = _preferred([p for p in paths if kinds[p] == "gyro"])
    if len(accels) != 1 or len(gyros) != 1:
        return None
    aside = tuple(p for p in paths if p not in (*accels, *gyros))
    if any(kinds[p] is None and not _of_no_sensor(p) for p in aside):
        return None  # another recording, or a log that its name does not tell
    return SensorFiles(accels[0], gyros[0], aside)


def tables_in(folder: Path) -> list[Path]:
    """The files of a folder that may be recordings, by their names."""
    suffixes = {s for module in FORMATS for s in module.SUFFIXES}
    return sorted(p for p in folder.iterdir() if p.is_file() and p.suffix.lower() in suffixes)


def _kind(path: Path) -> str | None:
    name = plain(path.stem)
    found = [kind for kind, words in FILES.items() if words.search(name)]
    return found[0] if len(found) == 1 else None


def _preferred(paths: list[Path]) -> list[Path]:
    """The files that may stand for the sensor: with gravity, and corrected, where there is such a one."""
    whole = [p for p in paths if "total" in plain(p.stem)]
    if whole:
        return whole
    kept = [p for p in paths if not means("no_gravity", p.stem.replace("_", " "))]
    plainly = [p for p in kept if not any(w in plain(p.stem) for w in _LEAST)]
    return plainly or kept


def _of_no_sensor(path: Path) -> bool:
    """Whether a file is one of an app's others: of what it derives, of its place, and of itself."""
    return any(word in plain(path.stem) for word in _OTHERS)


_OTHERS = (
    "gravity", "orient", "rotation", "attitude", "location", "gps", "barom", "pressure", "light", "micro", "proxim",
    "pedom", "annot", "meta", "battery", "compass", "heart", "wrist", "activity", "humid",
)  # fmt: skip
