"""Variances that uncertainties are stated with, and the lobes of a frequency."""

import jax
import numpy as np
import pytest

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose.estimates.parameters import tune
from inertiax.diagnose.noise import reml as variance_fit
from inertiax.diagnose.noise.observation_series import BOUNDS, variances
from inertiax.diagnose.noise.reml import fit_noise, interval_noise
from inertiax.diagnose.noise.state_space import Known
from inertiax.diagnose.problem import prepare, retuned
from inertiax.diagnose.selection.score_test import whiten_system
from inertiax.effects import CATALOGUE


G = 9.80665
REPOSITIONED = 1e-3  # m/s², one standard deviation; a block's white noise is a hundredth of it


def set_down_again(dwells, seed=0):
    """A triad at rest that is set down anew in the same pose, 20 s each, 2 Hz; a constant model."""
    rng = np.random.default_rng(seed)
    position = np.repeat(np.arange(dwells), 40)
    accel = np.array([0.0, 0.0, G]) + 2e-5 * rng.standard_normal((len(position), 3))
    accel += REPOSITIONED * rng.standard_normal((dwells, 3))[position]
    recording = Recording(0.5 * np.arange(len(position)), accel=accel, position=position)
    model = ModelChoice(accel_estimator="static", temperature_degree=0)
    return Campaign((recording,), Site(G), Rig(), model, "navigation")


def prepared(campaign, effects=()):
    return prepare(campaign, effects).triads[0]


def only_dwells(monkeypatch):
    """Pin every variance but the dwells'."""
    nothing = [(-20.0, -20.0)] * len(BOUNDS)
    nothing[0], nothing[3] = (0.0, 0.0), BOUNDS[3]
    monkeypatch.setattr(variance_fit, "BOUNDS", nothing)


@pytest.mark.slow
def test_a_variance_loses_one_degree_of_freedom_more(monkeypatch):
    only_dwells(monkeypatch)
    num = 7
    campaign = set_down_again(num)
    (recording,) = campaign.recordings
    means = np.array([recording.accel[recording.position == k].mean(axis=0) for k in range(num)])
    square = np.square(means - means.mean(axis=0)).sum(axis=0)
    with jax.enable_x64(True):
        system = prepared(campaign).system
        noise = fit_noise(system)
        stated = interval_noise(system, noise, [])
        likely = np.array([v.dwell for v in variances(system, noise)])
        wide = np.array([v.dwell for v in variances(system, stated)])
    # By hand: the restricted likelihood of SS = Σ (y − ȳ)² is σ^-(n-1) exp(−SS / 2σ²), with its maximum at
    # SS / (n − 1); the density of log σ² flat in σ has one σ more and its maximum at SS / (n − 2). The white noise
    # of a dwell's mean is 1e-5 of the square, and the search stops where the slope is 0.05 of about 3.
    assert likely == pytest.approx(square / (num - 1), rel=0.03)
    assert wide == pytest.approx(square / (num - 2), rel=0.03)


@pytest.mark.slow
def test_nothing_is_added_to_what_other_units_tell(monkeypatch):
    only_dwells(monkeypatch)
    with jax.enable_x64(True):
        system = prepared(set_down_again(7)).system
        told = Known(np.zeros(7), np.diag([0.0, 0.0, 0.0, 1e-9, 0.0, 0.0, 0.0]))
        system = type(system)(
            system.base, system.chains, system.scales, system.frames, system.longer,
            tuple(told for _ in system.chains),
        )  # fmt: skip
        noise = fit_noise(system)
        stated = interval_noise(system, noise, [])
    for one, other in zip(noise.theta, stated.theta):
        assert other == pytest.approx(one, abs=0.02)  # e-folds: where the search stops


def humming(frequency, seconds=4000.0, seed=3):
    """A triad at rest with a sine of 0.06 mm/s² on x, half a block's noise, which takes turns with pauses."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.5)
    accel = np.array([0.0, 0.0, G]) + 2.5e-4 * rng.standard_normal((len(time), 3))
    accel[:, 0] += 6e-5 * np.sin(2.0 * np.pi * frequency * time)
    recording = Recording(time, accel=accel, position=np.zeros(len(time), int))
    model = ModelChoice(accel_estimator="static", temperature_degree=0)
    return Campaign((recording,), Site(G), Rig(), model, "navigation")


@pytest.mark.slow
def test_a_frequency_is_found_from_a_neighbouring_lobe():
    true, seconds = 0.0131, 4000.0
    effect = next(e for e in CATALOGUE if e.name == "interference")
    with jax.enable_x64(True):
        one = prepared(humming(true, seconds), (effect,))
        mine = [t for t in one.candidates if t.name == "interference" and t.channels == (0,)]
        (beside,) = retuned(one, mine[0], [true + 2.6 / seconds])
        noise = fit_noise(one.system, [beside])
        term, std = tune(one, noise, beside, [])
        (score,) = whiten_system(one.system, noise, [term]).scores
    # Cramér and Rao's bound of a sine A: σ_ω² = 24 σ² / (A² N T²), and with z² = A² N / 2σ² σ_f = √3 / (π T z).
    expected = np.sqrt(3.0) / (np.pi * seconds * np.sqrt(score.gain))
    assert score.gain > 100.0
    assert std == pytest.approx(expected, rel=0.1)
    assert abs(term.setting - true) < 4.0 * expected


@pytest.mark.slow
def test_lobes_that_cannot_be_told_apart_widen_the_frequency():
    # Two minutes at either end of an hour and a half: each lobe of 1/T is nearly as high as the next.
    campaign = humming(0.0131, 6000.0)
    (recording,) = campaign.recordings
    kept = (recording.time < 240.0) | (recording.time > 5760.0)
    position = np.where(kept, 0, -1)
    gap = Recording(recording.time, accel=recording.accel, position=position)
    campaign = Campaign((gap,), campaign.site, campaign.rig, campaign.model, "navigation")
    effect = next(e for e in CATALOGUE if e.name == "interference")
    with jax.enable_x64(True):
        one = prepared(campaign, (effect,))
        mine = [t for t in one.candidates if t.name == "interference" and t.channels == (0,)]
        (start,) = retuned(one, mine[0], [0.0131])
        noise = fit_noise(one.system, [start])
        term, std = tune(one, noise, start, [])
    # Each end alone knows the frequency to about √3 / (π 240 s z), z being some 4 there: 6e-4 Hz, three lobes.
    assert 0.5 / 6000.0 < std < 6e-4
    assert abs(term.setting - 0.0131) < 3.0 * std


@pytest.mark.slow
def test_the_search_ends_no_lower_than_scipys_from_the_same_starts():
    import scipy.optimize

    from inertiax.diagnose.noise.observation_series import STARTS
    from inertiax.diagnose.noise.reml import likelihood_inputs
    from inertiax.diagnose.noise.state_space import value_and_gradient

    with jax.enable_x64(True):
        system = prepared(set_down_again(12, seed=3)).system
        found = fit_noise(system)
        for c in range(3):
            inputs = likelihood_inputs(system, c, [])

            def objective(theta, c=c, inputs=inputs):
                value, slope = value_and_gradient(
                    theta, system.scales[c], system.chains[c], *inputs, system.known[c]
                )
                return float(value), np.asarray(slope)

            peers = [
                scipy.optimize.minimize(objective, s, jac=True, method="L-BFGS-B", bounds=BOUNDS)
                for s in STARTS
            ]
            # It ends where a step gains less than 1e-3, and valleys are long; models are chosen by several.
            assert found.value[c] < min(p.fun for p in peers) + 0.2
