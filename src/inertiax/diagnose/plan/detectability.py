"""Plan audit: what a campaign could show, before any of its outputs is explained.

Only the plan enters: inputs, temperatures, times and the noise. A signature that the calibration absorbs
is not testable; signatures that overlap after the calibration is projected out cannot be told apart in
this plan, whatever the noise; what remains is as large as its whitened length says.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.special

from ..._jax import eqx, jax
from ...data.recording import Campaign
from ...effects import CATALOGUE, Effect
from ...numerics.blas_threads import one_blas_thread
from ..candidates.empirical import PREFIX
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit, START, System
from ..noise.reml import fit_noise
from ..observations.model_rows import ModelForm
from ..problem import prepare, Prepared
from ..problem_of_motions import prepared_motions
from ..selection.evidence import count_forms, duration, observations
from ..selection.forward import GATE
from ..selection.multiple_testing import Family, family
from ..selection.score_test import Score, whiten_system
from .aliasing import alias_sets, aliases
from .degrees_of_freedom import best_length, BY_ALL, deviations_for, Told, told_by_dwells
from .limits import Absorbed, Audit, Detectable


UNEXCITED = (
    1e-4  # part of the largest square below which a combination of parameters is not excited
)
BEYOND = 30.0  # times the usual size from which an effect counts as out of reach
UNTOLD = (
    "the dwells are no more than the parameters and it; more of them are needed, in other positions"
)


@dataclass(frozen=True, eq=False)
class Audited:
    """One triad's catalogue under given noise."""

    prepared: Prepared
    scores: tuple[Score, ...]  # of the catalogue's terms that the calibration does not absorb
    tests: Family  # effective numbers of independent tests
    noise: NoiseFit

    @cached_property
    def told(self) -> list[Told]:
        """What each of the scores is told by."""
        return told_by_dwells(self.prepared.system, self.noise, self.scores)

    def tells(self, name: str) -> bool:
        """Whether the scatter between dwells leaves anything to tell an effect by."""
        return any(
            t.anything for s, t in zip(self.scores, self.told, strict=True) if s.term.name == name
        )

    @property
    def each_alone(self) -> tuple[Score, ...]:
        """The scores of each on its own rows, where the rig's errors couple the chains of some."""
        system = self.prepared.system
        if system.shared is None:
            return self.scores
        alone = eqx.tree_at(lambda s: s.shared, system, None)
        return whiten_system(alone, self.noise, [s.term for s in self.scores]).scores


@one_blas_thread()
def audit(
    campaign: Campaign, *, effects: Sequence[Effect] = CATALOGUE, estimate_noise: bool = False
) -> Audit:
    """Audit the plan of a one-device campaign.

    **Arguments:** `campaign` may be simulated: its outputs serve only to know the specific force and the noise
    inside blocks. With `estimate_noise` the variance components are fitted to the outputs, else a
    moderate flicker beside the white noise is assumed. **Returns** an `Audit`.
    """
    with jax.enable_x64(True):
        problem = prepare(campaign, effects)
        motions = prepared_motions(problem, effects)
        triads = [*problem.triads, *([] if motions is None else [motions])]
        found = conclude([_audited(p, estimate_noise) for p in triads], effects)
        return replace(found, model=problem.plain.model)


def _audited(prepared: Prepared, estimate_noise: bool) -> Audited:
    system = prepared.system
    noise = fit_noise(system) if estimate_noise else assumed_noise(system)
    scores = whiten_system(system, noise, prepared.candidates).scores
    tests = family(scores, [len(y) for y in system.base.observed])
    listed = tuple(s for s in scores if not s.term.name.startswith(PREFIX))
    return Audited(prepared, listed, tests, noise)


def assumed_noise(system: System) -> NoiseFit:
    """White noise by the scatter inside blocks, and beside it a flicker of about the same size."""
    return NoiseFit(tuple(START for _ in system.chains), tuple(0.0 for _ in system.chains))


def conclude(triads: Sequence[Audited], effects: Sequence[Effect]) -> Audit:
    """The audit of all triads together."""
    sizes, pairs, absorbed, lines = [], [], [], []
    for one in triads:
        sizes.extend(detectable_sizes(one))
        pairs.extend(aliases(one.each_alone))
        absorbed.extend(_absorbed(one))
        lines.extend(_unobservable(one.prepared.system))
    seen = {d.name for d in sizes}
    shown = {s.term.name for t in triads for s in t.scores}
    taken = {a.name for a in absorbed} - shown
    absent = []
    for effect in effects:
        if effect.name in seen:
            continue
        why = [t.prepared.missing[effect.name] for t in triads if effect.name in t.prepared.missing]
        reason = why[0] if why else f"it needs {effect.needs}"
        if effect.name in taken:
            reason = "the calibration itself absorbs it in this plan"
        elif not why and not any(t.prepared.form.triad in effect.triads for t in triads):
            reason = (
                f"it is an effect of the {'gyros' if 'gyro' in effect.triads else 'accelerometers'}"
            )
        elif effect.name in shown and not any(t.tells(effect.name) for t in triads):
            reason = UNTOLD
        elif effect.name in shown:
            reason = f"not even {BEYOND:g} times its usual size would show; it needs {effect.needs}"
        absent.append((effect.name, reason))
    return Audit(
        tuple(absent), tuple(sizes), tuple(pairs), tuple(absorbed), tuple(lines),
        tuple(alias_sets(pairs, effects)),
    )  # fmt: skip


def needed(size: int, rows: int, forms: int, tests: float, told: Told = BY_ALL) -> float:
    r"""Standard deviations at which an effect passes the diagnosis with probability `POWER`.

    A term of `size` coefficients must exceed the family's threshold, $\chi^2$ at $1 - (1 - \alpha)^{1/N}$, and
    pay the price of its columns and of its forms; $z = \sqrt{\text{threshold}} + \Phi^{-1}(0.9)$, and more where few
    dwells tell their scatter, see `deviations_for`.
    """
    single = -np.expm1(np.log1p(-GATE) / max(tests, 1.0))
    gate = float(scipy.special.chdtri(size, single))
    price = size * np.log(max(rows, 2)) + 2.0 * np.log(max(forms, 1))
    return deviations_for(max(gate, price), size, told)


def at_the_gate(tests: Family, score: Score) -> float:
    """Tests that a term pays for at the likelihood ratio which just passes the gate."""
    number = tests.tests(score.term)
    for _ in range(3):  # it grows with a power of the ratio, and the ratio with its logarithm
        single = -np.expm1(np.log1p(-GATE) / max(number, 1.0))
        number = tests.tests(score.term, float(scipy.special.chdtri(score.size, single)))
    return number


def detectable_sizes(one: Audited) -> list[Detectable]:
    """For each effect and channel the smallest coefficient that the diagnosis would detect.

    Where theory fixes the coefficient at one, the smallest nuisance setting (a time constant, a width).
    """
    forms = count_forms(one.prepared.candidates)
    system = one.prepared.system
    found: dict[tuple[str, tuple[str, ...]], list[tuple[Score, float]]] = {}
    for score, told in zip(one.scores, one.told, strict=True):
        term = score.term
        z = needed(
            score.size,
            observations(system, term),
            forms[term.name, term.channels],
            at_the_gate(one.tests, score),
            told,
        )
        found.setdefault((term.name, term.channel_names), []).append((score, z))
    made = []
    for (name, channels), members in found.items():
        effect = members[0][0].term.known
        if effect.unit_amplitude and effect.nuisance:
            size, unit = smallest_setting(members), effect.nuisance_unit
        else:
            size, unit = smallest_coefficient(members)
            usual = effect.usual(one.prepared.form.triad, None, duration(one.prepared.system))
            size = np.inf if usual and size > BEYOND * usual[1] else size
        if np.isfinite(size):
            band = _band(members) if effect.nuisance_unit == "Hz" else None
            made.append(Detectable(name, channels, float(size), unit, band))
    return made


def _band(members: Sequence[tuple[Score, float]]) -> tuple[float, float]:
    """Frequencies among which that of the smallest size was sought, Hz."""
    values = [score.term.setting for score, _ in members]
    return min(values), max(values)


def smallest_coefficient(members: Sequence[tuple[Score, float]]) -> tuple[float, str]:
    """The smallest coefficient that is detected, and its unit: of the forms in the effect's own unit, if it has any.

    A change of the bias and one of the scale factor are numbers of two kinds, of which none is the smaller. A jump
    chooses no moment: its size is that of half of the moments.
    """
    known = members[0][0].term
    units = [s.term.known.unit(s.term.triad, s.term.variant.settings) for s, _ in members]
    own = known.known.units[known.triad]
    unit = own if own in units else units[0]
    sizes = [z * sigma(s) for (s, z), u in zip(members, units, strict=True) if u == unit]
    return float(np.median(sizes)) if known.known.jump else min(sizes), unit


def sigma(score: Score) -> float:
    """Standard deviation of the best-seen coefficient with the term's others at zero, SI."""
    length = best_length(score)
    return 1.0 / length if length > 0.0 else np.inf


def smallest_setting(members: Sequence[tuple[Score, float]]) -> float:
    """Smallest nuisance setting at which a coefficient of one is detected; between grid points the length
    of the signature goes by a power of the setting."""
    term = members[0][0].term
    groups: dict[tuple, list[tuple[float, float]]] = {}
    for score, z in members:
        if np.isinf(z):
            continue
        settings = dict(score.term.variant.settings)
        value = float(settings.pop(term.known.nuisance))
        strength = 1.0 / (z * sigma(score))
        groups.setdefault(tuple(sorted(settings.items())), []).append((value, strength))
    best = np.inf
    for points in groups.values():
        value, strength = np.array(sorted(points)).T
        above = np.flatnonzero(strength >= 1.0)
        if not len(above):
            continue
        k = int(above[0])
        if k == 0:
            best = min(best, value[0])
            continue
        slope = np.log(value[k] / value[k - 1]) / np.log(strength[k] / strength[k - 1])
        best = min(best, value[k] * strength[k] ** -slope)
    return float(best)


def _absorbed(one: Audited) -> list[Absorbed]:
    """Effects of which no form survives beside the calibration, by triad."""
    seen = {(s.term.name, s.term.channels) for s in one.scores}
    gone: dict[str, list[Term]] = {}
    for term in one.prepared.candidates:
        if (
            term.effect is not None
            and (term.name, term.channels) not in seen
            and _felt(one.prepared.system, term)
        ):
            gone.setdefault(term.name, []).append(term)
    made = []
    for name, members in gone.items():
        channels = dict.fromkeys(n for t in members for n in t.channel_names)
        by = dict.fromkeys(p for t in members for p in takers(one.prepared.system, t))
        made.append(Absorbed(name, tuple(channels), tuple(by)[:4]))
    return made


def _felt(system: System, term: Term) -> bool:
    """Whether the effect at its largest usual size would reach the rows at all."""
    usual = term.known.usual(term.triad, None, duration(system))
    size = usual[1] if usual else 1.0
    return any(
        size * float(np.abs(c).max(initial=0.0)) > 1e-3 * float(system.scales[k][1]) ** 0.5
        for k, c in zip(term.chains, term.columns)
    )


def takers(system: System, term: Term) -> tuple[str, ...]:
    """The calibration's parameters that take most of a term's columns up."""
    base, found = system.base, []
    for chain, columns in zip(term.chains, term.columns):
        x = base.columns[chain]
        norm = np.linalg.norm(x, axis=0) + 1e-300
        share = np.abs(np.linalg.lstsq(x / norm, columns[:, :1], rcond=1e-8)[0][:, 0])
        strongest = np.flatnonzero(share > 0.3 * share.max())
        found += [_parameter(system, int(base.index[chain][k])) for k in strongest]
    return tuple(dict.fromkeys(found))


def _parameter(system: System, flat: int) -> str:
    names = system.base.form.names
    number = flat // system.base.coefficients.shape[1]
    # A user's own model has parameters by their place in the flattened pytree.
    return names[number] if len(names) == len(system.base.coefficients) else f"parameters[{number}]"


def _left_out(form: ModelForm) -> list[tuple[int, int]]:
    """Elements of the invariant estimator's matrix that are no parameters of the model."""
    if form.estimator != "invariant":
        return []
    return [(i, j) for i in range(3) for j in range(i) if (i, j) not in form.matrix]


def _unobservable(system: System) -> list[str]:
    """Combinations of the calibration's own parameters that the plan does not excite.

    Columns of one kind of parameter are compared in the same unit, so that one which only feels what a
    misalignment lets through counts as unexcited. Misalignments that the calibration left out, since the positions
    do not determine them, are among them.
    """
    lines = [f"accel.matrix[{i},{j}]" for i, j in _left_out(system.base.form)]
    for chain, x in enumerate(system.base.columns):
        names = np.array([_parameter(system, int(k)) for k in system.base.index[chain]])
        kinds = np.array([n.partition("[")[0] for n in names])
        norm = np.linalg.norm(x, axis=0)
        largest = np.array([norm[kinds == k].max() for k in kinds])
        value, vector = np.linalg.eigh((x / largest).T @ (x / largest))
        unseen = vector[:, value < UNEXCITED * value[-1]]
        if not unseen.shape[1]:
            continue
        # Each combination gets a parameter of its own, so that single parameters stand alone where they can.
        order = np.asarray(scipy.linalg.lu(unseen)[0])
        own = np.argmax(order, axis=0)[: unseen.shape[1]]
        for part in np.abs(unseen @ np.linalg.inv(unseen[own])).T:
            mixed = list(dict.fromkeys(names[part > 0.3 * part.max()].tolist()))
            line = mixed[0] if len(mixed) == 1 else f"a combination of {', '.join(mixed)}"
            lines.append(line)
    return list(dict.fromkeys(lines))
