"""The fitted noise beside the Allan deviation of the rows, where rests are long enough for one."""

import numpy as np
from scipy.special import ndtri

from ..._jax import eqx
from ...allan import deviations
from ..candidates.signatures import Term
from ..noise.draws import draw
from ..noise.observation_series import NoiseFit, variances
from ..problem import Prepared
from ..selection.blocked_cross_validation import columns_of


ENOUGH = 48  # blocks in one rest
DRAWS = 200
LEVEL = 0.99  # of the interval that the fitted noise gives
# Of a converter's step, the noise below which steps hide it: above, it dithers them (Widrow, Kollár, 2008).
DITHERS = 0.5
ROUNDING = 1e-12  # of the outputs, below which a deviation is that of sums in double precision


class AllanCheck(eqx.Module):
    """Allan deviation of one chain's rows in its longest rest against that of the fitted noise."""

    channel: str = eqx.field(static=True)
    tau: float = eqx.field(static=True)  # s
    measured: float = eqx.field(static=True)  # m/s² or rad/s
    expected: float = eqx.field(static=True)  # median over draws of the fitted noise
    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)

    @property
    def agrees(self) -> bool:
        """Whether the measured value lies within the interval."""
        return self.low <= self.measured <= self.high

    @property
    def deviate(self) -> float:
        """Distance of the logarithms in standard deviations, by the interval's width."""
        spread = (np.log(self.high) - np.log(self.low)) / (2.0 * float(ndtri(0.5 + 0.5 * LEVEL)))
        return float((np.log(self.measured) - np.log(self.expected)) / spread)

    def line(self) -> str:
        """The comparison in words."""
        unit = "rad/s" if self.channel.startswith("gyro") else "m/s^2"
        verdict = "agrees with" if self.agrees else "does NOT agree with"
        return (
            f"{self.channel}: the Allan deviation {self.measured:.3g} {unit} at {self.tau:.3g} s {verdict} the "
            f"fitted noise ({self.low:.3g} to {self.high:.3g})"
        )


def allan_checks(prepared: Prepared, noise: NoiseFit, chosen: list[Term]) -> tuple[AllanCheck, ...]:
    """Compare at one block, and at an eighth of the longest rest; nothing where no rest has enough blocks.

    Rows have the baseline and the chosen terms taken away by least squares, and so have the draws of the noise. Outputs
    whose noise hides in the converter's steps hardly change within a rest, and are not compared.
    """
    blocks, system = prepared.blocks, prepared.system
    numbers, counts = np.unique(blocks.dwell[~blocks.moving], return_counts=True)
    if not len(numbers) or counts.max() < ENOUGH:
        return ()
    rest = np.flatnonzero(blocks.dwell == numbers[int(np.argmax(counts))])
    step = float(np.median(np.diff(blocks.time[rest])))
    factors = np.array([1, len(rest) // 8])
    made = []
    hidden = _hidden(prepared)
    for c, chain in enumerate(system.chains):
        if hidden[c]:
            continue
        y = system.base.observed[c][:, None]
        rng = np.random.default_rng([17, c])
        both = np.concatenate([y, draw(chain, variances(system, noise)[c], DRAWS, rng)], axis=1)
        extra = columns_of(chosen, c)
        x = system.frames[c] if extra is None else np.concatenate([system.frames[c], extra], axis=1)
        weight = 1.0 / np.sqrt(chain.white)[:, None]
        frame = np.linalg.qr(x / (np.linalg.norm(x, axis=0) + 1e-300) * weight)[0]
        left = (both * weight - frame @ (frame.T @ (both * weight))) / weight
        found = np.array(
            [
                deviations(row, rate=1.0 / step, factors=factors).deviation
                for row in np.ascontiguousarray(left[rest].T)
            ]
        )
        name = f"{prepared.form.triad}_{'xyz'[c]}" if len(system.chains) == 3 else "|accel|"
        low, middle, high = np.quantile(
            found[1:], [0.5 - 0.5 * LEVEL, 0.5, 0.5 + 0.5 * LEVEL], axis=0
        )
        least = ROUNDING * float(np.abs(np.asarray(prepared.signal.output)).max())
        for k, factor in enumerate(factors):
            if found[0, k] <= least:
                continue
            made.append(
                AllanCheck(
                    name, float(step * factor), float(found[0, k]), float(middle[k]), float(low[k]),
                    float(high[k]),
                )
            )  # fmt: skip
    return tuple(made)


def _hidden(prepared: Prepared) -> list[bool]:
    """Of each chain whether the steps of a channel that it is made of hide that channel's noise."""
    signal, chains = prepared.signal, len(prepared.system.chains)
    if prepared.motions or signal.resolution is None or signal.scatter is None:
        return [False] * chains
    below = np.asarray(signal.scatter) < DITHERS * np.asarray(signal.resolution)
    return [bool(b) for b in below] if chains == 3 else [bool(below.any())] * chains
