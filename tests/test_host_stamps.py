"""Stamps that a host made in bursts are told of, with the sensor's own rate."""

import numpy as np
import pytest

from inertiax.allan import noise_of
from inertiax.data.recording import Recording
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.host_stamps import host_stamps, usual_rate


def burst_stamps(rate=100.0, count=6000, burst=20, seed=0):
    """A host that reads all rows that have come, some 20 at a time, and stamps them 2 ms apart while it writes."""
    rng = np.random.default_rng(seed)
    measured = np.arange(count) / rate
    reads = np.cumsum(rng.integers(burst - 8, burst + 8, count // burst + 50))
    reads = reads[reads < count]
    last = np.append(reads, count - 1)[np.searchsorted(reads, np.arange(count))]
    first = np.append(0, reads)[np.searchsorted(reads, np.arange(count))]
    return measured[last] + 0.002 * (np.arange(count) - first) + 1e-4 * rng.random(count)


def recording(time, seed=1):
    rng = np.random.default_rng(seed)
    gyro = [0.08, 0.001, 0.02] + 0.002 * rng.standard_normal((len(time), 3))
    return Recording(time=time, gyro=gyro, name="still.csv")


@pytest.mark.parametrize("rate", [50.0, 100.0, 104.0, 119.0])
def test_the_rate_behind_bursts_is_found(rate):
    found = host_stamps(burst_stamps(rate))
    assert found is not None and found.rate == rate


def test_regular_and_jittering_stamps_are_no_bursts():
    rng = np.random.default_rng(0)
    time = np.arange(5000) / 100
    assert host_stamps(time) is None
    assert host_stamps(time + 0.003 * rng.random(5000)) is None
    # One row in a hundred is lost: gaps, but no bursts.
    assert host_stamps(time[rng.random(5000) > 0.01]) is None


def test_where_rows_were_lost_no_rate_is_offered():
    time = burst_stamps()
    found = host_stamps(np.concatenate([time[:2000], time[2500:]]))
    assert found is not None and found.rate is None


def test_a_halt_of_the_host_and_rows_lost_here_and_there_leave_a_rate():
    """It writes half a second's rows at once when it goes on; the second log loses up to two rows of a hundred."""
    stalled = np.maximum.accumulate(np.where(np.arange(6000) // 50 == 60, 30.5, 0.0))
    time = np.maximum(burst_stamps(), stalled + 1e-6 * np.arange(6000))
    assert np.diff(time).max() > 0.4 and np.all(np.diff(time) > 0.0)
    assert host_stamps(time).rate == 100.0
    # The mean rate is no usual one.
    rng = np.random.default_rng(3)
    kept = burst_stamps(count=60000)
    kept = kept[rng.random(60000) > np.linspace(0.0, 0.02, 60000)]
    mean = (len(kept) - 1) / (kept[-1] - kept[0])
    assert mean < 99.2 and host_stamps(kept).rate == pytest.approx(mean, rel=1e-3)


def test_an_unusual_rate_is_given_as_measured():
    assert usual_rate(99.9) == 100.0
    assert usual_rate(91.2345) == 91.23


def test_errors_that_bursts_explain_say_so():
    still = recording(burst_stamps())
    with pytest.raises(
        ValueError, match=r"no rest.*stamps come in bursts.*time = \{ rate = 100 \}\.$"
    ):
        reduce_to_dwells([still])
    with pytest.raises(ValueError, match=r"longest rest has .*time = \{ rate = 100 \}\.$"):
        noise_of(still)
    # And the line mends it: the bias comes out.
    counted = Recording(time=np.arange(6000) / 100, gyro=still.gyro)
    np.testing.assert_allclose(
        np.asarray(reduce_to_dwells([counted]).gyro)[0], [0.08, 0.001, 0.02], atol=1e-4
    )
