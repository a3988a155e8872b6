"""Whether a staircase of rates has one positioning error or one at each rate is read off the rows; tables in NumPy."""

import jax
import numpy as np
import pytest

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose.noise.observation_series import positionings_of
from inertiax.diagnose.problem import prepare


ANGLE = 3e-4  # rad, of a positioning
STAIRCASE = np.radians([30.0, -30.0, 60.0, -60.0, 100.0, -100.0])
SECONDS, HERTZ = 10, 10


def table(rng, *, shared, cross=0.0):
    """Twice a staircase about each axis, then rests; gyro x also gets `cross` |ω_y|."""
    axes = np.repeat(np.tile(np.eye(3), (2, 1)), len(STAIRCASE), axis=0)
    rate = np.concatenate([axes * np.tile(STAIRCASE, 6)[:, None], np.zeros((6, 3))])
    up = np.concatenate([axes, np.tile(np.eye(3), (2, 1))])
    drawn = ANGLE * rng.standard_normal((len(rate), 3))
    if shared:
        drawn[:36] = np.repeat(drawn[:6], 6, axis=0)
    seen = 1.002 * rate + np.cross(drawn, rate) + 1e-3
    seen[:, 0] += cross * np.abs(rate[:, 1])
    rows = lambda x: np.repeat(x, SECONDS * HERTZ, axis=0)
    number = np.where(np.arange(len(rate)) < 36, -1, np.arange(len(rate)))
    recording = Recording(
        time=np.arange(len(rate) * SECONDS * HERTZ) / HERTZ,
        gyro=rows(seen) + 1e-3 * rng.standard_normal((len(rows(seen)), 3)),
        reference_gyro=rows(rate),
        reference_accel=9.81 * rows(up),
        position=rows(number),
        name="table.csv",
    )
    rig = Rig(position_uncertainty=ANGLE, rate_uncertainty=1e-5)
    model = ModelChoice(gyro_estimator="reference", temperature_degree=0)
    return Campaign((recording,), Site(gravity=9.81), rig=rig, model=model)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shared", "cross"), [(True, 0.0), (False, 0.0), (True, 3e-3)], ids=["one", "each", "effect"]
)
def test_the_rows_tell_whether_plateaus_share_a_positioning(shared, cross):
    """An effect that grows with the rate about another axis, twenty times its standard deviation, is no wobble."""
    with jax.enable_x64(True):
        (gyro,) = prepare(table(np.random.default_rng(4), shared=shared, cross=cross)).triads
    assert len(np.unique(positionings_of(gyro.blocks))) == 7  # six staircases, and the rests
    # An error of one positioning moves the outputs of six plateaus. About one axis at a time an error of one plateau is
    # each channel's own, and none is shared.
    dwell = np.count_nonzero(gyro.blocks.dwell == gyro.blocks.dwell[0])
    errors = gyro.system.shared
    assert (errors is not None) == shared
    if errors is not None:
        moved = np.any(np.stack(errors.columns) != 0.0, axis=0).sum(axis=0)
        assert moved.max() == 6 * dwell
