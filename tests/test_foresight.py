"""Prediction of stretches left out, and draws of the fitted noise."""

import numpy as np

from inertiax.diagnose.foresight import Foresight, skill, stretches
from inertiax.diagnose.noise_draws import draw
from inertiax.diagnose.whiten import Chain, TIME_CONSTANTS, Variances


def test_draws_of_the_noise_have_the_covariance_of_its_formula():
    time = np.array([0.0, 2.0, 5.0, 40.0, 43.0, 50.0])
    gap = np.r_[0.0, np.diff(time)]
    white = np.array([0.5, 1.0, 0.7, 0.2, 0.4, 0.9])
    dwell = np.array([0, 0, 1, 1, 2, 2])
    cycle = np.array([0, 0, 0, 1, 1, 1])
    loads = np.array([[1.0, 0.2], [0.8, -0.5], [0.1, 1.0], [0.3, 0.3], [-0.7, 0.6], [0.9, 0.0]])
    fresh, power = (np.r_[1.0, (np.diff(x) != 0).astype(float)] for x in (dwell, cycle))
    chain = Chain(white, loads, gap, fresh, power, np.full(6, 0.3))
    v = Variances(*(np.array(x) for x in (1.2, 0.4, 0.05, 0.6, 0.8)))
    num = 40_000
    made = draw(chain, v, num, np.random.default_rng(1))
    lag = np.abs(time[:, None] - time)
    slow = 0.4 * sum(np.exp(-lag / tau) for tau in TIME_CONSTANTS)
    slow = slow + 0.05 * np.minimum(time[:, None], time) + 0.8 * (cycle[:, None] == cycle)
    expected = np.diag(1.2 * white) + (0.6 + 0.3) * (dwell[:, None] == dwell)
    expected = expected + (loads @ loads.T) * slow
    found = made @ made.T / num
    # The standard deviation of an element is at most sqrt(2 / num) of the diagonal's product; five of them.
    size = np.sqrt(np.diag(expected))
    assert np.all(np.abs(found - expected) < 5.0 * np.sqrt(2.0 / num) * size[:, None] * size)


def test_the_error_of_stretches_left_out_is_that_of_plain_refits():
    rng = np.random.default_rng(2)
    num = 240
    time = np.sort(rng.uniform(0.0, 500.0, num))
    weight = rng.uniform(0.5, 2.0, num)
    base = np.stack([np.ones(num), time / 500.0], axis=1)
    column = np.sin(time / 40.0)[:, None]
    rows = base @ [0.3, -1.0] + 0.8 * column[:, 0] + 0.1 * rng.standard_normal(num)
    frame = np.linalg.qr(base * weight[:, None])[0]
    left = rows * weight
    left = left - frame @ (frame.T @ left)
    one = Foresight(weight, (stretches(time, 5), stretches(time, 8)), frame, left)
    errors = []
    for x in (base, np.concatenate([base, column], axis=1)):
        for part in one.stretch:
            total = 0.0
            for k in np.unique(part):
                out = part == k
                w = weight[~out]
                fitted = np.linalg.lstsq(x[~out] * w[:, None], rows[~out] * w, rcond=None)[0]
                total += np.sum(np.square((rows[out] - x[out] @ fitted) * weight[out]))
            errors.append(total)
    np.testing.assert_allclose(one.errors(None), errors[:2], rtol=1e-9)
    np.testing.assert_allclose(one.errors(column), errors[2:], rtol=1e-9)
    ratio = np.array(errors[:2]) / np.array(errors[2:])
    assert abs(skill(one, column) - np.mean(0.5 * np.log(ratio))) < 1e-9
