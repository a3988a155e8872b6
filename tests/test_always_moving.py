"""A log of a walk holds no rest: its own quietest windows are steps as well."""

import numpy as np
import pytest

from inertiax.campaign_draft.accel_unit import accel_unit
from inertiax.campaign_draft.resting import resting
from inertiax.data.recording import Recording
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.rests import find_rests


RATE = 100.0
G = 9.81
QUIET = 0.003, np.radians(0.05)  # m/s², rad/s: a consumer's noise


def walk(seconds, *, still=0.0, seed=0):
    """Steps at 1.8 a second with impacts that ring down, and before them a rest of `still` seconds."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(RATE * seconds)) / RATE
    phase = 2 * np.pi * (1.8 * time + 0.02 * np.cumsum(rng.normal(size=len(time))) / RATE)
    moves = (time > still)[:, None]
    swing = np.stack([np.sin(phase / 2), np.cos(phase / 2 + 0.4), np.sin(phase + 1.0)], axis=1)
    rate = moves * np.radians([25.0, 15.0, 20.0]) * swing
    force = moves * np.array([1.5, 1.5, 3.0]) * np.roll(swing, 1, axis=1)
    force = force + [0.0, 0.0, G] + QUIET[0] * rng.normal(size=(len(time), 3))
    return time, force, rate + QUIET[1] * rng.normal(size=(len(time), 3))


@pytest.mark.parametrize("triads", ["both", "accel", "gyro"])
def test_a_walk_is_no_rest(triads):
    time, accel, gyro = walk(60.0)
    log = Recording(
        time=time,
        accel=None if triads == "gyro" else accel,
        gyro=None if triads == "accel" else gyro,
        name="walk.csv",
    )
    found = find_rests(log, window=1.0)
    assert len(found.start) == 0
    assert found.statement.startswith(
        "no rest: the device moves all the time; even in the quietest 1 s, outputs"
    )
    with pytest.raises(
        ValueError,
        match="walk.csv: no rest .*moves all the time; even in the quietest 1 s, outputs",
    ):
        reduce_to_dwells([log])


@pytest.mark.parametrize("seed", range(3))
def test_a_walk_at_the_ankle_is_no_rest(seed):
    """At 50 Hz steps shake the accelerometers from sample to sample, too: three tenths of it are in means of five."""
    time, accel, gyro = walk(120.0, seed=seed)
    accel = accel + 2.3 * np.random.default_rng(seed).normal(size=accel.shape)
    thin = slice(None, None, 2)
    found = find_rests(
        Recording(time=time[thin], accel=accel[thin], gyro=gyro[thin], name="ankle.csv"), window=1.0
    )
    assert len(found.start) == 0 and found.statement.startswith("no rest: the device moves all")


@pytest.mark.parametrize("loud", ["accel", "gyro"])
def test_one_triad_that_sways_beside_white_noise_rests(loud):
    """Gyros in a wrong unit whose bias sways, or a bench that sways under them: the other triad's noise is white."""
    rng = np.random.default_rng(4)
    time = np.arange(5400) / 45.0
    sway = np.sin(2 * np.pi * time)[:, None]
    accel = [0.0, 0.0, G] + 4.0 * rng.normal(size=(5400, 3)) + 4.0 * (loud == "accel") * sway
    gyro = np.radians(30.0) * rng.normal(size=(5400, 3)) + 0.6 * (loud == "gyro") * sway
    found = find_rests(Recording(time=time, accel=accel, gyro=gyro), window=1.0)
    assert sum(found.stop - found.start) > 0.9 * 5400


def test_a_rest_shorter_than_a_twentieth_of_a_walk_is_found():
    time, accel, gyro = walk(120.0, still=3.0)
    found = find_rests(Recording(time=time, accel=accel, gyro=gyro), window=1.0)
    assert len(found.start) == 1
    # A window ends a half of itself before the motion, and transients are cut by windows.
    assert time[found.start[0]] < 0.6 and 2.0 < time[found.stop[0] - 1] <= 3.0


@pytest.mark.parametrize(
    ("accel_noise", "gyro_noise", "shake"),
    [
        pytest.param(2.0, np.radians(20.0), 0.0, id="white, as loud"),
        pytest.param(0.2, np.radians(1.0), 0.0, id="cheap"),
        pytest.param(0.2, np.radians(10.0), 0.0, id="gyros in a wrong unit"),
        pytest.param(0.05, np.radians(0.1), 6.0, id="a motor of 37 Hz"),
    ],
)
def test_a_loud_sensor_or_bench_rests(accel_noise, gyro_noise, shake):
    rng = np.random.default_rng(1)
    time = np.arange(6000) / RATE
    hum = np.sin(2 * np.pi * 37.0 * time)[:, None]
    accel = [0.0, 0.0, G] + accel_noise * rng.normal(size=(6000, 3)) + shake * hum
    gyro = gyro_noise * rng.normal(size=(6000, 3)) + np.radians(5.0 * shake) * hum
    found = find_rests(Recording(time=time, accel=accel, gyro=gyro), window=1.0)
    assert sum(found.stop - found.start) > 0.9 * 6000


def test_a_coarse_converter_rests():
    """Ten bits over ±3 g: a step of 0.06 m/s², and noise below it; of the gyros 1°/s."""
    rng = np.random.default_rng(2)
    time = np.arange(6000) / RATE
    accel = 0.06 * np.round(([0.02, 0.0, G] + 0.02 * rng.normal(size=(6000, 3))) / 0.06)
    step = np.radians(1.0)
    gyro = step * np.round((0.4 * step + 0.3 * step * rng.normal(size=(6000, 3))) / step)
    found = find_rests(Recording(time=time, accel=accel, gyro=gyro), window=1.0)
    assert sum(found.stop - found.start) > 0.9 * 6000


def test_a_draft_of_a_walk_counts_no_rest():
    time, accel, _ = walk(60.0)
    rests = resting(time, accel, single_rows=False, centre=np.zeros(3))
    assert rests.turned
    assert accel_unit(accel, rests).why.endswith("on average; no rests were found")
