"""Devices that were recorded unlike the others: fewer rests, or a channel that is noisier.

Neither moves a parameter, so that the distribution of parameters does not show it. The noise of a channel is what the
noise within dwells leaves in its bias, times the root of the number of dwells; devices of one plan have it alike.
"""

from pathlib import Path

import msgspec
import numpy as np
import polars as pl
from jaxtyping import Bool, Float
from scipy.special import ndtri

from ..population.unit_covariance import CHANCE
from ..store import each_part, Manifest


FEWEST = 8  # devices
FEWER = 0.75  # of the usual number of dwells; dwells that are cut as the temperature moves differ by a tenth
LOUDER = 1.5  # times the usual noise, and beyond what chance and the spread of the line make of it
SOURCE = "dwell noise"


class OddRecording(msgspec.Struct, frozen=True):
    """A calibrated device with what is unusual in its recording, in words."""

    device: str
    words: str


def odd_recordings(folder: Path, manifest: Manifest) -> tuple[OddRecording, ...]:
    """The devices of a run that were recorded unlike the others; none of fewer than eight, or of a run of many rows,
    which keeps no covariance by source."""
    triads = [t for t in ("accel", "gyro") if getattr(manifest, t) is not None]
    columns = [f"{t}_{k}" for t in triads for k in ("sources", "source_covariances")]
    if not manifest.documented or not triads:
        return ()
    table = pl.concat(each_part(folder, ["device", "dwells", *columns]))
    if table.height < FEWEST:
        return ()
    devices, dwells = table.get_column("device"), table.get_column("dwells").to_numpy()
    usual = float(np.median(dwells))
    few = dwells < FEWER * usual
    found = [
        OddRecording(devices[int(k)], f"{dwells[k]} rests and turns, {usual:.0f} are usual")
        for k in np.flatnonzero(few)
    ]
    for triad in triads:
        unknowns = getattr(manifest, triad).unknowns
        sources = (
            table.get_column(f"{triad}_sources"),
            table.get_column(f"{triad}_source_covariances"),
        )
        noise = np.array([_of_biases(*row, unknowns) for row in zip(*sources, strict=True)])
        noise *= np.sqrt(dwells)[:, None]
        for k, c in np.argwhere(_louder(noise) & ~few[:, None]):
            times = noise[k, c] / np.nanmedian(noise[:, c])
            words = f"noise makes the bias of {triad}_{'xyz'[c]} {times:.2g} times as uncertain as usual"
            found.append(OddRecording(devices[int(k)], words))
    return tuple(found)


def _of_biases(sources: pl.Series | None, lower: pl.Series | None, unknowns: int) -> list[float]:
    """Standard deviations by the noise within dwells of the biases' first coefficients."""
    size = unknowns * (unknowns + 1) // 2
    if sources is None or lower is None or SOURCE not in (names := sources.to_list()):
        return [np.nan] * 3
    mine = lower.to_numpy()[names.index(SOURCE) * size :]
    return [float(np.sqrt(mine[k * (k + 1) // 2 + k])) for k in range(3)]


def _louder(noise: Float[np.ndarray, "devices 3"]) -> Bool[np.ndarray, "devices 3"]:
    """Which channels of which devices are beyond 1.5 times the median and beyond the spread, at 1 % for any of them."""
    logs = np.log(np.where(noise > 0.0, noise, np.nan))
    away = logs - np.nanmedian(logs, axis=0)
    spread = 1.4826 * np.nanmedian(np.abs(away), axis=0)
    limit = -ndtri(CHANCE / (2 * noise.size))
    return (away > np.log(LOUDER)) & (away > limit * spread)
