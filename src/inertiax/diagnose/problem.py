"""From a campaign to its calibration and one system of rows per triad, with candidates."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._jax import jax
from ..calibrate.pipeline import calibrate_device
from ..calibrate.results import DeviceResult, TriadResult
from ..calibrate.table_error_sizes import table_error_sizes, within_statement
from ..calibrate.wanted_sensors import nothing_left
from ..data.recording import Campaign
from ..effects import CATALOGUE, Effect, Signal, Variant
from ..model_selection.model_spec import ModelSpec
from ..numerics.compilation_cache import make_room
from ..numerics.side_by_side import side_by_side
from ..reduction.rig_errors import move_covariance, rig_covariance
from ..reduction.rounded_temperature import probe_sigma
from ..reduction.standing_axes import angles_of_axes
from .candidates.bumps import between
from .candidates.empirical import alternatives
from .candidates.signatures import block_shapes, coarsen, in_other_form, NO_RATES, Term, terms
from .candidates.smooth import flexible
from .noise.observation_series import make, System
from .noise.positioning_errors import with_rig_errors
from .noise.type_noise import TypeNoise
from .observations.blocks import Blocks, cut, Log, with_scatter_about
from .observations.delay_ramps import Delay, find_delay, without_delay
from .observations.log_outputs import with_outputs
from .observations.model_rows import (
    Baseline,
    calibrated,
    CalibratedTriad,
    expected_output,
    ModelForm,
    rows,
    spanning,
    usable,
)
from .observations.motion_rows import few_motions
from .observations.rest_lines import Line, Sought
from .observations.signals import build, specific_force
from .observations.table_rows import standing_of_blocks, without_table_errors
from .observations.untold_heading import (
    errors_of_rests,
    with_heading_errors,
    with_leans_of_part_turns,
)
from .without_interference import without_interference


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
    lines: tuple[Line, ...] = ()  # in the rests' samples; taken away from every one of them
    sought: Sought | None = None  # what such lines are left, which move no mean of a rest
    log: Log | None = None
    only: Callable[[np.ndarray], "Prepared"] | None = None  # the same triad with some of its blocks
    motions: bool = False  # rows are of the gyros' motions between rests, two each, rad
    axes: tuple[float, float] | None = None  # rad, what the outer and inner err by where one stands


@dataclass(frozen=True, eq=False)
class Problem:
    """A campaign with its calibration, and each calibrated triad ready to be diagnosed."""

    campaign: Campaign  # without lines and a delay that were found
    plain: DeviceResult  # of the campaign as it was recorded
    fitted: DeviceResult  # of the campaign here
    log: Log
    triads: tuple[Prepared, ...]


def rig_variance(
    campaign: Campaign, form: ModelForm, blocks: Blocks, base: Baseline, step: float
) -> list[np.ndarray]:
    """Variance that the rig's stated uncertainties give to each chain's rows at every positioning; `step`, s, is
    between samples."""
    num = blocks.num_blocks
    made = [np.zeros(num) for _ in base.observed]
    angle, rate = campaign.rig.position_uncertainty or 0.0, campaign.rig.rate_uncertainty or 0.0
    if form.by_reference:
        given = getattr(blocks, f"reference_{form.triad}")
        square = rig_covariance(given, angle, rate if form.triad == "gyro" else 0.0)
        if form.triad == "gyro":
            square = square + move_covariance(blocks.move, step * blocks.count, angle)
        made = [square[:, c, c] for c in range(3)]
    return made


def probe_error(
    campaign: Campaign, signal: Signal, blocks: Blocks, base: Baseline
) -> list[np.ndarray]:
    """Change of each chain's rows by one standard deviation of the probe, `(block, 1)` or `(block, 0)`."""
    sigma = probe_sigma(campaign.rig)
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
    noise: TypeNoise | None = None,
    model: ModelSpec | None = None,
) -> Problem:
    """Calibrate, cut the recordings into blocks, and make each triad's rows and all candidates.

    The model that is judged is `model`, else the one that the calibration chooses. `noise` is what other units tell of
    the variances.
    Raises `ValueError` where the campaign cannot be calibrated or the noise is of another station or other rows.
    """
    if noise is not None:
        noise.require(campaign.rig)
    make_room()
    freed = without_interference(campaign, catalogue, model)
    campaign, log, plain, fitted = freed.campaign, freed.log, freed.recorded, freed.fitted
    delays: dict[str, Delay] = {}
    if any(e.stream_delay for e in catalogue):
        log, delays = _delays(log, fitted)
    if any(d.found for d in delays.values()):
        campaign = with_outputs(campaign, log)
        fitted = calibrate_device(
            campaign, model=plain.model, checked=True, segments=fitted.segments
        )
    prepared, why = [], few_motions(campaign, log, fitted)
    for made in prepared_triads(campaign, log, fitted, catalogue, in_ramps=tuple(delays)):
        triad = made.form.triad
        made = replace(made, delay=delays.get(triad))
        made = _with_lines(made, freed.lines.get(triad, ()), freed.sought.get(triad))
        if why is not None and triad == "gyro":
            made = _with_reason(made, why)
        prepared.append(made if noise is None else replace(made, system=noise.inform(made.system)))
    if not prepared:
        raise nothing_left(campaign, "diagnose")
    return Problem(campaign, plain, fitted, log, tuple(prepared))


def _with_reason(made: Prepared, why: str) -> Prepared:
    """The triad, and what is made of some of its blocks, with the reason why rates are not judged."""
    again = made.only
    return replace(
        made,
        missing={
            name: why if reason == NO_RATES else reason for name, reason in made.missing.items()
        },
        only=None if again is None else lambda kept: _with_reason(again(kept), why),
    )


def prepared_triads(
    campaign: Campaign,
    log: Log,
    fitted: DeviceResult,
    catalogue: Sequence[Effect],
    triads: Sequence[str] = ("accel", "gyro"),
    in_ramps: Sequence[str] = (),
) -> list[Prepared]:
    """Rows and candidates of a campaign, whose log this is, about a calibration; of the calibrated ones of `triads`.

    A delay is no candidate of the triads `in_ramps`, whose ramps tell it to a fraction of a millisecond: what rows of
    plateaus show in its shape, such as an axis off by an arc second, is something else.
    """
    blocks = cut(log)
    force = specific_force(log, blocks, calibrated(fitted, "accel"))

    def one(model: CalibratedTriad) -> Prepared:
        triad = model.form.triad
        expected = expected_output(model, log, blocks)
        seen = blocks if expected is None else with_scatter_about(blocks, log, triad, expected)
        seen = with_heading_errors(seen, log.step)
        within = log.recording[seen.start]
        seen = with_leans_of_part_turns(seen, campaign.rig, log.step, within)
        mine = seen[usable(model.form, blocks)]
        listed = [e for e in catalogue if not (e.stream_delay and triad in in_ramps)]
        with jax.enable_x64(True):  # which is set for each thread
            sizes = _table_errors(getattr(fitted, triad))
            return _of_blocks(campaign, log, model, force, listed, mine, sizes)

    models = [m for m in (calibrated(fitted, triad) for triad in triads) if m is not None]
    models = [spanning(m, blocks) for m in models]
    return side_by_side(one, models, rows=len(models) * len(log.time))


def _with_lines(made: Prepared, lines: tuple[Line, ...], sought: Sought | None) -> Prepared:
    """A triad with the lines that it was freed from and that it has, also on fewer blocks."""
    of_blocks = made.only
    again = of_blocks and (lambda kept: _with_lines(of_blocks(kept), lines, sought))
    return replace(made, lines=lines, sought=sought, only=again)


def _table_errors(result: TriadResult) -> np.ndarray | None:
    """The table's errors as far as the station's statement allows them, in stated standard deviations."""
    sizes = table_error_sizes(result.estimator, result.solution.curve, result.dwells)
    return None if sizes is None else within_statement(sizes)


def _of_blocks(
    campaign: Campaign,
    log: Log,
    model: CalibratedTriad,
    force: np.ndarray | None,
    catalogue: Sequence[Effect],
    blocks: Blocks,
    sizes: np.ndarray | None,
) -> Prepared:
    """One triad on some blocks, without table errors of these `sizes`; able to be made again on fewer blocks."""
    base = rows(model, blocks, None if force is None else blocks.mean(force))
    base = without_table_errors(base, blocks, log, campaign.rig, sizes)
    made = prepare_triad(campaign, log, blocks, base, force, catalogue)
    again = lambda kept: _of_blocks(campaign, log, model, force, catalogue, blocks[kept], sizes)
    return replace(made, log=log, only=again)


def _delays(log: Log, fitted: DeviceResult) -> tuple[Log, dict[str, Delay]]:
    """The delay of each triad that ramps tell one of, and the log without those that were found."""
    delays = {}
    for triad in ("accel", "gyro"):
        model = calibrated(fitted, triad)
        delay = None if model is None else find_delay(log, model)
        if model is None or delay is None:
            continue
        delays[triad] = delay
        if delay.found:
            log = without_delay(log, delay, model)
    return log, delays


def prepare_triad(
    campaign: Campaign,
    log: Log,
    blocks: Blocks,
    base: Baseline,
    force: np.ndarray | None,
    catalogue: Sequence[Effect],
) -> Prepared:
    """Candidates and noise structure of one calibrated triad."""
    form = base.form
    signal = build(log, blocks, base, force)
    coarse = coarsen(signal, blocks)
    listed, missing = terms(tuple(catalogue), signal, blocks, base)
    system = make(
        base,
        blocks,
        rig_variance(campaign, form, blocks, base, log.step),
        probe_error(campaign, signal, blocks, base),
        errors_of_rests(blocks, form, campaign.rig, log.step),
    )
    axes = None
    if form.by_reference:
        rate = (campaign.rig.rate_uncertainty or 0.0) if form.triad == "gyro" else 0.0
        reading = getattr(blocks, f"reference_{form.triad}")
        angle = campaign.rig.position_uncertainty or 0.0
        standing = standing_of_blocks(blocks, log, campaign.rig)
        system = with_rig_errors(system, blocks, reading, angle, rate, listed, standing)
        axes = None if standing is None else angles_of_axes(campaign.rig)
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
        axes=axes,
    )


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
    signal, coarse, blocks = prepared.signal, prepared.coarse, prepared.blocks
    shapes = block_shapes(term.known, variants, signal, coarse, blocks)
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
