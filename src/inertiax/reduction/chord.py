"""By how much the mean of a force that turns in the case is shorter than the force: a hand holds nothing still."""

import numpy as np
from jaxtyping import Float, Int


_BEYOND_NOISE = (
    4.0  # standard deviations, by which a turn shortens a mean more than noise does (convention)
)
_NO_REST = 0.01  # a direction that scatters by 8° rms, or outputs that are noise: no rest whose length is known
_FEWEST = 4  # samples of a part, whose mean has an eighth of a sample's variance across at most
_MOST_PARTS = 32  # of a rest: what turns within one of these shortens its mean by a thousandth of what it does to all


def shortening(
    values: Float[np.ndarray, "row 3"], starts: Int[np.ndarray, " rest"]
) -> Float[np.ndarray, " rest"]:
    """Part by which the mean over each rest is shorter than the force, 0 where nothing turns.

    A direction that scatters by θ, rms, about its mean has a mean vector that is shorter by θ²/2: 0.1 % at 2.6°. With
    the means $m_p$ of up to 32 equal parts of a rest, and what the samples' scatter within parts gives to their
    directions taken away,

        (⟨|m_p|⟩ − |⟨m_p⟩| − ⟨(tr S_p − uᵀ S_p u) / (2 |m|)⟩ (1 − 1/P)) / |⟨m_p⟩|,

    with $S_p$ the diagonal covariance of $m_p$ and u the direction of the mean. Noise lengthens each of them by as
    much, and is no turn; what it may give by chance is 0.

    **Arguments:** `values` in any unit, the rows of the rests one after the other; `starts` are their first rows.

    ```python
    import numpy as np
    from inertiax.reduction.chord import shortening

    angle = np.linspace(-0.05, 0.05, 320)    # rad, from end to end of a rest
    force = 9.81 * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    print(shortening(force, np.array([0])))    # [0.00041...]: 0.1**2 / 24
    ```
    """
    counts = np.diff(np.append(starts, len(values)))
    parts = np.clip(counts // _FEWEST, 1, _MOST_PARTS)
    owner = np.repeat(np.arange(len(counts)), parts)
    first = np.cumsum(parts) - parts
    within = np.arange(len(owner)) - first[owner]
    edges = starts[owner] + within * counts[owner] // parts[owner]
    size = np.diff(np.append(edges, len(values)))[:, None]
    # Axis by axis: along rows of three numbers NumPy takes six times as long.
    values = np.asfortranarray(values)
    over = lambda x: np.stack([np.add.reduceat(column, edges) for column in x.T], axis=1)
    mean = over(values) / size
    scatter = np.maximum(over(values**2) / size - mean**2, 0.0) / np.maximum(size - 1, 1)
    of_rest = lambda x: np.add.reduceat(x, first, axis=0) / parts.reshape(-1, *[1] * (x.ndim - 1))
    whole = of_rest(mean)
    length = np.linalg.norm(whole, axis=1)
    kept = np.where(length > 0.0, length, 1.0)
    u = whole / kept[:, None]
    noise = of_rest(scatter)
    across = noise.sum(axis=1) - np.sum(noise * u**2, axis=1)
    longer = of_rest(np.linalg.norm(mean, axis=1)) - length
    by_noise = across / (2.0 * kept) * (1.0 - 1.0 / parts)
    turned = longer - by_noise
    # Two channels across and P parts are 2 (P - 1) degrees of freedom, of which χ² scatters by one in √(P - 1).
    seen = turned > _BEYOND_NOISE * by_noise / np.sqrt(np.maximum(parts - 1, 1))
    seen &= (parts > 1) & (turned < _NO_REST * length)
    return np.where(seen, turned / kept, 0.0)


def shortening_within(
    values: Float[np.ndarray, "time 3"],
    start: Int[np.ndarray, " range"],
    stop: Int[np.ndarray, " range"],
) -> Float[np.ndarray, " range"]:
    """`shortening` of the rows `[start, stop)` of each of some ranges."""
    counts = stop - start
    first = np.cumsum(counts) - counts
    return shortening(values[np.arange(counts.sum()) + np.repeat(start - first, counts)], first)
