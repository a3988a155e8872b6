"""Plan audit: what a campaign could show, before any of its outputs is looked at.

Only the plan enters: inputs, temperatures, times and the expected noise. A signature that the
calibration absorbs is not testable; signatures that overlap after the calibration is projected out
cannot be told apart in this plan, whatever the noise.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np

from ..effects import CATALOGUE, Effect
from ..recordings import Campaign
from .alternatives import PREFIX
from .engine import prepare, Prepared
from .quantify import detectable
from .result import Detectable
from .system import fit_noise, NoiseFit, Score, START, whiten_system


ALIASED = 0.95  # R² of two projected signatures from which they count as one


class Alias(eqx.Module):
    """Two effects on the same channel that this plan shows in the same way."""

    channel: str = eqx.field(static=True)
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    r_squared: float = eqx.field(static=True)


class Audit(eqx.Module):
    """What a plan can tell."""

    not_testable: tuple[tuple[str, str], ...] = eqx.field(static=True)  # name and reason
    detectable: tuple[Detectable, ...]
    aliases: tuple[Alias, ...]

    def lines(self) -> tuple[str, ...]:
        """The audit as lines of text."""
        made = [f"not testable: {name} ({why})" for name, why in self.not_testable]
        made += [
            f"detectable from {d.size:.2g} {d.unit}: {d.name} on {', '.join(d.channels)}"
            for d in self.detectable
        ]
        made += [
            f"not separable on {a.channel}: {a.first} and {a.second} (R² {a.r_squared:.3f})"
            for a in self.aliases
        ]
        return tuple(made)


def audit(
    campaign: Campaign, *, effects: Sequence[Effect] = CATALOGUE, estimate_noise: bool = False
) -> Audit:
    """Audit the plan of a one-device campaign.

    **Arguments:** `campaign` may be simulated: its outputs serve only to know the specific force and the noise
    inside blocks. With `estimate_noise` the variance components are fitted to the outputs, else a
    moderate flicker beside the white noise is assumed. **Returns** an `Audit`.
    """
    with jax.enable_x64(True):
        _, triads = prepare(campaign, effects)
        absent, sizes, aliases, seen = [], [], [], set()
        for prepared in triads:
            scores = _scores(prepared, estimate_noise)
            seen |= {s.term.name for s in scores}
            sizes.extend(detectable(scores))
            aliases.extend(_aliases(scores))
        for effect in effects:
            if effect.name not in seen:
                why = [p.missing[effect.name] for p in triads if effect.name in p.missing]
                absent.append(
                    (
                        effect.name,
                        why[0] if why else "the calibration itself absorbs it in this plan",
                    )
                )
        return Audit(tuple(absent), tuple(sizes), tuple(aliases))


def _scores(prepared: Prepared, estimate_noise: bool) -> tuple[Score, ...]:
    system = prepared.system
    if estimate_noise:
        noise = fit_noise(system)
    else:
        noise = NoiseFit(tuple(START for _ in system.chains), tuple(0.0 for _ in system.chains))
    listed = [t for t in prepared.candidates if not t.name.startswith(PREFIX)]
    return whiten_system(system, noise, listed).scores


def _aliases(scores: Sequence[Score]) -> list[Alias]:
    """Pairs of effects of one channel whose best-matching forms overlap."""
    made = []
    for channel in sorted({s.term.channel_names for s in scores}):
        mine = [s for s in scores if s.term.channel_names == channel]
        names = list(dict.fromkeys(s.term.name for s in mine))
        for i, first in enumerate(names):
            for second in names[i + 1 :]:
                overlap = _overlap(
                    [s for s in mine if s.term.name == first],
                    [s for s in mine if s.term.name == second],
                )
                if overlap > ALIASED:
                    made.append(Alias(", ".join(channel), first, second, overlap))
    return made


def _overlap(first: Sequence[Score], second: Sequence[Score]) -> float:
    """Largest R² between a direction of one effect's forms and the other's single forms."""
    a = (
        np.concatenate([np.concatenate(s.directions) for s in first if s.size == 1], axis=1)
        if any(s.size == 1 for s in first)
        else None
    )
    b = (
        np.concatenate([np.concatenate(s.directions) for s in second if s.size == 1], axis=1)
        if any(s.size == 1 for s in second)
        else None
    )
    if a is None or b is None:
        return 0.0
    return float(np.square(a.T @ b).max())
