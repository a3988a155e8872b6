"""What comes again with the same input is no scatter, which is drawn anew: a test of lack of fit by replicates."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from inertiax.data.recording import Campaign, Recording, Site
from inertiax.diagnose import diagnose_model
from inertiax.diagnose.candidates.repeated_inputs import NAME, repeated_levels
from inertiax.diagnose.custom_model import prepare_model
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.selection.evidence import bank, judge, refine
from inertiax.diagnose.selection.lack_of_fit import _rareness


RATES = np.radians([5, 11, 17, 29, 41, 60, 79])
ROWS = 10  # of a plateau
NOISE = 1e-5 * np.sqrt(ROWS / 30.0)  # of a row: 2e-6 rad/s of a plateau's mean
MODEL = (np.zeros(3), np.zeros((3, 3)))


def plateaus(fringe=0.0, scatter=0.0, *, sets=2, seed=3):
    """42 rates about three axes, each set in an order of its own, 10 s at 1 Hz each, with noise of 2e-6 rad/s in
    a plateau's mean; a fringe of 0.31 rad/s over the rates, and an error of each plateau."""
    rng = np.random.default_rng(seed)
    plan = [(axis, sign * rate) for axis in range(3) for rate in RATES for sign in (1, -1)]
    rate = np.zeros((sets * len(plan), 3))
    for k, j in enumerate(np.concatenate([rng.permutation(len(plan)) for _ in range(sets)])):
        rate[k, plan[j][0]] = plan[j][1]
    rate = np.repeat(rate * (1.0 + 2e-5 * rng.normal(size=(len(rate), 1))), ROWS, axis=0)
    off = np.repeat(scatter * rng.normal(size=(len(rate) // ROWS, 3)), ROWS, axis=0)
    gyro = rate + fringe * np.sin(2.0 * np.pi * rate / 0.31) + off
    gyro += NOISE * rng.normal(size=rate.shape)
    return rate, Recording(time=np.arange(float(len(rate))), gyro=gyro)


def linear(parameters, signal):
    """Biases, scale factors and misalignments, as a user's own model."""
    bias, matrix = map(jnp.asarray, parameters)
    rate = jnp.asarray(signal.input)
    return bias[None] + rate @ (jnp.eye(3) + matrix).T


def fitted(rate, recording):
    """The least-squares parameters of `linear`."""
    columns = np.c_[np.ones(len(rate)), rate]
    found = np.linalg.lstsq(columns, recording.gyro - rate, rcond=None)[0]
    return found[0], found[1:].T


def prepared(rate, recording):
    with jax.enable_x64(True):
        campaign = Campaign((recording,), Site(9.81))
        return prepare_model(
            linear, fitted(rate, recording), campaign, (), triad="gyro", inputs=rate
        )


def diagnosed(rate, recording):
    return diagnose_model(
        linear, fitted(rate, recording), recording, triad="gyro", inputs=rate, grade="tactical"
    )


def by_hand(rate, recording):
    """The chance of Draper and Smith's F for each gyro, from the means of the plateaus by NumPy and SciPy."""
    inputs = rate.reshape(-1, ROWS, 3).mean(axis=1)
    means = (recording.gyro - rate).reshape(-1, ROWS, 3).mean(axis=1)
    columns = np.c_[np.ones(len(inputs)), inputs]
    left = means - columns @ np.linalg.lstsq(columns, means, rcond=None)[0]
    _, number = np.unique(inputs.round(3), axis=0, return_inverse=True)
    number = number.ravel()
    count = np.bincount(number)[:, None]
    level = np.stack([np.bincount(number, x) for x in left.T], axis=1) / count
    within = np.sum((left - level[number]) ** 2, axis=0)
    total, n, k = np.sum(left**2, axis=0), len(inputs), len(count)
    fisher = (total - within) / (k - 4) / (within / (n - k))
    return scipy.stats.f.logsf(fisher, k - 4, n - k)


def chances(data):
    """The logarithm of the chance of the levels of each gyro, by the program."""
    made = prepared(*data)
    levels = [t for t in made.flexible if t.name == NAME]
    with jax.enable_x64(True):
        start = bank(made.system, [fit_noise(made.system)], [])
        leading = judge(made.system, start, levels, [], {}, None)
        found = judge(made.system, refine(made.system, start, leading, []), levels, [], {}, None)
        by_axis = sorted(found, key=lambda one: one.term.channels)
        return [_rareness(made.system, [], one) for one in by_axis]


@pytest.mark.parametrize("fringe", [0.0, 1.5e-5])
def test_the_chance_is_that_of_fisher_s_test_by_replicates(fringe):
    data = plateaus(fringe, 2e-5)
    expected = by_hand(*data)
    # Plateaus are alike to the noise of their means, (NOISE / √ROWS)² of (2e-5)²: 1 %. Logarithms of chances.
    np.testing.assert_allclose(chances(data), expected, rtol=0.1, atol=0.15)


def test_what_follows_directly_or_differs_by_more_than_tables_do_does_not_come_again():
    rate, recording = plateaus()
    made = prepared(rate, recording)
    assert made.flexible[-1].columns[0].shape[1] == 42
    # A plateau that is cut in two is one positioning; the two of its input are no replicates.
    first = made.blocks.dwell == made.blocks.dwell[0]
    cut = made.blocks.dwell + np.where(first, 0, 1)
    cut[np.flatnonzero(first)[: first.sum() // 2]] -= 1
    again = jax.tree.map(lambda x: x, made.blocks)
    object.__setattr__(again, "dwell", cut)
    terms = repeated_levels(made.coarse, again, made.system.base)
    assert terms[0].columns[0].shape[1] == 41
    # 5 % apart, 0.3 % of the largest for the smallest: each comes once.
    other = rate.copy()
    other[len(rate) // 2 :] *= 1.05
    assert not [t for t in prepared(other, recording).flexible if t.name == NAME]


@pytest.mark.slow
def test_a_fringe_over_rates_that_come_again_is_unexplained():
    """2e-5 rad/s at 42 rates, far from every power and step, where a plateau's noise is 2e-6."""
    found = diagnosed(*plateaus(2e-5))
    assert found.verdict == "unexplained" and not found.effects
    assert "a level of each of 42 inputs that come again" in found.empirical
    assert {w.driver for w in found.where} == {"input"}


@pytest.mark.slow
def test_a_name_stays_beside_what_comes_again_on_other_channels():
    """An asymmetry of 45 ppm on x, found as it is; the fringe beside it is on all three gyros."""
    rate, recording = plateaus(2e-5)
    gyro = recording.gyro + 4.5e-5 * np.abs(rate) * [1.0, 0.0, 0.0]
    found = diagnosed(rate, Recording(time=recording.time, gyro=gyro))
    assert found.verdict == "unexplained" and "inputs that come again" in found.empirical
    for effect in found.effects:  # those of channels on which nothing unexplained is worse
        assert (effect.name, effect.channels) == ("scale_asymmetry", ("gyro_x",))
    without = diagnosed(
        rate, Recording(time=recording.time, gyro=gyro - (2e-5 * np.sin(2.0 * np.pi * rate / 0.31)))
    )
    (only,) = without.effects
    assert without.verdict == "missing-physics" and only.name == "scale_asymmetry"
    size = dict(only.parameters)["coefficient"]
    assert abs(size.value - 4.5e-5) < 3.0 * size.std


def test_scatter_that_is_drawn_anew_stays_scatter():
    found = diagnosed(*plateaus(0.0, 2e-5))
    assert found.verdict == "consistent" and "times their noise" in found.summary


@pytest.mark.slow
def test_by_scatter_alone_chances_are_uniform():
    """Sixty chances of twenty sets, half of them with scatter below the noise of a plateau's mean, where they may be
    too large: what dwells alone tell is judged by the dwells."""
    large = np.exp([x for seed in range(10) for x in chances(plateaus(0.0, 2e-5, seed=seed))])
    small = np.exp([x for seed in range(10) for x in chances(plateaus(0.0, 5e-7, seed=seed))])
    assert scipy.stats.kstest(large, "uniform").pvalue > 1e-3
    assert scipy.stats.kstest(small, "uniform", alternative="greater").pvalue > 1e-3
