"""Directions of the specific force in the case, as a hand holds a device, and how they are said.

One wording serves where a person is told how to lay a device down: live, in a run that is proposed, in a report.
"""

import itertools

import numpy as np
from jaxtyping import Float


_AXES = ("x", "y", "z")
_TILT = np.radians(30.0)
_NONE = np.sin(np.radians(3.0))  # a component that is not said
_ALIKE = 0.05  # difference of components up to which axes point up alike

# Rests that are nearer to each other than this tell hardly more than one of them (convention: the tilt of a hand
# that means to hold still), and an invariant fit of biases and scale factors has six unknowns.
SAME_DIRECTION = np.radians(5.0)
FEWEST_DIRECTIONS = 6


def num_directions(
    outputs: Float[np.ndarray, "rest 3"], apart: float = SAME_DIRECTION, most: int | None = None
) -> int:
    """How many of the directions are further than `apart` (rad) from all others; counting ends at `most`."""
    kept = np.zeros((0, 3))
    for unit in outputs / np.maximum(np.linalg.norm(outputs, axis=1, keepdims=True), 1e-300):
        if np.all(kept @ unit < np.cos(apart)):
            kept = np.vstack([kept, unit])
        if len(kept) == most:
            break
    return len(kept)


def hand_directions() -> Float[np.ndarray, "candidate 3"]:
    """What a hand can do: six faces, twelve edges, eight corners up, and the faces tilted by 30°; easiest first."""
    signs = (-1.0, 0.0, 1.0)
    cube = [np.array(v) for v in itertools.product(signs, signs, signs) if any(v)]
    cube.sort(key=lambda v: (np.count_nonzero(v), *(-v)))
    tilted = []
    for face in cube[:6]:
        for towards in cube[:6]:
            if face @ towards == 0.0:
                tilted.append(np.cos(_TILT) * face + np.sin(_TILT) * towards)
    made = np.array([v / np.linalg.norm(v) for v in [*cube, *tilted]])
    return made + 0.0  # no negative zeros


def nearest_by_hand(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The one of `hand_directions` that is nearest to a direction."""
    candidates = hand_directions()
    return candidates[int(np.argmax(candidates @ up))]


def up_in_words(up: Float[np.ndarray, "3"]) -> str:
    """How a device rests of which this direction of the case (a unit vector) points up, to follow "it rests".

    "with +x up", "halfway between +x up and −z up", "midway between +x up, +y up and −z up", or "with +y up, tilted
    by 30° towards +x".
    """
    size = np.abs(up)
    order = [k for k in np.argsort(-size, kind="stable") if size[k] > _NONE]
    name = lambda k: f"{'+' if up[k] > 0 else '−'}{_AXES[k]}"
    first = order[0]
    if len(order) > 1 and all(abs(size[k] - size[first]) < _ALIKE for k in order):
        ups = [f"{name(k)} up" for k in sorted(order)]
        where = "halfway" if len(ups) == 2 else "midway"
        return f"{where} between {', '.join(ups[:-1])} and {ups[-1]}"
    tilts = [
        f"by {np.degrees(np.arctan2(size[k], size[first])):.0f}° towards {name(k)}"
        for k in order[1:]
    ]
    return f"with {name(first)} up" + (f", tilted {' and '.join(tilts)}" if tilts else "")
