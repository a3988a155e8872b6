"""Independent tests of an effect whose setting is sought between the points of its grid.

Where a moment in time is sought among the block edges beside the leading one of the grid, noise has as many more
chances. Under a random walk each edge is nearly a test of its own; under white noise neighbours are nearly the same.
The search is repeated on drawn noise: the grid first, then every form between the neighbours of its leading points.
"""

from collections.abc import Sequence

import numpy as np
import scipy.special
from jaxtyping import Float

from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit, System
from .multiple_testing import Count, counted, Family
from .score_test import Score, whiten_system


LEADING = 2  # points of the grid beside which forms are tried: under the fitted noise, and under less slow noise
DRAWS = 160


def recounted(
    tests: Family, system: System, noise: NoiseFit, grid: Sequence[Term], fine: Sequence[Term]
) -> Family:
    """The family with the tests of one effect counted anew: its forms on the grid, and all that lie between."""
    scores = whiten_system(system, noise, [*grid, *fine]).scores
    between = set(map(id, fine))
    number = searched_tests(
        [(s.term.setting, s) for s in scores if id(s.term) not in between],
        [(s.term.setting, s) for s in scores if id(s.term) in between],
        [len(y) for y in system.base.observed],
    )
    return tests.recounted((grid[0].name, grid[0].channels), number)


def searched_tests(
    grid: Sequence[tuple[float, Score]],
    between: Sequence[tuple[float, Score]],
    lengths: Sequence[int],
    draws: int = DRAWS,
) -> Count:
    """Independent tests with the same smallest p-value as a search from the grid to the forms between.

    **Arguments:** settings with their scores, of one effect on its channels; `lengths` of the chains' rows.
    """
    rng = np.random.default_rng(20240229)
    noise = [rng.standard_normal((n, draws)) for n in lengths]
    coarse = _chances([s for _, s in grid], noise)
    fine = _chances([s for _, s in between], noise)
    forms = [s for _, s in (*grid, *between)]
    if not grid:  # the calibration absorbs every point of it
        return counted(fine.min(axis=0, initial=1.0), forms)
    points = np.unique([value for value, _ in grid])
    place = np.searchsorted(points, [value for value, _ in grid])
    by_point = np.stack([coarse[place == k].min(axis=0) for k in range(len(points))])
    values = np.array([value for value, _ in between])
    smallest = by_point.min(axis=0)
    leading = np.argsort(by_point, axis=0)[:LEADING]
    for k in range(draws):
        for point in leading[:, k]:
            low, high = points[max(point - 1, 0)], points[min(point + 1, len(points) - 1)]
            inside = (values > low) & (values < high)
            smallest[k] = min(smallest[k], fine[inside, k].min(initial=1.0))
    return counted(smallest, forms)


def _chances(
    scores: Sequence[Score], noise: Sequence[np.ndarray]
) -> Float[np.ndarray, "form draw"]:
    """P-value of each form's gain on each draw of white residuals."""
    made = np.ones((len(scores), noise[0].shape[1]))
    alone: dict[int, list[int]] = {}  # of one column on one chain: all at once
    for k, s in enumerate(scores):
        if len(s.chains) == 1 and s.term.size == 1:
            alone.setdefault(s.chains[0], []).append(k)
            continue
        part = sum(w.T @ noise[c] for w, c in zip(s.white, s.chains))
        made[k] = scipy.special.chdtrc(s.size, np.square(s.turn.T @ part).sum(axis=0))
    for c, mine in alone.items():
        unit = np.concatenate([scores[k].white[0] @ scores[k].turn for k in mine], axis=1)
        made[mine] = scipy.special.chdtrc(1, np.square(unit.T @ noise[c]))
    return made
