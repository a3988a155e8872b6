"""Noise by groups of rows in NumPy against the row-by-row filter of JAX: whitening, likelihood and slope."""

import gc

import equinox as eqx
import jax
import numpy as np
import pytest
import scipy.optimize
import scipy.stats

from inertiax.diagnose.noise import grouped_filter
from inertiax.diagnose.noise.grouped_filter import groups_of, know, ROWS, whiten
from inertiax.diagnose.noise.many_variances import grams_under_each, Steps
from inertiax.diagnose.noise.restricted_likelihood import RestrictedLikelihood
from inertiax.diagnose.noise.state_space import (
    Chain,
    Known,
    STATED,
    stated_price,
    TIME_CONSTANTS,
    unpack,
    value_and_gradient,
    whiten as whiten_row_by_row,
)


NUM = 3 * ROWS + 7  # the last group is not full
THETAS = np.array(
    [
        [0.0, -1.0, -4.0, -2.0, -3.0, -1.5, -0.5],
        [0.4, 4.0, 3.0, 2.0, 5.0, -0.5, -2.5],  # slow noise that dwarfs the white one
        [-0.6, -9.0, -9.0, -9.0, -9.0, -6.0, -3.0],  # white noise alone
    ]
)


def chain(channels: int, heated: bool, seed: int = 0) -> Chain:
    """Uneven rows with pauses of hours, dwells and power cycles that end within groups, and a rig's error."""
    rng = np.random.default_rng(seed)
    gap = np.r_[0.0, rng.uniform(0.5, 20.0, NUM - 1)]
    gap[[40, 77]] = 3600.0, 3e5  # after which a fast process is as good as new
    dwell = np.r_[1.0, (rng.uniform(size=NUM - 1) < 0.2)].astype(float)
    mounted = np.where(np.cumsum(dwell) % 2 == 1, dwell, 0.0)  # for two dwells each
    cycle = np.r_[1.0, np.zeros(NUM - 1)]
    cycle[[40, 77]] = 1.0
    loads = np.ones((NUM, 1)) if channels == 1 else rng.standard_normal((NUM, channels))
    probe = rng.standard_normal((NUM, 1 if heated else 0))
    rig = rng.uniform(0.0, 3.0, NUM)
    return Chain(
        rng.uniform(0.5, 2.0, NUM), loads, gap, dwell, mounted, cycle, rig, rig[::-1], probe
    )


SCALE = np.array([1.0, 1.2, 1e-3, 1.1, 0.9, 0.5, 1.0])
CASES = [(1, False), (1, True), (3, True)]


@pytest.mark.parametrize("channels, heated", CASES)
@pytest.mark.parametrize("theta", THETAS)
def test_whitened_rows_are_those_of_the_filter_row_by_row(channels, heated, theta):
    one = chain(channels, heated)
    columns = np.random.default_rng(1).standard_normal((NUM, 9))
    with jax.enable_x64(True):
        other, logs = whiten_row_by_row(unpack(theta, SCALE), one, columns)
    mine, own_logs = whiten(one, np.exp(theta) * SCALE, columns)
    # Rounding, which slow noise of a hundred times the white one's deviation enlarges by as much.
    np.testing.assert_allclose(mine, np.asarray(other), rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(own_logs, float(logs), rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("channels, heated", CASES)
@pytest.mark.parametrize("theta", THETAS)
def test_the_restricted_likelihood_and_its_slope_are_those_of_jax(channels, heated, theta):
    one, rng = chain(channels, heated), np.random.default_rng(2)
    y, x, z = rng.standard_normal(NUM), rng.standard_normal((NUM, 4)), rng.standard_normal((NUM, 2))
    known = Known(np.full(7, -1.0), np.diag([0.0, 0.5, 1.0, 2.0, 0.3, 0.0, 0.0]))
    for told in (Known.nothing(), known):
        with jax.enable_x64(True):
            value, slope = value_and_gradient(theta, SCALE, one, y, x, z, told)
        mine = RestrictedLikelihood(groups_of(one), SCALE, told, y, x, z)
        own, own_slope = mine.value_and_slope(theta)
        np.testing.assert_allclose(own, float(value), rtol=1e-11)
        np.testing.assert_allclose(mine.value(theta), own, rtol=1e-13)
        # Of sums of a hundred rows' terms that cancel to a slope near zero: rounding of the largest.
        largest = np.abs(slope).max()
        np.testing.assert_allclose(own_slope, np.asarray(slope), rtol=1e-8, atol=1e-9 * largest)


def test_the_slope_is_that_of_differences():
    one, rng = chain(3, True), np.random.default_rng(3)
    rows = rng.standard_normal(NUM), rng.standard_normal((NUM, 3)), np.zeros((NUM, 0))
    mine = RestrictedLikelihood(groups_of(one), SCALE, Known.nothing(), *rows)
    # Differences of 1e-6 of a value of about 300, rounded in the 16th digit, are good to 1e-7.
    error = scipy.optimize.check_grad(
        mine.value, lambda t: mine.value_and_slope(t)[1], THETAS[0], epsilon=1e-6
    )
    assert error < 1e-4 * np.abs(mine.value_and_slope(THETAS[0])[1]).max()


def test_rows_of_padding_are_left_out():
    one = chain(1, False)
    longer = jax.tree.map(lambda x: np.concatenate([x, np.zeros((9, *x.shape[1:]))]), one)
    columns = np.random.default_rng(4).standard_normal((NUM, 2))
    variances = np.exp(THETAS[0]) * SCALE
    for mine, other in zip(whiten(one, variances, columns), whiten(longer, variances, columns)):
        np.testing.assert_array_equal(mine, other)


def test_no_covariance_where_variances_are_not_finite_ends_in_an_infinite_value():
    one, rng = chain(1, False), np.random.default_rng(5)
    rows = rng.standard_normal(NUM), rng.standard_normal((NUM, 2)), np.zeros((NUM, 0))
    mine = RestrictedLikelihood(groups_of(one), SCALE, Known.nothing(), *rows)
    theta = np.full(7, 800.0)  # e⁸⁰⁰ is no double
    with np.errstate(all="ignore"):
        assert mine.value(theta) == np.inf
        value, slope = mine.value_and_slope(theta)
    assert value == np.inf and not slope.any()


def test_groups_of_other_white_variances_are_those_made_anew():
    one = chain(1, False)
    other, anew = (
        eqx.tree_at(lambda c: c.white, jax.tree.map(lambda x: x, one), 2.5 * one.white)
        for _ in range(2)
    )
    know(other, one)
    np.testing.assert_array_equal(groups_of(other).own, groups_of(anew).own)
    assert not np.array_equal(groups_of(other).own, groups_of(one).own)


def test_groups_are_made_once_and_forgotten_with_their_chain():
    one = chain(1, False)
    assert groups_of(one) is groups_of(one)
    key = id(one)
    assert key in grouped_filter._KNOWN
    del one
    gc.collect()
    assert key not in grouped_filter._KNOWN


@pytest.mark.slow
@pytest.mark.parametrize("channels, heated", CASES)
def test_many_variances_side_by_side_give_what_each_gives_alone(channels, heated):
    one = chain(channels, heated)
    padded = jax.tree.map(lambda x: np.concatenate([x, np.zeros((9, *x.shape[1:]))]), one)
    columns = np.random.default_rng(6).standard_normal((NUM + 9, 4))
    columns[NUM:] = 0.0
    with jax.enable_x64(True):
        grams, logs = grams_under_each(np.exp(THETAS) * SCALE, Steps.of(padded), columns)
        for k, theta in enumerate(THETAS):
            alone, its_logs = whiten_row_by_row(unpack(theta, SCALE), padded, columns)
            gram = np.asarray(alone).T @ np.asarray(alone)
            np.testing.assert_allclose(grams[k], gram, rtol=1e-11, atol=1e-11 * np.max(gram))
            np.testing.assert_allclose(logs[k], float(its_logs), rtol=1e-12)


def test_processes_that_decay_and_are_seen_alike_are_one_state():
    # One dwell, one power cycle: walk, level and the dwell's error go together, and the filter is the same.
    one = chain(1, False)
    first = np.r_[1.0, np.zeros(NUM - 1)]
    one = Chain(
        one.white, one.loads, one.gap, first, first, first, one.rig, one.rig_of_dwell, one.heated
    )
    assert groups_of(one).decay.shape[1] == len(TIME_CONSTANTS) + 1
    columns = np.random.default_rng(7).standard_normal((NUM, 3))
    with jax.enable_x64(True):
        other, logs = whiten_row_by_row(unpack(THETAS[0], SCALE), one, columns)
    mine, own_logs = whiten(one, np.exp(THETAS[0]) * SCALE, columns)
    np.testing.assert_allclose(mine, np.asarray(other), rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(own_logs, float(logs), rtol=1e-12)


def test_a_rigs_statement_is_a_variance_estimated_with_its_degrees_of_freedom():
    """By SciPy: with true variance σ² an estimate s² of ν degrees of freedom has ν s² / σ² as χ²."""
    theta = np.linspace(-3.0, 0.0, 7)
    truth = np.exp(theta)  # of the stated variance, which is 1
    density = scipy.stats.chi2.logpdf(STATED / truth, STATED) + np.log(STATED / truth)
    np.testing.assert_allclose(
        [stated_price(x) - stated_price(0.0) for x in theta],
        -2.0 * (density - density[-1]),
        atol=1e-9,
    )


def test_a_chain_without_a_rig_has_no_price_of_one():
    one = chain(1, False)
    bare = eqx.tree_at(lambda c: (c.rig, c.rig_of_dwell), one, 2 * (np.zeros(NUM),))
    rng = np.random.default_rng(8)
    rows = rng.standard_normal(NUM), rng.standard_normal((NUM, 2)), np.zeros((NUM, 0))
    other = THETAS[0] + np.array([*6 * [0.0], -1.5])
    values = [
        RestrictedLikelihood(groups_of(bare), SCALE, Known.nothing(), *rows).value(theta)
        for theta in (THETAS[0], other)
    ]
    assert values[0] == values[1]
