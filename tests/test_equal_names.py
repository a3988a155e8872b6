"""What a diagnosis says first where names are equally likely, and of coefficients that the rows do not tell."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest

from inertiax.diagnose.result import Parameter
from inertiax.diagnose.wording.explain import formula
from inertiax.diagnose.wording.sentences import Said, sentence
from inertiax.effects.bias_step import EFFECT


VALUE = (("coefficient", Parameter(-0.19, 0.05, "m/s^2")),)


def said(*odds):
    names = ("bias_step", "warm_up", "cross_coupling", "second_order")
    return sentence(EFFECT, {}, [Said(("accel_y",), VALUE, tuple(zip(names, odds)))])


def test_names_that_are_as_likely_lead():
    text = said(0.32, 0.32, 0.31, 0.05)
    assert text.startswith(
        "bias_step, warm_up and cross_coupling explain accel_y about equally well. By the first of them: the bias of "
        "accel_y jumped at one moment."
    )
    assert "cannot decide between: bias_step 32 %" in text


@pytest.mark.parametrize("odds", [(0.8, 0.15, 0.05), (0.1, 0.5, 0.4), (1.0,)])
def test_a_name_that_leads_or_does_not_is_said_as_before(odds):
    assert said(*odds).startswith("The bias of accel_y jumped at one moment.")


def test_several_jumps_are_said_as_several():
    members = [Said(("accel_y",), VALUE, (), form=f"time={t}") for t in (50, 150, 250)]
    text = sentence(EFFECT, {}, members, moments=3)
    assert text.startswith("The bias of accel_y jumped at 3 moments.")


def candidate(values, sigmas):
    term = SimpleNamespace(
        triad="accel",
        channel_names=("accel_x",),
        variant=SimpleNamespace(label="sin(2 pi f / fmax + phase)"),
        columns=(np.ones((4, len(values))),),
    )
    score = SimpleNamespace(
        coefficients=np.array(values), covariance=np.diag(np.square(np.array(sigmas)))
    )
    return SimpleNamespace(term=term, score=score)


def test_a_coefficient_that_is_not_told_is_left_out():
    text = inspect.unwrap(formula)(candidate([1.55, 0.0], [0.2, 0.0]))
    assert text == "accel_x += (1.55 ± 0.2) m/s^2 · sin(2 pi f / fmax + phase)"
    both = inspect.unwrap(formula)(candidate([1.55, -0.3], [0.2, 0.1]))
    assert "(1.55 ± 0.2 , -0.3 ± 0.1)" in both
