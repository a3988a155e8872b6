"""Magnetometers that a line's devices recorded: a fleet calibrates none, and says so."""

from collections.abc import Sequence

import polars as pl

from ..calibrate.magnetometers_of_device import has_magnetometers
from ..data.formats import ColumnMap
from ..data.recording import Campaign, NOT_CALIBRATED
from .reduce.campaign_folders import campaigns_of
from .reduce.columns import triad_names
from .reduce.locations import is_address
from .reduce.tasks import Task


LEFT_OUT = (
    "Magnetometers are not calibrated by `fleet`: `inertiax calibrate` does it, device by device."
)


def in_campaigns(tasks: Sequence[Task]) -> bool:
    """Whether the first of a folder's campaigns that can be read recorded magnetometers that are to be calibrated.

    Raises `ValueError` where these are all that it recorded.
    """
    devices = (one for task in tasks for _, one in campaigns_of(task))
    first = next((one for one in devices if isinstance(one, Campaign)), None)
    if first is None or not has_magnetometers(first):
        return False
    if all(r.accel is None and r.gyro is None for r in first.recordings):
        raise ValueError(
            f"{first.path}: magnetometers alone, and `fleet` calibrates accelerometers and gyros; use "
            "'inertiax calibrate' for each device."
        )
    return True


def in_tables(campaign: Campaign, tasks: Sequence[Task], columns: ColumnMap) -> bool:
    """The same of Parquet files of many devices, by their columns; of files elsewhere, by what `[columns]` says."""
    if campaign.model.mag_estimator == NOT_CALIBRATED:
        return False
    file = next((s.file for task in tasks for _, stretches in task.devices for s in stretches), "")
    if columns.mag is not None or not file or is_address(file):
        return columns.mag is not None
    return set(triad_names(None, "mag")) <= set(pl.read_parquet_schema(file))
