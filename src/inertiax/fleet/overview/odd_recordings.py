"""Devices that were recorded unlike the others: fewer rests, or a channel that is noisier.

Neither moves a parameter, so that the distribution of parameters does not show it.
"""

from pathlib import Path

import msgspec
import numpy as np
import polars as pl
from jaxtyping import Bool, Float
from scipy.special import ndtri

from ..population.unit_covariance import CHANCE
from ..store import each_part, Manifest, part_files


FEWEST = 8  # devices
FEWER = 0.75  # of the usual number of dwells; dwells that are cut as the temperature moves differ by a tenth
LOUDER = 1.5  # times the usual noise, and beyond what chance and the spread of the line make of it


class OddRecording(msgspec.Struct, frozen=True):
    """A calibrated device with what is unusual in its recording, in words."""

    device: str
    words: str


def odd_recordings(folder: Path, manifest: Manifest) -> tuple[OddRecording, ...]:
    """The devices of a run that were recorded unlike the others; none of fewer than eight, or of a run of an older
    version, which keeps no noise."""
    kept = pl.read_parquet_schema(part_files(folder)[0])
    triads = [t for t in ("accel", "gyro") if getattr(manifest, t) and f"{t}_noise" in kept]
    table = pl.concat(each_part(folder, ["device", "dwells", *(f"{t}_noise" for t in triads)]))
    if not triads or table.height < FEWEST:
        return ()
    devices, dwells = table.get_column("device"), table.get_column("dwells").to_numpy()
    usual = float(np.median(dwells))
    few = dwells < FEWER * usual
    found = [
        OddRecording(devices[int(k)], f"{dwells[k]} rests and turns, {usual:.0f} are usual")
        for k in np.flatnonzero(few)
    ]
    for triad in triads:
        values = table.get_column(f"{triad}_noise").to_list()
        noise = np.array([[np.nan] * 3 if v is None else v for v in values], float)
        for k, c in np.argwhere(_louder(noise) & ~few[:, None]):
            times = noise[k, c] / np.nanmedian(noise[:, c])
            words = f"{triad}_{'xyz'[c]} has {times:.2g} times the usual noise at rest"
            found.append(OddRecording(devices[int(k)], words))
    return tuple(found)


def _louder(noise: Float[np.ndarray, "devices 3"]) -> Bool[np.ndarray, "devices 3"]:
    """Which channels of which devices are beyond 1.5 times the median and beyond the spread, at 1 % for any of them."""
    logs = np.log(np.where(noise > 0.0, noise, np.nan))
    away = logs - np.nanmedian(logs, axis=0)
    spread = 1.4826 * np.nanmedian(np.abs(away), axis=0)
    limit = -ndtri(CHANCE / (2 * noise.size))
    return (away > np.log(LOUDER)) & (away > limit * spread)
