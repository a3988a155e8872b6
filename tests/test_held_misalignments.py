"""Six faces off level: biases and scale factors err by what the misalignments do, which are held at zero."""

import equinox as eqx
import numpy as np
import pytest

from inertiax.calibrate.held_misalignments import stated_with_held, with_held
from inertiax.calibrate.one_triad import estimate_triad
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.calibrate.split_covariance import fit_of, HELD, NOISE, SLOW, split
from inertiax.data.recording import Campaign, Recording, Rig, Site
from inertiax.estimators import Invariant
from inertiax.model_selection.select_model import ChosenModel
from inertiax.reduction.dwells import Dwells


GRAVITY = 9.80665
FACES = np.vstack([np.eye(3), -np.eye(3)])


def _device(rng: np.random.Generator, misalignment: float) -> tuple[Campaign, np.ndarray]:
    """Six faces off by some 7°, 4 s each with a jolt between, and the truth in the order of the names."""
    bias, scale = rng.normal(0.0, 0.1, 3), rng.normal(0.0, 8e-3, 3)
    matrix = np.eye(3) + np.diag(scale) + np.tril(rng.normal(0.0, misalignment, (3, 3)), -1)
    faces = FACES + rng.normal(0.0, 0.12, FACES.shape)
    force = GRAVITY * faces / np.linalg.norm(faces, axis=1, keepdims=True)
    rows = []
    for one in force:
        rows.append(np.tile(one, (400, 1)))
        rows.append(one + rng.normal(0.0, 3.0, (100, 3)))
    still = np.concatenate(rows)
    output = still @ matrix.T + bias + rng.normal(0.0, 0.02, still.shape)
    made = Recording(time=np.arange(len(output)) / 100.0, accel=output, name="six")
    return Campaign((made,), Site(gravity=GRAVITY)), np.concatenate([bias, scale])


@pytest.mark.slow
def test_stated_sigmas_hold_what_held_misalignments_of_the_usual_size_do():
    """rms of error over sigma of 30 devices, 6 numbers each: a standard error of 0.075 where half are alike."""
    z = []
    for seed in range(30):
        campaign, truth = _device(np.random.default_rng(seed), 1e-2)
        found = calibrate_device(campaign, checked=True).calibration.accel
        assert found is not None and len(found.names) == 6
        error = np.asarray(found.curve.coefficients).ravel() - truth
        z.append(error / np.sqrt(np.diagonal(np.asarray(found.covariance))))
    assert 0.77 < np.sqrt(np.mean(np.square(z))) < 1.23


def test_level_faces_owe_next_to_nothing_to_held_misalignments():
    """A face off by ε reads ε γ of a misalignment γ; the stated sigma grows with ε."""
    campaign, _ = _device(np.random.default_rng(1), 0.0)
    off = calibrate_device(campaign, checked=True).calibration.accel
    level = np.tile(np.repeat(GRAVITY * FACES, 500, axis=0), 1)
    rng = np.random.default_rng(2)
    output = level + rng.normal(0.0, 0.02, level.shape)
    output[400:500] += rng.normal(0.0, 3.0, (100, 3))
    for k in range(1, 6):
        output[500 * k + 400 : 500 * k + 500] += rng.normal(0.0, 3.0, (100, 3))
    flat = Recording(time=np.arange(len(output)) / 100.0, accel=output, name="six")
    same = Campaign((flat,), Site(gravity=GRAVITY))
    on = calibrate_device(same, checked=True).calibration.accel
    assert off is not None and on is not None
    worst = [np.sqrt(np.diagonal(np.asarray(t.covariance))[:3]).max() for t in (on, off)]
    assert worst[0] < 1.5e-3  # m/s²: 0.02 / √400 / √2 of noise
    assert worst[1] > 5e-3  # 0.12 times 10 mrad of g


def test_the_budget_names_what_held_misalignments_do():
    """The parts sum to what is stated, and off-level faces owe most of it to the misalignments."""
    campaign, _ = _device(np.random.default_rng(4), 1e-2)
    fitted = calibrate_device(campaign, checked=True).accel
    assert fitted is not None
    parts = {p.source: p.covariance for p in split(fit_of(fitted), Rig())}
    whole = np.asarray(fitted.solution.covariance)
    np.testing.assert_allclose(sum(parts.values()), whole, rtol=1e-6, atol=1e-9 * whole.max())
    variances = {k: np.diagonal(c)[:3].sum() for k, c in parts.items()}
    assert variances[HELD] > 5.0 * variances[NOISE]


def test_slow_noise_and_held_misalignments_both_are_in_the_covariance():
    """Eight visits to six faces, a minute each, a bias that wanders within 300 s."""
    rng, count = np.random.default_rng(2), 48
    time = 60.0 * np.arange(count)
    faces = FACES + rng.normal(0.0, 0.05, FACES.shape)
    unit = np.tile(faces / np.linalg.norm(faces, axis=1, keepdims=True), (count // 6, 1))
    alike = np.exp(-np.abs(time[:, None] - time) / 300.0) + 1e-12 * np.eye(count)
    slow = 2e-2 * np.linalg.cholesky(alike) @ rng.standard_normal((count, 3))
    output = GRAVITY * unit + slow + 2e-3 * rng.standard_normal((count, 3))
    dwells = Dwells.from_arrays(output, temperature=np.full(count, 25.0), sigma=2e-3)
    dwells = eqx.tree_at(lambda d: d.time, dwells, time)
    chosen = ChosenModel("invariant", None, False, (0, None), (), accel_misalignments=False)
    estimator = Invariant(gravity=GRAVITY, misalignments=False)
    fitted = estimate_triad(estimator, dwells, chosen, "gauss-newton", lambda _: None, [], [])
    stated = stated_with_held(fitted)
    parts = {p.source: p.covariance for p in split(fit_of(stated), Rig())}
    whole = np.asarray(stated.solution.covariance)
    np.testing.assert_allclose(sum(parts.values()), whole, rtol=1e-6, atol=1e-9 * whole.max())
    assert SLOW in parts
    # By hand: |a| changes by u_i of a bias, g u_i² of a scale factor and g u_i u_j of a misalignment.
    rows = np.hstack([unit, GRAVITY * unit**2])
    held = GRAVITY * unit[:, [1, 2, 2]] * unit[:, [0, 0, 1]]
    slope = np.linalg.lstsq(rows, held, rcond=None)[0]
    by_hand = np.diagonal(1e-4 * slope @ slope.T)  # of 10 mrad each
    # Directions come from outputs that are up to 2 % of g off.
    np.testing.assert_allclose(
        np.diagonal(parts[HELD]), by_hand, rtol=0.1, atol=1e-3 * by_hand.max()
    )
    # What gyros by gravity are told of the accelerometers is the same.
    joint = with_held(stated)
    own = [joint.names.index(n) for n in stated.estimator.names]
    np.testing.assert_array_equal(joint.covariance[np.ix_(own, own)], whole)
