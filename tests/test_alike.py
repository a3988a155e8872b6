"""What two channels of a triad tell of the third one's noise."""

from dataclasses import replace

import jax
import numpy as np
import pytest
import scipy.stats

from inertiax.data.recording import Campaign, ModelChoice, Rig
from inertiax.diagnose import diagnose
from inertiax.diagnose.noise.observation_series import NoiseFit
from inertiax.diagnose.noise.pooled_channels import _log_likelihood, alike, SCATTER, TOLD
from inertiax.diagnose.noise.reml import fit_noise, LEARNED, likelihood, likelihood_inputs
from inertiax.diagnose.noise.state_space import WALK
from inertiax.diagnose.noise.type_noise import learn_chain
from inertiax.diagnose.problem import prepare
from inertiax.numerics.student_t import HeavyTails, TAILS, WIDTH
from type_noise_data import anova, DWELL, FEW, ORDER, pooled, unit


PLACE = ORDER.index("dwell")


def system_of(campaign, catalogue=()):
    """The rows of the campaign's only triad, and its candidates."""
    (prepared,) = prepare(campaign, catalogue).triads
    return prepared.system, prepared.candidates


def told(system, chain):
    """Mean of the log variance of a channel's dwells (SI) and its standard deviation, scatter left out."""
    known = system.known[chain]
    seen = np.flatnonzero(np.diag(known.precision))
    covariance = np.linalg.inv(known.precision[np.ix_(seen, seen)])
    k = list(seen).index(PLACE)
    mean = known.center[PLACE] + np.log(system.scales[chain][PLACE])
    return mean, np.sqrt(covariance[k, k] - SCATTER**2)


@pytest.mark.slow
def test_two_channels_tell_the_textbooks_variance_of_the_third():
    campaign = unit(5)
    with jax.enable_x64(True):
        system, _ = system_of(campaign)
        found = alike(system, fit_noise(system))
    for c in range(3):
        expected = np.log(np.mean([anova(campaign, k) for k in range(3) if k != c]))
        mean, spread = told(found, c)
        # Two channels of 44 degrees of freedom: sqrt(2 / 88) = 0.15, and flicker may take a part of it over.
        assert 0.12 < spread < 0.4
        assert abs(mean - expected) < 2.0 * spread
        # White noise and what the station promises are each channel's own.
        assert not found.known[c].precision[[0, 5, 6]].any()


@pytest.mark.slow
def test_a_noisier_channel_says_so_itself():
    campaign = unit(6, dwell=DWELL * np.array([1.0, 1.0, 2.0]))
    with jax.enable_x64(True):
        system, _ = system_of(campaign)
        found = alike(system, fit_noise(system))
        noise = fit_noise(found)
    mean, _ = told(found, 2)
    assert abs(mean - np.log(DWELL**2)) < 0.5
    own = noise.theta[2][PLACE] + np.log(found.scales[2][PLACE])
    # 44 degrees of freedom tell a log variance to 0.21, the others to 0.15 and a scatter of 0.5 with heavy tails: of
    # the distance of 1.4 between them a fifth may be lost.
    assert own - np.log((2.0 * DWELL) ** 2) == pytest.approx(-0.2, abs=0.5)


@pytest.mark.slow
def test_a_drift_shows_more_clearly_beside_channels_that_are_alike():
    # As with the noise of a type: six standard deviations, 36 in the likelihood ratio under the true noise.
    alone, helped = [], []
    with jax.enable_x64(True):
        for seed in range(31, 39):
            system, candidates = system_of(unit(seed, dwells=12, added=9e-4), FEW)
            mine = [t for t in candidates if t.name == "drift" and t.channels == (1,)]
            term = next(t for t in mine if t.variant.label == "bias")
            for rows, ratios in (
                (system, alone),
                (alike(system, fit_noise(system)), helped),
            ):
                without, beside = fit_noise(rows), fit_noise(rows, [term])
                ratios.append(2.0 * (without.value[1] - beside.value[1]))
    # Two channels of nine degrees of freedom each know the noise less well than four units do.
    assert np.mean(alone) + 2.0 < np.mean(helped) < 36.0


@pytest.mark.slow
def test_what_was_chosen_on_one_channel_is_no_noise_of_the_others():
    with jax.enable_x64(True):
        system, candidates = system_of(unit(7, dwells=24, added=6e-3), FEW)
        mine = [t for t in candidates if t.name == "drift" and t.channels == (1,)]
        term = next(t for t in mine if t.variant.label == "bias")
        without = alike(system, fit_noise(system))
        beside = alike(system, fit_noise(system, [term]), [term])
        clean, _ = system_of(unit(7, dwells=24), FEW)
        expected = alike(clean, fit_noise(clean))
    slow = [ORDER.index("flicker"), ORDER.index("walk")]
    for chain in (0, 2):
        raised, kept, true = (s.known[chain].center[slow] for s in (without, beside, expected))
        assert np.abs(kept - true).max() < 1.0 < np.abs(raised - true).max()


@pytest.mark.slow
def test_a_diagnosis_beside_alike_channels_invents_nothing():
    found = diagnose(unit(33, dwells=12, added=1.5e-3), effects=FEW)
    assert [(e.name, e.channels) for e in found.effects] == [("drift", ("accel_y",))]
    clean = diagnose(unit(33, dwells=12), effects=FEW)
    assert clean.verdict == "consistent"
    assert TOLD.format(triad="accel") in clean.as_dict()["noise"]


@pytest.mark.slow
def test_rows_of_one_chain_and_known_noise_stay_as_they_are():
    campaign = unit(8)
    model = ModelChoice(accel_estimator="invariant", temperature_degree=0)
    magnitude = Campaign(campaign.recordings, campaign.site, Rig(), model, "tactical")
    with jax.enable_x64(True):
        system, _ = system_of(magnitude)
        assert alike(system, fit_noise(system)) is system
        informed = pooled([unit(1), unit(2)]).inform(system_of(campaign)[0])
        assert alike(informed, fit_noise(informed)) is informed


@pytest.mark.slow
def test_the_draws_likelihood_is_that_of_one_fit_at_a_time():
    with jax.enable_x64(True):
        system, candidates = system_of(unit(9, dwells=12), FEW)
        chosen = [next(t for t in candidates if t.channels == (1,))]
        noise = fit_noise(system)
        unit_of = np.log(system.scales[1][LEARNED])
        logs = noise.theta[1][LEARNED] + unit_of + np.array([[0.0] * 4, [1.0, 0.5, -1.0, 0.3]])
        inputs = likelihood_inputs(system, 1, chosen)
        made = _log_likelihood(system, noise, 1, inputs, logs, unit_of)
        # A draw whose rows cannot be told counts for nothing, and the others as before.
        broken = np.concatenate([[[np.nan] * 4], logs])
        again = _log_likelihood(system, noise, 1, inputs, broken, unit_of)
        assert again[0] == -np.inf and np.array_equal(again[1:], made)
        single = []
        for row in logs:
            theta = noise.theta[1].copy()
            theta[LEARNED] = row - unit_of
            value = likelihood(system, NoiseFit((theta,) * 3, noise.value), chosen, 1)
            # Less the price of a walk, a prior which the channel pays once.
            single.append(0.5 * WALK * np.logaddexp(0.0, theta[2] + 3.0) - value)
    assert made[1] - made[0] == pytest.approx(single[1] - single[0], rel=1e-7)


@pytest.mark.slow
def test_channels_that_are_not_alike_are_left_to_themselves():
    campaign = unit(6, dwell=DWELL * np.array([1.0, 4.0, 16.0]))
    with jax.enable_x64(True):
        system, _ = system_of(campaign)
        assert alike(system, fit_noise(system)) is system
    assert TOLD.format(triad="accel") not in diagnose(campaign, effects=FEW).noise


def test_the_draws_density_is_scipys():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 4))
    covariance, values = root @ root.T + np.eye(4), rng.standard_normal((6, 4))
    frozen = scipy.stats.multivariate_t(np.ones(4), WIDTH**2 * covariance, df=TAILS)
    shape = HeavyTails.around(np.ones(4), covariance)
    made = shape.log_density(values)
    np.testing.assert_allclose(made, frozen.logpdf(values), rtol=1e-12)
    # Of many draws the middle half and nine tenths lie where SciPy's own distribution has them.
    drawn = shape.draw(20_000, np.random.default_rng(1))
    off = np.linalg.solve(np.linalg.cholesky(covariance), (drawn - 1.0).T) / WIDTH
    square = np.square(off).sum(axis=0) / 4.0
    for part in (0.25, 0.75, 0.95):
        # The standard error of a share of 20 000 draws is at most 0.0031.
        assert abs(np.mean(square < scipy.stats.f.ppf(part, 4, TAILS)) - part) < 0.011


@pytest.mark.slow
def test_two_channels_tell_what_two_units_would():
    campaign = unit(5)
    with jax.enable_x64(True):
        system, _ = system_of(campaign)
        found = alike(system, fit_noise(system))
        # `learn_noise` takes the same channel of several units: here two channels as if they were one of two.
        turned = [turned_to(system, c) for c in (1, 2)]
        learned = learn_chain(turned, 0, "accel_x")
    mean, spread = told(found, 0)
    assert abs(mean - learned.mean[PLACE]) < 0.5 * spread
    width = np.sqrt(learned.covariance[PLACE, PLACE] - 1.5 * learned.scatter[PLACE] ** 2)
    assert (
        0.5 < spread / width < 2.0
    )  # the other sum is over seven variances and holds their usual sizes


def turned_to(system, chain):
    """The system with one of its chains first."""
    first = lambda values: (values[chain], *values[1:])
    base = replace(system.base, observed=first(system.base.observed))
    return replace(
        system, base=base, chains=first(system.chains), scales=first(system.scales),
        frames=first(system.frames), longer=first(system.longer),
    )  # fmt: skip
