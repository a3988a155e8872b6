"""Slow noise between dwells: 95 % intervals hold 95 % of the truths, with it and without it."""

import equinox as eqx
import numpy as np
import pytest

from inertiax.calibrate.alike_dwells import AlikeDwells
from inertiax.calibrate.one_triad import estimate_triad
from inertiax.calibrate.slow_noise import SlowNoise
from inertiax.calibrate.split_covariance import fit_of, SLOW, split
from inertiax.data.recording import Rig
from inertiax.estimators import ReferenceAccel
from inertiax.model_selection.select_model import ChosenModel
from inertiax.reduction.dwells import Dwells


G, WHITE, STEP, COUNT = 9.80665, 2e-4, 60.0, 48
NUMBER = 120  # tables
# Of 3 biases and 9 elements a table: 1 in 1000 sets is farther from 0.95.
BIASES, ELEMENTS = (3.29 * np.sqrt(0.95 * 0.05 / (count * NUMBER)) for count in (3, 9))
SPEC = ChosenModel("reference", None, False, (0, None), ())


def table(rng, tau, slow):
    """Six faces eight times, a dwell a minute; Gauss-Markov noise by its covariance, independent on each axis; and its
    mean over the log."""
    mean = np.zeros(3)
    faces = G * np.tile(np.concatenate([np.eye(3), -np.eye(3)]), (COUNT // 6, 1))
    time = STEP * np.arange(COUNT)
    output = faces + WHITE * rng.standard_normal((COUNT, 3))
    if slow:
        covariance = np.exp(-np.abs(time[:, None] - time) / tau) + 1e-12 * np.eye(COUNT)
        wander = slow * np.linalg.cholesky(covariance) @ rng.standard_normal((COUNT, 3))
        output, mean = output + wander, wander.mean(axis=0)
    made = Dwells.from_arrays(
        output, reference_accel=faces, temperature=np.full(COUNT, 25.0), sigma=WHITE
    )
    return eqx.tree_at(lambda d: d.time, made, time), mean


def estimated(dwells):
    return estimate_triad(ReferenceAccel(), dwells, SPEC, "gauss-newton", lambda _: None, [], [])


def coverage(tau, slow, number=NUMBER):
    """Shares of biases (truth: the log's mean) and of matrix elements (zero) within 1.96 sigma, and of tables with slow
    noise found."""
    rng, ratios, found = np.random.default_rng(3), [], 0
    for _ in range(number):
        dwells, mean = table(rng, tau, slow)
        result = estimated(dwells)
        found += result.slow_noise.probability > 0.5
        sigma = np.sqrt(np.diagonal(np.asarray(result.solution.covariance)))
        error = np.asarray(result.solution.curve.coefficients).ravel()
        error[:3] -= mean
        ratios.append(error / sigma)
    bias = np.array([".bias" in name for name in ReferenceAccel().names])
    inside = np.abs(ratios) < 1.959964
    return inside[:, bias].mean(), inside[:, ~bias].mean(), found / number


def alike_by_hand(time, experiment, constant):
    """K of the module as a matrix."""
    same = experiment[:, None] == experiment
    return np.exp(-np.abs(time[:, None] - time) / constant) * same


@pytest.mark.parametrize("rows", [1, 3])
def test_whitening_in_time_is_that_by_the_whole_matrix(rows):
    rng, count, shares, times = np.random.default_rng(0), 300, np.array([0.1, 0.96]), [30.0, 9e3]
    time, experiment = rng.uniform(0.0, 5e3, count), rng.integers(0, 3, count).astype(float)
    output = rng.normal(size=(count, 3)) if rows == 1 else None
    columns = rng.normal(size=(count, rows, 4))
    dwells = AlikeDwells(time, experiment, output)
    gram, volume = dwells.whitened(columns, shares, np.array(times))
    wide = columns.reshape(count, -1)
    for k, constant in enumerate(times):
        alike = alike_by_hand(time, experiment, constant)
        if output is not None:
            size = np.linalg.norm(output, axis=1)
            alike *= output @ output.T / np.outer(size, size)
        whole = (1.0 - shares[k]) * np.eye(count) + shares[k] * alike
        solved = np.linalg.solve(whole, wide).reshape(columns.shape)
        np.testing.assert_allclose(gram[k], np.einsum("nri,nrj->ij", columns, solved), rtol=1e-9)
        assert abs(volume[k] - rows * np.linalg.slogdet(whole)[1]) < 1e-8
        moved = (alike @ wide).reshape(columns.shape)
        found = dwells.product(columns, np.array([0.3]), np.array([constant]))
        expected = 0.3 * np.einsum("nri,nrj->ij", columns, moved)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("tau", [60.0, 200.0, 600.0])
def test_intervals_hold_the_truth_under_slow_noise(tau):
    bias, matrix, found = coverage(tau, 5.0 * WHITE)
    assert found > 0.5
    # What fades within a few dwells is hardly told from scatter, which is an error of the log's mean, too.
    assert bias > 0.95 - BIASES
    assert abs(matrix - 0.95) < ELEMENTS


@pytest.mark.slow
def test_white_noise_is_left_as_it_was():
    bias, matrix, found = coverage(1.0, 0.0)
    assert found < 0.1  # more likely than not, of a tenth of the tables at most
    assert abs(bias - 0.95) < BIASES
    assert abs(matrix - 0.95) < ELEMENTS


@pytest.mark.parametrize("experiments", [1, 2])
def test_the_parts_with_slow_noise_sum_to_the_covariance(experiments):
    dwells, _ = table(np.random.default_rng(1), 600.0, 10.0 * WHITE)
    experiment = np.arange(COUNT) * experiments // COUNT
    result = estimated(eqx.tree_at(lambda d: d.experiment, dwells, experiment))
    parts = split(fit_of(result), Rig())
    assert SLOW in {p.source for p in parts}
    whole = sum(p.covariance for p in parts)
    np.testing.assert_allclose(whole, result.solution.covariance, rtol=1e-6, atol=1e-18)
    part = next(p for p in parts if p.source == SLOW).covariance
    slow: SlowNoise = result.slow_noise
    time, own = STEP * np.arange(COUNT), np.asarray(result.sigma)[0, 0] ** 2
    alike = sum(
        b * alike_by_hand(time, experiment, c) for b, c in zip(slow.parts, slow.times, strict=True)
    )
    # By hand: a bias is the mean over n equal dwells, a scale factor Σ f a / Σ f².
    along = np.asarray(dwells.reference_accel)[:, 0]
    by_scale = along @ alike @ along / (along @ along) ** 2
    assert part[3, 3] == pytest.approx(own * by_scale, rel=1e-3)
    # In one experiment a bias is that of the log's mean, which the mean over the dwells is.
    by_bias = 0.0 if experiments == 1 else alike.mean()
    assert part[0, 0] == pytest.approx(own * by_bias, rel=1e-3, abs=1e-9 * own * alike.mean())
