"""A target that is further away than a person turns a device: what is said of it, and when nothing gains any more.

With n rests and the limits ρ times too narrow, rests like these reach them after about n (ρ² − 1) more. That many is
said once, with what limits; the session goes on, since whoever turns the device may stop where it is good enough.
"""

import math

import numpy as np

from .estimate import Estimate, Triad, TRIADS


MOST_FURTHER = (
    200  # rests; more than a person makes in a sitting (an hour at 18 s each; convention)
)
JUDGED_FROM = 18  # rests, before which ρ is mostly what the noise's prior says
# A gain that `next` says as 0 %: the person is told that no position gains. The mean of n rests alike gains 1 / 2n by
# one more, the best position about four times that: a session has some hundreds of rests by then.
NO_GAIN = 0.005


def rests_to_target(found: Estimate) -> int | None:
    """Rests like these that the target still needs, where a person does not make so many; else `None`."""
    if found.rests < JUDGED_FROM or not found.determined or not math.isfinite(found.ratio):
        return None
    further = found.rests * (found.ratio**2 - 1.0)
    return round(further) if further > MOST_FURTHER else None


def nothing_gains(found: Estimate) -> bool:
    """Whether the target is out of reach and neither the best position nor a further rest like these gains."""
    if rests_to_target(found) is None or 0.5 / found.rests >= NO_GAIN:
        return False
    position = found.next_position()
    return position is None or position.gain < NO_GAIN


def far_target_in_words(found: Estimate, further: int) -> str:
    """How far the target is, what limits, and that the session goes on."""
    return (
        f"the target is about {float(f'{further:.2g}'):.0f} rests like these away. {_limit(found)} "
        "The session goes on; stop it (Ctrl-C) when what is said so far is good enough."
    )


def _limit(found: Estimate) -> str:
    """What limits the triad that is furthest from its limits."""
    triad = max(
        (t for t in found.triads if np.isfinite(t.limits).any()),
        key=lambda t: float(np.max(t.posterior.std / t.limits)),
    )
    place = TRIADS[triad.names[0].partition(".")[0]]
    scatter, within = _scatter_and_noise(triad)
    if scatter > within:
        return (
            f"What limits is the scatter of the {place} from rest to rest, {scatter / within:.1f} times the noise "
            "within a rest: longer rests do not lessen it; firm support, or a warm device, may."
        )
    return (
        f"What limits is the noise of the {place} within a rest, {within / max(scatter, 1e-300):.1f} times the scatter "
        "from rest to rest: longer rests (--hold) lessen it."
    )


def _scatter_and_noise(triad: Triad) -> tuple[float, float]:
    """Standard deviations from rest to rest and within a rest, of one row."""
    return math.sqrt(triad.posterior.scatter_variance), math.sqrt(max(triad.own_variance, 1e-300))
