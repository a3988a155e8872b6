"""Is a twin's noise that of the device? Allan deviations of twins and of held-out logs of real devices at rest.

    INERTIAX_RECORDINGS=… python benchmarks/twin_devices.py [FOLDER]

The noise of each channel is identified on the first half of a log (`allan.identify`) and given to twins, the sensor's
low-pass filter with it; the twins' logs, as long as the second half, are compared with the second half. At each
averaging time the two Allan variances agree where their ratio is inside the 95 % limits of F with both logs'
equivalent degrees of freedom. Shares are means over five twins.

Devices: an MPU-6050 of tomisuarez2/ImuCalibration (449 s at rest), another of sunsided/sensor-fusion (10 min), an
Xsens MTi of imu_tk (its first 45 s). Counts become SI by the data sheets' nominal scales. `FOLDER` holds further logs
in any format that `inertiax` reads, with a `campaign.toml` where columns or units need one; their longest rest counts.

Two were measured so. A phone of ohad1765/Navigation_project_IMU_calibration: six rests of five minutes on its faces at
100 Hz, `Recordings_for_6_turns_method/imu_rec_*.mat` (MATLAB timetables: acceleration, orientation, angular velocity,
each as stamps in ms and three columns). And an IG-500N of milkytipo/Allan-variance: 2.44 h at rest in 36 572 rows, of
which columns 4 to 6 are m/s² and 7 to 9 deg/s, without the first 12 000 rows, in which it warms up by 8 °C.
"""

import argparse
import os
from pathlib import Path

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

import inertiax as ix
from inertiax.allan import identify, logs_of, name_of
from inertiax.allan.confidence import degrees_of_freedom
from inertiax.allan.deviations import deviations
from inertiax.allan.model import NoiseModel
from inertiax.allan.rest_channels import longest_rest


RATE = 100.0
TWINS = 5  # to a device
G = 9.80665
Channels = dict[str, tuple[np.ndarray, np.ndarray]]  # accelerometers and gyros, SI


def logs(home: Path) -> Channels:
    """Logs at rest by device."""
    counts = np.loadtxt(
        home / "tomisuarez-mpu6050" / "example_data_tinit_calc.csv", delimiter=",", skiprows=5
    )
    # Full scales of 2 g and 250 °/s in 16 bits.
    force, rate = counts[:, :3] * (G / 16384.0), np.deg2rad(counts[:, 3:] / 131.0)
    found = {"MPU-6050 (tomisuarez)": (force, rate)}
    still = home / "sunsided-mpu6050" / "unmoved-with-x-pointing-forward-10min"
    with (
        h5py.File(still / "mpu6050_accelerometer.mat") as accel,
        h5py.File(still / "mpu6050_gyroscope.mat") as gyro,
    ):
        rows = [np.asarray(f[next(iter(f))])[1:] for f in (accel, gyro)]
    found["MPU-6050 (sunsided)"] = rows[0].T * G, np.deg2rad(rows[1].T)
    xsens = [
        np.loadtxt(home / "imu_tk-xsens" / f"xsens_{k}.mat")[200:4700, 1:] for k in ("acc", "gyro")
    ]
    found["Xsens MTi"] = xsens[0] / 415.0, xsens[1] / 4778.0
    return found


def twin_logs(models: dict[str, list[NoiseModel]], size: int, rate: float) -> np.ndarray:
    """Accelerometers and gyros of twins at rest with the noise models of their channels: twin, time, channel."""
    # Off the grid of the read-out, where rounding is as good as random.
    force, turn = jnp.array([0.1234, -0.2345, 9.8]), jnp.array([0.0123, -0.0234, 0.0345])
    twin = ix.Twin(ix.Calibration(G), models, sample_rate=rate)

    @jax.jit
    def run(key: jax.Array) -> jax.Array:
        step = lambda state, _: twin.step(state, force, turn, 20.0)
        return jnp.concatenate(
            jax.lax.scan(step, twin.init(key, 20.0), None, length=size)[1], axis=1
        )

    return np.stack([np.asarray(run(jax.random.PRNGKey(k))) for k in range(TWINS)])


def agreement(
    held: np.ndarray, twins: np.ndarray, model: NoiseModel, rate: float
) -> tuple[float, int]:
    """Averaging times at which a log and a twin's agree, mean over the twins, and how many there are."""
    theirs = deviations(held, rate=rate)
    exponents = model.exponents(theirs.tau)
    freedom = np.array(
        [
            degrees_of_freedom(theirs.kind, len(held), int(m), int(a))
            for m, a in zip(theirs.factor, exponents)
        ]
    )
    low, high = (scipy.stats.f.ppf(p, freedom, freedom) for p in (0.025, 0.975))
    ratios = [(theirs.deviation / deviations(x, rate=rate).deviation) ** 2 for x in twins]
    return float(np.mean([np.sum((r >= low) & (r <= high)) for r in ratios])), len(theirs.tau)


def share(device: str, log: np.ndarray, rate: float) -> None:
    """Print the share of averaging times at which twins and the second half of a log agree; six channels."""
    half = len(log) // 2
    triads = {"accel": log[:half, :3], "gyro": log[:half, 3:]}
    models = {
        name: [identify(x, rate=rate, triad=name) for x in three.T]
        for name, three in triads.items()
    }
    made, counts, said = twin_logs(models, half, rate), np.zeros(2), []
    every = [model for three in models.values() for model in three]
    for channel, model in enumerate(every):
        one = agreement(log[-half:, channel], made[:, :, channel], model, rate)
        counts += one
        said.append(f"{model.triad}.{'xyz'[channel % 3]} {one[0]:.1f}/{one[1]}")
    print(
        f"{device}, {len(log) / rate:.0f} s: {counts[0] / counts[1]:.3f} ({', '.join(said)})",
        flush=True,
    )


def main() -> None:
    """Print each device's share of averaging times at which twins and held-out log agree."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, help="further logs at rest")
    folder = parser.parse_args().folder
    if "INERTIAX_RECORDINGS" in os.environ:
        for device, triads in logs(Path(os.environ["INERTIAX_RECORDINGS"])).items():
            share(device, np.concatenate(triads, axis=1), RATE)
    for parts in logs_of(ix.load_campaign(folder).recordings) if folder else ():
        rest, _ = longest_rest(parts)
        columns = [rest.channel(triad, axis) for triad in ("accel", "gyro") for axis in range(3)]
        first, last = rest.span
        rate = (rest.num_samples - 1) / (last - first)
        share(name_of(parts), np.stack([c[:] for c in columns], axis=1), rate)


if __name__ == "__main__":
    with jax.enable_x64(True):
        main()
