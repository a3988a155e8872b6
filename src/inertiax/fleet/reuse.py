"""Results of an earlier run over other files that still hold: those of devices whose files and settings are the same.

A device keeps its rows where its recordings and its `campaign.toml` have the content that they had (SHA-256), its rows
lie where they lay, and the line's model and everything else that the manifest states came out the same. Devices that
were set aside are tried again.
"""

from pathlib import Path

import msgspec
import polars as pl

from .input_hashes import Hashes, same_files
from .reduce.tasks import Stretch, Task
from .rows import empty_table
from .store import Manifest, part_files, read_parts


_OF_THE_FILES = ("inputs", "tasks", "reasons", "kept")  # fields that other files may change


class Kept(msgspec.Struct, frozen=True):
    """A plan whose first task is done, with its rows."""

    manifest: Manifest
    rows: pl.DataFrame


def kept_results(before: Manifest, planned: Manifest, hashes: Hashes, folder: Path) -> Kept | None:
    """The plan with the devices that need no more work in its first task; `None` where there are none.

    **Arguments:** `before` is the run that `folder` holds, `planned` the one over the files with these `hashes`.
    """
    alike = all(
        getattr(before, f) == getattr(planned, f)
        for f in Manifest.__struct_fields__
        if f not in _OF_THE_FILES
    )
    if not alike or not list((folder / "parts").glob("part-*.parquet")):
        return None
    rows = read_parts(folder).collect()
    if rows.columns != [c for c in empty_table(planned).columns if c != "number"]:
        return None  # of another version
    same = same_files(hashes, folder, campaigns=planned.campaigns)
    old, devices = _stretches(before), _stretches(planned)
    # Of several devices in one campaign each row is named folder/serial.
    owner = pl.col("device")
    if planned.campaigns:
        owner = owner.str.split("/").list.first()
    rows = rows.with_columns(owner=owner)
    good = set(rows.group_by("owner").agg((pl.col("reason") == "").all()).filter("reason")["owner"])
    kept = [
        (name, own)
        for name, own in devices.items()
        if name in good and old.get(name) == own and all(s.file in same for s in own)
    ]
    if not kept:
        return None
    names = {name for name, _ in kept}
    rows = rows.filter(pl.col("owner").is_in(list(names))).drop("owner")
    left = [tuple(d for d in t.devices if d[0] not in names) for t in planned.tasks]
    todo = [own for own in left if own]
    tasks = (Task(0, tuple(kept)), *(Task(k, own) for k, own in enumerate(todo, start=1)))
    return Kept(msgspec.structs.replace(planned, tasks=tasks, kept=len(kept)), rows)


def take_away_parts(folder: Path) -> None:
    """Remove the parts of an earlier run."""
    for file in part_files(folder):
        file.unlink()


def _stretches(manifest: Manifest) -> dict[str, tuple[Stretch, ...]]:
    return {name: own for task in manifest.tasks for name, own in task.devices}
