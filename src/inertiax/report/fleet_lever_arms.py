"""Lever arms on the pages of a fleet: of one device, and over the line."""

from pathlib import Path

import numpy as np
import polars as pl

from ..calibration.quantities import with_sigma
from ..fleet.lever_arms import COLUMNS
from ..fleet.store import each_part, Manifest, matrix_of
from .page import Section, Table


_TITLE = "Lever arms"
_MM = 1e3
_WHERE = "Where each accelerometer is, from the point about which the table turns"
_HELD = " 0: no plateau shows it; held at zero, as uncertain as the others are long."


def device_lever_arms(row: dict) -> list[Section]:
    """A device's table, from its row of the results' table; empty where none were estimated."""
    if row.get("accel_lever_arms") is None:
        return []
    arms = np.reshape(row["accel_lever_arms"], (3, 3))
    sigmas = np.reshape(row["accel_lever_arms_sigma"], (3, 3))
    rows = tuple(
        (f"{'xyz'[k]} along {'xyz'[j]}", *with_sigma(_MM * arms[k, j], _MM * sigmas[k, j]))
        for k in range(3)
        for j in range(3)
    )
    head = ("accelerometer", "mm", "± 1 sigma")
    caption = f"{_WHERE}.{_HELD if np.any(arms == 0.0) else ''}"
    return [Section(_TITLE, tables=(Table(head, rows, numeric=(1, 2), caption=caption),))]


def line_lever_arms(folder: Path, manifest: Manifest) -> list[Section]:
    """The line's table; empty where none were estimated."""
    if manifest.model is None or not manifest.model.lever_arms:
        return []
    kept = pl.concat(each_part(folder, list(COLUMNS))).drop_nulls("accel_lever_arms")
    if not kept.height:
        return []
    arms = _MM * matrix_of(kept.get_column("accel_lever_arms"))
    sigmas = _MM * np.median(matrix_of(kept.get_column("accel_lever_arms_sigma")), axis=0)
    rows = []
    for n, own in enumerate(sigmas.tolist()):
        values = (np.median(arms[:, n]), arms[:, n].min(), arms[:, n].max())
        shown = (with_sigma(float(v), own)[0] for v in values)
        name = f"{'xyz'[n // 3]} along {'xyz'[n % 3]}"
        rows.append((name, *shown, with_sigma(0.0, own)[1]))
    head = ("accelerometer", "median, mm", "least", "greatest", "own 1 sigma")
    caption = f"{_WHERE}, over {kept.height} devices; own: of one device, median."
    caption += _HELD if np.any(arms == 0.0) else ""
    return [
        Section(_TITLE, tables=(Table(head, tuple(rows), numeric=(1, 2, 3, 4), caption=caption),))
    ]
