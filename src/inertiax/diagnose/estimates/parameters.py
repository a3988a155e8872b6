"""How large: parameters of a named effect with their uncertainty, and what moved in the calibration."""

from collections.abc import Sequence

import numpy as np

from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit, System
from ..problem import Prepared, retuned
from ..result import Moved, Parameter
from ..selection.score_test import Score, whiten_system
from .common_size import held_to_common_size
from .moments import tuned_moments


CHI2_95 = 3.8415  # of one degree of freedom
LOBES = 6.0  # resolution widths 1/T on either side that a frequency is looked for
PER_LOBE = 24  # frequencies tried in each
# Of the largest coefficient: what least squares leave in one that no row shows.
_ROUNDING = 1e-9


def _drop(score: Score, amplitude: float | None) -> float:
    """Drop of the sum of squares with a free coefficient, or with a given one."""
    if amplitude is None:
        return score.gain
    direction = np.linalg.pinv(score.turn) @ np.full(score.turn.shape[0], amplitude)
    return float(2.0 * direction @ score.part - direction @ direction)


def tune(
    prepared: Prepared, noise: NoiseFit, term: Term, others: Sequence[Term]
) -> tuple[Term, float | None]:
    """Refine the nuisance setting by its profile likelihood; its standard deviation, or `None` if flat.

    Where theory fixes the coefficient at one, the profile is taken at one. The profile of a time constant is
    lopsided: the standard deviation is that of the longer side of its 95 % interval. That of a frequency has lobes,
    one at each 1/T: the standard deviation holds what the other lobes weigh.
    """
    effect = term.effect
    if effect is None or not effect.nuisance:
        return term, None
    if effect.nuisance == "time":
        ((tuned, std),) = tuned_moments(prepared, noise, [term], others)
        return tuned, std
    if effect.nuisance == "frequency":
        term, beside = _best_lobe(prepared, noise, term, others)
        centre = float(term.variant.settings["frequency"])
        width = 0.5 / (prepared.signal.duration * centre)
        tuned, std = _tune_within(prepared, noise, term, others, width)
        return tuned, None if std is None else float(np.hypot(std, beside))
    return _tune_within(prepared, noise, term, others, 0.45)


def _tune_within(
    prepared: Prepared, noise: NoiseFit, term: Term, others: Sequence[Term], width: float
) -> tuple[Term, float | None]:
    """The maximum of the profile within an e-folding `width` of the setting, and its standard deviation."""
    centre = float(term.variant.settings[term.known.nuisance])
    lowest, highest = _limits(prepared, term)
    width = width if centre > 0 else 0.0
    best, curved = term, None  # the logarithm's standard deviation by the curvature
    for _ in range(3):
        grid = centre * np.exp(np.linspace(-width, width, 9))
        grid = np.unique(np.clip(grid, min(lowest, centre), max(highest, centre)))
        members, gains = _profile(prepared, noise, term, others, grid)
        k = int(np.argmax(gains))
        best, centre = members[k], grid[k]
        if 0 < k < len(grid) - 1 and np.isfinite(gains[k - 1 : k + 2]).all():
            x = np.log(grid[k - 1 : k + 2])
            a, b, _ = np.polyfit(x - x[1], gains[k - 1 : k + 2], 2)
            if a < 0:
                centre = float(grid[k] * np.exp(np.clip(-0.5 * b / a, -width / 4, width / 4)))
                curved = 1.0 / np.sqrt(-a)  # drop of chi² by one: a s² = 1
            width = float(np.clip(3.0 / np.sqrt(max(-a, 1e-12)), width / 12, width))
    if curved is not None and curved > 1.0:
        curved = None
    (tuned,) = retuned(prepared, best, [float(centre)])
    if curved is None:
        return tuned, None
    return tuned, _longer_side(prepared, noise, tuned, others, curved)


def _limits(prepared: Prepared, term: Term) -> tuple[float, float]:
    """Range of a setting: that of the effect's grid and a third more."""
    same = [t for t in prepared.candidates if t.name == term.name]
    grid = [float(t.variant.settings[term.known.nuisance]) for t in same]
    return min(grid, default=0.0) / 1.3, max(grid, default=np.inf) * 1.3


def _profile(
    prepared: Prepared, noise: NoiseFit, term: Term, others: Sequence[Term], grid: np.ndarray
) -> tuple[list[Term], np.ndarray]:
    """The term at each setting, and its drop of the sum of squares."""
    members = retuned(prepared, term, grid.tolist())
    scores = {id(s.term): s for s in whiten_system(prepared.system, noise, members, others).scores}
    amplitude = 1.0 if term.known.unit_amplitude else None
    gains = [_drop(scores[id(m)], amplitude) if id(m) in scores else -np.inf for m in members]
    return members, np.array(gains)


def _longer_side(
    prepared: Prepared, noise: NoiseFit, term: Term, others: Sequence[Term], curved: float
) -> float:
    """Standard deviation of a setting from where its profile has dropped by the 95 % point of chi²."""
    centre = float(term.variant.settings[term.known.nuisance])
    steps = curved * np.linspace(0.0, 4.0, 17)
    sides = []
    for sign in (-1.0, 1.0):
        grid = centre * np.exp(sign * steps)
        _, gains = _profile(prepared, noise, term, others, grid)
        drop = np.maximum.accumulate(gains[0] - gains)
        sides.append(abs(float(np.interp(CHI2_95, drop, grid)) - centre))
    return float(max(sides) / np.sqrt(CHI2_95))


def _best_lobe(
    prepared: Prepared, noise: NoiseFit, term: Term, others: Sequence[Term]
) -> tuple[Term, float]:
    """The frequency with the largest likelihood, and the root mean square distance of the lobes beside its own.

    A sine that is seen for a time T looks much the same where its frequency is off by a multiple of 1/T, and the
    next lobe may be the higher one on the grid of the search. Each frequency weighs with its likelihood.
    """
    width = 1.0 / prepared.signal.duration
    centre = float(term.variant.settings["frequency"])
    lowest, highest = _limits(prepared, term)
    num = round(LOBES * PER_LOBE)
    grid = centre + np.arange(-num, num + 1) * width / PER_LOBE
    grid = grid[(grid >= min(lowest, centre)) & (grid <= max(highest, centre))]
    members, gains = _profile(prepared, noise, term, others, grid)
    best = int(np.argmax(gains))
    weight = np.exp(0.5 * (gains - gains[best]))
    far = np.abs(grid - grid[best]) > 0.6 * width
    square = np.square(grid[far] - grid[best])
    return members[best], float(np.sqrt(weight[far] @ square / weight.sum()))


def parameters(
    prepared: Prepared,
    noise: NoiseFit,
    term: Term,
    others: Sequence[Term],
    nuisance_std: float | None,
) -> tuple[tuple[str, Parameter], ...]:
    """Coefficients and nuisance setting of a term, in SI units.

    The coefficients' covariance is the marginal one: $C + s s^T \\sigma^2$ with $C$ at the refined setting, $s$
    the coefficients' slope by the setting and $\\sigma$ the setting's standard deviation. Those of several columns are
    held to one size (`common_size`).
    """
    effect = term.known
    found = whiten_system(prepared.system, noise, [term], others).scores
    made: list[tuple[str, Parameter]] = []
    if effect.nuisance:
        value = float(term.variant.settings[effect.nuisance])
        if effect.nuisance == "time":  # on the clock of the recordings
            value = float(np.interp(value, prepared.signal.time, prepared.clock))
        made.append((effect.nuisance, Parameter(value, nuisance_std, effect.nuisance_unit)))
    if found:
        values, covariance = found[0].coefficients, found[0].covariance
        if nuisance_std is not None and effect.nuisance != "time" and not effect.unit_amplitude:
            slope = _slope(prepared, noise, term, others, nuisance_std)
            covariance = covariance + nuisance_std**2 * np.outer(slope, slope)
        values, covariance = held_to_common_size(values, covariance)
        spread = np.sqrt(np.diag(covariance))
        label = "amplitude" if effect.unit_amplitude else "coefficient"
        for k, (value, std) in enumerate(zip(values, spread)):
            name = label if len(values) == 1 else f"{label}[{k}]"
            told = float(std) if found[0].told[k] else None
            if told is None and abs(value) < _ROUNDING * np.abs(values).max():
                value = 0.0
            unit = effect.unit(term.triad, term.variant.settings, k)
            made.append((name, Parameter(float(value), told, unit)))
    return tuple(made)


def _slope(
    prepared: Prepared, noise: NoiseFit, term: Term, others: Sequence[Term], std: float
) -> np.ndarray:
    """Change of the fitted coefficients by the nuisance setting: over half a standard deviation each way."""
    value = float(term.variant.settings[term.known.nuisance])
    either = retuned(prepared, term, [value - 0.5 * std, value + 0.5 * std])
    scores = whiten_system(prepared.system, noise, either, others).scores
    if len(scores) < 2:
        return np.zeros(term.size)
    return (scores[1].coefficients - scores[0].coefficients) / std


def _solve(
    system: System, noise: NoiseFit, chosen: Sequence[Term], chain: int
) -> tuple[np.ndarray, np.ndarray]:
    """Generalised least squares of the baseline's linear correction beside the chosen terms."""
    from ..selection.score_test import whiten_columns

    x = system.base.columns[chain]
    mine = [t.columns[t.chains.index(chain)] for t in chosen if chain in t.chains]
    both = np.concatenate([x, *mine], axis=1)
    norm = np.linalg.norm(both, axis=0) + 1e-300
    y = system.base.observed[chain]
    unit = system.scales[chain][1] ** 0.5
    white = whiten_columns(
        system, noise, chain, np.concatenate([y[:, None] / unit, both / norm], axis=1)
    )
    gram = white[:, 1:].T @ white[:, 1:]
    covariance = np.linalg.pinv(gram, rcond=1e-13, hermitian=True)
    solution = covariance @ (white[:, 1:].T @ (white[:, 0] * unit)) / norm
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / norm
    return solution[: x.shape[1]], spread[: x.shape[1]]


def corrected(
    system: System, noise: NoiseFit, chosen: Sequence[Term]
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of the baseline with the chosen terms beside it, and their standard deviations."""
    base = system.base
    values, spread = base.coefficients.copy().reshape(-1), np.zeros(base.coefficients.size)
    for c in range(len(system.chains)):
        step, std = _solve(system, noise, chosen, c)
        values[base.index[c]] += step
        spread[base.index[c]] = std
    return values.reshape(base.coefficients.shape), spread.reshape(base.coefficients.shape)


def moved(system: System, noise: NoiseFit, chosen: Sequence[Term]) -> tuple[Moved, ...]:
    """Calibration parameters (at mid temperature) that the omission pulled by more than one sigma."""
    without, _ = corrected(system, noise, [])
    beside, std = corrected(system, noise, chosen)
    # What the calibration says, and how far the effects move it under one and the same weighting.
    before = system.base.coefficients
    after = before + (beside - without)
    size = before.shape[1]
    # Chebyshev series at x = 0: 1, 0, -1, 0, 1, ...
    middle = np.array([np.cos(0.5 * np.pi * k) for k in range(size)])
    old, new = before @ middle, after @ middle
    spread = np.sqrt((std**2) @ middle**2)
    names = system.base.form.names
    if len(names) != len(old):  # a user's model: parameters by their place in the flattened pytree
        names = tuple(f"parameters[{k}]" for k in range(len(old)))
    made = [Moved(n, float(a), float(b), float(s)) for n, a, b, s in zip(names, old, new, spread)]
    made.sort(key=lambda m: -abs(m.after - m.before) / max(m.std, 1e-300))
    return tuple(m for m in made if abs(m.after - m.before) > m.std)
