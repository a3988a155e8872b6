"""A folder of campaigns as a fleet: each sub-folder with its own `campaign.toml`, in any readable format.

Every campaign is reduced as `inertiax calibrate` does it. A device is named after its sub-folder, and
`sub-folder/serial` where a campaign holds several; so no two have the same name. A campaign that cannot be
read is a device that is set aside.
"""

import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path

from ...data.campaign import CampaignTable, find_files, load_campaign, load_settings
from ...data.recorded import recorded
from ...data.recording import Campaign
from ...plausibility import require_plausible, statements
from ...reduction.dwell_means import reduce_to_dwells
from ...reduction.earth_at_rest import without_earth_rate
from .many_dwells import Reduced, Reduction
from .tasks import Stretch, Task


TOGETHER = 16  # campaigns of a task


def find_campaigns(folder: Path) -> tuple[Path, ...]:
    """`campaign.toml` of every sub-folder, in natural order (2 before 10)."""
    parts = lambda p: [(not t.isdigit(), t.zfill(20)) for t in re.split(r"(\d+)", p.parent.name)]
    return tuple(sorted(folder.glob("*/campaign.toml"), key=parts))


def common_settings(
    folder: Path, files: tuple[Path, ...]
) -> tuple[Campaign, dict[Path, tuple[Path, ...]]]:
    """Place and model of all campaigns of a folder, and by campaign.toml the recordings that it names.

    Raises `ValueError` where two campaigns have different gravity or ask for different models, naming them.
    """
    first: tuple[Path, Campaign] | None = None
    used: dict[Path, tuple[Path, ...]] = {}
    for file in files:
        used[file] = ()
        found = _settings(file)
        if found is None:
            continue
        campaign, table = found
        used[file] = tuple(_recordings(file, table))
        if first is None:
            first = file, campaign
        _check_same(first[0], first[1], file, campaign)
    if first is None:
        load_settings(files[0])  # raises with what is wrong
        raise ValueError(f"{folder}: none of {len(files)} campaign.toml can be read.")
    return dataclasses.replace(first[1], path=folder), used


def _settings(file: Path) -> tuple[Campaign, CampaignTable] | None:
    try:
        return load_settings(file)
    except ValueError:
        return None  # said of the device when its turn comes


def _recordings(file: Path, table: CampaignTable) -> Iterator[Path]:
    said = table.recordings
    further = (said.gyro_files, said.table_files, said.temperature_files)
    for patterns in (said.files, *(p or () for p in further)):
        try:
            yield from find_files(file.parent, patterns) if patterns else ()
        except ValueError:
            return


def _check_same(first: Path, one: Campaign, second: Path, other: Campaign) -> None:
    if one.site.gravity != other.site.gravity:
        raise ValueError(
            f"{second}: [site] gravity = {other.site.gravity:g}, but {first} has {one.site.gravity:g}; a fleet "
            "is calibrated at one place. Make a folder for each."
        )
    if one.model != other.model:
        raise ValueError(
            f"{second}: [model] is not that of {first}; a fleet has one model. Make the tables equal, or leave "
            "them out."
        )


def split_campaigns(files: tuple[Path, ...]) -> tuple[Task, ...]:
    """Tasks of a few campaigns; a device's stretch names its `campaign.toml`."""
    devices = [(f.parent.name, (Stretch(str(f), 0, 0),)) for f in files]
    starts = range(0, len(devices), TOGETHER)
    return tuple(
        Task(number, tuple(devices[start : start + TOGETHER]))
        for number, start in enumerate(starts)
    )


def campaigns_of(task: Task) -> Iterator[tuple[str, Campaign | str]]:
    """A task's devices, each with its campaign, or in words why that cannot be read."""
    for name, (stretch,) in task.devices:
        file = Path(stretch.file)
        try:
            campaign = load_campaign(file)
        except (ValueError, OSError) as error:
            yield name, _reason(error, file)
            continue
        several = len(campaign.devices) > 1
        for serial in campaign.devices:
            yield f"{name}/{serial}" if several else name, campaign.of_device(serial)


def read_campaigns(task: Task, *, force: bool = False) -> Reduction:
    """The dwells of a task's devices; with `force` those of data that cannot be right too."""
    return Reduction.of([_reduced(name, one, force) for name, one in campaigns_of(task)])


def _reduced(name: str, one: Campaign | str, force: bool) -> Reduced:
    if isinstance(one, str):
        return Reduced(name, None, one)
    try:
        warnings = statements(require_plausible(one, force=force))
        known = recorded(one.recordings, warnings)
        dwells = without_earth_rate(reduce_to_dwells(one.recordings), one)
        return Reduced(name, dwells, recorded=known)
    except ValueError as error:
        assert one.path is not None  # read from a file
        return Reduced(name, None, _reason(error, one.path))


def _reason(error: Exception, file: Path) -> str:
    text = " ".join(str(error).split())
    return text.removeprefix(f"{file}: ").rstrip(".")
