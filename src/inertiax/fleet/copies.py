"""One recording under several serial numbers: none of these devices can be calibrated by it.

A rest's mean and scatter are those of another device's by chance never, to the last digit. Whose recording it is the
data do not tell, so all of them are set aside.
"""

import hashlib
from pathlib import Path

import numpy as np
import polars as pl

from ..reduction.dwells import Dwells
from .store import part_files, read_parts, write_table


MARK = "first_rest"  # column of the results' table
_BEGINS = "its samples are those of "
_NAMED = 3  # devices


def marks_of(dwells: Dwells) -> list[str | None]:
    """A mark of each device's first dwell, by means and variances of all triads; `None` where it has no scatter.

    **Arguments:** `dwells` leads with the devices.
    """
    parts: list[np.ndarray] = []
    noisy = np.zeros(len(np.asarray(dwells.valid)), bool)
    for triad in ("accel", "gyro"):
        mean, covariance = getattr(dwells, triad), getattr(dwells, f"{triad}_covariance")
        if mean is None or covariance is None:
            continue
        variance = np.diagonal(np.asarray(covariance)[:, 0], axis1=1, axis2=2)
        noisy |= np.all(variance > 0, axis=1)
        parts += [np.asarray(mean)[:, 0], variance]
    if not parts:
        return [None] * len(noisy)
    rows = np.ascontiguousarray(np.concatenate(parts, axis=1), np.float64)
    return [
        hashlib.blake2b(row.tobytes(), digest_size=16).hexdigest() if known else None
        for row, known in zip(rows, noisy.tolist(), strict=True)
    ]


def set_copies_aside(folder: Path) -> None:
    """Give all devices of a run that share their samples the reason, and take it from those that no longer do."""
    columns = read_parts(folder).collect_schema().names()
    if MARK not in columns:  # of a version that kept none
        return
    known = read_parts(folder).select("device", "reason", MARK).collect()
    twice = known.drop_nulls(MARK).filter(pl.col(MARK).is_duplicated())
    groups = twice.group_by(MARK, maintain_order=True).agg(pl.col("device")).get_column("device")
    said = {d: _reason([o for o in own if o != d]) for own in groups.to_list() for d in own}
    stale = known.filter(pl.col("reason").str.starts_with(_BEGINS)).get_column("device")
    if not said and not len(stale):
        return
    for file in part_files(folder):
        part = pl.read_parquet(file)
        reasons = [
            said.get(device, "") if reason == "" or reason.startswith(_BEGINS) else reason
            for device, reason in part.select("device", "reason").iter_rows()
        ]
        if reasons != part.get_column("reason").to_list():
            write_table(part.with_columns(pl.Series("reason", reasons)), file)


def _reason(others: list[str]) -> str:
    more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
    named = (", " if more else " and ").join(others[:_NAMED]) + more
    return (
        f"{_BEGINS}{named}, to the last digit: one recording was copied under several serial numbers, and which device "
        "it is of cannot be told"
    )
