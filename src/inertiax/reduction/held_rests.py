"""Rests that a hand held: what their means are worth by the scatter of their own parts."""

import numpy as np
from jaxtyping import Bool, Float, Int

from .handling import Undisturbed


# s, of a rest held by hand that is kept: at its ends the hand may move by millimetres a second, which over a second
# is as many mm/s² (convention).
_HELD = 1.5
PARTS = 8  # of a rest held by hand, whose scatter is that of its mean: a tremor is slower than the samples


def variance_by_parts(
    values: Float[np.ndarray, "time 3"],
    start: Int[np.ndarray, " rest"],
    stop: Int[np.ndarray, " rest"],
) -> Float[np.ndarray, "rest 3"]:
    """Variance of the mean of rows `[start, stop)` by the means of eight equal parts, in the values' unit squared.

        Var = s² / 8,   s² = Σ (part's mean − their mean)² / 7

    Samples that follow each other share a hand's tremor, which lasts for tenths of a second; parts of a rest of seconds
    hardly do. Rests of fewer than two samples a part have a variance of zero: their samples' scatter is all there is.

    ```python
    import numpy as np
    from inertiax.reduction.held_rests import variance_by_parts

    ramp = np.repeat(np.arange(8.0), 10)[:, None] * np.ones(3)
    print(variance_by_parts(ramp, np.array([0]), np.array([80])))    # [[0.75 0.75 0.75]]
    ```
    """
    found = np.zeros((len(start), 3))
    for k in np.flatnonzero(stop - start >= 2 * PARTS):
        edges = np.linspace(start[k], stop[k], PARTS + 1).astype(int)
        parts = np.array(
            [values[a:b].mean(axis=0) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        )
        found[k] = parts.var(axis=0, ddof=1) / PARTS
    return found


def kept_for_magnitude(
    left: Undisturbed,
    start: Int[np.ndarray, " rest"],
    stop: Int[np.ndarray, " rest"],
    position: Int[np.ndarray, " rest"],
    step: float,
) -> Bool[np.ndarray, " rest"]:
    """Which rests of one recording a hand held, but for long enough that they stay, as a whole, for |a|.

    **Arguments:** what is `left` of the rests `[start, stop)`, and the `step` from row to row, s.
    """
    gone = {d.position for d in left.disturbances if d.kind == "held" and d.left_out}
    empty = (left.start == left.stop)[: len(start)]
    return np.isin(position, list(gone)) & empty & ((stop - start) * step >= _HELD)
