"""Signatures: what every catalogued effect, in every form and on every channel, would do to the rows."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..effects import Effect, Signal, Variant
from .baseline import Baseline
from .blocks import Blocks


UNFELT = 2e-3  # part of an addition's square that must reach the rows: a rotation leaves |a| alone


class Term(eqx.Module):
    """One candidate: an effect in one form on some channels, as columns of rows."""

    name: str = eqx.field(static=True)
    triad: str = eqx.field(static=True)
    channels: tuple[int, ...] = eqx.field(static=True)
    variant: Variant = eqx.field(static=True)
    chains: tuple[int, ...] = eqx.field(static=True)  # which chains of rows it touches
    columns: tuple[Float[np.ndarray, "block column"], ...]  # one array for each of those chains
    effect: Effect | None = eqx.field(
        static=True, default=None
    )  # None for a structured alternative

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
    def size(self) -> int:
        """Number of coefficients."""
        return self.columns[0].shape[1]


def block_shapes(
    effect: Effect, variants: Sequence[Variant], signal: Signal, coarse: Signal, blocks: Blocks
) -> list[np.ndarray]:
    """The effect's additions for unit coefficients at the blocks, `(block, 3, column)` for each variant.

    Variants that differ in numbers only are evaluated together.
    """
    groups: dict[tuple, list[int]] = {}
    for k, variant in enumerate(variants):
        numbers = tuple(sorted(n for n, v in variant.settings.items() if isinstance(v, float)))
        others = tuple(
            sorted((n, v) for n, v in variant.settings.items() if not isinstance(v, float))
        )
        groups.setdefault((numbers, others), []).append(k)
    made: list[np.ndarray] = [np.empty(0)] * len(variants)
    where = coarse if effect.slow else signal
    for (numbers, others), members in groups.items():
        for first in range(0, len(members), 32):
            part = members[first : first + 32]
            shapes = _evaluate(effect, [variants[k] for k in part], numbers, dict(others), where)
            for k, shape in zip(part, shapes):
                shape = shape if effect.slow else blocks.mean(shape)
                made[k] = np.broadcast_to(shape, (shape.shape[0], 3, shape.shape[2]))
    return made


def _evaluate(effect, variants, numbers, others, signal) -> list[np.ndarray]:
    if len(variants) < 3 or not numbers:
        return [np.asarray(effect.shape(signal, **v.settings), float) for v in variants]
    grid = [jnp.asarray([v.settings[n] for v in variants]) for n in numbers]
    together = jax.vmap(lambda *x: effect.shape(signal, **dict(zip(numbers, x)), **others))(*grid)
    return list(np.asarray(together, float))


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
    found: list[Term] = []
    missing: dict[str, str] = {}
    for effect in catalogue:
        if signal.triad not in effect.triads:
            continue
        lacking = [k for k in effect.requires if getattr(signal, k) is None]
        if lacking:
            missing[effect.name] = f"no {', '.join(lacking)} recorded or known"
            continue
        variants = effect.variants(coarse if effect.slow else signal)
        if not variants:
            missing[effect.name] = "does not apply to this model"
        for variant, addition in zip(
            variants, block_shapes(effect, variants, signal, coarse, blocks)
        ):
            if effect.common:
                found.extend(common_term(effect, variant, base, addition))
            else:
                found.extend(channel_terms(effect, variant, base, addition))
    return found, missing


def common_term(
    effect: Effect, variant: Variant, base: Baseline, addition: np.ndarray
) -> list[Term]:
    """One term with the same coefficients on all channels; none where the rows hardly feel it."""
    rows = tuple(base.rows(addition))
    felt, added = sum(float(np.sum(r**2)) for r in rows), float(np.sum(addition**2))
    if felt < UNFELT * added:
        return []
    return [
        Term(
            effect.name, base.form.triad, (0, 1, 2), variant, tuple(range(len(rows))), rows, effect
        )
    ]


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
