"""What a line's model leaves out: forms chosen before the run, scores gathered after it.

line.json      effects common to the line, and effects of single devices, by triad
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import jax
import msgspec
import numpy as np
import polars as pl

from ...data.json_documents import decode, encode
from ...storage.whole_files import write_atomically
from ..effects.population_effects import FEWEST, LineMismatch, read_line
from ..effects.score_statistics import choose_forms, FleetScores, Form, terms_of
from ..reduce.many_dwells import Reduced, Reduction
from ..reduce.tasks import Task
from ..rows import calibrate_reduced, estimators_of
from ..solve.triad_model import basis_of
from ..store import Manifest, matrix_of, read_parts


SCHEMA = "inertiax.fleet-line/1"
TRIALS = 8  # devices of one task: they give the overlaps of signatures, which the plan makes

Reader = Callable[[Task], Reduction]


class LineFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file's contents."""

    schema: str
    triads: tuple[LineMismatch, ...]


def choose_line_forms(manifest: Manifest, reader: Reader) -> dict[str, tuple[Form, ...]]:
    """By triad, the effects to score, from the first device that can be read."""
    for task in manifest.tasks:
        with jax.enable_x64(True):
            usable = [r.dwells for r in reader(_few(task)) if r.dwells is not None]
            if usable:
                one = jax.tree.map(lambda x: np.asarray(x)[None], usable[0])
                return {
                    estimator.triad: choose_forms(estimator, basis_of(model), one)
                    for estimator, model in estimators_of(manifest, one)
                }
    return {}


def _few(task: Task) -> Task:
    return Task(task.number, task.devices[: 4 * TRIALS])


def write_line(folder: Path, manifest: Manifest, reader: Reader) -> tuple[LineMismatch, ...]:
    """Read the scores of all devices of a run that is done, and store what they say as `line.json`.

    A triad of which fewer than eight devices were calibrated is left out.
    """
    overlaps = _overlaps(manifest, reader)
    found: list[LineMismatch] = []
    for triad, forms in (manifest.forms or {}).items():
        columns = [f"{triad}_amplitudes", f"{triad}_amplitude_sigmas"]
        table = read_parts(folder).filter(pl.col("reason") == "")
        table = table.select("device", *columns).drop_nulls().collect()
        if table.height < FEWEST or triad not in overlaps:
            continue
        amplitude, sigma = (matrix_of(table.get_column(c)) for c in columns)
        scores = FleetScores(terms_of(forms, triad), amplitude, sigma, overlaps[triad])
        found.append(read_line(triad, table.get_column("device").to_list(), scores))
    contents = LineFile(SCHEMA, tuple(found))
    file = folder / "line.json"
    write_atomically(file, encode(contents, str(file)))
    return contents.triads


def read_line_file(folder: Path) -> tuple[LineMismatch, ...] | None:
    """What `write_line` stored, `None` where it did not. Raises `ValueError` for a damaged file."""
    file = folder / "line.json"
    if not file.exists():
        return None
    return decode(file.read_bytes(), LineFile, str(file), "the effects of a line", SCHEMA).triads


def _overlaps(manifest: Manifest, reader: Reader) -> dict[str, np.ndarray]:
    """By triad, how much the signatures look alike, from the first devices that can be read."""
    found: dict[str, np.ndarray] = {}

    def keep(triad: str, scores: FleetScores) -> None:
        found.setdefault(triad, scores.overlap)

    for task in manifest.tasks:
        with jax.enable_x64(True):
            usable: Sequence[Reduced] = [r for r in reader(_few(task)) if r.dwells is not None]
            if usable:
                calibrate_reduced(Reduction.of(usable[:TRIALS]), manifest, observe=keep)
        if found:
            break
    return found
