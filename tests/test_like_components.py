"""Two components of one effect on one channel: both told, or one with its setting sought anew."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from diagnose_cases import candidate
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose.estimates.like_components import one_of_like_components
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.problem import prepare, retuned
from inertiax.diagnose.selection.constraints import barred
from inertiax.diagnose.selection.evidence import Candidate
from inertiax.diagnose.selection.multiple_testing import Family
from inertiax.diagnose.selection.score_test import whiten_system
from inertiax.diagnose.selection.verdict import Answer, Named
from inertiax.effects import CATALOGUE, Signal


WARM_UP = tuple(e for e in CATALOGUE if e.name == "warm_up")
WHITE = 1e-6  # rad/s, one sample


def warming(*parts):
    """Gyros at rest for 1500 s, 1 Hz, that settle by some (size, time constant) each; ready to be diagnosed."""
    rng = np.random.default_rng(8)
    time = np.arange(1500.0)
    output = WHITE * rng.standard_normal((len(time), 3)) + 1e-4
    output[:, 0] += sum(c * np.exp(-time / tau) for c, tau in parts)
    recording = Recording(time=time, gyro=output, position=(time // 25).astype(int))
    model = ModelChoice(gyro_estimator="static", temperature_degree=0)
    campaign = Campaign((recording,), Site(9.81), Rig(), model, "tactical")
    (prepared,) = prepare(campaign, WARM_UP).triads
    return prepared


def answered(prepared, *settings):
    """The answer that names a component of x with each of these settings, as a search finds it on its grid."""
    like = next(t for t in prepared.candidates if t.name == "warm_up" and t.channels == (0,))
    terms = retuned(prepared, like, settings)
    noise = fit_noise(prepared.system, terms)
    named = []
    for k, term in enumerate(terms):
        (score,) = whiten_system(prepared.system, noise, [term], terms[:k] + terms[k + 1 :]).scores
        named.append(Named(Candidate(term, score, score.gain, 0.5 * score.gain), 1e-9, ()))
    tests = Family({}, 1.0)
    return Answer(
        "missing-physics",
        tuple(named),
        None,
        1.0,
        noise,
        noise,
        0.0,
        tests,
        (),
        (),
        (),
        None,
        False,
    )


@pytest.mark.slow
def test_of_two_components_that_stand_for_one_one_stays_with_its_own_setting():
    with jax.enable_x64(True):
        prepared = warming((4e-6, 130.0))
        found = one_of_like_components(prepared, answered(prepared, 100.0, 170.0))
    (one,) = found.named
    assert one.candidate.term.setting == pytest.approx(130.0, rel=0.15)
    assert one.candidate.score.coefficients[0] == pytest.approx(4e-6, rel=0.15)


@pytest.mark.slow
def test_two_components_that_are_there_stay():
    with jax.enable_x64(True):
        prepared = warming((4e-5, 30.0), (4e-5, 500.0))
        found = one_of_like_components(prepared, answered(prepared, 30.0, 500.0))
    assert len(found.named) == 2


def test_a_channel_warms_up_once_when_effects_are_compared_again():
    warm, lag = candidate("warm_up", 9.0).term, candidate("drift", 9.0).term
    assert barred([warm], warm) and not barred([warm], lag) and not barred([lag], lag)
    elsewhere = replace(warm, channels=(1,))
    assert not barred([elsewhere], warm)


@pytest.mark.parametrize(("seconds", "shortest"), [(120.0, 12.0), (3000.0, 30.0)])
def test_the_time_constants_of_a_warm_up_begin_at_a_tenth_of_a_short_log(seconds, shortest):
    time, zero, rest = np.array([0.0, seconds]), np.zeros((2, 3)), np.ones(2, bool)
    signal = Signal(
        triad="gyro", time=time, input=zero, output=zero, since_power=time, since_start=time,
        since_move=time, move=zero, at_rest=rest, temperature=None, force=None, rate=zero,
        degree=0, low=0.0, high=1.0,
    )  # fmt: skip
    grid = [v.settings["time_constant"] for v in WARM_UP[0].variants(signal)]
    assert min(grid) == pytest.approx(shortest) and max(grid) == pytest.approx(max(60.0, seconds))
