"""Motions between rests as rows: by how much gravity's direction is off after each.

Where gyros were calibrated by gravity's rotation, a motion gives two angles r, rad (`estimators.gravity_rotation`). An
addition e to the outputs while the device moves changes them by

    δr = Σₛ Rₛ e(tₛ),

with the response R of `GravityRotationOnHost`. The bias and D are as the rests tell them, a hundred times better than
motions of seconds could; the rows leave only Θ to be fitted beside an effect.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..._jax import eqx, jax
from ...calibrate.results import DeviceResult, TriadResult
from ...data.recording import Campaign
from ...estimators import GravityRotation
from ...estimators.host_forms.gravity_rotation import GravityRotationOnHost
from ...reduction.dwells import Dwells
from .blocks import Blocks, Log
from .model_rows import Baseline, calibrated, CalibratedTriad, errors_at


# Motions: four equations for each of the nine elements of Θ. With fewer their scatter is hardly known (convention).
FEWEST = 18


class MotionBlocks(Blocks):
    """Two rows for each motion, one behind the other; `dwell` numbers the motions."""

    response: tuple[Float[np.ndarray, "_ 2 3"], ...]  # rad per rad/s, by motion

    def felt(
        self, addition: Float[np.ndarray, "time channels column"]
    ) -> Float[np.ndarray, "block ..."]:
        """The change of each angle by an addition on each channel."""
        wide = np.broadcast_to(addition, (addition.shape[0], 3, *addition.shape[2:]))
        ranges = zip(self.start[::2], self.stop[::2], self.response, strict=True)
        parts = [np.einsum("skc,scq->kcq", r, wide[a:b]) for a, b, r in ranges]
        return np.concatenate(parts) if parts else np.zeros((0, *wide.shape[1:]))

    def __getitem__(self, rows: np.ndarray) -> "MotionBlocks":
        """Those rows; both of a motion, or none."""
        kept = np.arange(self.num_blocks)[rows]
        # All motions' responses have lengths of their own, and are no columns.
        bare = eqx.tree_at(lambda b: b.response, self, ())
        response = tuple(self.response[k // 2] for k in kept[::2])
        return eqx.tree_at(
            lambda b: b.response,
            jax.tree.map(lambda column: column[kept], bare),
            response,
            is_leaf=lambda x: isinstance(x, tuple),
        )


class MotionRows(NamedTuple):
    """The motions of a campaign as rows of one chain."""

    blocks: MotionBlocks
    base: Baseline
    scatter: float  # of a row beyond its own noise, as the calibration found it, rad
    rates: Float[np.ndarray, "time 3"]  # compensated, rad/s, one row per sample of the log


def motion_rows(campaign: Campaign, log: Log, fitted: DeviceResult) -> MotionRows | None:
    """Rows of the gyros' motions; `None` where they were not calibrated by these, or where motions are few."""
    gyro, model = fitted.gyro, calibrated(fitted, "gyro")
    if gyro is None or model is None or not isinstance(gyro.estimator, GravityRotation):
        return None
    start, stop = _ranges(campaign, log, gyro.dwells)
    seen = stop > start
    if seen.sum() < FEWEST:
        return None
    dwells, start, stop = gyro.dwells[seen], start[seen], stop[seen]
    form = GravityRotationOnHost(gyro.estimator)
    vectors = _vectors(gyro, dwells)
    now = form.linearise(vectors, dwells)
    response = tuple(r[: b - a] for r, a, b in zip(form.response(vectors, dwells), start, stop))
    blocks = _blocks(log, start, stop, now.sigma, response)
    rates = compensated_rates(model, log)
    return MotionRows(blocks, _base(model, blocks, rates, now.misfit), float(gyro.scatter), rates)


def few_motions(campaign: Campaign, log: Log, fitted: DeviceResult) -> str | None:
    """Why rates of a log that turns are not judged, in words; `None` where they are, or where a reference tells them.

    Rows of rests hold no rate but Earth's, whatever the log holds between them.
    """
    gyro = fitted.gyro
    if gyro is None or gyro.estimator.by_reference or log.gyro is None:
        return None
    if not isinstance(gyro.estimator, GravityRotation):
        return "the gyros are calibrated by their rests alone, which hold no rates but Earth's"
    start, stop = _ranges(campaign, log, gyro.dwells)
    number = int(np.sum(stop > start))
    if number >= FEWEST:
        return None
    return f"{number} motions between rests tell of rates, and {FEWEST} are asked for"


def rows_again(rows: MotionRows, model: CalibratedTriad, kept: np.ndarray) -> MotionRows:
    """Some of the rows, both of each motion."""
    blocks = rows.blocks[kept]
    observed = rows.base.observed[0][kept].reshape(-1, 2)
    return rows._replace(blocks=blocks, base=_base(model, blocks, rows.rates, observed))


def compensated_rates(model: CalibratedTriad, log: Log) -> Float[np.ndarray, "time 3"]:
    """What the gyros felt at every sample by equation (3), rad/s; without D, a thousandth of hand motion at most."""
    assert log.gyro is not None  # which is calibrated
    basis = model.form.basis(log.temperature, len(log.time))
    bias, matrix = errors_at(model.form, model.coefficients, basis)
    return np.linalg.solve(np.eye(3) + matrix, (log.gyro - bias)[:, :, None])[:, :, 0]


def _vectors(gyro: TriadResult, dwells: Dwells) -> Float[np.ndarray, "motion parameter"]:
    curve = gyro.solution.curve
    return curve.basis.rows(np.asarray(dwells.temperature)) @ np.asarray(curve.coefficients)


def _ranges(campaign: Campaign, log: Log, dwells: Dwells) -> tuple[np.ndarray, np.ndarray]:
    """First row of the log and one past the last of each motion; empty where the log has other rows there."""
    assert dwells.motion is not None and dwells.rows is not None
    assert log.gyro is not None
    order = np.argsort([float(r.time[0]) for r in campaign.recordings], kind="stable")
    sizes = np.array([r.num_samples for r in campaign.recordings])
    offset = np.empty(len(sizes), np.int64)
    offset[order] = np.cumsum(sizes[order]) - sizes[order]
    recording, after = np.asarray(dwells.rows)[:, :2].T
    steps = np.asarray(dwells.motion.step)
    # Shorter motions are padded with steps of no duration at the end.
    count = steps.shape[1] - np.argmax(steps[:, ::-1] > 0.0, axis=1)
    last = offset[recording] + after
    first = last - count
    gyro = np.asarray(dwells.motion.gyro)
    same = np.array(
        [
            a >= 0 and np.array_equal(log.gyro[[a, b]], g[[0, n]])
            for a, b, g, n in zip(first, last, gyro, count)
        ],
        bool,
    )
    return first, np.where(same, last + 1, first)


def _blocks(
    log: Log,
    start: np.ndarray,
    stop: np.ndarray,
    sigma: Float[np.ndarray, "motion 2"],
    response: tuple[np.ndarray, ...],
) -> MotionBlocks:
    """Rows with their circumstances; a third of the variance stands for each channel, whose sum is the row's."""
    twice = lambda x: np.repeat(x, 2)
    middle = (start + stop) // 2
    mean = lambda x: np.repeat([x[a:b].mean(axis=0) for a, b in zip(start, stop)], 2, axis=0)
    probe = log.temperature
    return MotionBlocks(
        start=twice(start),
        stop=twice(stop),
        dwell=twice(np.arange(len(start))),
        moving=np.ones(2 * len(start), bool),
        held=np.zeros(2 * len(start), bool),
        move=np.zeros(2 * len(start), bool),
        time=twice(log.time[middle]),
        experiment=twice(log.experiment[start]),
        position=twice(np.full(len(start), -1)),
        attitude=twice(np.arange(len(start))),
        cycle=twice(log.cycle[start]),
        temperature=None if probe is None else mean(probe),
        accel=None if log.accel is None else mean(log.accel),
        gyro=mean(log.gyro),
        reference_accel=None,
        reference_gyro=None,
        accel_white=None,
        gyro_white=np.repeat(np.square(sigma).reshape(-1, 1) / 3.0, 3, axis=1),
        response=response,
    )


def _base(
    model: CalibratedTriad,
    blocks: MotionBlocks,
    rates: Float[np.ndarray, "time 3"],
    tilt: Float[np.ndarray, "motion 2"],
) -> Baseline:
    """The angles beside what a change of each element of Θ makes of them."""
    form = model.form
    size = model.coefficients.shape[1]
    basis = form.basis(blocks.temperature, blocks.num_blocks)
    felt = blocks.felt(np.repeat(rates[:, None, :], 3, axis=1))  # (row, output, rate about axis)
    columns, index = [], []
    for place, (i, j) in enumerate(form.matrix, start=3):
        columns.append(felt[:, i, j, None] * basis)
        index.append(np.arange(place * size, (place + 1) * size))
    return Baseline(
        form,
        model.coefficients,
        (tilt.reshape(-1),),
        (np.concatenate(columns, axis=1),),
        (np.concatenate(index),),
        (np.ones((blocks.num_blocks, 3)),),
        blocks.mean(rates),
    )
