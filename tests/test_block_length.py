"""Blocks of a hand log are longer than its tremor, so that their scatter is white, and tell small effects."""

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from inertiax.reduction.block_length import length_beyond_tremor


RATE, RESTS, SAMPLES = 200.0, 16, 800
FIRST = np.arange(RESTS) * (SAMPLES + 100)


def _length(values, shortest=8):
    return length_beyond_tremor(values, FIRST, FIRST + SAMPLES, shortest)


@pytest.mark.parametrize("seed", range(20))
def test_white_noise_keeps_the_shortest_block(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(FIRST[-1] + SAMPLES, 4))
    assert [_length(values, shortest) for shortest in (6, 8, 11)] == [6, 8, 11]


@pytest.mark.parametrize("seed", range(5))
def test_red_noise_keeps_the_shortest_block(seed):
    rng = np.random.default_rng(seed)
    assert _length(np.cumsum(rng.normal(size=(FIRST[-1] + SAMPLES, 4)), axis=0)) == 8


@pytest.mark.parametrize("seed", range(5))
def test_a_tremor_of_6_hz_asks_for_blocks_longer_than_its_period_by_half_at_least(seed):
    """The acceleration of a hand that trembles in place: the second derivative of a position of 3 to 9 Hz, ten times
    the white noise. What the blocks scatter says of longer means is then right to a factor of three, by NumPy alone."""
    rng = np.random.default_rng(seed)
    rows = FIRST[-1] + SAMPLES
    place = sosfilt(butter(2, [3.0, 9.0], "band", fs=RATE, output="sos"), rng.normal(size=rows))
    force = np.gradient(np.gradient(place))
    white = rng.normal(size=rows)
    values = (white + 10.0 * force / force.std())[:, None]
    length = _length(values)
    assert length >= 0.5 * RATE / 6.0

    def density(samples):
        """Allan variance of means over some samples times their number: the same at all of them for white noise."""
        parts = [values[a : a + SAMPLES // samples * samples, 0] for a in FIRST]
        means = np.stack([p.reshape(-1, samples).mean(axis=1) for p in parts])
        return samples * 0.5 * np.mean(np.diff(means, axis=1) ** 2)

    assert density(8) > 10.0 * density(128)
    assert density(length) < 3.0 * density(128)  # what the length promises
