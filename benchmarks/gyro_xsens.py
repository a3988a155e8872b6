"""Gyros by gravity's rotation on imu_tk's Xsens recording: time of the fit, and what D is worth.

    INERTIAX_RECORDINGS=... python benchmarks/gyro_xsens.py [--json FILE]

imu_tk's own gyro fit takes 0.32 s there (9 parameters, 37 motions, compiled C++; as measured on two cores). The fit
here has 12 parameters and a covariance; the first call compiles (what the command line keeps in its cache), the
second shows the fit alone. Below: the error of a pose left out when the rests' mean rates are predicted by a bias,
and by bias and D.
"""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

from inertiax.calibrate import calibrate, DeviceResult
from inertiax.campaign import load_campaign
from inertiax.intervals import reduce_to_dwells
from inertiax.one_device import iterate_one
from inertiax.recordings import Campaign
from inertiax.temperature import Constant


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
    (result,) = calibrate(campaign)
    whole = time.perf_counter() - started
    assert isinstance(result, DeviceResult) and result.gyro is not None
    estimator, dwells = result.gyro.estimator, result.gyro.dwells
    seconds = []
    for _ in range(6):
        started = time.perf_counter()
        iterate_one(estimator, Constant(), dwells)
        seconds.append(time.perf_counter() - started)
    again = time.perf_counter()
    calibrate(campaign)
    again = time.perf_counter() - again
    bias, with_d = (left_out(campaign, g_sensitivity=d) for d in (False, True))
    print(
        f"whole calibration in process: first {whole:.2f} s, of which compilation {whole - again:.2f} s"
    )
    print(f"gyro fit: median {np.median(seconds[1:]):.3f} s compiled; imu_tk 0.32 s")
    print(
        f"pose left out, bias alone: {np.round(bias, 4)} deg/s; bias and D: {np.round(with_d, 4)} deg/s"
    )
    if arguments.json:
        rows = {"whole": whole, "again": again, "fit": seconds, "bias": bias.tolist()}
        arguments.json.write_text(json.dumps({**rows, "with_d": with_d.tolist()}, indent=1) + "\n")


if __name__ == "__main__":
    main()
