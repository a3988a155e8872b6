"""One gyro, or two, in another unit or of another scale than the rest, by gravity's turns between rests.

A triad that was scaled as one is `gyro_turns`' matter. Here the angles about one axis, or about two, are multiplied by
every factor of a grid; what makes the integrated rates turn gravity as it turned is the factor.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import GYRO_UNITS
from . import remedies
from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds
from .turns import misfit_as_given, Motions, score


# From factor to factor. Half of it, 10 %, of a turn of a radian is 0.1 rad, which the limit of agreement allows.
_RATIO = 1.2
_LARGEST = 3e5  # a rad/s is 2.06e5 deg/h, the smallest unit that a file may be in
_MOST_STEPS = 128  # of a motion while the grid is searched: at 60 s half a second each
_SOME = 8  # motions, for the grid; 16 angles for a factor
_FEWEST = (
    6  # motions: a factor and two choices of axes beside the exchanges; twice what those ask for
)
_MORE = 2 * _SOME  # to refine the factor
_AXES = ((0,), (1,), (2,), (0, 1), (0, 2), (1, 2))
_NEAR = 2.0  # times the least misfit; another axis that explains the motions as well leaves it open which one is wrong


@dataclasses.dataclass(frozen=True)
class AxisFactor:
    """What the values of some axes have to be multiplied by."""

    axes: tuple[int, ...]
    factor: float
    misfit: float  # rad, that it leaves


def axis_factor(motions: Motions, given: float, limits: Thresholds) -> AxisFactor | None:
    """The axis, or the two, and the factor that explain the motions; `None` where none does, or several do.

    **Arguments:** `given` is the score of the motions as they are, rad.
    """
    if motions.count < _FEWEST or given < limits.turn_agrees:
        return None
    coarse = _coarse(motions)
    factors = np.exp(np.arange(0.0, math.log(_LARGEST), math.log(_RATIO)))
    factors = np.concatenate([1.0 / factors[:0:-1], factors])
    factors = np.concatenate([factors, -factors])
    made = []
    for axes in _AXES:
        first = factors[int(np.argmin(_scores(coarse, axes, factors)))]
        made.append(_refined(motions, axes, float(first)))
    least = min(m.misfit for m in made)
    # Motions of several radians keep 0.2 rad of gyros that are off by 5 %: what does not disagree will do.
    if least >= limits.turn_disagrees or given <= limits.turn_gain * least:
        return None
    near = [m for m in made if m.misfit < _NEAR * least]
    fewest = min(len(m.axes) for m in near)
    simplest = [m for m in near if len(m.axes) == fewest]
    return simplest[0] if len(simplest) == 1 else None


def one_axis_finding(
    device: DeviceLogs,
    name: str,
    motions: Motions,
    given: float,
    found: AxisFactor,
    limits: Thresholds,
) -> Finding:
    """The axis' own unit, scale or sign, with the line that mends it: an error where no working gyro is."""
    ratio = 1.0 / found.factor
    which = " and ".join("xyz"[k] for k in found.axes)
    others = " and ".join("xyz"[k] for k in range(3) if k not in found.axes)
    unit, factor = _likely(device, found.factor, limits)
    gross = max(abs(ratio), 1.0 / abs(ratio)) > limits.accel_ratio_error or ratio < 0.0
    what = "another unit" if unit is not None else "another scale"
    what += " and mirrored" if ratio < 0.0 else ""
    likely = f", likely {unit}" if unit is not None else ""
    several = len(found.axes) > 1
    return finding(
        "gyro_unit",
        "error" if gross else "warning",
        "gyro" if several else f"gyro_{which}",
        f"{name}: gyro {which} {'read' if several else 'reads'} {ratio:.3g} times what gravity's turns between rests "
        f"say, beside {others}: {motions.count} motions disagree by {given:.2f} rad on average, and by "
        f"{found.misfit:.2f} rad where the values are multiplied by {factor:.4g}: {which} "
        f"{'are' if several else 'is'} in {what}{likely}.",
        remedy=remedies.axes_rescaled("gyro", device.columns, found.axes, factor),
        ratio=ratio,
        pairs=motions.count,
        as_given=given,
        misfit=found.misfit,
    )


def _coarse(motions: Motions) -> Motions:
    """Some of the motions, with neighbouring steps added up."""
    some = slice(None, None, -(-motions.count // _SOME))
    angle = motions.angle[some]
    group = -(-angle.shape[1] // _MOST_STEPS)
    angle = np.pad(angle, ((0, 0), (0, -angle.shape[1] % group), (0, 0)))
    angle = angle.reshape(len(angle), -1, group, 3).sum(axis=2)
    return Motions(angle, motions.before[some], motions.after[some])


def _scores(
    motions: Motions, axes: tuple[int, ...], factors: Float[np.ndarray, " factor"]
) -> Float[np.ndarray, " factor"]:
    """What is left, rad, with each factor; all at once."""
    by = np.ones((len(factors), 1, 1, 3))
    by[..., list(axes)] = factors[:, None, None, None]
    count, steps, _ = motions.angle.shape
    angle = (motions.angle * by).reshape(-1, steps, 3)
    before, after = (np.tile(u, (len(factors), 1)) for u in (motions.before, motions.after))
    return score(misfit_as_given(Motions(angle, before, after)).reshape(-1, count))


def _refined(motions: Motions, axes: tuple[int, ...], near: float) -> AxisFactor:
    """The factor to 0.3 % within a step of the grid, by a few motions, and what it leaves of all."""
    from scipy.optimize import minimize_scalar  # slow to import, and seldom needed

    some = slice(None, None, -(-motions.count // _MORE))
    few = Motions(motions.angle[some], motions.before[some], motions.after[some])
    width = math.log(_RATIO)
    left = lambda of, factor: float(_scores(of, axes, np.array([factor]))[0])
    cost = lambda log: left(few, near * math.exp(float(log)))
    best = minimize_scalar(cost, bounds=(-width, width), method="bounded", options={"xatol": 3e-3})
    factor = near * math.exp(float(best.x))
    return AxisFactor(axes, factor, left(motions, factor))


def _likely(device: DeviceLogs, factor: float, limits: Thresholds) -> tuple[str | None, float]:
    """The unit, or a decimal part or multiple of one, that the axis would be in, and the factor: the unit's, that of a
    range of half or twice the width, or the measured one."""
    said = device.columns.gyro
    now = GYRO_UNITS.get((said.unit if said is not None else None) or "rad/s")
    size = abs(factor)
    halves = 2.0 ** round(math.log2(size))
    if abs(halves / size - 1.0) < limits.rate_off:
        return None, math.copysign(halves, factor)
    if now is None:
        return None, factor
    for unit, si in GYRO_UNITS.items():
        power = 10.0 ** round(math.log10(now * size / si))
        if abs(power * si / (now * size) - 1.0) < limits.rate_off:
            said = unit if power == 1.0 else f"{power:g} {unit}"
            return said, math.copysign(power * si / now, factor)
    return None, factor
