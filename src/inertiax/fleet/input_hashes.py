"""`inputs.json`: the files of a fleet run with their SHA-256, taken when the run begins.

By campaign: of a folder of campaigns each `campaign.toml` with the recordings that it names, of a line in Parquet files
the one `campaign.toml` with all of them. Files of other machines are not listed.
"""

import os
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec

from ..data.inputs import hashed, InputFile
from ..data.json_documents import decode, encode
from ..storage.whole_files import write_atomically


FILE, SCHEMA = "inputs.json", "inertiax.fleet-inputs/1"


class FleetInputs(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The document."""

    schema: str  # inertiax.fleet-inputs/1
    campaigns: dict[str, tuple[InputFile, ...]]  # by the path of the campaign.toml, itself first


Hashes = dict[str, tuple[InputFile, ...]]  # by the path of the campaign.toml, itself first


def write_inputs(hashes: Hashes, folder: Path) -> None:
    """Write `inputs.json`."""
    inputs = FleetInputs(SCHEMA, hashes)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / FILE
    write_atomically(file, encode(inputs, str(file), indent=1))


def changes_since(hashes: Hashes, folder: Path) -> tuple[str, ...] | None:
    """What differs from the files of the run in a folder by content, in words; `None` where the run kept no hashes."""
    known = read_inputs(folder)
    if known is None:
        return None
    before, now = (
        {(c, f.file): f.sha256 for c, own in campaigns.items() for f in own}
        for campaigns in (known.campaigns, hashes)
    )
    said = []
    for key in sorted({*before, *now}):
        if before.get(key) == now.get(key):
            continue
        what = "changed" if key in before and key in now else "new" if key in now else "gone"
        said.append(f"{Path(key[0]).parent.name}/{key[1]} ({what})")
    return tuple(said)


def same_files(hashes: Hashes, folder: Path, *, campaigns: bool) -> frozenset[str]:
    """Absolute paths of what has the content that it had in the run of a folder.

    With `campaigns` those of each `campaign.toml` all of whose files are the same ones; else those of the recordings
    beside one `campaign.toml` that is the same.
    """
    known = read_inputs(folder)
    before = {} if known is None else known.campaigns
    same: set[str] = set()
    for name, own in hashes.items():
        old = {f.file: f.sha256 for f in before.get(name, ())}
        new = {f.file: f.sha256 for f in own}
        toml = Path(name)
        if campaigns:
            same |= {name} if old and old == new else set()
        elif old.get(toml.name) == new.get(toml.name):
            alike = [f for f in new if f != toml.name and old.get(f) == new[f]]
            same |= {os.path.abspath(toml.parent / f) for f in alike}
    return frozenset(same)


def hashes_of(files: Mapping[Path, Iterable[Path]]) -> Hashes:
    """SHA-256 of every campaign's files, several at a time.

    **Arguments:** `files` are the recordings by their `campaign.toml`. What cannot be read is left out: its device is
    set aside with the reason.
    """
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        found = [
            (str(campaign.absolute()), pool.map(lambda f, c=campaign: _one(f, c.parent), (campaign, *own)))
            for campaign, own in files.items()
        ]  # fmt: skip
        return {name: tuple(f for several in own for f in several) for name, own in found}


def read_inputs(folder: Path) -> FleetInputs | None:
    """The hashes of a run, `None` where it was begun by a version that kept none.

    Raises `ValueError` where the file is damaged.
    """
    file = folder / FILE
    if not file.is_file():
        return None
    return decode(file.read_bytes(), FleetInputs, str(file), "a fleet's inputs", SCHEMA)


def _one(file: Path, home: Path) -> tuple[InputFile, ...]:
    try:
        return hashed([file], home)
    except ValueError:
        return ()
