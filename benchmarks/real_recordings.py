"""What the diagnosis finds in other people's recordings, and how well it predicts what it did not see.

Three public recordings, found through the environment variable INERTIAX_RECORDINGS:

* a thermal sweep of one pose (tofupilot/examples, MIT) with only the usual cubic in temperature as the
  model; the last cooling branch is kept from fit and choice;
* an Xsens MTi in 38 poses (imu_tk): its gyros at rest with only a bias as the model, its accelerometers
  with the invariant one; each pose is predicted from the others;
* three MPU-9150 logs (mikoff/imu-calib, MIT) with the same models: nothing to be found.

The bound in the same run is the model alone. `python benchmarks/real_recordings.py [sweep|xsens|mpu ...]`
"""

import os
import sys
import time
from pathlib import Path

import numpy as np
import polars as pl

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import Diagnosis, hold_out, leave_positions_out, Prediction


COUNTS_ACCEL = np.array([415.0, 413.0, 415.0])  # per m/s², the manufacturer's
COUNTS_GYRO = np.array([4778.0, 4758.0, 4766.0])  # per rad/s
OFFSET = 32768.0


def folder() -> Path:
    """Where the recordings are. Raises `ValueError` where the variable is not set or names no folder."""
    named = os.environ.get("INERTIAX_RECORDINGS", "")
    if not named or not Path(named).is_dir():
        raise ValueError(f"INERTIAX_RECORDINGS={named!r}: set it to the folder of the recordings.")
    return Path(named)


def sweep() -> tuple[Campaign, float]:
    """The thermal sweep with the static cubic model, and when its last cooling branch begins, s."""
    path = folder() / "tofupilot-thermal" / "imu_raw_data.csv"
    rows = pl.read_csv(path, separator="\t")[5:].to_numpy().astype(float)
    time_ = np.arange(len(rows)) * 1.0  # its stamps are no clock; about one row per second
    recording = Recording(
        time=time_,
        accel=rows[:, 4:7],
        gyro=rows[:, 1:4],
        temperature=rows[:, -1:],
        position=np.zeros(len(rows), int),
    )
    model = ModelChoice("static", "static", False, 3)
    return Campaign((recording,), Site(9.81), Rig(), model), float(time_[rows[:, -1].argmax()])


def xsens() -> Campaign:
    """The Xsens log: gyros with a bias only, accelerometers with the invariant model."""
    accel, gyro = (
        np.loadtxt(folder() / "imu_tk-xsens" / f"xsens_{kind}.mat") for kind in ("acc", "gyro")
    )
    num = min(len(accel), len(gyro))
    recording = Recording(
        time=accel[:num, 0],
        accel=(accel[:num, 1:] - OFFSET) / COUNTS_ACCEL,
        gyro=(gyro[:num, 1:] - OFFSET) / COUNTS_GYRO,
    )
    model = ModelChoice("invariant", "static", False, 0)
    return Campaign((recording,), Site(9.81744), Rig(), model)


def mpu(number: int) -> Campaign:
    """An MPU-9150 log: gyros with a bias only, accelerometers with the invariant model."""
    rows = np.loadtxt(folder() / "mikoff-mpu9150" / f"imu{number}.log")
    recording = Recording(time=np.arange(len(rows)) * 0.01, accel=rows[:, :3], gyro=rows[:, 3:])
    model = ModelChoice("invariant", "static", False, 0)
    return Campaign((recording,), Site(9.81), Rig(), model)


def show(title: str, found: Diagnosis, predicted: tuple[Prediction, ...], seconds: float) -> None:
    """One recording's answer and its table of predictions."""
    print(f"\n{title}: {found.verdict} ({seconds:.0f} s)")
    for effect in found.effects:
        others = f" (or {', '.join(effect.alternatives)})" if effect.alternatives else ""
        print(f"  {effect.name}{others} on {', '.join(effect.channels)}")
        for name, value in effect.parameters:
            std = "not determined" if value.std is None else f"± {value.std:.2g}"
            print(f"    {name}: {value.value:.4g} {std} {value.unit}")
    if found.empirical:
        print(f"  empirical: {found.empirical}")
    print(f"  {'channel':8s} {'model alone':>12s} {'with effects':>12s}")
    for p in predicted:
        unit = "rad/s" if p.channel.startswith("gyro") else "m/s²"
        print(
            f"  {p.channel:8s} {p.baseline_rms:12.3g} {p.augmented_rms:12.3g} {unit:6s} {', '.join(p.effects)}"
        )


def main(asked: list[str]) -> None:
    """Run what is asked for, or everything."""
    if not asked or "sweep" in asked:
        begin = time.perf_counter()
        campaign, start = sweep()
        show("thermal sweep", *hold_out(campaign, start=start), time.perf_counter() - begin)
    if not asked or "xsens" in asked:
        begin = time.perf_counter()
        show("Xsens MTi", *leave_positions_out(xsens()), time.perf_counter() - begin)
    for number in range(3) if not asked or "mpu" in asked else ():
        begin = time.perf_counter()
        found = leave_positions_out(mpu(number))
        show(f"MPU-9150 {number}", *found, time.perf_counter() - begin)


if __name__ == "__main__":
    main(sys.argv[1:])
