"""Signatures: what every catalogued effect, in every form and on every channel, would do to the rows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from jaxtyping import Float

from ..._jax import jax, jnp
from ...effects import Effect, Signal, Variant
from ..observations.blocks import Blocks, MOST_BLOCKS
from ..observations.model_rows import Baseline


BATCH = 32  # settings evaluated together
STILL = "the temperature moves by no more than the least step of its readings"
NO_RATES = "no rates but Earth's"
UNFELT = 2e-3  # part of an addition's square that must reach the rows: a rotation leaves |a| alone


INPUTS = ("rate", "specific_force", "input", "attitude")  # drivers of effects
ON_INPUT = ("scale", "misalignment")  # what an effect acts on where its columns go with the input
BY_DWELL = ("input", "move", "position")  # in names of unlisted dependences that follow them


@dataclass(frozen=True, eq=False)
class Term:
    """One candidate: an effect in one form on some channels, as columns of rows."""

    name: str
    triad: str
    channels: tuple[int, ...]
    variant: Variant
    chains: tuple[int, ...]  # which chains of rows it touches
    columns: tuple[Float[np.ndarray, "block column"], ...]  # one array for each of those chains
    effect: Effect | None = None  # None for a structured alternative

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Such as `accel_y`."""
        return tuple(f"{self.triad}_{'xyz'[c]}" for c in self.channels)

    @property
    def known(self) -> Effect:
        """The catalogued effect. Raises `ValueError` for a structured alternative."""
        if self.effect is None:
            raise ValueError(f"{self.name} is not an effect of the catalogue")
        return self.effect

    @property
    def joint(self) -> bool:
        """Whether one set of coefficients serves all channels."""
        return len(self.channels) > 1

    @property
    def setting(self) -> float:
        """What enters non-linearly: a time constant, a moment. Raises `ValueError` for a structured alternative."""
        effect = self.known
        if not effect.nuisance:
            raise ValueError(f"{self.name} has no setting")
        return float(self.variant.settings[effect.nuisance])

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.columns[0].shape[1]

    @property
    def scales_input(self) -> bool:
        """Whether a catalogued effect acts on a scale factor or misalignment, so that its columns go with the input."""
        return self.effect is not None and self.variant.settings.get("on", "bias") in ON_INPUT

    @cached_property
    def follows_input(self) -> bool:
        """Whether the columns are a function of what the triad feels, dwell by dwell, of one channel.

        Products with time or temperature are among them: rivals must be judged under one noise.
        """
        if self.effect is None:
            return any(word in self.name for word in BY_DWELL)
        return self.effect.driver in INPUTS and not self.effect.common

    @property
    def like_the_rig(self) -> bool:
        """Whether the rig's errors, dwell by dwell, can do what it does: its columns go with the input, of one channel
        or, as an error of the station does, of all. A pier's tilt that grows is one: what axes that stand err by grows
        by chance."""
        of_the_station = self.effect is not None and self.effect.common
        return self.follows_input or self.scales_input or of_the_station


def bucket(rows: int, finest: int = 4) -> int:
    """The next power of two, or of `finest` equal steps between two of them, from 256 on."""
    base = 256
    while 2 * base < rows:
        base *= 2
    return next(s for s in (base + base * n // finest for n in range(finest + 1)) if s >= rows)


def block_shapes(
    effect: Effect, variants: Sequence[Variant], signal: Signal, coarse: Signal, blocks: Blocks
) -> list[np.ndarray]:
    """The effect's additions for unit coefficients at the blocks, `(block, 3, column)` for each variant."""
    where = coarse if effect.slow else signal
    make = _evaluated if effect.in_numpy else _compiled
    made = []
    for shape in make(effect, variants, where):
        shape = shape if effect.slow else blocks.felt(shape)
        made.append(np.broadcast_to(shape, (shape.shape[0], 3, shape.shape[2])))
    return made


def _evaluated(
    effect: Effect, variants: Sequence[Variant], signal: Signal
) -> Iterator[Float[np.ndarray, "time channels columns"]]:
    """The shape in each form, as it stands."""
    for variant in variants:
        yield np.asarray(effect.shape(signal, **variant.settings), float)


def _compiled(
    effect: Effect, variants: Sequence[Variant], signal: Signal
) -> list[Float[np.ndarray, "time channels columns"]]:
    """The shape in each form by JAX; variants that differ in numbers only are evaluated together."""
    rows, signal = len(signal.time), _padded(signal, len(signal.time))
    groups: dict[tuple, list[int]] = {}
    for k, variant in enumerate(variants):
        numbers = tuple(sorted(n for n, v in variant.settings.items() if isinstance(v, float)))
        others = tuple(
            sorted((n, v) for n, v in variant.settings.items() if not isinstance(v, float))
        )
        groups.setdefault((numbers, others), []).append(k)
    made: list[np.ndarray] = [np.empty(0)] * len(variants)
    for (numbers, others), members in groups.items():
        for first in range(0, len(members), BATCH):
            part = members[first : first + BATCH]
            grid = [[variants[k].settings[n] for k in part] for n in numbers]
            together = _evaluate(effect, numbers, others, signal, grid, len(part))
            for k, shape in zip(part, together):
                made[k] = shape[:rows]
    return made


def _padded(signal: Signal, rows: int) -> Signal:
    """The signal lengthened to a bucket size by repeats of its last row, as arrays of JAX.

    Campaigns of nearly the same length then share their compiled programs.
    """
    extra = bucket(rows, finest=1 if rows > MOST_BLOCKS else 4) - rows

    def longer(x):
        if isinstance(x, np.ndarray) and x.ndim and x.shape[0] == rows:
            return jnp.asarray(np.concatenate([x, np.repeat(x[-1:], extra, axis=0)]))
        return jnp.asarray(x) if isinstance(x, (np.ndarray, float)) else x

    return jax.tree.map(longer, signal)


def _evaluate(effect, numbers, others, signal, grid, count) -> np.ndarray:
    if count < 3 and effect.nuisance not in numbers:  # constants: a shape may branch on them
        settings = [(*others, *zip(numbers, values)) for values in zip(*grid)] or [others] * count
        return np.stack([np.asarray(_at(effect.shape, s, signal), float) for s in settings])
    # The batch has one size, so that one compiled program serves every grid.
    full = [np.resize(np.asarray(values, float), BATCH) for values in grid]
    return np.asarray(_over_grid(effect.shape, numbers, others, signal, full), float)[:count]


@partial(jax.jit, static_argnums=(0, 1))
def _at(shape, settings, signal):
    return shape(signal, **dict(settings))


@partial(jax.jit, static_argnums=(0, 1, 2))
def _over_grid(shape, numbers, others, signal, grid):
    def one(*values):
        return shape(signal, **dict(zip(numbers, values)), **dict(others))

    return jax.vmap(one)(*grid)


def coarsen(signal: Signal, blocks: Blocks) -> Signal:
    """The signal averaged over blocks."""
    num = len(signal.time)

    def mean(x):
        if isinstance(x, np.ndarray) and x.ndim and x.shape[0] == num:
            return blocks.mean(x)
        return x

    return jax.tree.map(mean, signal)


def terms(
    catalogue: tuple[Effect, ...], signal: Signal, blocks: Blocks, base: Baseline
) -> tuple[list[Term], dict[str, str]]:
    """All candidates of one triad, and for each effect that cannot be tested why not."""
    coarse = coarsen(signal, blocks)
    greatest = float(np.abs(np.asarray(coarse.input)).max())
    found: list[Term] = []
    missing: dict[str, str] = {}
    for effect in catalogue:
        if signal.triad not in effect.triads:
            continue
        lacking = [k for k in effect.requires if getattr(signal, k) is None]
        if lacking:
            still = "temperature" in lacking and blocks.temperature is not None
            named = f"no {', '.join(lacking)} recorded or known"
            missing[effect.name] = STILL if still else named
            continue
        if signal.triad == "gyro" and greatest < effect.least_rate:
            missing[effect.name] = NO_RATES
            continue
        variants = effect.variants(coarse if effect.slow else signal)
        if not variants:
            missing[effect.name] = "does not apply to this model and recording"
        for variant, addition in zip(
            variants, block_shapes(effect, variants, signal, coarse, blocks)
        ):
            if not effect.common and effect.singly:
                found.extend(channel_terms(effect, variant, base, addition))
            if effect.common or effect.package:
                found.extend(common_term(effect, variant, base, addition))
    return found, missing


def common_term(
    effect: Effect, variant: Variant, base: Baseline, addition: np.ndarray
) -> list[Term]:
    """One term with the same coefficients on all channels; none where the rows hardly feel it."""
    made = _joint(effect, variant, base, addition)
    felt, added = sum(float(np.sum(r**2)) for r in made.columns), float(np.sum(addition**2))
    return [] if felt < UNFELT * added else [made]


def _joint(effect: Effect, variant: Variant, base: Baseline, addition: np.ndarray) -> Term:
    rows = tuple(base.rows(addition))
    chains = tuple(range(len(rows)))
    return Term(effect.name, base.form.triad, (0, 1, 2), variant, chains, rows, effect)


def in_other_form(term: Term, variant: Variant, base: Baseline, addition: np.ndarray) -> Term:
    """The term's effect in another form on the same channels."""
    if term.joint:
        return _joint(term.known, variant, base, addition)
    return channel_terms(term.known, variant, base, addition)[term.channels[0]]


def channel_terms(
    effect: Effect | str, variant: Variant, base: Baseline, addition: np.ndarray
) -> list[Term]:
    """Three terms, each on one channel; `effect` may be a bare name for a structured alternative."""
    name = effect if isinstance(effect, str) else effect.name
    known = None if isinstance(effect, str) else effect
    made = []
    for c in range(3):
        if len(base.observed) == 1:
            rows, chain = addition[:, c] * base.loads[0][:, c : c + 1], 0
        else:
            rows, chain = np.ascontiguousarray(addition[:, c]), c
        made.append(Term(name, base.form.triad, (c,), variant, (chain,), (rows,), known))
    return made
