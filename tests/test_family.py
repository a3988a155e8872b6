"""How rare the best of many candidates is, and what is said of an effect's settings."""

from dataclasses import replace

import jax
import numpy as np
import pytest
import scipy.stats

from diagnose_cases import score
from diagnose_data import only, still, sweep
from inertiax.data.recording import Campaign, Recording, Rig, Site
from inertiax.diagnose.estimates.parameters import parameters, tune
from inertiax.diagnose.noise.observation_series import System
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.problem import prepare, retuned
from inertiax.diagnose.selection.evidence import Candidate
from inertiax.diagnose.selection.multiple_testing import Count, Family, family
from inertiax.diagnose.selection.score_test import whiten_columns
from inertiax.effects import CATALOGUE


def test_orthogonal_forms_count_each_and_equal_forms_once():
    rows = np.linalg.qr(np.random.default_rng(0).standard_normal((60, 24)))[0].T
    different = [score(row, "many", 0) for row in rows]
    same = [score(rows[0], "one", 0) for _ in range(24)]
    open_ones = [score(row, "~bump", 0) for row in rows[:6]]
    found = family([*different, *same, *open_ones], [60], draws=4000)
    # N is known to 1 / sqrt(draws / 2), 2.2 %: two of them.
    assert found.groups["many", (0,)].number == pytest.approx(24.0, rel=0.05)
    assert found.groups["one", (0,)].number == pytest.approx(1.0, rel=0.05)
    assert found.unlisted == pytest.approx(6.0, rel=0.05)


def bumps():
    """Bumps that move by a tenth of their width: 160 forms that are about a dozen independent ones."""
    rows, centers = np.arange(300.0), np.linspace(40.0, 260.0, 160)
    return np.exp(-0.5 * ((rows[None, :] - centers[:, None]) / 14.0) ** 2), None


def jumps():
    """Jumps of a bias at each of 290 rows."""
    rows, moments = np.arange(300.0), np.arange(5.0, 295.0)
    shapes = (rows[None, :] > moments[:, None]).astype(float)
    return shapes - shapes.mean(axis=1)[:, None], next(
        e for e in CATALOGUE if e.name == "bias_step"
    )


@pytest.mark.slow
@pytest.mark.parametrize("forms", [bumps, jumps])
def test_a_dense_setting_counts_as_more_tests_the_rarer_the_best_of_it_is(forms):
    shapes, effect = forms()
    shapes = shapes / np.linalg.norm(shapes, axis=1)[:, None]
    scores = [score(x, "sought", 0) for x in shapes]
    scores = [replace(s, term=replace(s.term, effect=effect)) for s in scores]
    count = family(scores, [300], draws=4000).groups["sought", (0,)]
    rng = np.random.default_rng(3)
    best = [np.square(rng.standard_normal((4000, 300)) @ shapes.T).max(axis=1) for _ in range(75)]
    # The chance of the best of them by simulation; 300 000 draws know 1e-4 to 18 %.
    for ratio in (12.0, 16.0, 20.0):
        chance = np.mean(np.concatenate(best) > ratio)
        single = scipy.stats.chi2.sf(ratio, 1)
        error = 2.0 / np.sqrt(3e5 * chance)
        # The growth is that of the leading order; from 4 to 12 the next one is still worth a fifth.
        assert count.at(ratio) * single == pytest.approx(chance, rel=0.2 + error)
    # Carried over as it was counted, the chance would be stated too small by nearly half.
    assert count.number < 0.6 * count.at(20.0) < 0.6 * count.forms


def test_each_effect_pays_for_its_own_forms_times_the_number_of_effects():
    groups = {("many", (0,)): Count(24.0), ("one", (0,)): Count(1.0)}
    shares = Family(groups, 6.0)
    ratio = 20.0
    single = scipy.stats.chi2.sf(ratio, 1)
    for name, tests in (("many", 48.0), ("one", 2.0), ("~bump", 6.0)):
        own = score(np.ones(4), name, 0)
        made = Candidate(own.term, own, ratio, 0.0)
        assert shares.p_value(made) == pytest.approx(1.0 - (1.0 - single) ** tests, rel=1e-9)


@pytest.mark.slow
def test_a_coefficient_carries_the_uncertainty_of_its_time_constant():
    def warm(probe, time):
        return only(1, 2e-5 * np.exp(-time / 400.0))

    effect = next(e for e in CATALOGUE if e.name == "warm_up")
    with jax.enable_x64(True):
        (prepared,) = prepare(sweep(3, warm), (effect,)).triads
        mine = [t for t in prepared.candidates if t.name == "warm_up" and t.channels == (1,)]
        start = min(mine, key=lambda t: abs(t.variant.settings["time_constant"] - 400.0))
        noise = fit_noise(prepared.system, [start])
        term, std = tune(prepared, noise, start, [])
        made = dict(parameters(prepared, noise, term, [], std))
        tau = made["time_constant"].value
        time = prepared.coarse.time
        # Gauss and Newton's covariance of coefficient and time constant together, by hand.
        shape = np.exp(-time / tau)
        slope = made["coefficient"].value * shape * time / tau**2
        both = np.stack([shape, slope], axis=1)
        scale = np.linalg.norm(both, axis=0)
        white = projected(prepared.system, noise, 1, both / scale)
        covariance = np.linalg.inv(white.T @ white) / np.outer(scale, scale)
    assert made["coefficient"].std == pytest.approx(np.sqrt(covariance[0, 0]), rel=0.05)
    assert made["time_constant"].std == pytest.approx(np.sqrt(covariance[1, 1]), rel=0.1)
    assert abs(made["coefficient"].value - 2e-5) < 4.0 * made["coefficient"].std


def projected(system: System, noise, chain, columns):
    """Whitened columns with the whitened baseline projected out."""
    x = system.base.columns[chain] / np.linalg.norm(system.base.columns[chain], axis=0)
    white = whiten_columns(system, noise, chain, np.concatenate([x, columns], axis=1))
    q = np.linalg.qr(white[:, : x.shape[1]])[0]
    left = white[:, x.shape[1] :]
    return left - q @ (q.T @ left)


@pytest.mark.slow
def test_a_jump_in_a_pause_is_put_in_its_middle_with_the_pause_as_uncertainty():
    campaign = still(2000.0)
    recording = campaign.recordings[0]
    time, accel, position = recording.time, recording.accel.copy(), recording.position.copy()
    accel[time >= 1003.0, 0] += 2e-3
    position[(time >= 980.0) & (time < 1020.0)] = -1  # 40 s that no block sees
    gap = Recording(time, accel=accel, position=position)
    campaign = Campaign((gap,), Site(9.80665), Rig(), campaign.model, "navigation")
    effect = next(e for e in CATALOGUE if e.name == "bias_step")
    with jax.enable_x64(True):
        (prepared,) = prepare(campaign, (effect,)).triads
        mine = [t for t in prepared.candidates if t.name == "bias_step" and t.channels == (0,)]
        (best,) = retuned(prepared, mine[0], [1000.0])
        noise = fit_noise(prepared.system, [best])
        term, std = tune(prepared, noise, best, [])
    blocks = prepared.blocks.time
    before, after = blocks[blocks < 1000.0].max(), blocks[blocks > 1000.0].min()
    assert term.variant.settings["time"] == pytest.approx(0.5 * (before + after), abs=1e-6)
    # A jump of 200 times a block's noise: nothing but the pause is uncertain, evenly over it.
    assert std == pytest.approx((after - before) / np.sqrt(12.0), rel=0.02)
