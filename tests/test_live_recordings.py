"""Other people's recordings by hand, replayed through `live`: the batch's rests, and an end at or before theirs."""

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from inertiax.calibrate.pipeline import calibrate, calibrate_device, DeviceResult
from inertiax.data.recording import Campaign, Recording, Rig, Site
from inertiax.live.session import Session
from inertiax.live.target import parse_target
from inertiax.reduction.segments import segment


REAL = os.environ.get("INERTIAX_RECORDINGS")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(REAL is None, reason="INERTIAX_RECORDINGS names no folder of recordings"),
]
STANDARD = 9.80665


def xsens():
    accel, gyro = (
        np.loadtxt(Path(str(REAL)) / "imu_tk-xsens" / f"xsens_{k}.mat") for k in ("acc", "gyro")
    )
    num = min(len(accel), len(gyro))
    force = (accel[:num, 1:] - 32768) / [415.0, 413.0, 415.0]
    rate = (gyro[:num, 1:] - 32768) / [4778.0, 4758.0, 4766.0]
    return Recording(accel[:num, 0], accel=force, gyro=rate), 9.81744


def mpu(number):
    rows = np.loadtxt(Path(str(REAL)) / "mikoff-mpu9150" / f"imu{number}.log")
    return Recording(np.arange(len(rows)) * 0.01, accel=rows[:, :3], gyro=rows[:, 3:]), 9.81


def tomisuarez():
    file = Path(str(REAL)) / "tomisuarez-mpu6050" / "example_data_calibration.csv"
    rows = np.loadtxt(file, delimiter=",", skiprows=5)
    rate = np.deg2rad(rows[:, 3:] / 131)
    time = np.arange(len(rows)) * 0.01
    return Recording(time, accel=rows[:, :3] * STANDARD / 16384, gyro=rate), 9.797


def phone(name):
    folder = Path(str(REAL)) / "tyrex-phones" / name
    accel, gyro = (np.loadtxt(folder / f"{k}.txt") for k in ("accelerometer", "gyroscope"))
    accel = accel[np.unique(accel[:, 0], return_index=True)[1]]
    accel = accel[(accel[:, 0] >= gyro[0, 0]) & (accel[:, 0] <= gyro[-1, 0])]
    rate = np.stack([np.interp(accel[:, 0], gyro[:, 0], gyro[:, k]) for k in (1, 2, 3)], axis=1)
    force = accel[:, 1:4] * (-STANDARD if name.startswith("iPhone") else 1.0)
    return Recording(accel[:, 0], accel=force, gyro=rate), 9.80


LOGS = {
    "xsens": xsens,
    **{f"mpu{k}": lambda k=k: mpu(k) for k in range(3)},
    "tomisuarez": tomisuarez,
    **{n: lambda n=n: phone(n) for n in ("Nexus5_d1", "Nexus5_d2", "iPhone4S_d2", "iPhone4S_d3")},
}


# Of all others both biases and scale factors are asked for.
BIAS_ALONE = {"xsens": "accel.bias=2 mg", "mpu1": "accel.bias=6 mg"}


def part(recording, first, last):
    return Recording(
        recording.time[first:last],
        accel=recording.accel[first:last],
        gyro=recording.gyro[first:last],
    )


@cache
def replayed(name):
    """The recording and its gravity, the session and how many rows it took."""
    recording, gravity = LOGS[name]()
    target = BIAS_ALONE.get(name, "accel.bias=3 mg, accel.scale=3000 ppm")
    session = Session(Campaign((), Site(gravity), Rig()), parse_target(target))
    for first in range(0, recording.num_samples, 200):
        rows = part(recording, first, first + 200)
        list(session.feed(rows, rows.time))
        if session.finished:
            return recording, gravity, session, min(first + 200, recording.num_samples)
    list(session.end())
    return recording, gravity, session, recording.num_samples


@pytest.mark.parametrize("name", LOGS)
def test_a_replayed_recording_has_the_batch_rests(name):
    recording, _, session, rows = replayed(name)
    batch = segment(part(recording, 0, rows), held=True)
    assert abs(len(session.accepted) - batch.num_segments) <= 1
    ends = [(recording.time[a], recording.time[b - 1]) for a, b in zip(batch.start, batch.stop)]
    overlap = lambda r: any(min(r.time[1], b) - max(r.time[0], a) > 0 for a, b in ends)
    assert sum(map(overlap, session.accepted)) >= batch.num_segments - 1


def _accel(recording, gravity, held=True):
    campaign = Campaign((recording,), Site(gravity), Rig())
    (found,) = calibrate(campaign)
    assert isinstance(found, DeviceResult)
    if not held:
        rests = tuple(s.without_held() for s in found.segments)
        found = calibrate_device(campaign, segments=rests)
    triad = found.calibration.accel
    return np.asarray(triad.curve.coefficients)[0], np.sqrt(np.diag(np.asarray(triad.covariance)))


@pytest.mark.parametrize("name", BIAS_ALONE)
def test_where_it_stops_the_calibration_is_that_of_the_whole_log(name):
    recording, gravity, session, rows = replayed(name)
    assert session.finished and session.estimate.reached and rows < recording.num_samples
    (whole, _), first = _accel(recording, gravity), part(recording, 0, rows)
    # It asks for a rest that a hand held once more, where `calibrate` takes its |a|.
    early, std = _accel(first, gravity, held=False)
    # By the deviations that are said while it is recorded: those of a batch do not widen where few rests tell the
    # scatter. The early recording is a part of the whole, whose own error is smaller.
    mine = session.estimate.triads[0].posterior
    assert np.all(np.abs(early - whole) < 3.0 * mine.std)
    assert np.all(np.abs(mine.mean - early) < std)
