"""From a campaign to one system of rows per triad, with candidates."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np

from ..calibration.calibration import Calibration
from ..data.recording import Campaign
from ..effects import CATALOGUE, Effect, Signal, Variant
from ..numerics.compilation_cache import make_room
from .candidates.bumps import between
from .candidates.empirical import alternatives
from .candidates.signatures import block_shapes, coarsen, in_other_form, padded, Term, terms
from .candidates.smooth import flexible
from .noise.observation_series import make, share, System
from .noise.type_noise import TypeNoise
from .observations.blocks import Blocks, cut, join, Log
from .observations.delay_ramps import Delay, find_delay, without_delay
from .observations.model_rows import Baseline, choose, fit, ModelForm, usable
from .observations.signals import build, specific_force


@dataclass(frozen=True, eq=False)
class Prepared:
    """One triad, ready to be diagnosed."""

    form: ModelForm
    blocks: Blocks
    signal: Signal
    coarse: Signal
    system: System
    candidates: tuple[Term, ...]
    flexible: tuple[Term, ...]  # what must find nothing beside the right explanation
    missing: dict[str, str]
    clock: np.ndarray  # s, the recording's clock at every sample of the log
    delay: Delay | None = (
        None  # what the ramps between plateaus say; taken away from the rows where it is found
    )
    log: Log | None = None
    moved: float = 0.0  # s of rests left out, since the device moved in them


def rig_variance(
    campaign: Campaign, form: ModelForm, blocks: Blocks, base: Baseline
) -> list[np.ndarray]:
    """Variance that the rig's stated uncertainties give to each chain's rows at every positioning."""
    num = blocks.num_blocks
    rows = [np.zeros(num) for _ in base.observed]
    angle, rate = campaign.rig.position_uncertainty or 0.0, campaign.rig.rate_uncertainty or 0.0
    if form.estimator == "reference":
        given = getattr(blocks, f"reference_{form.triad}")
        across = (given**2).sum(axis=1)[:, None] - given**2
        square = angle**2 * across + (rate**2 * given**2 if form.triad == "gyro" else 0.0)
        rows = [square[:, c] for c in range(3)]
    return rows


def probe_error(
    campaign: Campaign, signal: Signal, blocks: Blocks, base: Baseline
) -> list[np.ndarray]:
    """Change of each chain's rows by one stated standard deviation of the probe, `(block, 1)` or `(block, 0)`."""
    sigma = campaign.rig.temperature_uncertainty or 0.0
    if signal.at_temperature is None or signal.temperature is None or sigma == 0.0:
        return [np.zeros((blocks.num_blocks, 0)) for _ in base.observed]
    probe = np.asarray(signal.temperature)
    change = 0.5 * (signal.at_temperature(probe + sigma) - signal.at_temperature(probe - sigma))
    rows = blocks.mean(np.asarray(change))
    if len(base.observed) == 3:
        return [rows[:, c : c + 1] for c in range(3)]
    return [(rows * base.loads[0]).sum(axis=1, keepdims=True)]


def prepare(
    campaign: Campaign,
    catalogue: Sequence[Effect] = CATALOGUE,
    calibration: Calibration | None = None,
    noise: TypeNoise | None = None,
) -> tuple[Log, list[Prepared]]:
    """Cut the recordings into blocks, fit the baseline of each triad and make all candidates.

    `noise` is what other units tell of the variances. Raises `ValueError` where it is of another station or other rows.
    """
    if noise is not None:
        noise.require(campaign.rig)
    make_room()
    log = join(campaign)
    if calibration is not None:
        log = compensate(log, calibration)
    blocks = cut(log)
    accel_base, prepared = None, []
    for triad in ("accel", "gyro"):
        form = choose(campaign, blocks, triad)
        if form is None:
            continue
        mine = blocks[usable(form, blocks)]
        force = specific_force(log, blocks, accel_base)
        base = fit(form, mine, None if force is None else mine.mean(force))
        delay = find_delay(log, base) if any(e.name == "time_delay" for e in catalogue) else None
        if delay is not None and delay.found:
            log = without_delay(log, delay, base)
            blocks = cut(log)
            mine = blocks[usable(form, blocks)]
            base = fit(form, mine, None if force is None else mine.mean(force))
        if triad == "accel":
            accel_base = base
            force = specific_force(log, blocks, accel_base)
        made = prepare_triad(campaign, log, mine, form, base, force, catalogue)
        lost = blocks[blocks.moved & ~usable(form, blocks)]
        made = replace(made, delay=delay, log=log, moved=float(lost.count.sum() * log.step))
        prepared.append(made if noise is None else replace(made, system=noise.inform(made.system)))
    return log, prepared


def prepare_triad(
    campaign: Campaign,
    log: Log,
    blocks: Blocks,
    form: ModelForm,
    base: Baseline,
    force: np.ndarray | None,
    catalogue: Sequence[Effect],
) -> Prepared:
    """Candidates and noise structure of one triad with a fitted baseline."""
    signal = build(log, blocks, base, force)
    coarse = coarsen(signal, blocks)
    listed, missing = terms(tuple(catalogue), signal, blocks, base)
    system = make(
        base,
        blocks,
        rig_variance(campaign, form, blocks, base),
        probe_error(campaign, signal, blocks, base),
    )
    if form.estimator == "reference":
        rate = (campaign.rig.rate_uncertainty or 0.0) if form.triad == "gyro" else 0.0
        reading = getattr(blocks, f"reference_{form.triad}")
        system = share(system, blocks, reading, campaign.rig.position_uncertainty or 0.0, rate)
    return Prepared(
        form,
        blocks,
        signal,
        coarse,
        system,
        (*listed, *alternatives(coarse, blocks, base)),
        tuple(flexible(coarse, base)),
        missing,
        log.clock,
    )


def compensate(log: Log, calibration: Calibration) -> Log:
    """The log with a known calibration taken away by equation (3), sample by sample."""
    num = len(log.time)
    accel = np.zeros((num, 3)) if log.accel is None else log.accel
    gyro = np.zeros((num, 3)) if log.gyro is None else log.gyro
    temperature = np.full(num, 20.0) if log.temperature is None else log.temperature
    by_parameters = jax.jit(jax.vmap(calibration.without_effects()))
    force, rate = by_parameters(accel, gyro, temperature)
    changed = {"accel": np.asarray(force), "gyro": np.asarray(rate)}
    columns = {k: getattr(log, k) for k in log.__dataclass_fields__}
    columns |= {k: v for k, v in changed.items() if columns[k] is not None}
    return Log(**columns)


def retuned(prepared: Prepared, term: Term, values: Sequence[float]) -> list[Term]:
    """The same term with other values of its effect's nuisance setting."""
    effect = term.known
    variants = [
        Variant(f"{effect.nuisance}={v:.4g}", {**term.variant.settings, effect.nuisance: float(v)})
        for v in values
    ]
    return _formed(prepared, term, variants)


def rebuilt(prepared: Prepared, term: Term) -> Term:
    """The same term in the same form, from the triad's signal."""
    return _formed(prepared, term, [term.variant])[0]


def _formed(prepared: Prepared, term: Term, variants: Sequence[Variant]) -> list[Term]:
    shapes = block_shapes(
        term.known,
        variants,
        padded(prepared.signal, len(prepared.signal.time)),
        padded(prepared.coarse, prepared.blocks.num_blocks),
        prepared.blocks,
    )
    base = prepared.system.base
    return [in_other_form(term, v, base, shape) for v, shape in zip(variants, shapes)]


def finer(prepared: Prepared, term: Term) -> list[Term]:
    """The same term with settings between its grid's neighbours: every block's edge for a moment in time."""
    effect = term.effect
    if effect is None:
        return between(term, prepared.coarse, prepared.system.base)
    if not effect.nuisance:
        return []
    value = term.setting
    grid = np.unique([t.setting for t in _same(prepared, term)])
    place = int(np.argmin(np.abs(grid - value)))
    values = _inside(prepared, effect, grid[max(place - 1, 0)], grid[min(place + 1, len(grid) - 1)])
    return retuned(prepared, term, [float(v) for v in values if v != value])


def between_all(prepared: Prepared, term: Term) -> list[Term]:
    """Every form of the term's effect on its channels that `finer` reaches from any point of the grid."""
    effect = term.effect
    if effect is None or not effect.nuisance:
        return []
    same = _same(prepared, term)
    grid = np.unique([t.setting for t in same])
    pieces = [_inside(prepared, effect, a, b) for a, b in zip(grid[:-1], grid[1:])]
    values = [float(v) for v in np.setdiff1d(np.concatenate([*pieces, []]), grid)]
    kinds = {}
    for t in same:
        other = {k: v for k, v in t.variant.settings.items() if k != effect.nuisance}
        kinds.setdefault(repr(sorted(other.items())), t)
    return [made for t in kinds.values() for made in retuned(prepared, t, values)] if values else []


def _same(prepared: Prepared, term: Term) -> list[Term]:
    """The effect's forms on the same channels, on the grid."""
    key = (term.name, term.channels)
    return [t for t in prepared.candidates if (t.name, t.channels) == key]


def _inside(prepared: Prepared, effect: Effect, low: float, high: float) -> np.ndarray:
    """Settings between two points of an effect's grid."""
    if effect.nuisance == "time":
        edges = np.asarray(prepared.coarse.time)
        values = edges[(edges > low) & (edges < high)]
        return values[:: max(1, len(values) // 80)]
    return np.linspace(low, high, 9)[1:-1]
