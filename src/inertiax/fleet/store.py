"""The output folder of a fleet run: parts written once each, beside a manifest, so that nothing is lost.

    manifest.json                 what is calibrated, how, and how it is split into tasks
    parts/part-000017.parquet     one row for each device of task 17, good ones and those set aside

A part is written beside and renamed, so it is there whole or not at all; a task is done when its part is
there. A run that was killed is started again with the same command and does the tasks that are left.
"""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
import polars as pl
from jaxtyping import Float

from ..data.json_documents import decode, encode
from ..data.recording import HALF, Rig
from ..model_selection.model_spec import ModelSpec
from ..storage.whole_files import write_atomically, written_beside
from .effects.score_statistics import Form
from .population.population import Population
from .reduce.tasks import Task
from .solve.triad_model import TriadModel as TriadModel


SCHEMA = "inertiax.fleet/1"
_AT_ONCE = 2**20  # bytes of parts read together: each call takes a millisecond


class Manifest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The plan of a run."""

    schema: str
    inputs: str  # fingerprint of the files' names, sizes and times of change
    gravity: float
    accel: TriadModel | None
    gyro: TriadModel | None
    g_sensitivity: bool
    reasons: tuple[str, ...]
    tasks: tuple[Task, ...]
    prior: Population | None = None  # with which every device was calibrated
    campaigns: bool = False  # a stretch names a campaign.toml, not rows of a Parquet file
    # By triad, effects whose size is scored in every device; `None` where that was not asked for.
    forms: dict[str, tuple[Form, ...]] | None = None
    precision: Literal["float64", "float32"] = (
        "float64"  # of the invariant accelerometer problem's arithmetic
    )

    model: ModelSpec | None = None  # as other commands describe it
    # What the station promises, 1 sigma: rad of each positioning, part of the rate, °C, rad of level and of axes.
    rig: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    axes: tuple[tuple[float, ...], tuple[float, ...]] | None = None  # as `Rig` has them
    outer_part: float = HALF

    exact: bool = False  # every device was reduced as `calibrate` does, not by sums over blocks
    one_by_one: bool = False  # and calibrated as it does, for want of a program that takes many
    # Rows hold what a protocol states beside the estimates: what was recorded, warnings, covariances by source.
    documented: bool = False
    # Rows of devices calibrated one by one hold what was chosen of each, and all its reservations.
    own_words: bool = False
    magnetometers: bool = False  # were recorded, and are not calibrated here
    latitude: float | None = None  # rad, where the campaign states it
    force: bool = False  # what cannot be right is calibrated all the same
    kept: int = (
        0  # devices of the first task whose results are those of an earlier run over other files
    )

    @property
    def station(self) -> Rig:
        """What the station promises."""
        return Rig(*self.rig, axes=self.axes, outer_part=self.outer_part)


def fingerprint(states: Iterable[str]) -> str:
    """Changes when a file is added, taken away, or written to; see `locations` for the states."""
    digest = hashlib.sha256()
    for state in states:
        digest.update(f"{state}\n".encode())
    return digest.hexdigest()


def write_manifest(manifest: Manifest, folder: Path) -> None:
    """Begin a run in a folder."""
    (folder / "parts").mkdir(parents=True, exist_ok=True)
    file = folder / "manifest.json"
    write_atomically(file, encode(manifest, str(file)))


def read_manifest(folder: Path) -> Manifest | None:
    """The plan of the run that a folder holds, `None` where it holds none.

    Raises `ValueError` where the file is damaged or of another version.
    """
    file = folder / "manifest.json"
    if not file.exists():
        return None
    return decode(file.read_bytes(), Manifest, str(file), "a fleet's manifest", SCHEMA)


def part_file(folder: Path, task: int) -> Path:
    """Where a task's devices are stored."""
    return folder / "parts" / f"part-{task:06d}.parquet"


def is_done(folder: Path, task: int) -> bool:
    """Whether a task's part is there."""
    return part_file(folder, task).exists()


def write_part(folder: Path, task: int, table: pl.DataFrame) -> None:
    """Store a task's devices, whole or not at all."""
    write_table(table, part_file(folder, task))


def write_table(table: pl.DataFrame, file: Path) -> None:
    """Write a Parquet file beside its place and rename it."""
    with written_beside(file) as beside:
        table.write_parquet(beside)


def read_parts(folder: Path | str) -> pl.LazyFrame:
    """All devices stored so far. Raises `ValueError` where there is no run or nothing is done."""
    return pl.scan_parquet(part_files(Path(folder)))


def each_part(folder: Path, columns: Sequence[str]) -> Iterator[pl.DataFrame]:
    """Part by part, small ones together, the devices that were not set aside; raises as `read_parts` does."""
    for files in _lots(part_files(folder)):
        yield pl.scan_parquet(files).filter(pl.col("reason") == "").select(columns).collect()


def _lots(files: Iterable[Path]) -> Iterator[list[Path]]:
    """Files that follow one another, as many as are small together."""
    lot: list[Path] = []
    size = 0
    for file in files:
        own = file.stat().st_size
        if lot and size + own > _AT_ONCE:
            yield lot
            lot, size = [], 0
        lot.append(file)
        size += own
    if lot:
        yield lot


def part_files(folder: Path) -> list[Path]:
    """The parts stored so far, in the order of their tasks; raises as `read_parts` does."""
    if not (folder / "manifest.json").exists():
        raise ValueError(f"{folder}: no manifest.json; it is not the output of a fleet run.")
    files = sorted((folder / "parts").glob("part-*.parquet"))
    if not files:
        raise ValueError(f"{folder}: no part is done yet.")
    return files


def matrix_of(column: pl.Series) -> Float[np.ndarray, "rows width"]:
    """A column of lists of one length as a matrix."""
    return column.explode().to_numpy().reshape(len(column), -1)
