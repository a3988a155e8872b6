"""One triad's rows with the structure of their noise."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from ..._jax import eqx, jax
from ...reduction.dwells import known_force
from ...reduction.positionings import shared_positionings
from ...reduction.standing_axes import StandingErrors
from ..candidates.columns import lengthen, span
from ..observations.blocks import Blocks, SHAKEN
from ..observations.model_rows import Baseline
from .common_mode import MOST, SharedErrors, signatures
from .state_space import Chain, Known, unpack, Variances


START = np.array([0.0, -1.0, -4.0, -2.0, -3.0, -1.5, -0.5])
# The likelihood of flicker and walk together has more than one maximum.
STARTS = (START, np.array([0.0, -6.0, 1.0, -2.0, -3.0, -1.5, -0.5]))
# Neither a probe nor a rig is worse than stated; how much better it is, the rows say.
BOUNDS = [(-1.0, 4.0), *4 * [(-9.0, 12.0)], (-6.0, 0.0), (-3.0, 0.0)]


class System(eqx.Module):
    """Rows of one triad: chains with noise structure, residuals, and the baseline's columns."""

    base: Baseline
    chains: tuple[Chain, ...]
    scales: tuple[np.ndarray, ...]
    frames: tuple[np.ndarray, ...]  # orthonormal basis of the baseline's columns, chain by chain
    longer: tuple[Chain, ...]  # the chains with rows of padding, for compiled programs
    known: tuple[Known, ...]  # what other units tell of each chain's variances
    shared: SharedErrors | None = None  # errors of the rig that couple the chains

    @property
    def num_rows(self) -> int:
        """Observations over all chains."""
        return sum(len(y) for y in self.base.observed)


def make(
    base: Baseline,
    blocks: Blocks,
    rig: Sequence[np.ndarray],
    heated: Sequence[np.ndarray],
    rig_of_dwell: Sequence[np.ndarray] | None = None,
) -> System:
    """Chains of a fitted baseline; `rig` gives each chain's positioning variance per block, `heated` the change by
    one standard deviation of the probe's error, `(block, 1)` or `(block, 0)`, `rig_of_dwell` the variance that the rig
    states of each dwell by itself."""
    own = [np.zeros(blocks.num_blocks)] * len(rig) if rig_of_dwell is None else rig_of_dwell
    white = getattr(blocks, f"{base.form.triad}_white")
    gap = np.r_[0.0, np.maximum(np.diff(blocks.time), 0.0)]
    anew = lambda numbers: np.r_[1.0, (np.diff(numbers) != 0).astype(float)]
    fresh, cycle = anew(blocks.dwell), anew(blocks.cycle)
    set_anew = anew(positioned(blocks, base.form.triad))
    chains, scales = [], []
    for c, _ in enumerate(base.observed):
        if len(base.observed) == 1:
            level = (white * base.loads[0] ** 2).sum(axis=1)
        else:
            level = white[:, c]
        chains.append(
            Chain(level, base.loads[c], gap, fresh, set_anew, cycle, rig[c], own[c], heated[c])
        )
        mean = float(np.mean(level[level <= SHAKEN * np.median(level)]))
        scales.append(np.array([1.0, mean, mean / 1000.0, mean, mean, 0.5, 1.0]))
    frames = tuple(span(x / np.linalg.norm(x, axis=0)) for x in base.columns)
    longer = tuple(jax.tree.map(lengthen, chain) for chain in chains)
    nothing = tuple(Known.nothing() for _ in chains)
    return System(base, tuple(chains), tuple(scales), frames, longer, nothing)


def positioned(blocks: Blocks, triad: str) -> Int[np.ndarray, " block"]:
    """Number of the positioning whose error each block has; plateaus that share one are `positionings_of`.

    Accelerometers at rest feel how the case is mounted, which stays while a table turns about the vertical. Gyros at
    rest feel next to nothing of it, and their plateaus in between decide it.
    """
    return blocks.attitude if triad == "accel" else blocks.dwell


def share(
    system: System,
    blocks: Blocks,
    reading: np.ndarray,
    angle: float,
    rate: float,
    positioning: np.ndarray | None,
    standing: StandingErrors | None = None,
) -> System:
    """The system with the rig's errors shared between the chains, between plateaus of one `positioning`, and between
    rests through which an axis stands, where there are such and not too many."""
    white = np.stack([chain.white for chain in system.chains], axis=1)
    number = positioned(blocks, system.base.form.triad)
    alone = np.ones(blocks.num_blocks) if standing is None else np.maximum(1.0 - standing.part, 0.0)
    angles = angle * np.sqrt(alone)
    errors, own = signatures(reading, number, white, angles, rate, positioning)
    if errors.shape[2] > MOST and positioning is not None:  # those of positionings count most
        several = positioning >= 0
        there = signatures(
            reading[several],
            number[several],
            white[several],
            angles[several],
            rate,
            positioning[several],
        )
        errors, own = np.zeros((len(several), 3, there[0].shape[2])), np.full(own.shape, np.nan)
        errors[several], own[several] = there
    if standing is not None:
        errors = np.concatenate([errors, getattr(standing, system.base.form.triad)], axis=2)
    if not 0 < errors.shape[2] <= MOST:
        return system
    free = []
    for k, chain in enumerate(system.chains):
        kept = np.where(np.isnan(own[:, k]), alone * chain.rig, own[:, k])
        free.append(eqx.tree_at(lambda c: c.rig, chain, kept))
    longer = tuple(jax.tree.map(lengthen, chain) for chain in free)
    columns = tuple(errors[:, c] for c in range(3))
    return eqx.tree_at(
        lambda s: s.shared,
        system,
        SharedErrors(columns, longer, lasting=standing is not None),
        is_leaf=lambda x: x is None,
    )


def positionings_of(blocks: Blocks) -> np.ndarray | None:
    """Number of the positioning that the block's plateau shares with others, −1 elsewhere; `None` without plateaus."""
    if blocks.reference_gyro is None:
        return None
    force = known_force(blocks.reference_accel, blocks.accel)
    number = shared_positionings(
        blocks.position, blocks.reference_gyro, None if force is None else np.asarray(force)
    )
    for group in np.unique(number[number >= 0]):
        if len(np.unique(blocks.dwell[number == group])) == 1:
            number[number == group] = -1
    return number if np.any(number >= 0) else None


class NoiseFit(eqx.Module):
    """Fitted variances of every chain, and minus the log likelihood reached."""

    theta: tuple[np.ndarray, ...]
    value: tuple[float, ...]
    # Log variances of each chain where the rig's errors couple the chains: dwell and rig fitted to all together.
    coupled: tuple[np.ndarray, ...] | None = None
    # Of minus the log likelihood at the fit, for the next one of the same chain; nothing where none was fitted.
    curvature: tuple[np.ndarray | None, ...] = ()

    def curvature_of(self, chain: int) -> np.ndarray | None:
        """The curvature that a fit of this chain found, if one did."""
        return self.curvature[chain] if chain < len(self.curvature) else None

    @property
    def total(self) -> float:
        """Minus the restricted log likelihood over all chains."""
        return float(sum(self.value))


def variances(system: System, noise: NoiseFit) -> list[Variances]:
    """Variance components in SI units squared, chain by chain."""
    return [jax.tree.map(float, unpack(t, s)) for t, s in zip(noise.theta, system.scales)]
