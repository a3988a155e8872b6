"""What the rows of a diagnosis know beside the outputs: the probe's error, and how large a misalignment can be."""

import jax
import numpy as np
import pytest
import scipy.stats

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose.noise.observation_series import variances
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.observations.blocks import cut, EARTH_RATE, join
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.selection.lack_of_fit import log_chance


G = 9.81
FACES = np.concatenate([np.eye(3), -np.eye(3)]) * G


def faces(misalignment, *, turns, degree, bias_slope=0.0, rig=None, seed=1):
    """Rests of 20 s on six faces, 2 Hz, while the chamber goes from 0 to 50 °C; no reference.

    `misalignment` is Γ's element (1, 0), `bias_slope` that of x in m/s² per °C, white noise of 0.2 mm/s² and 0.2 mm/s²
    more in each dwell.
    """
    rng = np.random.default_rng(seed)
    position = np.repeat(np.tile(np.arange(6), turns), 40)
    time = 0.5 * np.arange(len(position))
    temperature = np.linspace(0.0, 50.0, len(time))
    force = FACES[position]
    accel = force.copy()
    accel[:, 1] += misalignment * force[:, 0]
    accel[:, 0] += bias_slope * temperature
    accel += 2e-4 * rng.standard_normal(accel.shape)
    accel += np.repeat(2e-4 * rng.standard_normal((6 * turns, 3)), 40, axis=0)
    moved = np.where((np.arange(len(time)) % 40) < 2, -1, position)
    recording = Recording(time, accel=accel, temperature=temperature[:, None], position=moved)
    model = ModelChoice(accel_estimator="invariant", temperature_degree=degree)
    return Campaign((recording,), Site(G), rig or Rig(), model, "tactical")


def prepared(campaign):
    with jax.enable_x64(True):
        return prepare(campaign, ()).triads[0]


@pytest.mark.parametrize(("dwells", "size"), [(8, 3), (14, 1), (200, 4)])
def test_the_chance_of_a_likelihood_ratio_is_that_of_an_ordinary_regression(dwells, size):
    """Beside a constant, by least squares; where dwells are many it is that of χ²."""
    rng = np.random.default_rng(dwells)
    constant, columns = np.ones((dwells, 1)), rng.standard_normal((dwells, size))
    y = rng.standard_normal(dwells) + columns[:, 0]
    squares = [
        np.linalg.lstsq(x, y, rcond=None)[1][0] for x in (constant, np.hstack([constant, columns]))
    ]
    free = dwells - 1
    fisher = (squares[0] / squares[1] - 1.0) * (free - size) / size
    ratio = free * np.log(squares[0] / squares[1])
    expected = scipy.stats.f.logsf(fisher, size, free - size)
    assert log_chance(ratio, size, free) == pytest.approx(expected, rel=1e-9)
    many = scipy.stats.chi2.logsf(ratio, size)
    assert log_chance(ratio, size, 10**7) == pytest.approx(many, rel=1e-4)
    assert log_chance(ratio, size) == pytest.approx(many, rel=1e-9)
    assert log_chance(ratio, size, size) == 0.0


@pytest.mark.slow
def test_misalignments_that_faces_do_not_determine_are_no_parameters():
    # |a| on a face knows a misalignment m by m²/2 alone.
    base = prepared(faces(3e-3, turns=20, degree=3)).system.base
    assert base.form.matrix == ((0, 0), (1, 1), (2, 2))


@pytest.mark.slow
def test_the_probe_counts_by_the_slope_of_the_outputs_and_its_stated_uncertainty():
    campaign = faces(0.0, turns=8, degree=1, bias_slope=2e-3, rig=Rig(temperature_uncertainty=0.1))
    one = prepared(campaign)
    (heated,) = (chain.heated for chain in one.system.chains)
    # By hand: |a| feels the bias of x by the direction's x, so 0.1 °C are 2e-4 m/s² on faces ±x and nothing on others.
    direction = FACES[one.blocks.position] / G
    # The fitted slope of a bias is known to 2e-4 / (15 °C sqrt(16 dwells)) = 3e-6 of 2e-3; ten of them.
    assert np.allclose(heated[:, 0], 2e-4 * direction[:, 0], atol=4e-6)


@pytest.mark.slow
def test_without_a_stated_uncertainty_the_probe_does_not_count():
    one = prepared(faces(0.0, turns=8, degree=1, bias_slope=2e-3))
    assert all(chain.heated.shape[1] == 0 for chain in one.system.chains)


def rate_table(rates, *, ramp=3.0, flat=12.0, step=0.25):
    """Plateaus about z, run-up and run-down between them, and whether a sample is on a plateau."""
    speed, steady = [], []
    for rate in rates:
        up = rate * (np.arange(int(ramp / step)) + 0.5) * step / ramp
        level = np.full(int(flat / step), rate)
        speed += [up, level, up[::-1], np.zeros(8)]
        steady += [
            np.repeat([False, True, False], [len(up), len(level), len(up)]),
            np.zeros(8, bool),
        ]
    speed, steady = np.concatenate(speed), np.concatenate(steady)
    reference = np.stack([0.0 * speed, 0.0 * speed, speed + 0.7 * EARTH_RATE], axis=1)
    position = np.full(len(speed), -1)
    recording = Recording(
        step * np.arange(len(speed)), gyro=reference, reference_gyro=reference, position=position
    )
    return Campaign((recording,), Site(G), Rig(), ModelChoice()), steady


def test_slow_plateaus_are_rows_and_slow_ramps_are_not():
    # 0.02 deg/s is five Earth rates; 0.05 deg/s in 3 s grows by one Earth rate from sample to sample.
    campaign, steady = rate_table(np.deg2rad([0.02, -0.05, 0.1, -1.0, 30.0]))
    blocks = cut(join(campaign))
    rows = np.zeros(len(steady), bool)
    for start, stop in zip(blocks.start, blocks.stop):
        rows[start:stop] = True
    inside = steady & np.r_[True, steady[:-1]] & np.r_[steady[1:], True]
    assert (rows & inside).sum() == inside.sum()
    # Five samples an edge are the most that looks as constant as the Earth's turning allows; 12 are in a ramp.
    assert (rows & ~steady).sum() <= 2 * 5 * 5
    assert len(np.unique(blocks.dwell)) == 5


def test_an_unlabelled_rest_is_no_plateau():
    campaign, _ = rate_table(np.deg2rad([5.0]))
    (recording,) = campaign.recordings
    blocks = cut(join(campaign))
    rest = np.flatnonzero(np.linalg.norm(recording.reference_gyro, axis=1) < 2.0 * EARTH_RATE)
    covered = np.concatenate([np.arange(a, b) for a, b in zip(blocks.start, blocks.stop)])
    assert len(rest) >= 8 and not np.isin(rest, covered).any()


@pytest.mark.slow
def test_the_rigs_promise_is_a_limit_that_the_rows_may_undercut():
    # Positions repeat to 2e-5 rad where 1e-4 is promised: angle errors of a reference on faces, 9.81 m/s² times that.
    rng = np.random.default_rng(4)
    position = np.repeat(np.tile(np.arange(6), 30), 16)
    force = FACES[position]
    turn = np.repeat(2e-5 * rng.standard_normal((180, 3)), 16, axis=0)
    accel = force + np.cross(force, turn) + 2e-5 * rng.standard_normal(force.shape)
    moved = np.where(np.arange(len(position)) % 16 < 2, -1, position)
    time = 0.5 * np.arange(len(position))
    recording = Recording(time, accel=accel, reference_accel=force, position=moved)
    model = ModelChoice(accel_estimator="reference", temperature_degree=0)
    campaign = Campaign((recording,), Site(G), Rig(position_uncertainty=1e-4), model, "tactical")
    system = prepared(campaign).system
    with jax.enable_x64(True):
        fitted = variances(system, fit_noise(system))
    for v, chain in zip(fitted, system.chains):
        found = np.sqrt(v.rig * chain.rig.max() + v.dwell) / 9.81
        # 120 of 180 dwells turn the axis, and the promise counts as four more: of the variance promised
        # (120 · 0.2² + 4) / 124, which is 2.66e-5. One sigma of it is 1 / sqrt(248) = 6 %; bounds at four.
        assert found == pytest.approx(2.66e-5, rel=0.25)
