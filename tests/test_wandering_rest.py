"""Slow noise within the one rest of a log: what it adds to the noise of the mean, and what is said of it."""

import numpy as np
import polars as pl
import pytest

import inertiax as ix
from inertiax.calibrate.pipeline import calibrate
from inertiax.data.campaign import Campaign, Site
from inertiax.data.formats import ColumnMap
from inertiax.data.formats.columns import TriadColumns
from inertiax.fleet.reduce.raw_rows import reduce_table
from inertiax.reduction.wandering_rest import wander_of_rest


RATE, COUNT, NOISE = 100.0, 6000, 1e-3  # Hz, samples, rad/s


def _white(seed: int, count: int = COUNT) -> np.ndarray:
    return NOISE * np.random.default_rng(seed).normal(size=(count, 3))


def _recording(gyro: np.ndarray) -> ix.Recording:
    noise = 0.01 * np.random.default_rng(9).normal(size=gyro.shape)
    time = np.arange(len(gyro)) / RATE
    return ix.Recording.from_arrays(time, noise + [0.0, 0.0, 9.8], gyro)


def _flicker(rng: np.random.Generator, count: int) -> np.ndarray:
    """Power 1/f, by the transform of four times as many white samples."""
    frequency = np.fft.rfftfreq(4 * count)
    frequency[0] = frequency[1]
    white = np.fft.rfft(rng.normal(size=(4 * count, 3)), axis=0)
    return np.fft.irfft(white / np.sqrt(frequency)[:, None], axis=0)[:count]


SLOW = {
    "white": lambda rng, n: np.zeros((n, 3)),
    "walk": lambda rng, n: 1e-5 * np.cumsum(rng.normal(size=(n, 3)), axis=0),
    "flicker": lambda rng, n: 1e-4 * _flicker(rng, n),
    "ramp": lambda rng, n: np.linspace(0.0, 1e-3, n)[:, None] * rng.choice([-1.0, 1.0], 3),
}


def test_a_ramp_has_its_allan_variance_and_white_noise_none():
    variance = np.full(3, NOISE**2 / COUNT)
    ramp = np.linspace(-0.5, 0.5, COUNT)[:, None] * [0.0, 0.1, 1.0]
    found = wander_of_rest(_white(0) + ramp, variance)
    assert not wander_of_rest(_white(0), variance).any()
    # The slope is known to less than 1 %.
    np.testing.assert_allclose(found[1:], np.square([0.1, 1.0]) / 2.0, rtol=0.02)
    assert not wander_of_rest(np.zeros((COUNT, 3)), np.zeros(3)).any()  # constant outputs
    assert not wander_of_rest(_white(0)[:100], variance).any()  # too few samples tell nothing


def test_one_rest_that_drifts_says_so_in_its_sigmas():
    drift = np.linspace(-0.5e-2, 0.5e-2, COUNT)[:, None] * [1.0, 0.0, 0.0]
    result = calibrate(Campaign((_recording(_white(1) + drift),), Site()))[0]
    # Its ends are 5 mrad/s off its mean; the samples alone said 0.013 mrad/s.
    sigma = np.sqrt(np.diag(np.asarray(result.gyro.solution.covariance)))
    assert 5e-3 < sigma[0] < 9e-3
    assert np.all(sigma[1:] < 5.0 * NOISE / np.sqrt(COUNT))
    said = [c for c in result.choices if "wanders within the one rest" in c]
    assert len(said) == 1 and said[0].startswith("gyros")


def test_several_rests_tell_it_by_their_means():
    rests = [_recording(_white(k) + np.linspace(0.0, 1e-2, COUNT)[:, None]) for k in (1, 2)]
    assert ix.reduce_to_dwells(rests).wander is None
    assert ix.reduce_to_dwells(rests[:1]).wander is not None


@pytest.mark.slow  # 240 reductions
@pytest.mark.parametrize("kind", SLOW)
def test_halves_of_a_log_agree_within_their_sigmas(kind):
    deviates = []
    for seed in range(30):
        rng = np.random.default_rng([seed, 7])
        both = _white(seed, 2 * COUNT) + SLOW[kind](rng, 2 * COUNT)
        first, second = (ix.reduce_to_dwells(_recording(x)) for x in (both[:COUNT], both[COUNT:]))
        variance = [np.diagonal(d.gyro_covariance[0]) for d in (first, second)]
        deviates.append((first.gyro - second.gyro)[0] / np.sqrt(np.sum(variance, axis=0)))
    # Of 90 deviates the root mean square is known to 8 %; a flicker's slope passes for a ramp in part, which is wide.
    rms = float(np.sqrt(np.mean(np.square(deviates))))
    assert (0.35 if kind == "flicker" else 0.75) < rms < 1.3


def test_a_fleet_has_it_of_a_device_with_one_rest(tmp_path):
    rate = np.degrees(_white(3) + np.linspace(-0.5e-2, 0.5e-2, COUNT)[:, None])
    table = pl.DataFrame({"time": np.arange(COUNT) / RATE, "position": np.zeros(COUNT, int)})
    columns = {f"gyro_{a}": rate[:, k] for k, a in enumerate("xyz")}
    columns |= {
        f"accel_{a}": np.full(COUNT, v) for a, v in zip("xyz", (0.0, 0.0, 1.0), strict=True)
    }
    table = table.with_columns(**{name: pl.Series(v) for name, v in columns.items()})
    gyro = TriadColumns(names=("gyro_x", "gyro_y", "gyro_z"), unit="deg/s")
    accel = TriadColumns(names=("accel_x", "accel_y", "accel_z"), unit="g")
    found = reduce_table(table, np.array([COUNT]), ("a",), ColumnMap(accel=accel, gyro=gyro))
    (stack,) = found.stacks
    sigma = np.sqrt(np.diagonal(np.asarray(stack.dwells.gyro_covariance)[0, 0]))
    assert np.all((sigma > 5e-3) & (sigma < 9e-3))
