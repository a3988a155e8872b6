"""Short disturbances: stretches where a channel scatters more than elsewhere.

Means over blocks hide an oscillation faster than a block, and no smooth dependence follows one that lasts a few
minutes. Two scans look for them: of the scatter inside blocks, channel by channel, and of the whitened residuals of the
block means, without what the rig gives to all channels. Windows of doubling length slide over the campaign; the sum of
squares in each is compared with what the rest of the campaign lets expect, its spread between windows included, so that
scatter which varies everywhere is not taken for an event.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.special
from jaxtyping import Float

from ...data.moments import moment
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit
from ..observations.blocks import block_mean
from ..problem import Prepared
from ..result import Where
from ..selection.score_test import residual_together


LEVEL = 1e-5  # family-wise false alarms
LONGEST = 0.15  # of the campaign: longer is a change of the noise, not a short disturbance
ALONE = 4.0  # standard deviations that one block may count
SHARED = 0.1  # of the excess on another channel: from there on it is a motion
FAINT = (
    3.0  # times the usual mean square: below, one sample is disturbed by hardly more than its noise
)
INSIDE = "scatter inside blocks"
BETWEEN = "scatter of the means of blocks"


@dataclass(frozen=True, eq=False)
class Burst:
    """A stretch of blocks with too much scatter."""

    channel: str
    first: int
    last: int
    excess: float  # rms beyond the usual scatter, m/s² or rad/s
    p_value: float
    kind: str

    def formula(self, start: float, end: float, first: float) -> str:
        """The dependence in words with its size; `first` is the clock's time at the first row, s."""
        unit = "m/s^2" if self.channel.startswith("accel") else "rad/s"
        begin, finish = (moment(float(round(t)), float(round(first))) for t in (start, end))
        return (
            f"{self.channel} carries a disturbance of {self.excess:.3g} {unit} rms from {begin} to {finish} "
            f"({self.kind})"
        )


@dataclass(frozen=True, eq=False)
class Window:
    """The stretch of rows that stands out most."""

    first: int
    last: int
    p_value: float
    ratio: float  # mean square there against elsewhere


def most_scattered(
    squares: Float[np.ndarray, " block"], dof: Float[np.ndarray, " block"]
) -> Window | None:
    """The window whose sum of squares is least likely; `None` with fewer than 40 rows.

    `squares` are sums of squares with `dof` degrees of freedom each, in any unit.
    """
    num = len(squares)
    if num < 40:
        return None
    centre = (1.0 - 2.0 / (9.0 * dof)) ** 3  # median of chi² over its degrees of freedom
    unit = float(np.median(squares / dof / centre))
    if unit <= 0.0:
        return None
    # One block alone, however loud, is an outlier and no disturbance that lasts.
    spread = 2.0 / (9.0 * dof)
    loudest = dof * (1.0 - spread + ALONE * np.sqrt(spread)) ** 3
    total = np.r_[0.0, np.cumsum(np.minimum(squares / unit, loudest))]
    count = np.r_[0.0, np.cumsum(dof)]
    best, windows = None, 0
    length = 1
    while length <= max(2, LONGEST * num):
        start = np.arange(0, num - length + 1, max(1, length // 4))
        s, nu = total[start + length] - total[start], count[start + length] - count[start]
        windows += len(start)
        z = _normal(s / nu, nu)
        middle = np.median(z)
        spread = max(1.0, 1.4826 * float(np.median(np.abs(z - middle))))
        score = (z - max(middle, 0.0)) / spread
        k = int(np.argmax(score))
        if best is None or score[k] > best[0]:
            best = (float(score[k]), int(start[k]), int(start[k]) + length - 1, float(s[k] / nu[k]))
        length *= 2
    assert best is not None
    single = scipy.special.ndtr(-best[0])
    p = float(-np.expm1(windows * np.log1p(-min(single, 1 - 1e-12))))
    return Window(best[1], best[2], p, best[3])


def _normal(ratio: np.ndarray, dof: np.ndarray) -> np.ndarray:
    """Standard normal deviates of chi² over its degrees of freedom (Wilson and Hilferty, PNAS 17, 1931)."""
    spread = 2.0 / (9.0 * dof)
    return (np.cbrt(ratio) - (1.0 - spread)) / np.sqrt(spread)


def find_bursts(
    prepared: Prepared,
    outputs: Float[np.ndarray, "time 3"],
    noise: NoiseFit,
    chosen: Sequence[Term],
) -> list[Burst]:
    """Short disturbances of one triad beyond the chosen terms, most significant first."""
    made = [*_inside(prepared, outputs), *_between(prepared, noise, chosen)]
    return sorted((b for b in made if b.p_value < LEVEL), key=lambda b: b.p_value)


def _inside(prepared: Prepared, outputs: np.ndarray) -> list[Burst]:
    """By the scatter of samples about each block's mean, as told by differences of neighbours and by level."""
    blocks, triad = prepared.blocks, prepared.form.triad
    dof = np.maximum(blocks.count - 1.0, 1.0)
    given = prepared.signal.rate if triad == "gyro" else None
    values = outputs if given is None else outputs - np.asarray(given)[: len(outputs)]
    mean = block_mean(values, blocks.start, blocks.stop)
    offset = values.mean(axis=0)
    square = block_mean((values - offset) ** 2, blocks.start, blocks.stop)
    sums = np.maximum(square - (mean - offset) ** 2, 0.0) * blocks.count[:, None]
    rest = np.flatnonzero(~blocks.moving & _inner(blocks.dwell))
    windows = [most_scattered(sums[rest, c], dof[rest]) for c in range(3)]
    found = []
    for c, window in enumerate(windows):
        if window is None:
            continue
        usual = np.median(sums[rest] / dof[rest, None], axis=0)
        here = rest[window.first : window.last + 1]
        ratio = sums[here].sum(axis=0) / dof[here].sum() / usual
        if ratio[c] < FAINT or _moved(ratio, float(dof[here].sum()), c):
            continue
        excess = float(np.sqrt(max(ratio[c] - 1.0, 0.0) * usual[c]))
        found.append(
            Burst(
                f"{triad}_{'xyz'[c]}", int(here[0]), int(here[-1]), excess, window.p_value, INSIDE
            )
        )
    return found


def _inner(dwell: np.ndarray) -> np.ndarray:
    """Blocks that are neither first nor last of their rest: the ends may still hold some of the motion."""
    return np.r_[False, np.diff(dwell) == 0] & np.r_[np.diff(dwell) == 0, False]


def _between(prepared: Prepared, noise: NoiseFit, chosen: Sequence[Term]) -> list[Burst]:
    """By the whitened residuals of the blocks' means."""
    system, triad = prepared.system, prepared.form.triad
    residual = residual_together(system, noise, chosen)
    rest = np.flatnonzero(_inner(prepared.blocks.dwell))
    found = []
    for c, white in enumerate(residual):
        window = most_scattered(white[rest] ** 2, np.ones(len(rest)))
        if window is None:
            continue
        here = rest[window.first : window.last + 1]
        ratio = np.array([np.mean(w[here] ** 2) / np.mean(w[rest] ** 2) for w in residual])
        if len(residual) == 3 and _moved(ratio, float(len(here)), c):
            continue
        axis = c if len(residual) == 3 else _axis(white[here], system.base.loads[0][here])
        level = float(np.sqrt(np.mean(system.chains[c].white[here])))
        excess = level * float(np.sqrt(max(window.ratio - 1.0, 0.0)))
        channel = f"{triad}_{'xyz'[axis]}"
        found.append(Burst(channel, int(here[0]), int(here[-1]), excess, window.p_value, BETWEEN))
    return found


def _moved(ratio: np.ndarray, dof: float, channel: int) -> bool:
    """A knock or a hand on the table scatters all axes; a disturbed read-out is one channel's."""
    others = np.delete(ratio, channel)
    seen = _normal(others, np.full(len(others), dof)) > 4.0
    return bool(np.any(seen & (others - 1.0 > SHARED * (ratio[channel] - 1.0))))


def _axis(residual: np.ndarray, loads: np.ndarray) -> int:
    """The channel whose part in |a| goes best with the squares of the residual."""
    gains = [(residual**2 - 1.0) @ loads[:, c] ** 2 / (loads[:, c] ** 2).sum() for c in range(3)]
    return int(np.argmax(gains))


def burst_places(prepared: Prepared, burst: Burst) -> list[Where]:
    """The stretch of a burst as rows of `where`, experiment by experiment."""
    blocks, made = prepared.blocks, []
    for experiment in np.unique(blocks.experiment[burst.first : burst.last + 1]):
        mine = burst.first + np.flatnonzero(
            blocks.experiment[burst.first : burst.last + 1] == experiment
        )
        begin = prepared.clock[blocks.start[mine[0]]]
        end = prepared.clock[blocks.stop[mine[-1]] - 1]
        made.append(
            Where(
                burst.channel, int(experiment), float(begin), float(end), "time", burst.excess,
                burst.p_value,
            )
        )  # fmt: skip
    return made


def swallows(prepared: Prepared, burst: Burst, term: Term) -> bool:
    """Whether a named jump is but a moment of the disturbance: within it, or nearer than its length."""
    if term.effect is None or not term.effect.jump:
        return False
    time = prepared.coarse.time
    begin, end = float(time[burst.first]), float(time[burst.last])
    reach = end - begin
    return begin - reach <= float(term.variant.settings["time"]) <= end + reach
