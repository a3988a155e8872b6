"""A stretch of a campaign kept from the diagnosis, then predicted by what the rest has taught.

Neither the fit nor the choice of effects sees an output of the stretch. Its times and temperatures do
enter, because an effect with memory (lag, hysteresis) carries its state from the rest into the stretch.
"""

from collections.abc import Sequence

import numpy as np

from .._jax import eqx, jax
from ..calibrate.pipeline import calibrate_device
from ..data.recording import Campaign
from ..data.recording_order import in_order
from ..effects import CATALOGUE, Effect
from .candidates.signatures import block_shapes, coarsen, in_other_form, Term
from .estimates.cross_validation import effect_columns, predict_rest
from .estimates.tuned_names import tuned
from .findings import find, find_all, Finding, Progress, silent
from .observations.blocks import Blocks, cut, join, Log
from .observations.model_rows import Baseline, calibrated, CalibratedTriad, rows, spanning, usable
from .observations.signals import specific_force
from .pipeline import conclude_findings
from .problem import prepare, prepare_triad, Prepared
from .result import Diagnosis


class Prediction(eqx.Module):
    """How well one channel's rows of the stretch are predicted, and by what."""

    channel: str = eqx.field(static=True)  # or `|accel|` for the invariant model
    effects: tuple[str, ...] = eqx.field(static=True)
    baseline_rms: float = eqx.field(static=True)  # m/s² or rad/s, the model alone
    augmented_rms: float = eqx.field(static=True)  # with the effects that the rest named


def hold_out(
    campaign: Campaign,
    *,
    start: float,
    end: float = np.inf,
    effects: Sequence[Effect] = CATALOGUE,
    progress: Progress = silent,
) -> tuple[Diagnosis, tuple[Prediction, ...]]:
    """Diagnose a campaign without the stretch from `start` to `end`, then predict the stretch.

    **Arguments:** `start`, `end` in s on the clock of the recordings (of all recordings that have that time).
    **Returns** the diagnosis of the rest, and one `Prediction` for each chain of rows. Coefficients come
    from least squares on the rest with the white noise as weight. Raises `ValueError` where the stretch
    or the rest holds no rows.
    """
    with jax.enable_x64(True):
        log = join(campaign)
        blocks = cut(log)
        middle = log.clock[(blocks.start + blocks.stop) // 2]
        inside = (middle >= start) & (middle <= end)
        if not inside.any() or inside.all():
            raise ValueError(
                f"`hold_out(start={start:g}, end={end:g})`: {int(inside.sum())} of {len(inside)} blocks lie "
                f"inside; the recordings span {log.clock.min():g} s to {log.clock.max():g} s, and both the "
                "stretch and the rest need rows."
            )
        fitted = calibrate_device(_without(campaign, log, blocks, inside), checked=True)
        accel = calibrated(fitted, "accel")
        force = specific_force(log, blocks, accel)
        findings, predictions = [], []
        for triad in ("accel", "gyro"):
            model = calibrated(fitted, triad)
            if model is None:
                continue
            model = spanning(model, blocks)
            fits = usable(model.form, blocks)
            rest, left = blocks[~inside & fits], blocks[inside & fits]
            base = rows(model, rest, None if force is None else rest.mean(force))
            prepared = prepare_triad(campaign, log, rest, base, force, effects)
            hint = findings[-1].answer.remembered if findings else None
            finding = find(prepared, campaign.grade, progress, hint)
            findings.append(finding)
            about, named = tuned(prepared, finding.answer, finding.answer.noise)
            terms = [t for _, t, _ in named]
            predictions.extend(_predict(about, model, terms, log, left, force))
        return conclude_findings(findings, effects, progress)[0], tuple(predictions)


def _without(campaign: Campaign, log: Log, blocks: Blocks, inside: np.ndarray) -> Campaign:
    """The campaign without the rows from the stretch's first block to its last, recording by recording."""
    kept = np.ones(len(log.time), bool)
    for number in np.unique(log.recording[blocks.start[inside]]):
        mine = np.flatnonzero(inside & (log.recording[blocks.start] == number))
        kept[blocks.start[mine[0]] : blocks.stop[mine[-1]]] = False
    recordings = []
    for number, recording in enumerate(in_order(campaign.recordings)):
        own = kept[log.recording == number]
        edges = np.flatnonzero(np.diff(np.r_[0, own.astype(int), 0]))
        recordings += [recording[a:b] for a, b in zip(edges[::2], edges[1::2])]
    return eqx.tree_at(lambda c: c.recordings, campaign, tuple(recordings))


def leave_positions_out(
    campaign: Campaign,
    *,
    effects: Sequence[Effect] = CATALOGUE,
    progress: Progress = silent,
) -> tuple[Diagnosis, tuple[Prediction, ...]]:
    """Diagnose a campaign, then predict each position's mean from the other positions.

    The effects are chosen on all rests; the coefficients of model and effects are refitted without the position
    that they predict, and one that the other positions do not tell predicts nothing (`cross_validation.predict_rest`).
    **Returns** the diagnosis and one `Prediction` per chain: rms over positions, SI.
    """
    with jax.enable_x64(True):
        triads = prepare(campaign, effects).triads
        findings = find_all(triads, campaign.grade, progress)
        predictions = [p for f in findings for p in _positions_out(f)]
        return conclude_findings(findings, effects, progress)[0], tuple(predictions)


def _positions_out(finding: Finding) -> list[Prediction]:
    prepared = finding.prepared
    _, named = tuned(prepared, finding.answer, finding.answer.noise)
    chosen = [t for _, t, _ in named]
    base, position = prepared.system.base, prepared.blocks.position
    made = []
    for c, chain in enumerate(prepared.system.chains):
        mine = [t for t in chosen if c in t.chains]
        rms = []
        for some in ([], mine):
            y, effects = base.observed[c], effect_columns(some, c, len(base.observed[c]))
            misses = []
            for number in np.unique(position[position >= 0]):
                out = position == number
                said = predict_rest(base.columns[c], effects, y, chain.white, ~out)
                misses.append(np.mean(y[out] - said))
            rms.append(float(np.sqrt(np.mean(np.square(misses)))))
        made.append(Prediction(_label(base, c), tuple(t.name for t in mine), rms[0], rms[1]))
    return made


def _solve(x: np.ndarray, y: np.ndarray, variance: np.ndarray) -> np.ndarray:
    weight = 1.0 / np.sqrt(variance)
    norm = np.linalg.norm(x, axis=0) + 1e-300
    return np.linalg.lstsq(x / norm * weight[:, None], y * weight, rcond=1e-9)[0] / norm


def _label(base: Baseline, chain: int) -> str:
    return f"{base.form.triad}_{'xyz'[chain]}" if len(base.observed) == 3 else "|accel|"


def _predict(
    prepared: Prepared,
    model: CalibratedTriad,
    chosen: Sequence[Term],
    log: Log,
    left: Blocks,
    force: np.ndarray | None,
) -> list[Prediction]:
    base = prepared.system.base
    other = rows(model, left, None if force is None else left.mean(force))
    coarse = coarsen(prepared.signal, left)
    made = []
    for c, chain in enumerate(prepared.system.chains):
        mine = [t for t in chosen if c in t.chains]
        rms = []
        for terms in ([], mine):
            x = [base.columns[c], *(t.columns[t.chains.index(c)] for t in terms)]
            solution = _solve(np.concatenate(x, axis=1), base.observed[c], chain.white)
            there = [other.columns[c]]
            for term in terms:
                (shape,) = block_shapes(term.known, [term.variant], prepared.signal, coarse, left)
                again = in_other_form(term, term.variant, other, shape)
                there.append(again.columns[again.chains.index(c)])
            miss = other.observed[c] - np.concatenate(there, axis=1) @ solution
            rms.append(float(np.sqrt(np.mean(miss**2))))
        made.append(Prediction(_label(base, c), tuple(t.name for t in mine), rms[0], rms[1]))
    return made
