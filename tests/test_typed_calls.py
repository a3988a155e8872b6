"""The checks of types that `typed_calls.py` makes rarer."""

import numpy as np
import pytest

import typed_calls
from inertiax.physics.rotation import exp


@pytest.mark.parametrize("again", [False, True])
def test_each_test_checks_shapes_anew(again):
    with pytest.raises(TypeError, match="checking the parameters of inertiax.physics.rotation.exp"):
        exp(np.zeros(4))
    for _ in range(typed_calls.CALLS):
        exp(np.zeros(3))
    with pytest.raises(ValueError):  # of the computation itself: by now no check comes before it
        exp(np.zeros(4))
