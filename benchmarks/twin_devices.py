"""Is a twin's noise that of the device? Allan deviations of twins and of held-out logs of real devices at rest.

    INERTIAX_RECORDINGS=… python benchmarks/twin_devices.py

The noise of each channel is identified on the first half of a log (`allan.identify`) and given to a twin; the twin's
log, as long as the second half, is compared with the second half. At each averaging time the two Allan variances
agree where their ratio is inside the 95 % limits of F with both logs' equivalent degrees of freedom.

Devices: an MPU-6050 of tomisuarez2/ImuCalibration (449 s at rest), another of sunsided/sensor-fusion (10 min), an
Xsens MTi of imu_tk (its first 45 s). Counts become SI by the data sheets' nominal scales.
"""

import os
from pathlib import Path

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

import inertiax as ix
from inertiax.allan import identify
from inertiax.allan.confidence import degrees_of_freedom
from inertiax.allan.deviations import deviations
from inertiax.allan.model import NoiseModel


RATE = 100.0
G = 9.80665
Channels = dict[str, tuple[np.ndarray, np.ndarray]]  # accelerometers and gyros, SI


def logs(home: Path) -> Channels:
    """Logs at rest by device."""
    counts = np.loadtxt(
        home / "tomisuarez-mpu6050" / "example_data_tinit_calc.csv", delimiter=",", skiprows=5
    )
    found = {"MPU-6050 (tomisuarez)": _mpu(counts[:, :3], counts[:, 3:])}
    still = home / "sunsided-mpu6050" / "unmoved-with-x-pointing-forward-10min"
    with (
        h5py.File(still / "mpu6050_accelerometer.mat") as accel,
        h5py.File(still / "mpu6050_gyroscope.mat") as gyro,
    ):
        rows = [np.asarray(f[next(iter(f))])[1:] for f in (accel, gyro)]
    found["MPU-6050 (sunsided)"] = _mpu(*(r.T for r in rows))
    xsens = [
        np.loadtxt(home / "imu_tk-xsens" / f"xsens_{k}.mat")[200:4700, 1:] for k in ("acc", "gyro")
    ]
    found["Xsens MTi"] = xsens[0] / 415.0, xsens[1] / 4778.0
    return found


def _mpu(accel: np.ndarray, gyro: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Full scales of 2 g and 250 °/s in 16 bits."""
    return accel * (G / 16384.0), np.deg2rad(gyro / 131.0)


def twin_log(models: dict[str, list], size: int) -> tuple[np.ndarray, np.ndarray]:
    """A twin at rest with the noise models of its channels."""
    noise = {}
    for triad, three in models.items():
        value = lambda name, three=three: np.array([m.terms[name].value or 0.0 for m in three])
        noise[triad] = {name: value(name) for name in "NBKQ"}
        if all(m.rounding > 0.0 for m in three):
            noise[triad]["resolution"] = np.array([m.rounding for m in three])

    @jax.jit
    def run(key: jax.Array) -> tuple[jax.Array, ...]:
        twin = ix.Twin(ix.Calibration(G), noise, sample_rate=RATE)
        # Off the grid of the read-out, where rounding is as good as random.
        force, rate = jnp.array([0.1234, -0.2345, 9.8]), jnp.array([0.0123, -0.0234, 0.0345])
        return jax.lax.scan(
            lambda state, _: twin.step(state, force, rate, 20.0),
            twin.init(key, 20.0),
            None,
            length=size,
        )[1]

    accel, gyro = run(jax.random.PRNGKey(1))
    return np.asarray(accel), np.asarray(gyro)


def agreement(held: np.ndarray, twin: np.ndarray, model: NoiseModel) -> tuple[int, int]:
    """Averaging times at which the two agree, and how many there are."""
    ours, theirs = (deviations(x, rate=RATE) for x in (twin, held))
    exponents = model.exponents(ours.tau)
    freedom = np.array(
        [
            degrees_of_freedom(ours.kind, len(held), int(m), int(a))
            for m, a in zip(ours.factor, exponents)
        ]
    )
    ratio = (theirs.deviation / ours.deviation) ** 2
    low, high = (scipy.stats.f.ppf(p, freedom, freedom) for p in (0.025, 0.975))
    return int(np.sum((ratio >= low) & (ratio <= high))), len(ratio)


def main() -> None:
    """Print each device's share of averaging times at which twin and held-out log agree."""
    home = Path(os.environ["INERTIAX_RECORDINGS"])
    for device, triads in logs(home).items():
        half = len(triads[0]) // 2
        models = {
            name: [identify(x, rate=RATE, triad=name) for x in log[:half].T]
            for name, log in zip(("accel", "gyro"), triads)
        }
        made = twin_log(models, half)
        counts, said = np.zeros(2, int), []
        for (name, three), log, twin in zip(models.items(), triads, made):
            for axis, model in enumerate(three):
                one = agreement(log[-half:, axis], twin[:, axis], model)
                counts += one
                said.append(f"{name}.{'xyz'[axis]} {one[0]}/{one[1]}")
        print(
            f"{device}: {counts[0]}/{counts[1]} = {counts[0] / counts[1]:.3f} ({', '.join(said)})",
            flush=True,
        )


if __name__ == "__main__":
    with jax.enable_x64(True):
        main()
