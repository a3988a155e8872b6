"""Gyros by gravity's rotation on imu_tk's Xsens recording: agreement, time of the fit, and what D is worth.

    INERTIAX_RECORDINGS=... python benchmarks/gyro_xsens.py [--json FILE]

imu_tk's own gyro fit takes 0.32 s there (9 parameters, 37 motions, compiled C++; as measured on two cores). The fit
here has 12 parameters and a covariance; the first call compiles (what the command line keeps in its cache), the
second shows the fit alone.

imu_tk holds the bias at the mean of the first rest, 50 s long. So its scale factors are compared twice, with our bias
of all rests and with the bias held as it does; its bias is compared with our mean of that rest. Below: what is left
of gravity's direction after a motion, without and with D, and the error of a pose left out when the rests' mean rates
are predicted by a bias, and by bias and D.
"""

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np

from inertiax.calibrate.pipeline import calibrate, DeviceResult
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, ModelChoice
from inertiax.physics.temperature import Constant
from inertiax.procedure.single_device import iterate_one, joint_fit_one, Problem
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.rotations_between_rests import bias_scatter


CAMPAIGN = """
[site]
gravity = 9.81744
[recordings]
files = ["{folder}/xsens_acc.mat"]
gyro_files = ["{folder}/xsens_gyro.mat"]
[columns]
accel = {{ unit = "count", offset = 32768, scale = [415, 413, 415], scale_unit = "count per m/s^2" }}
gyro = {{ unit = "count", offset = 32768, scale = [4778, 4758, 4766], scale_unit = "count per rad/s" }}
"""


SCALE = np.array([4777.96, 4764.21, 4773.66])  # imu_tk's, counts per rad/s
BIAS = np.array([32777.1, 32459.8, 32511.8])  # imu_tk's, counts
NOMINAL = np.array([4778.0, 4758.0, 4766.0])


def inverse_scales(theta: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """Our Θ (by rows) as imu_tk's inverse scales: its frame is the one in which the accelerometers' inverse matrix
    is upper triangular, and there the gyros' is T K with a unit diagonal of T."""
    q, upper = np.linalg.qr(np.linalg.inv(np.eye(3) + gamma))
    q = q * np.sign(np.diagonal(upper))
    return NOMINAL / np.diagonal(q.T @ np.linalg.inv(np.eye(3) + theta.reshape(3, 3)))


def compared(theta: np.ndarray, covariance: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """Inverse scales less imu_tk's, in our standard deviations."""
    steps = 1e-6 * np.eye(9)
    slopes = [inverse_scales(theta + h, gamma) - inverse_scales(theta - h, gamma) for h in steps]
    jacobian = np.array(slopes).T / 2e-6
    sigma = np.sqrt(np.diagonal(jacobian @ covariance @ jacobian.T))
    return (inverse_scales(theta, gamma) - SCALE) / sigma


def with_bias_held(problem: Problem, bias: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Θ by rows and its covariance from the motions alone, the bias (rad/s) held."""
    vector = np.concatenate([bias, np.zeros(9)])
    for _ in range(8):
        rows, tilts = _tilts(problem, vector)
        vector[3:] -= np.linalg.lstsq(rows, tilts, rcond=None)[0]
    rows, _ = _tilts(problem, vector)
    return vector[3:], np.linalg.inv(rows.T @ rows)


def _tilts(problem: Problem, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    now = problem.at(vector[None])
    return now.jacobian[:, 3:, 3:12].reshape(-1, 9), now.residual[:, 3:].ravel()


def calibrated(
    campaign: Campaign, *, g_sensitivity: bool = False, together: bool = False
) -> DeviceResult:
    model = ModelChoice(g_sensitivity=g_sensitivity, together=together)
    changed = Campaign(campaign.recordings, campaign.site, model=model)
    (result,) = calibrate(changed)
    assert isinstance(result, DeviceResult) and result.gyro is not None, result
    return result


def agreement(campaign: Campaign, result: DeviceResult) -> dict[str, list[float]]:
    """Differences from imu_tk's answers, in our standard deviations."""
    assert result.gyro is not None and result.accel is not None
    gamma = np.asarray(result.calibration.accel_errors(0.0).matrix)
    solution = result.gyro.solution
    vector, covariance = np.asarray(solution.curve.coefficients)[0], np.asarray(solution.covariance)
    rests = reduce_to_dwells(campaign.recordings)
    first = np.asarray(rests.gyro)[0]
    own = np.sqrt(np.diagonal(np.asarray(rests.gyro_covariance)[0]))
    problem = Problem(result.gyro.estimator, Constant(), result.gyro.dwells)
    held = with_bias_held(problem, first)
    bias = (BIAS - 32768.0) / NOMINAL
    return {
        "scale, bias of all rests": list(compared(vector[3:12], covariance[3:12, 3:12], gamma)),
        "scale, bias of the first rest": list(compared(*held, gamma)),
        "bias of the first rest": list((first - bias) / own),
        "bias of all rests, by the scatter": list((vector[:3] - bias) / bias_scatter(rests)),
        "bias of all rests, by its sigma": list(
            (vector[:3] - bias) / np.sqrt(np.diagonal(covariance))[:3]
        ),
    }


def left_out(campaign: Campaign, *, g_sensitivity: bool) -> np.ndarray:
    """Root mean square error (deg/s) of each axis' mean rate at a rest that the fit did not see."""
    dwells = reduce_to_dwells(campaign.recordings)
    gyro, force = np.rad2deg(np.asarray(dwells.gyro)), np.asarray(dwells.accel)
    columns = [np.ones((len(gyro), 1)), *([force / 9.81744] if g_sensitivity else [])]
    design = np.hstack(columns)
    hat = design @ np.linalg.pinv(design)
    error = (gyro - hat @ gyro) / (1.0 - np.diagonal(hat))[:, None]
    return np.sqrt(np.mean(error**2, axis=0))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    source = Path(os.environ["INERTIAX_RECORDINGS"]) / "imu_tk-xsens"
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "campaign.toml").write_text(CAMPAIGN.format(folder=source))
        campaign = load_campaign(name)
    started = time.perf_counter()
    result = calibrated(campaign)
    whole = time.perf_counter() - started
    assert result.gyro is not None
    estimator, dwells = result.gyro.estimator, result.gyro.dwells
    times = {
        "one least squares, as imu_tk's": _times(
            lambda: joint_fit_one(estimator, Constant(), dwells)
        ),
        "procedure (default)": _times(lambda: iterate_one(estimator, Constant(), dwells)),
    }
    again = time.perf_counter()
    calibrated(campaign)
    again = time.perf_counter() - again
    bias, with_d = (left_out(campaign, g_sensitivity=d) for d in (False, True))
    apart = agreement(campaign, result)
    tilts = {
        "bias and matrix": result.gyro.rms,
        "and D": _rms(calibrated(campaign, g_sensitivity=True)),
        "and D, both triads together": _rms(
            calibrated(campaign, g_sensitivity=True, together=True)
        ),
    }
    print("difference from imu_tk, in our standard deviations (x, y, z)")
    for name, values in apart.items():
        print(f"  {name:36}" + "".join(f"{v:8.2f}" for v in values))
    print("gravity's direction after a motion, rms")
    for name, value in tilts.items():
        print(f"  {name:36}{1e3 * value:8.2f} mrad")
    print(
        f"pose left out, bias alone: {np.round(bias, 4)} deg/s; bias and D: {np.round(with_d, 4)} deg/s"
    )
    print(
        f"whole calibration in process: first {whole:.2f} s, of which compilation {whole - again:.2f} s"
    )
    print("gyro fit, compiled: median of 5 (of which the processor was busy); imu_tk 0.32 s")
    for name, (wall, busy) in times.items():
        print(f"  {name:36}{wall:8.3f} s ({busy:.3f} s)")
    if arguments.json:
        rows = {"whole": whole, "again": again, "fit": times, "bias": bias.tolist()}
        rows |= {"with_d": with_d.tolist(), "apart": apart, "tilts": tilts}
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")


def _times(fit: Callable[[], object]) -> tuple[float, float]:
    """Median seconds of five calls after a first one: by the clock, and of the processor."""
    fit()
    rows = []
    for _ in range(5):
        started, before = time.perf_counter(), time.process_time()
        fit()
        rows.append((time.perf_counter() - started, time.process_time() - before))
    wall, busy = np.median(rows, axis=0)
    return float(wall), float(busy)


def _rms(result: DeviceResult) -> float:
    assert result.gyro is not None
    return result.gyro.rms


if __name__ == "__main__":
    main()
