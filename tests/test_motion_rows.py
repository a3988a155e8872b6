"""The gyros' motions between rests in a diagnosis: their rows, and effects that show in nothing else."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.diagnose.observations.blocks import join
from inertiax.diagnose.observations.motion_rows import FEWEST, motion_rows, MotionRows
from inertiax.diagnose.pipeline import diagnose_campaign
from inertiax.diagnose.plan.detectability import audit
from inertiax.diagnose.plan.separate import NameSet, separate
from inertiax.diagnose.problem_of_motions import PARTED_BY
from inertiax.estimators.gravity_rotation import across
from turned_by_hand import log, SCALE


@pytest.fixture(scope="module")
def clean() -> MotionRows:
    campaign = log(3)
    rows = motion_rows(campaign, join(campaign), calibrate_device(campaign))
    assert rows is not None
    return rows


def carried(rates: np.ndarray, step: float, start: np.ndarray) -> np.ndarray:
    """A direction fixed in the room after a motion, by SciPy's rotations over twenty parts of every step."""
    fine = np.linspace(0.0, len(rates) - 1, 20 * (len(rates) - 1) + 1)
    middle = 0.5 * (fine[1:] + fine[:-1])
    between = np.stack([np.interp(middle, np.arange(len(rates)), r) for r in rates.T], axis=1)
    attitude = Rotation.identity()
    for turn in Rotation.from_rotvec(between * step / 20):
        attitude = attitude * turn
    return attitude.inv().apply(start)


@pytest.mark.slow
def test_response_is_the_change_of_the_end_by_scipys_rotations(clean):
    blocks, rates = clean.blocks, clean.rates
    for motion in (0, 7):
        rows = slice(blocks.start[2 * motion], blocks.stop[2 * motion])
        now = rates[rows]
        addition = np.zeros_like(rates)
        course = np.linspace(0.0, 1.0, len(now))
        addition[rows] = np.stack([course, np.sin(5 * course), 1.0 - course**2], axis=1)
        # What an output gains reaches the rate through the inverse of the calibrated matrix, near the true one.
        gained = 1e-4 * addition[rows] @ np.linalg.inv(SCALE).T
        start = np.array([0.6, -0.48, 0.64])
        before, after = (carried(w, 0.01, start) for w in (now, now + gained))
        # The end turns by a small v, every direction u of the room by u × v; two of them tell v.
        second = [carried(w, 0.01, np.array([0.0, 0.8, 0.6])) for w in (now, now + gained)]
        cross = lambda u: np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
        design = np.concatenate([cross(before), cross(second[0])])
        change = np.concatenate([after - before, second[1] - second[0]])
        v = np.linalg.lstsq(design, change, rcond=None)[0]
        felt = 1e-4 * blocks.felt(addition[:, :, None])[2 * motion : 2 * motion + 2].sum(
            axis=(1, 2)
        )
        # The rows are what that does to gravity, along two directions across it.
        end = _end_of(clean, motion)
        expected = np.asarray(across(end)) @ np.cross(end, v)
        # The tilt is a milliradian, the matrix known to 1e-3.
        np.testing.assert_allclose(felt, expected, rtol=0.01, atol=0.01 * np.linalg.norm(v))


def _end_of(rows: MotionRows, motion: int) -> np.ndarray:
    """Direction of the specific force at the rest after a motion, of the outputs there."""
    stop = int(rows.blocks.stop[2 * motion])
    campaign = log(3)
    force = campaign.recordings[0].accel[stop : stop + 300].mean(axis=0)
    force = (force - [0.1, -0.2, 0.05]) / 1.004
    return force / np.linalg.norm(force)


def test_rows_are_the_misfits_of_the_calibration(clean):
    fitted = calibrate_device(log(3)).gyro
    np.testing.assert_allclose(clean.base.observed[0].reshape(-1, 2), fitted.misfit, atol=1e-9)
    kept = np.repeat(np.arange(clean.blocks.num_blocks // 2) % 3 > 0, 2)
    some = clean.blocks[kept]
    ones = np.ones((len(clean.rates), 3, 1))
    np.testing.assert_array_equal(some.felt(ones), clean.blocks.felt(ones)[kept])


def test_few_motions_are_no_rows():
    campaign = log(4, motions=FEWEST - 1)
    assert motion_rows(campaign, join(campaign), calibrate_device(campaign)) is None


def test_a_set_that_only_motions_show_is_not_parted_by_a_stations_run():
    names = NameSet(("scale_asymmetry", "rate_nonlinearity"), ("gyro_x",))
    with pytest.raises(ValueError, match=f"rests show 0 of .*; .* is parted by {PARTED_BY}"):
        separate(log(11, motions=20), names)


HIDDEN = {
    "scale_asymmetry": (lambda w: np.abs(w) * [0.006, 0.0, 0.0], "gyro_x", 0.006),
    "rate_nonlinearity": (lambda w: w * np.abs(w) * [0.0, 0.006, 0.0], "gyro_y", 0.006),
    "cross_axis_rate": (lambda w: (w[:, :1] * w[:, 1:2]) * [0.0, 0.0, 0.006], "gyro_z", 0.006),
}


# Noise of the same density: a whole diagnosis of the rests needs no more rows.
SLOWER = {"rate": 25.0, "noise": 1e-3}


@pytest.mark.slow
@pytest.mark.parametrize("name", HIDDEN)
def test_an_effect_of_the_rate_is_named_and_the_calibration_beside_it_is_nearer(name):
    added, channel, size = HIDDEN[name]
    campaign = log(11, added, **SLOWER)
    found, beside = diagnose_campaign(campaign)
    assert found.verdict == "missing-physics"
    assert [(e.name, e.channels) for e in found.effects] == [(name, (channel,))]
    (said,) = found.effects
    value = dict(said.parameters)["coefficient"]
    assert abs(value.value - size) < 3.5 * value.std  # three draws: a chance of 0.2 %
    assert said.evidence.held_out_gain > 0.2 and "motions between rests" in said.statement
    assert said.separating_experiment == PARTED_BY
    plain = calibrate_device(campaign).calibration
    axis = "xyz".index(channel[-1])
    with jax.enable_x64(True):
        error = [
            np.abs(np.asarray(c.gyro_errors(25.0).matrix) + np.eye(3) - SCALE)[axis].max()
            for c in (plain, beside)
        ]
    assert error[1] < 0.7 * error[0]


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_hidden_and_the_audit_says_what_would_show():
    campaign = log(12, **SLOWER)
    found, _ = diagnose_campaign(campaign)
    assert found.verdict == "consistent" and not found.effects
    seen = {(d.name, d.channels) for d in audit(campaign, estimate_noise=True).detectable}
    assert {("scale_asymmetry", (f"gyro_{a}",)) for a in "xyz"} <= seen
    motions = [r for r in found.residuals if r.name == "gyro-motions"]
    assert len(motions) == 1 and motions[0].before.shape[1] == 1
