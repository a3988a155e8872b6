"""The run that parts names which a campaign could not tell from each other.

Let a campaign's rows be followed by those of a run, whitened by the campaign's noise. If the effect i is there, of
the size that the campaign tells, and j is fitted in its place, then beside the calibration X and j's columns S

    δ²_ij = min over β, γ, forms of j of ‖s_i − X β − S_j γ‖²

is left, and the expected logarithm of the Bayes factor for i is δ²_ij / 2 (the prices of their columns apart). What the
campaign's own rows have of it is taken away, since the diagnosis has weighed those, and found the names alike.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from ..._jax import eqx, jax
from ...data.recording import Campaign, Recording
from ...effects import CATALOGUE
from ...numerics.blas_threads import one_blas_thread
from ...physics.temperature import Curve, Polynomial
from ...simulate.bench import simulate_recordings
from ...simulate.scenario import (
    plan_of,
    RecordingTable,
    RigTable,
    Scenario,
    SiteTable,
)
from ...simulate.triad import (
    ACCEL_PARAMETERS,
    AccelerometerTriad,
    Device,
    GYRO_PARAMETERS,
    GyroTriad,
    Noise,
    TrueCurve,
)
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit, System
from ..noise.reml import fit_noise
from ..observations.blocks import Blocks, cut, join
from ..problem import finer, prepare, Prepared, prepared_triads, Problem, rebuilt
from ..problem_of_motions import PARTED_BY
from ..selection.score_test import Score, whiten_system
from .run_menu import menu, Run, station_of


# Expected logarithm of a Bayes factor from which one run is enough: the ratio scatters by √(2 E) about it, and a name
# is left out of a set from 3 on (`selection.verdict.SAME` / 2), so that 19 of 20 runs part the names.
ENOUGH = 11.0
TOLD = 3.0  # below which a name stays in the set more often than not (`selection.verdict.SAME` / 2)
AFTER = 3600.0  # s from the campaign's end to the run
MOST_RATE = 10.0  # Hz, of the run's rows: its blocks last seconds


@dataclass(frozen=True)
class NameSet:
    """Names that a diagnosis could not tell from each other, on some channels."""

    names: tuple[str, ...]
    channels: tuple[str, ...]


@dataclass(frozen=True)
class Expected:
    """What a run is expected to say."""

    run: Run
    # Expected logarithm of the Bayes factor for the first name over the second, if the first is there.
    pairs: tuple[tuple[str, str, float], ...]

    @property
    def worst(self) -> float:
        """Of the pair that is parted least."""
        return min(value for _, _, value in self.pairs)

    @property
    def enough(self) -> bool:
        """Whether one run is expected to leave one name alone."""
        return self.worst >= ENOUGH

    @property
    def parted(self) -> float:
        """Sum over the pairs, none of them counted beyond what is enough."""
        return sum(min(value, ENOUGH) for _, _, value in self.pairs)


def _keyed(pairs: Sequence[tuple[str, str, float]]) -> list[tuple[tuple[str, str], float]]:
    return [((i, j), value) for i, j, value in pairs]


@dataclass(frozen=True)
class Separation:
    """Runs in order, the best first, for one set."""

    names: NameSet
    runs: tuple[Expected, ...]
    rate: float  # Hz, of the run's rows
    noise: Noise
    campaign: Campaign

    @property
    def best(self) -> Expected:
        """The run to take."""
        return self.runs[0]

    @property
    def hopeless(self) -> tuple[str, ...]:
        """Names of which no run parts one from another: what else would tell stands in the catalogue."""
        best = {
            (i, j): max(dict(_keyed(e.pairs))[i, j] for e in self.runs)
            for i, j, _ in self.best.pairs
        }
        return tuple(dict.fromkeys(n for pair, value in best.items() if value < TOLD for n in pair))

    def scenario(self) -> Scenario:
        """The best run as a scenario, with the campaign's site, grade, rig and noise."""
        campaign, first = self.campaign, self.campaign.recordings[0]
        triads = [t for t in ("accel", "gyro") if getattr(first, t) is not None]
        said = {
            "plan": self.best.run.plan,
            "site": SiteTable(
                gravity=campaign.site.gravity,
                latitude=float(np.degrees(campaign.site.latitude or 0.0)),
            ),
            "device": {"grade": campaign.grade or "tactical", "triads": triads},
            "recording": RecordingTable(
                rate=self.rate, accel_noise=self.noise.accel, gyro_noise=self.noise.gyro
            ),
            "rig": RigTable(position_uncertainty=campaign.rig.position_uncertainty or 0.0),
        }
        return msgspec.convert(msgspec.to_builtins(said), Scenario)


@one_blas_thread()
def separate(
    campaign: Campaign,
    names: NameSet,
    others: Sequence[NameSet] = (),
    progress: Callable[[str], None] = lambda text: None,
    *,
    runs: Sequence[Run] | None = None,
) -> Separation:
    """Choose the run that parts the names best: where several part all of them for good the shortest, else the one that
    parts most.

    **Arguments:** a one-device campaign and a set that its diagnosis gave; `others` are what else it named, fitted
    beside; `runs` are chosen from, by default the `menu` of what the campaign was done with.
    Raises `ValueError` where the campaign shows fewer than two of the names.
    """
    listed = {n for one in (names, *others) for n in one.names}
    effects = tuple(e for e in CATALOGUE if e.name in listed)
    triad = names.channels[0].partition("_")[0]
    with jax.enable_x64(True):
        problem = prepare(campaign, effects)
        mine = next((p for p in problem.triads if p.form.triad == triad), None)
        if mine is None:
            raise ValueError(f"the campaign's {triad} is not calibrated, so nothing of it is told.")
        seen, beside, noise = _as_seen(mine, names, others)
        if len(seen) < 2:
            why = f"{len(seen)} of {', '.join(names.names)}, so there is nothing to part"
            if mine.form.estimator == "gravity":
                raise ValueError(
                    f"the campaign's rests show {why}; what the motions between them show is parted by {PARTED_BY}."
                )
            raise ValueError(f"the campaign shows {why}.")
        before = _pairs(mine, seen, beside, noise)
        axis = "xyz".index(names.channels[0][-1])
        blocks = cut(problem.log)
        rate = min(1.0 / problem.log.step, MOST_RATE)
        density = Noise(*(_density(blocks, t, problem.log.step) for t in ("accel", "gyro")))
        found = []
        for run in menu(station_of(problem.log), axis) if runs is None else runs:
            progress(f"expecting {run.name}")
            further = _recordings(problem, run, density, rate)
            joint = together(problem.campaign, further)
            (made,) = prepared_triads(joint, join(joint), problem.fitted, effects, (triad,))
            after = _pairs(made, seen, beside, _carried(noise, mine, made))
            gained = [(i, j, max(b - a, 0.0)) for (i, j, a), (_, _, b) in zip(before, after)]
            found.append(Expected(run, tuple(gained)))
    found.sort(key=lambda e: (-round(e.parted, 1), e.run.seconds))
    return Separation(names, tuple(found), rate, density, campaign)


# --- the effects as the campaign shows them -------------------------------------------------------


def _as_seen(
    prepared: Prepared, names: NameSet, others: Sequence[NameSet]
) -> tuple[list[tuple[Term, np.ndarray]], list[Term], NoiseFit]:
    """Each name's best form with its coefficients, the best form of what else was named, and the noise beside them."""
    system = _apart(prepared.system)
    noise, lead = fit_noise(system), _terms(prepared, names.names[0], names.channels)
    best = _best(system, noise, lead, [])
    beside: list[Term] = []
    for other in others:
        found = _best(system, noise, _terms(prepared, other.names[0], other.channels), beside)
        beside += [] if found is None else [found.term]
    noise = fit_noise(system, [*beside, *([] if best is None else [best.term])])
    seen = []
    for name in names.names:
        forms = _terms(prepared, name, names.channels)
        found = _best(system, noise, forms, beside)
        if found is None:
            continue
        nearer = _best(system, noise, [found.term, *finer(prepared, found.term)], beside)
        found = nearer or found
        seen.append((found.term, found.coefficients))
    return seen, beside, noise


def _terms(prepared: Prepared, name: str, channels: Sequence[str]) -> list[Term]:
    """All forms of a name that touch one of the channels."""
    return [
        t
        for t in prepared.candidates
        if t.name == name and not set(t.channel_names).isdisjoint(channels)
    ]


def _best(
    system: System, noise: NoiseFit, forms: Sequence[Term], beside: Sequence[Term]
) -> Score | None:
    """The form that gains most after half the logarithm of the rows for each coefficient."""
    scores = whiten_system(system, noise, forms, beside).scores if forms else ()
    price = np.log(max(system.num_rows, 2))
    return max(scores, key=lambda s: s.gain - s.size * price, default=None)


def _apart(system: System) -> System:
    """Chains each on its own rows, so that slow effects and those that follow the input are seen alike."""
    if system.shared is None:
        return system
    return eqx.tree_at(lambda s: s.shared, system, None)


def _carried(noise: NoiseFit, before: Prepared, after: Prepared) -> NoiseFit:
    """The same variances for rows of another system, whose unit of variance is another."""
    theta = tuple(
        t + np.log(a / b) for t, a, b in zip(noise.theta, before.system.scales, after.system.scales)
    )
    return replace(noise, theta=theta, coupled=None)


# --- what is left ---------------------------------------------------------------------------------


def _pairs(
    prepared: Prepared,
    seen: Sequence[tuple[Term, np.ndarray]],
    beside: Sequence[Term],
    noise: NoiseFit,
) -> tuple[tuple[str, str, float], ...]:
    """δ²_ij / 2 for all ordered pairs on these rows."""
    system = _apart(prepared.system)
    fixed = [rebuilt(prepared, t) for t in beside]
    here = [rebuilt(prepared, t) for t, _ in seen]
    truths = [_summed(t, size) for t, (_, size) in zip(here, seen)]
    forms = [_forms(prepared, t) for t in here]
    everything = [*truths, *(f for each in forms for f in each)]
    scores = {id(s.term): s for s in whiten_system(system, noise, everything, fixed).scores}
    made = []
    for i, truth in enumerate(truths):
        for j, rivals in enumerate(forms):
            if i != j:
                left = _left(scores, truth, rivals)
                made.append((truth.name, here[j].name, 0.5 * left))
    return tuple(made)


def _summed(term: Term, coefficients: np.ndarray) -> Term:
    """A term of one column: what the effect does to the rows with these coefficients."""
    columns = tuple((c @ coefficients)[:, None] for c in term.columns)
    return replace(term, columns=columns)


def _forms(prepared: Prepared, term: Term) -> list[Term]:
    """All forms of a term's effect on its channels, with those between its grid's points beside it."""
    grid = [t for t in prepared.candidates if (t.name, t.channels) == (term.name, term.channels)]
    return [term, *grid, *(finer(prepared, term) if grid else [])]


def _left(scores: dict[int, Score], truth: Term, rivals: Sequence[Term]) -> float:
    """Square of what no form of the rival takes up; 0 where the calibration itself takes the truth up."""
    mine = scores.get(id(truth))
    if mine is None:
        return 0.0
    white = dict(zip(mine.chains, (w[:, 0] for w in mine.white)))
    whole = sum(float(w @ w) for w in white.values())
    taken = 0.0
    for rival in rivals:
        score = scores.get(id(rival))
        if score is None:
            continue
        part = sum(
            (d.T @ white[c] for c, d in zip(score.chains, score.directions) if c in white),
            np.zeros(score.size),
        )
        taken = max(taken, float(part @ part))
    return max(whole - taken, 0.0)


def together(campaign: Campaign, further: Sequence[Recording]) -> Campaign:
    """A campaign followed by further recordings, an hour later by its clock, as further experiments."""
    before = campaign.recordings
    counted = [int(r.experiment.max()) for r in before if r.experiment is not None]
    number = 1 + max([len(before) - 1, *counted])
    begin = min((float(r.time[0]) for r in further), default=0.0)
    shift = max(float(r.time[-1]) for r in before) + AFTER - begin
    device = before[0].device
    made = [
        replace(
            r,
            time=r.time + shift,
            experiment=None if r.experiment is None else r.experiment + number,
            device=device,
        )
        for r in further
    ]
    return eqx.tree_at(lambda c: c.recordings, campaign, (*before, *made))


# --- a run's recordings ---------------------------------------------------------------------------


def _density(blocks: Blocks, triad: str, step: float) -> float:
    """White noise of a triad inside blocks, per √Hz; 0 where it was not recorded."""
    white = getattr(blocks, f"{triad}_white")
    if white is None:
        return 0.0
    return float(np.sqrt((white * blocks.count[:, None]).mean() * step))


def _recordings(problem: Problem, run: Run, noise: Noise, rate: float) -> list[Recording]:
    """What the calibrated device would send on a run, with the columns that the campaign has."""
    campaign, first = problem.campaign, problem.campaign.recordings[0]
    plan = eqx.tree_at(
        lambda p: (p.gravity, p.latitude),
        plan_of(Scenario(plan=run.plan)),
        (campaign.site.gravity, campaign.site.latitude or 0.0),
    )
    ideal, _ = simulate_recordings(None, plan, _ideal(), sample_rate=rate)
    distort = jax.jit(jax.vmap(problem.plain.calibration.distort_by_parameters))
    rng = np.random.default_rng(0)  # any: only the size of the noise counts
    made = []
    for k, one in enumerate(ideal):
        assert one.temperature is not None and one.accel is not None and one.gyro is not None
        temperature = one.temperature[:, 0]
        outputs = distort(one.accel, one.gyro, temperature)
        noisy = [
            None
            if getattr(first, triad) is None
            else np.asarray(x) + size * np.sqrt(rate) * rng.standard_normal(x.shape)
            for triad, x, size in zip(("accel", "gyro"), outputs, (noise.accel, noise.gyro))
        ]
        has = lambda label, value: None if getattr(first, label) is None else value
        made.append(
            Recording(
                time=one.time,
                accel=noisy[0],
                gyro=noisy[1],
                temperature=has("temperature", np.repeat(temperature[:, None], _probes(first), 1)),
                experiment=has("experiment", np.full(one.num_samples, k)),
                position=has("position", one.position),
                reference_accel=has("reference_accel", one.reference_accel),
                reference_gyro=has("reference_gyro", one.reference_gyro),
                device=first.device,
                name=f"{run.name}, {k}",
            )
        )
    return made


def _probes(recording: Recording) -> int:
    return 0 if recording.temperature is None else recording.temperature.shape[1]


def _ideal() -> Device:
    """A device whose outputs are its inputs."""
    basis = Polynomial(0, 0.0, 1.0)
    zero = lambda names: TrueCurve(
        Curve(basis, np.zeros((1, len(names)))), np.zeros(len(names)), np.zeros(len(names))
    )
    return Device(AccelerometerTriad(zero(ACCEL_PARAMETERS)), GyroTriad(zero(GYRO_PARAMETERS)))
