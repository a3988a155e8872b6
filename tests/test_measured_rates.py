"""A staircase of rates whose reference is measured: the plateaus are whole, and turning back is no rest. In NumPy."""

import numpy as np
import pytest

from inertiax.data.recording import Recording
from inertiax.reduction.segments import segment


HERTZ, HELD = 100, 10  # Hz, s
RATES = (30.0, -30.0, 60.0, -60.0, 240.0, -240.0)  # °/s
AXES = {"x": [1.0, 0.0, 0.0], "askew": [0.6, 0.0, -0.8]}


def staircase(axis, noise, seed=1):
    """Rest, the rates and rest, with ramps of 200 °/s² that pass zero; noise in °/s along the axis."""
    rate, now = [np.zeros(HELD * HERTZ)], 0.0
    for to in (*RATES, 0.0):
        rate += [np.linspace(now, to, int(abs(to - now) / 200.0 * HERTZ), endpoint=False)]
        rate += [np.full(HELD * HERTZ, to)]
        now = to
    rate = np.concatenate(rate)
    measured = rate + noise * np.random.default_rng(seed).standard_normal(len(rate))
    turns = np.abs(rate) > 0.05
    return Recording(
        time=np.arange(len(rate)) / HERTZ,
        accel=np.tile([0.0, 0.0, 9.81], (len(rate), 1)),
        gyro=np.radians(np.outer(rate, axis)),
        reference_gyro=np.radians(np.outer(measured, axis)),
        position=np.where(turns, -1, 3),
        name="table.csv",
    )


@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3, 2e-3], ids=str)
def test_plateaus_of_a_measured_rate_are_whole(axis, noise):
    recording = staircase(np.array(axis), noise)
    found = segment(recording)
    turning = np.asarray(found.position) < 0
    lasts = (recording.time[found.stop - 1] - recording.time[found.start])[turning]
    at = np.degrees(recording.reference_gyro[(found.start + found.stop) // 2] @ axis)[turning]
    # A step beyond 5 σ parts a plateau: 6 in 10⁷ steps of 6000. The last row may be without neighbours of its own.
    np.testing.assert_allclose(lasts, HELD, atol=0.05)
    np.testing.assert_allclose(at, RATES, atol=5.0 * noise + 1e-9)


@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
def test_a_row_in_which_a_table_turns_back_is_no_rest(axis):
    """From 30 to -30 °/s in 30 rows: one of them stands, and has the position's number."""
    recording = staircase(np.array(axis), 0.0)
    assert np.count_nonzero(np.diff(recording.position) == 4) > 2  # rests, as they are numbered
    found = segment(recording)
    lasts = (recording.time[found.stop - 1] - recording.time[found.start])[found.position >= 0]
    np.testing.assert_allclose(lasts, HELD, atol=0.05)
    assert len(lasts) == 2
