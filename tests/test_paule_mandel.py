"""Excess variance of Paule and Mandel, by hand and by SciPy."""

import numpy as np
import pytest
from scipy.optimize import brentq

from inertiax.numerics.paule_mandel import batched_excess_deviation, excess_deviation, widened


def test_equal_noise_by_hand():
    residuals = np.array([3.0, -3.0, 3.0, -3.0, 3.0])
    assert excess_deviation(residuals, np.full(5, 1.0), 2) == pytest.approx(np.sqrt(45 / 3 - 1))
    assert excess_deviation(residuals, np.zeros(5), 2) == pytest.approx(np.sqrt(15.0))
    assert excess_deviation(residuals, np.full(5, 9.0), 2) == 0.0


def test_no_degrees_of_freedom_and_no_residuals_give_none():
    assert excess_deviation(np.ones(2), np.zeros(2), 2) == 0.0
    assert excess_deviation(np.zeros(9), np.zeros(9), 2) == 0.0


def test_unequal_noise_solves_its_equation():
    residuals, sigmas = np.array([2.0, -1.0, 0.5, 4.0]), np.array([0.5, 0.0, 1.0, 2.0])
    found = excess_deviation(residuals, sigmas, 1)
    assert np.sum(residuals**2 / (sigmas**2 + found**2)) == pytest.approx(3.0, rel=1e-10)


def test_one_set_and_many_have_the_root_that_scipy_finds():
    draw = np.random.default_rng(3)
    sigmas = draw.uniform(0.1, 2.0, (20, 30))
    sigmas[:5, :3] = 0.0  # known exactly
    residuals = 3.0 * draw.standard_normal((20, 30))
    excess = lambda v, r, s: np.sum(np.square(r) / (np.square(s) + v)) - 21.0
    least = 1e-12  # from where the sum is finite without a noise, too
    roots = [brentq(excess, least, 100.0, (r, s), xtol=1e-14) for r, s in zip(residuals, sigmas)]
    one = [excess_deviation(r, s, 9) for r, s in zip(residuals, sigmas)]
    many = batched_excess_deviation(residuals**2, sigmas**2, np.full(20, 21.0))
    # brentq stops at 4 roundings of the root, Newton's steps at 1e-13 of it.
    np.testing.assert_allclose(np.square(one), roots, rtol=1e-11)
    np.testing.assert_allclose(np.square(many), roots, rtol=1e-11)


@pytest.mark.parametrize("freedom", [6, 15])
def test_intervals_with_widened_degrees_of_freedom_cover(freedom):
    """A mean of ν + 1 values of stated noise 1 that scatter by τ more; a share of 4000 is known to 0.35 %."""
    draw, count = np.random.default_rng(4), freedom + 1
    for tau in (0.0, 0.7, 1.4):
        values = np.hypot(1.0, tau) * draw.standard_normal((4000, count))
        mean = values.mean(axis=1)
        left = values - mean[:, None]
        by_hand = np.maximum(np.sum(left**2, axis=1) * (1.0 + 2.0 / freedom) / freedom, 1.0)
        found = [excess_deviation(r, np.ones(count), count - widened(float(freedom))) for r in left]
        np.testing.assert_allclose(1.0 + np.square(found), by_hand, rtol=1e-9)
        inside = np.abs(mean) < 1.959964 * np.sqrt(by_hand / count)
        assert 0.93 < inside.mean() < 0.975
