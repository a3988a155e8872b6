"""The checks of types that `typed_calls.py` makes rarer."""

import numpy as np
import pytest
from beartype import beartype
from jaxtyping import Float

import typed_calls
from inertiax.physics.rotation import exp


@pytest.mark.parametrize("again", [False, True])
def test_each_test_checks_shapes_anew(again):
    with pytest.raises(TypeError, match=r"inertiax.physics.rotation.exp\(\) parameter"):
        exp(np.zeros(4))
    for _ in range(typed_calls.CALLS):
        exp(np.zeros(3))
    with pytest.raises(ValueError):  # of the computation itself: by now no check comes before it
        exp(np.zeros(4))


def _sum(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return a + b if len(b) != 2 else np.zeros(3)


def _sum_in_words(
    a: "Float[np.ndarray, ' n']", b: "Float[np.ndarray, ' n']"
) -> "Float[np.ndarray, ' n']":
    return _sum(a, b)


@pytest.mark.parametrize("function", [_sum, _sum_in_words])
def test_arguments_and_the_answer_share_their_sizes(function):
    checked = typed_calls.jaxtyped(function, typechecker=beartype)
    with pytest.raises(Exception, match="(?i)type"):
        checked(np.zeros(4), np.zeros(1))  # NumPy would add them
    with pytest.raises(Exception, match="(?i)return"):
        checked(np.zeros(2), np.zeros(2))
    assert len(checked(np.zeros(4), np.ones(4))) == 4
