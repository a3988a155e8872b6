"""Excess variance of Paule and Mandel, by hand and one form against the other."""

import numpy as np
import pytest

from inertiax.numerics.paule_mandel import batched_excess_deviation, excess_deviation


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


def test_the_batched_form_is_the_same_equation():
    draw = np.random.default_rng(3)
    sigmas = draw.uniform(0.1, 2.0, (20, 30))
    residuals = 3.0 * draw.standard_normal((20, 30))
    one = [excess_deviation(r, s, 9) for r, s in zip(residuals, sigmas)]
    many = batched_excess_deviation(residuals**2, sigmas**2, np.full(20, 21.0))
    # Both solve to rounding: brentq to 1e-14 of the variance's upper limit, Newton to 1e-13.
    np.testing.assert_allclose(many, one, rtol=1e-9)
