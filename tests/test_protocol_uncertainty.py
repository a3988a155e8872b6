"""Expanded uncertainty against the GUM's own numbers, and the risk of wrong decisions against drawn measurements."""

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

from inertiax.protocol.expanded_uncertainty import coverage_factor, effective_degrees, quantile
from inertiax.protocol.guard_band import allowance, decide, Measured, RISK


# JCGM 100:2008, H.1.6: calibration of a 50 mm gauge block; nm and degrees of freedom.
GAUGE_BLOCK = ([25.0, 9.7, 2.9, 16.6], [18.0, 25.6, 50.0, 2.0])


def test_the_gauge_block_of_the_guide():
    stds, degrees = GAUGE_BLOCK
    found = effective_degrees(stds, degrees)
    assert round(math.hypot(*stds)) == 32  # nm, as printed
    assert math.floor(found) == 16  # as printed, truncated there
    assert coverage_factor(16.0, 0.99) == pytest.approx(2.92, abs=0.005)  # printed to 0.01
    assert round(32 * coverage_factor(16.0, 0.99)) == 93  # nm, U99 as printed


@pytest.mark.parametrize(
    ("degrees", "factor"),
    # JCGM 100:2008, table G.2, the column of 95 %.
    [
        (1.0, 12.71),
        (2.0, 4.30),
        (5.0, 2.57),
        (10.0, 2.23),
        (20.0, 2.09),
        (50.0, 2.01),
        (math.inf, 1.96),
    ],
)
def test_the_guides_table_of_t(degrees, factor):
    assert coverage_factor(degrees) == pytest.approx(factor, abs=0.005)  # printed to 0.01


@pytest.mark.parametrize("degrees", [0.7, 3.3, 171.0, 1e6])
def test_degrees_of_freedom_need_not_be_whole(degrees):
    assert quantile(0.975, degrees) == pytest.approx(scipy.stats.t.ppf(0.975, degrees), rel=1e-9)


def test_one_contribution_keeps_its_degrees_of_freedom_whatever_its_unit():
    assert effective_degrees([3.0], [7.0]) == pytest.approx(7.0)
    assert effective_degrees([1e-90, 1e-90], [4.0, 4.0]) == pytest.approx(8.0)
    assert effective_degrees([0.0, 0.0], [4.0, 4.0]) == math.inf
    assert effective_degrees([2.0, 5.0], [math.inf, math.inf]) == math.inf


def test_as_many_degrees_of_freedom_as_contributions():
    with pytest.raises(ValueError, match="2 uncertainties but 1 degrees"):
        effective_degrees([1.0, 1.0], [3.0])


def test_the_interval_covers_as_often_as_it_says():
    """Means of five readings and a stated offset, drawn: GUM G.4.1 is an approximation, good to a percent here."""
    rng, runs = np.random.default_rng(1), 20000
    readings = rng.normal(0.0, 1.0, (runs, 5))
    offset = rng.normal(0.0, 0.3, runs)
    own = readings.std(axis=1, ddof=1) / math.sqrt(5)
    error = np.abs(readings.mean(axis=1) + offset)
    inside = 0
    for u, e in zip(own, error, strict=True):
        degrees = effective_degrees([u, 0.3], [4.0, math.inf])
        inside += e <= coverage_factor(degrees) * math.hypot(u, 0.3)
    assert inside / runs == pytest.approx(0.95, abs=0.01)


@pytest.mark.parametrize("degrees", [4.0, 30.0, math.inf])
@pytest.mark.parametrize(
    ("truth", "wrong"), [(1.0001, "pass"), (0.9999, "fail"), (-1.0001, "pass")]
)
def test_at_the_limit_a_decision_is_wrong_as_seldom_as_stated(degrees, truth, wrong):
    rng, runs, sigma = np.random.default_rng(2), 4000, 0.05
    values = rng.normal(truth, sigma, runs)
    stds = np.full(runs, sigma)
    if math.isfinite(degrees):
        stds = sigma * np.sqrt(scipy.stats.chi2.rvs(degrees, size=runs, random_state=rng) / degrees)
    measured = [[Measured(v, s, degrees)] for v, s in zip(values, stds, strict=True)]
    rate = np.mean([decide(m, m, 1.0) == wrong for m in measured])
    # Three sigma of the number of runs.
    assert rate == pytest.approx(RISK, abs=3.0 * math.sqrt(RISK * (1 - RISK) / runs))


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_many_values_at_their_limit_fail_together_as_seldom_as_one(correlation):
    rng, runs, count = np.random.default_rng(3), 4000, 9
    covariance = 1e-4 * ((1 - correlation) * np.eye(count) + correlation)
    drawn = 1.0 - 1e-9 + rng.multivariate_normal(np.zeros(count), covariance, runs)
    fails = sum(
        decide(m, m, 1.0) == "fail"
        for m in ([Measured(v, 0.01, math.inf) for v in row] for row in drawn)
    )
    assert fails / runs <= RISK + 3.0 * math.sqrt(RISK / runs)
    assert fails > 0


def test_one_value_outside_keeps_all_from_passing():
    inside, outside = Measured(0.1, 0.01, math.inf), Measured(1.2, 0.01, math.inf)
    assert decide([inside, inside], [inside], 1.0) == "pass"
    assert decide([inside, outside], [inside, outside], 1.0) == "fail"
    assert decide([inside, outside], [inside], 1.0) == "undecided"
    assert decide([Measured(0.99, 0.01, math.inf)], [inside], 1.0) == "undecided"
    assert allowance(inside) == pytest.approx(0.01 * 1.959964, rel=1e-6)


def test_nothing_measured_is_no_decision():
    with pytest.raises(ValueError, match="no values"):
        decide([], [], 1.0)


@pytest.mark.slow
def test_a_whole_protocol_covers_as_often_as_it_says():
    """Few runs of the benchmark, which draws every source by lines of its own and counts 320."""
    path = Path(__file__).parents[1] / "benchmarks" / "protocol_coverage.py"
    spec = importlib.util.spec_from_file_location("protocol_coverage", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = module.count("g alone", 24, seed=7)
    # Three sigma of so many runs.
    assert abs(found.together - 0.95) < 3.0 * max(found.sigma, 0.005)
    assert found.wrong["pass"] < RISK + 3.0 * math.sqrt(RISK / found.decisions)
