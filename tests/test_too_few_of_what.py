"""A degree over temperature that dwells do not determine: the refusal names what they are too few of."""

import numpy as np
import pytest

from inertiax.calibrate.one_triad import require_observable
from inertiax.estimators import Invariant, ReferenceAccel
from inertiax.physics.temperature import Polynomial
from inertiax.reduction.dwells import Dwells


UPS = np.array(
    [
        [a, b, c]
        for a in (-1, 0, 1)
        for b in (-1, 0, 1)
        for c in (-1, 0, 1)
        if (a, b, c) != (0, 0, 0)
    ]
)
UPS = UPS / np.linalg.norm(UPS, axis=1, keepdims=True)


def dwells(poses, temperatures):
    """Dwells of the first of 26 directions, one for each of the temperatures."""
    up = 9.81 * UPS[np.arange(len(temperatures)) % poses]
    return Dwells.from_arrays(
        accel=up, reference_accel=up, temperature=np.asarray(temperatures, float), sigma=1e-3
    )


@pytest.mark.parametrize(
    ("estimator", "made", "said", "remedy"),
    [
        # 78 dwells tell every constant, and 234 equations are more than 48 unknowns.
        (ReferenceAccel(), dwells(26, np.repeat([0.0, 40.0], 39)), "too few temperatures do not determine 24 of 48",
         "they are at 2 temperatures, and temperature_degree = 3 needs 4"),
        (ReferenceAccel(), dwells(12, np.repeat(20.0, 12)), "too few temperatures: 12 dwells give 36 equations",
         "they are all at one temperature, and temperature_degree = 3 needs 4"),
        (Invariant(9.81), dwells(26, np.linspace(0.0, 40.0, 26)),
         "too few dwells for the temperature_degree: 26 dwells give 26 equations for 36 unknowns",
         "use a lower degree (0 for constants), or record more positions at each temperature"),
        (Invariant(9.81), dwells(3, np.linspace(0.0, 40.0, 30)), "too few positions: 30 dwells give 30 equations",
         "record more positions in different orientations"),
    ],
)  # fmt: skip
def test_the_refusal_names_the_cause(estimator, made, said, remedy):
    with pytest.raises(ValueError) as refused:
        require_observable(estimator, Polynomial(3, 0.0, 40.0), made)
    assert said in str(refused.value) and remedy in str(refused.value)
