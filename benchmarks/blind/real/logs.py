"""Other people's recordings in SI units: who made them, with what, and how their files are read.

Nothing of the package is used. Folders that are not there are left out, and said.
"""

import dataclasses
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np


DEG = np.pi / 180
STANDARD = 9.80665  # m/s²
XSENS_ACCEL = np.array([415.0, 413.0, 415.0])  # counts per m/s², the manufacturer's
XSENS_GYRO = np.array([4778.0, 4758.0, 4766.0])  # counts per rad/s


@dataclasses.dataclass(frozen=True, eq=False)
class Log:
    """One recording, SI, in the order of its rows."""

    name: str
    device: str  # the kind of device
    time: np.ndarray  # s
    accel: np.ndarray  # m/s²
    gyro: np.ndarray  # rad/s
    temperature: np.ndarray | None = None  # °C
    gravity: float = STANDARD  # m/s², where the log was made, or the standard value
    one_pose: bool = False


def read_all(recordings: Path, fetched: Path | None = None) -> list[Log]:
    """All logs under `recordings` (names as its README lists them) and `fetched` (see `fetch.py`)."""
    found = list(_own(recordings))
    if fetched is not None:
        found += _fetched(fetched)
    return found


def _own(root: Path) -> Iterator[Log]:
    readers: dict[str, Callable[[Path], Iterator[Log]]] = {
        "imu_tk-xsens": _xsens,
        "mikoff-mpu9150": _mikoff,
        "tyrex-phones": _phones,
        "sunsided-mpu6050": _sunsided,
        "tomisuarez-mpu6050": _tomisuarez,
        "imucal-ferraris": _imucal,
        "tofupilot-thermal": _tofupilot,
    }
    for folder, reader in readers.items():
        if (root / folder).is_dir():
            yield from reader(root / folder)
        else:
            print(f"left out: {root / folder} is not there")


def _xsens(folder: Path) -> Iterator[Log]:
    accel, gyro = (np.loadtxt(folder / f"xsens_{kind}.mat") for kind in ("acc", "gyro"))
    n = min(len(accel), len(gyro))
    yield Log(
        "xsens",
        "Xsens MTi",
        accel[:n, 0],
        (accel[:n, 1:] - 32768.0) / XSENS_ACCEL,
        (gyro[:n, 1:] - 32768.0) / XSENS_GYRO,
        gravity=9.81744,
    )


def _mikoff(folder: Path) -> Iterator[Log]:
    for number in range(3):
        rows = np.loadtxt(folder / f"imu{number}.log")
        yield Log(
            f"mpu9150-{number}", "MPU-9150", 0.01 * np.arange(len(rows)), rows[:, :3], rows[:, 3:6]
        )


def _phones(folder: Path) -> Iterator[Log]:
    for phone in sorted(p for p in folder.iterdir() if p.is_dir()):
        accel, gyro = (np.loadtxt(phone / f"{kind}.txt") for kind in ("accelerometer", "gyroscope"))
        # An iPhone tells multiples of g, with the sign of gravity instead of that of the specific force.
        unit = -STANDARD if phone.name.startswith("iPhone") else 1.0
        inside = (gyro[:, 0] > accel[0, 0]) & (gyro[:, 0] < accel[-1, 0])
        time = gyro[inside, 0]
        at = np.stack([np.interp(time, accel[:, 0], unit * accel[:, k]) for k in (1, 2, 3)], axis=1)
        yield Log(phone.name, phone.name.split("_")[0], time, at, gyro[inside, 1:4])


def _sunsided(folder: Path) -> Iterator[Log]:
    import h5py

    for sub, one_pose in (("full-sphere", False), ("unmoved-with-x-pointing-forward-10min", True)):
        columns = {}
        for kind in ("accelerometer", "gyroscope", "temperature"):
            with h5py.File(folder / sub / f"mpu6050_{kind}.mat") as file:
                data = next(v for v in file.values() if isinstance(v, h5py.Dataset))
                columns[kind] = np.array(data, dtype=float).T
        yield _as_sunsided(sub, one_pose, **columns)


def _as_sunsided(
    sub: str,
    one_pose: bool,
    accelerometer: np.ndarray,
    gyroscope: np.ndarray,
    temperature: np.ndarray,
) -> Log:
    """Multiples of g and degrees per second by size; host stamps in bursts, so rows are counted at 100 Hz."""
    n = min(len(accelerometer), len(gyroscope), len(temperature))
    size = np.median(np.linalg.norm(accelerometer[:n, -3:], axis=1))
    scale = STANDARD / size if size > 100 else (STANDARD if size < 3 else 1.0)
    gyro_unit = DEG / 131.0 if size > 100 else DEG
    warm = temperature[:n, -1]
    return Log(
        f"mpu6050-{'still' if one_pose else 'sphere'}",
        "MPU-6050 (desk)",
        0.01 * np.arange(n),
        accelerometer[:n, -3:] * scale,
        gyroscope[:n, -3:] * gyro_unit,
        warm if 0 < np.median(warm) < 80 else warm / 340.0 + 36.53,
        one_pose=one_pose,
    )


def _tomisuarez(folder: Path) -> Iterator[Log]:
    for file, one_pose in (
        ("example_data_calibration", False),
        ("example_data_tinit_calc", True),
        ("imu_static_test", True),
    ):
        rows = np.loadtxt(folder / f"{file}.csv", delimiter=",", skiprows=5)
        yield Log(
            f"mpu6050-{file.removeprefix('example_data_')}",
            "MPU-6050 (board)",
            0.01 * np.arange(len(rows)),
            rows[:, :3] * STANDARD / 16384.0,
            rows[:, 3:6] * DEG / 131.0,
            one_pose=one_pose,
        )


def _imucal(folder: Path) -> Iterator[Log]:
    rows = np.loadtxt(folder / "example_ferraris_session.csv", delimiter=",", skiprows=1)
    json.loads((folder / "example_ferraris_session_list.json").read_text())
    rate = 102.4  # Hz, of the sensor node; its rows are counted only
    yield Log(
        "ferraris", "BMI160 node", np.arange(len(rows)) / rate, rows[:, 4:7], rows[:, 1:4] * DEG, gravity=9.81
    )  # fmt: skip


def _tofupilot(folder: Path) -> Iterator[Log]:
    rows = np.loadtxt(folder / "imu_raw_data.csv", skiprows=6)
    yield Log(
        "sweep",
        "thermal chamber",
        1.0 * np.arange(len(rows)),  # its stamps are no clock; about one row a second
        rows[:, 4:7],
        rows[:, 1:4],
        rows[:, -1],
        gravity=9.81,
        one_pose=True,
    )


def _fetched(root: Path) -> Iterator[Log]:
    for number in (1, 2, 3):
        path = root / "staticposes" / f"imu_good{number}.txt"
        if path.exists():
            rows = np.loadtxt(path)
            # A host's stamps jitter by 1.5 ms about 100 Hz; rows are counted.
            yield Log(
                f"staticposes-{number}",
                "Xsens MTi (ROS)",
                0.01 * np.arange(len(rows)),
                rows[:, 1:4],
                rows[:, 4:7],
                gravity=9.79871,
            )
    from scipy.io import loadmat

    for folder, file, key in (("gesture", "caldata", "cal_data"), ("position", "Data", "data")):
        path = root / folder / f"{file}.mat"
        if path.exists():
            rows = loadmat(path)[key].astype(float)
            yield Log(
                folder,
                "MPU (2048 counts per g)",
                rows[:, 0],
                rows[:, 1:4] * STANDARD / 2048.0,
                rows[:, 4:7] * DEG / 16.4,
            )
