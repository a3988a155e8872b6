"""The accelerometers' uncertainty in gyros calibrated by gravity: by differences, and over simulated devices."""

import equinox as eqx
import numpy as np
import pytest

import turned_by_hand as hand
from inertiax.calibrate.accelerometers import calibrate_accelerometers
from inertiax.calibrate.accelerometers_in_gyros import sensitivity
from inertiax.calibrate.gyros import _turns
from inertiax.calibrate.one_triad import estimate_triad, with_refined_force
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.model_selection.select_model import build_estimators, choose_model
from inertiax.physics.parameter_names import parse
from inertiax.procedure.single_device import joint_fit_one
from inertiax.reduction.dwell_means import reduce_to_dwells


def test_the_sensitivity_is_what_changed_accelerometers_do_to_the_gyros():
    campaign = hand.log(3, motions=20)
    raw = reduce_to_dwells(campaign.recordings)
    chosen = choose_model(campaign, campaign.recordings)
    quiet = lambda _: None
    accel, chosen = calibrate_accelerometers(
        campaign, chosen, raw, "joint", None, quiet, choices=[], warnings=[]
    )

    def rests(coefficients):
        changed = eqx.tree_at(lambda r: r.solution.curve.coefficients, accel, coefficients)
        used = _turns(campaign, changed, with_refined_force(changed, raw), g_sensitivity=False)
        return used.dwells

    start = np.asarray(accel.solution.curve.coefficients)
    dwells = rests(start)
    _, estimator = build_estimators(chosen, campaign.site.gravity, raw, robust=None)
    assert estimator is not None
    gyro = estimate_triad(estimator, dwells, chosen, "joint", quiet, [], [])
    slope = sensitivity(gyro, accel, dwells)
    basis, small = gyro.solution.curve.basis, 1e-4
    for k in range(start.size):
        ends = []
        for sign in (1.0, -1.0):
            step = np.zeros(start.size)
            step[k] = sign * small
            moved = joint_fit_one(gyro.estimator, basis, rests(start + step.reshape(start.shape)))
            ends.append(np.asarray(moved.curve.coefficients).ravel())
        by_differences = (ends[0] - ends[1]) / (2.0 * small)
        # What is left out is of the order of the tilts' misfit and of the weights' change.
        assert np.allclose(slope[:, k], by_differences, rtol=0.02, atol=2e-3), k


@pytest.mark.slow
def test_gyros_of_thirty_devices_are_as_far_off_as_their_covariance_says():
    """χ² of gyros alone and with the accelerometers, and rms z, of 30 devices with white noise alone.

    Their mean is at most 1 by three standard errors. It is less, for scatter that ten degrees of freedom do not exclude
    is in the covariance: the accelerometers' variance is max(1, 1.2 χ²/10), 1.3 in the mean, and twice that in no fit
    in ten. The gyros' noise is small, so that much of their covariance is the accelerometers'.
    """
    truth = {"bias": hand.BIAS, "matrix": hand.SCALE - np.eye(3)}
    of_accel = {"bias": np.array([0.1, -0.2, 0.05]), "matrix": 0.004 * np.eye(3)}
    z, apart, alone, together = [], [], [], []
    for seed in range(30):
        device = hand.log(100 + seed, motions=18, rate=50.0, noise=1e-3)
        found = calibrate_device(device, checked=True).calibration
        assert found.cross_covariance is not None
        errors = [
            np.asarray(triad.curve.coefficients).ravel() - _true(triad.names, true)
            for triad, true in ((found.accel, of_accel), (found.gyro, truth))
        ]
        covariance = np.asarray(found.covariance)
        own = np.asarray(found.gyro.covariance)
        z.append(errors[1] / np.sqrt(np.diagonal(own)))
        alone.append(errors[1] @ np.linalg.solve(own, errors[1]))
        whole = np.concatenate(errors)
        together.append(whole @ np.linalg.solve(covariance, whole))
        names = found.gyro.names
        for i, j in ((0, 1), (0, 2), (1, 2)):  # the rotation between the triads
            row = np.zeros(len(names))
            row[names.index(f"gyro.matrix[{i},{j}]")] = 0.5
            row[names.index(f"gyro.matrix[{j},{i}]")] = -0.5
            apart.append(row @ errors[1] / np.sqrt(row @ own @ row))
    rms = lambda values: np.sqrt(np.mean(np.square(values)))
    # 360 numbers, half of them alike: a standard error of 0.053; then 90 numbers: one of 0.075.
    assert 0.84 / np.sqrt(1.3) < rms(z) < 1.16
    assert 0.78 / np.sqrt(1.3) < rms(apart) < 1.22
    for values, size in ((alone, 12.0), (together, 21.0)):
        error = 3.0 * np.sqrt(2.0 / size / 30.0)
        assert (1.0 - error) / 1.3 < np.mean(values) / size < 1.0 + error


def _true(names, truth):
    parts = [parse(name) for name in names]
    return np.array(
        [
            truth["bias"][p.row] if p.kind == "bias" else truth["matrix"][p.row, p.column]
            for p in parts
            if p is not None
        ]
    )
