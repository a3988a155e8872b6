"""Where the temperature's course is unknown within one recording; rows made by hand."""

import numpy as np
import pytest

from inertiax.data.recording import Campaign, Recording
from inertiax.diagnose.observations.blocks import join
from inertiax.diagnose.observations.signals import since_pause


@pytest.mark.parametrize(
    ("pause", "jump", "step", "paused"),
    [
        (1800.0, 40.0, 1.0, True),  # s, °C, s
        (1800.0, 0.0, 1.0, True),  # it may have gone and come back
        (300.0, 40.0, 1.0, True),
        (300.0, 2.0, 1.0, False),  # a straight line is as good
        (25.0, 40.0, 1.0, False),
        (1800.0, 40.0, 300.0, False),  # six usual steps: a log of few rows
    ],
)
def test_a_long_pause_at_whose_end_the_temperature_is_another_begins_anew(
    pause, jump, step, paused
):
    rows = np.arange(200) * step
    time = np.r_[rows, rows[-1] + pause + rows]
    recording = Recording(
        time=time, accel=np.tile([0.0, 0.0, 9.81], (400, 1)), position=np.zeros(400, int),
        temperature=np.r_[np.zeros(200), np.full(200, jump)][:, None],
    )  # fmt: skip
    found = since_pause(join(Campaign((recording,))))
    if not paused:
        assert found is None
        return
    np.testing.assert_allclose(found, np.r_[rows, rows])
