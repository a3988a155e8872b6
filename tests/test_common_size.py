"""Coefficients of one effect that are told very unequally, against SciPy's marginal likelihood and drawn truths."""

import numpy as np
import pytest
import scipy.optimize
import scipy.stats

from inertiax.diagnose.estimates.common_size import held_to_common_size


def test_estimates_are_those_of_scipys_marginal_likelihood():
    values = np.array([0.0102, 0.0086, -0.00017])
    spread = np.array([0.0080, 0.0227, 1.1e-5])
    alike = np.array([[1.0, 0.22, -0.01], [0.22, 1.0, 0.0], [-0.01, 0.0, 1.0]])
    covariance = alike * np.outer(spread, spread)

    def loss(log_size):
        total = covariance + np.exp(2 * log_size) * np.eye(3)
        return -scipy.stats.multivariate_normal(np.zeros(3), total).logpdf(values)

    best = scipy.optimize.minimize_scalar(loss, bounds=(-12, 0), method="bounded")
    edge = scipy.optimize.brentq(
        lambda x: loss(x) - best.fun - scipy.stats.chi2.ppf(0.95, 1) / 2, best.x, 2
    )
    prior, told = np.exp(-2 * edge) * np.eye(3), np.linalg.inv(covariance)
    after = np.linalg.inv(prior + told)

    got, sigma = held_to_common_size(values, covariance)
    np.testing.assert_allclose(got, after @ told @ values, rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(sigma, after, rtol=1e-3, atol=1e-12)
    assert abs(got[1]) < 0.05 * abs(
        values[1]
    )  # 8.6 mm with a standard deviation of 23 mm was noise
    assert abs(got[2] - values[2]) < 0.02 * spread[2]


def test_what_is_told_well_stays_and_so_does_one_alone():
    values = np.array([1.0, -2.0, 0.5])
    covariance = np.diag([0.1, 0.1, 0.1]) ** 2
    got, sigma = held_to_common_size(values, covariance)
    assert np.abs(got - values).max() < 0.1 * 0.1
    np.testing.assert_allclose(np.sqrt(np.diag(sigma)), 0.1, rtol=0.01)
    alone = np.array([3.0]), np.array([[25.0]])
    assert held_to_common_size(*alone) == alone


def test_a_direction_that_is_not_told_at_all_stays_at_zero():
    along = np.array([[1.0, 1.0]]) / np.sqrt(2)
    values, covariance = 4.0 * along[0], 0.01 * along.T @ along
    got, sigma = held_to_common_size(values, covariance)
    np.testing.assert_allclose(got, values, rtol=1e-3)
    assert abs(got[0] - got[1]) < 1e-9 and np.linalg.matrix_rank(sigma, 1e-9) == 1


@pytest.mark.slow
def test_intervals_cover_drawn_truths_and_errors_shrink():
    rng = np.random.default_rng(3)
    spread = np.array([0.01, 1.0, 10.0])
    inside, before, after = [], 0.0, 0.0
    for _ in range(1000):
        truth = rng.standard_normal(3)
        seen = truth + spread * rng.standard_normal(3)
        got, covariance = held_to_common_size(seen, np.diag(spread**2))
        inside.append(np.abs(got - truth) < 1.96 * np.sqrt(np.diag(covariance)))
        before, after = before + (seen - truth)[2] ** 2, after + (got - truth)[2] ** 2
    share = np.mean(inside, axis=0)
    # The mean within 3 standard deviations of 3000 intervals; the size itself, told by few, costs the worst 2 %.
    assert share.mean() > 0.938 and (share > 0.91).all()
    assert after < 0.3 * before
