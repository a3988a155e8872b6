"""A fitted effect has as many coefficients as its form, and settings of the right kind: else one line says so."""

import numpy as np
import pytest

import inertiax as ix
from inertiax.effects import CATALOGUE
from inertiax.effects.forms import num_coefficients


def made(name, count, unit, triad="gyro", **settings):
    return ix.FittedEffect(
        name, triad, (1,), tuple(settings.items()), np.ones(count), np.eye(count), unit
    )


RATE = "rad/s/(degC/min)"


@pytest.mark.parametrize(
    ("count", "settings", "said"),
    [
        (2, {"on": "bias", "time_constant": 0.0}, "2 coefficients; in this form the effect has 1"),
        (1, {"on": "gradient", "time_constant": 0.0}, "1 coefficients; .* the effect has 2"),
        (1, {"on": None, "time_constant": 0.0}, "'on' is nan; it must be text"),
        (1, {"on": 1, "time_constant": 0.0}, "'on' is 1; it must be text"),
        (1, {"on": "bias", "time_constant": None}, "'time_constant' is nan; it must be a number"),
        (
            1,
            {"on": "bias", "time_constant": "long"},
            "'time_constant' is long; it must be a number",
        ),
        (1, {"on": "temperature", "time_constant": 0.0}, "must be 'bias' or 'scale' or 'gradient'"),
    ],
)
def test_a_form_that_is_none_is_refused(count, settings, said):
    with pytest.raises(ValueError, match=said):
        made("temperature_rate", count, RATE, **settings)


def test_another_effect_has_its_own_count():
    with pytest.raises(ValueError, match="2 coefficients; in this form the effect has 1"):
        made("second_order", 2, "m/s^2/g^2", "accel")
    assert made("second_order", 1, "m/s^2/g^2", "accel").coefficients.shape == (1,)
    assert made("temperature_rate", 1, RATE, on="bias", time_constant=50).settings


def test_counts_are_those_of_the_equations():
    counts = {"size_effect": 3, "second_order": 1, "time_delay": 1, "table_misalignment": 3}
    for effect in CATALOGUE:
        if effect.name in counts and effect.in_numpy:
            assert num_coefficients(effect, effect.triads[0], {}, 1) == (counts[effect.name],)
    # The vertical axis is left out where it is known.
    (tilt,) = (e for e in CATALOGUE if e.name == "pier_tilt")
    assert num_coefficients(tilt, "accel", {"course": "linear"}, 1) == (2, 3)
