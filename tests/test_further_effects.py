"""What a chosen effect leaves for those that are sought beside it."""

from dataclasses import replace

import numpy as np
import pytest

from diagnose_cases import candidate
from inertiax.diagnose.noise.observation_series import NoiseFit
from inertiax.diagnose.observations.blocks import _pooled
from inertiax.diagnose.selection.candidate_screening import carried
from inertiax.diagnose.selection.constraints import explained_beside
from inertiax.diagnose.selection.evidence import Bank
from inertiax.diagnose.wording.explain import delta_bic
from inertiax.effects import CATALOGUE


def named(name, gain):
    made = candidate(name, 50.0)
    return replace(made, score=replace(made.score, gain=gain))


def test_what_geometry_fixes_leaves_no_trace():
    new = candidate("drift", 5.0)
    earth, jump = named("earth_rate", 8000.0), named("bias_step", 300.0)
    axis = named("table_axis_error", 2500.0)  # of several forms, each exact
    assert explained_beside([earth, axis, jump], new, {}) == pytest.approx(300.0)
    # A tilt of the pier is of the rig as well, but one of several courses in time.
    tilt = named("pier_tilt", 40.0)
    assert next(e for e in CATALOGUE if e.name == "pier_tilt").common
    assert explained_beside([earth, tilt], new, {}) == pytest.approx(40.0)
    elsewhere = replace(jump, term=replace(jump.term, chains=(1,)))
    assert explained_beside([elsewhere], new, {}) == 0.0
    # Of one that three channels have, what it explains on the candidate's own.
    lag = named("thermal_lag", 900.0)
    assert explained_beside([lag], new, {id(lag.term): {0: 0.2, 2: 0.8}}) == pytest.approx(180.0)


def test_what_was_fitted_on_other_channels_is_kept():
    before = [np.full(7, float(k)) for k in range(3)]
    other = np.full(7, 9.0)  # fitted beside a candidate on the last channel
    on_first = NoiseFit((np.full(7, 5.0), before[1], before[2]), (0.0, 0.0, 0.0))
    on_last = NoiseFit((before[0], before[1], other), (0.0, 0.0, 0.0))
    fits = (NoiseFit(tuple(before), (0.0, 0.0, 0.0)), on_first, on_last)
    noise = NoiseFit((np.full(7, -1.0), before[1], before[2]), (1.0, 2.0, 3.0))
    made = carried(Bank(fits, ()), noise, {0})
    # What was fitted on the first channel is of no use beside the new effect there.
    assert len(made) == 2
    assert all((fit.theta[0] == -1.0).all() and fit.value == noise.value for fit in made)
    assert {float(fit.theta[2][0]) for fit in made} == {2.0, 9.0}


def test_a_setting_that_is_fitted_is_paid_for():
    rows = np.exp(7.0)
    paid = {"drift": 1, "bias_step": 2, "thermal_lag": 1, "dead_band": 1, "second_order": 1}
    for name, number in paid.items():
        effect = next(e for e in CATALOGUE if e.name == name)
        assert delta_bic(30.0, 1, effect, rows) == pytest.approx(30.0 - 7.0 * number), name
    interference = next(e for e in CATALOGUE if e.name == "interference")
    assert delta_bic(30.0, 2, interference, rows) == pytest.approx(9.0)  # sine, cosine, frequency


def test_a_shaken_rest_keeps_its_noise_to_itself():
    """Eight rests of four blocks, variances by hand: a shaken one of 10⁴ and one that is loud on one axis only."""
    scatter, dwell = np.ones((32, 3)), np.repeat(np.arange(8), 4)
    scatter[dwell == 2] = 1e4
    scatter[dwell == 5, 0] = 1e4
    made = _pooled(scatter, np.full(32, 9), dwell)
    assert made[dwell == 2] == pytest.approx(1e4)
    quiet = made[dwell != 2]
    assert quiet[:, 1:] == pytest.approx(1.0)
    assert quiet[:, 0] == pytest.approx((6 * 1.0 + 1e4) / 7)
