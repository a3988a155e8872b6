"""Gyros by gravity's rotation between rests, against SciPy, simulated truth and imu_tk's answers."""

import os
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.calibrate.joint_imu_fit import fit_together
from inertiax.calibrate.pipeline import calibrate, DeviceResult
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, ModelChoice, Recording
from inertiax.estimators import GravityRotation, Invariant, JointImu, StaticGyro
from inertiax.estimators.gravity_rotation import across, tilt
from inertiax.model_selection.select_model import settle_gyro
from inertiax.physics.temperature import Constant
from inertiax.procedure.single_device import joint_fit_one
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.motions import carry, rotate, step_angle
from inertiax.reduction.rotations_between_rests import bias_scatter, shortfall, with_motions


GRAVITY = 9.81
STEP = 0.01  # s
FINE = 40  # steps of the generator's own integration in one of ours


# A hand that turns a device from pose to pose, integrated by SciPy in steps of 0.25 ms ------------


def _hand(rng, duration: float, *, vertical: bool, attitude: Rotation, parts: int):
    """Rates (rad/s) at fine steps of a turn by 40° to 150° with a tremble of some hertz."""
    t = (np.arange(round(duration / STEP * parts)) + 0.5) * STEP / parts
    swell = (1.0 - np.cos(2 * np.pi * t / duration)) / duration  # integrates to 1
    axis = attitude.inv().apply([0.0, 0.0, 1.0]) if vertical else rng.normal(size=3)
    angle = rng.uniform(np.deg2rad(40), np.deg2rad(150))
    main = np.outer(angle * swell, axis / np.linalg.norm(axis))
    shake = rng.uniform(-0.3, 0.3, (2, 3)) * (not vertical)
    window = (duration * swell / 2)[:, None]
    return main + window * sum(
        s * np.sin(2 * np.pi * f * t + k)[:, None]
        for k, (s, f) in enumerate(zip(shake, (1.7, 3.1)))
    )


def _log(
    rng,
    *,
    num_rests: int,
    truth: dict,
    noise: float = 0.0,
    vertical: bool = False,
    samples: tuple[int, int] = (200, 400),
    parts: int = FINE,
):
    """A recording of rests of 2 s joined by motions of 2 to 4 s, and the true specific force."""
    attitude = Rotation.random(random_state=int(rng.integers(2**31)))
    rates, attitudes, position = [], [], []
    for k in range(num_rests):
        rest = round(2.0 / STEP)
        rates.append(np.zeros((rest, 3)))
        attitudes.append(np.tile(attitude.as_quat(), (rest, 1)))
        position.append(np.full(rest, k))
        if k == num_rests - 1:
            break
        duration = rng.integers(*samples) * STEP
        fine = _hand(rng, duration, vertical=vertical, attitude=attitude, parts=parts)
        # The rate at the sample itself, between two fine middles.
        before, after = fine[parts - 1 : -1 : parts], fine[parts::parts]
        rates.append(np.vstack([np.zeros(3), 0.5 * (before + after)]))
        turn = Rotation.from_rotvec(fine[::parts] * STEP / parts)
        for n in range(1, parts):  # all of a sample's small steps, every sample at once
            turn = turn * Rotation.from_rotvec(fine[n::parts] * STEP / parts)
        course = []
        for whole in turn:
            course.append(attitude.as_quat())
            attitude = attitude * whole
        attitudes.append(np.array(course))
        position.append(np.full(len(course), -1))
    omega = np.concatenate(rates)
    force = Rotation.from_quat(np.concatenate(attitudes)).inv().apply([0.0, 0.0, GRAVITY])
    gyro = omega @ (np.eye(3) + truth["matrix"]).T + truth["bias"] + force @ truth["d"].T / GRAVITY
    recording = Recording(
        time=np.arange(len(omega)) * STEP,
        accel=force + 10 * noise * rng.normal(size=force.shape),
        gyro=gyro + noise * rng.normal(size=force.shape),
        position=np.concatenate(position),
        name="hand",
    )
    return recording, force


def _truth(rng, *, d: float = 0.0) -> dict:
    return {
        "bias": rng.normal(0.0, 0.01, 3),
        "matrix": rng.normal(0.0, 0.01, (3, 3)),
        "d": rng.normal(0.0, 1.0, (3, 3)) * d,
    }


def _vector(truth: dict, *, d: bool = False) -> np.ndarray:
    parts = [truth["bias"], truth["matrix"].ravel(), *([truth["d"].ravel()] if d else [])]
    return np.concatenate(parts)


# The formulas ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.1, 0.5])
def test_rotate_agrees_with_scipy_up_to_the_largest_step(angle):
    axis, vector = np.array([1.0, -2.0, 2.0]) / 3.0, np.array([0.3, -0.8, 0.5])
    expected = Rotation.from_rotvec(angle * axis).apply(vector)
    np.testing.assert_allclose(rotate(angle * axis, vector), expected, rtol=0, atol=3e-11)


def test_hand_motion_at_100_hz_is_carried_to_some_microradians():
    rng = np.random.default_rng(5)
    still = {"bias": np.zeros(3), "matrix": np.zeros((3, 3)), "d": np.zeros((3, 3))}
    recording, force = _log(rng, num_rests=2, truth=still)
    end = carry(force[0] / GRAVITY, recording.gyro, np.diff(recording.time))
    # Trapezoids leave h²/12 of the change of the rate's slope, which is none from rest to rest.
    assert np.linalg.norm(end - force[-1] / GRAVITY) < 2e-6


def test_step_of_a_linear_rate_is_exact_to_fourth_order():
    start, slope = np.array([0.4, -1.0, 0.7]), np.array([-3.0, 2.0, 5.0])

    def error(step: float) -> float:
        turn = Rotation.identity()
        fine = step / 2000
        for t in (np.arange(2000) + 0.5) * fine:
            turn = turn * Rotation.from_rotvec((start + slope * t) * fine)
        ours = step_angle(start, start + slope * step, step)
        return float(np.linalg.norm(np.asarray(ours) - turn.as_rotvec()))

    # Without the coning term the error at 0.2 s is 4e-3 and the ratio 8.
    assert error(0.2) < 1e-4
    assert error(0.2) / error(0.1) > 24.0


def test_a_coning_motion_is_followed_to_second_order_of_the_step():
    # A classical coning motion: attitude exp([a(t)]×) with a = c (cos wt, sin wt, 0), whose body rate
    # is (−w sin c sin wt, w sin c cos wt, w (cos c − 1)) as found by differentiating it.
    cone, w = 0.4, 5.0

    def error(step: float) -> float:
        t = np.arange(0.0, 1.0 + step / 2, step)
        rate = np.stack(
            [
                -w * np.sin(cone) * np.sin(w * t),
                w * np.sin(cone) * np.cos(w * t),
                w * (np.cos(cone) - 1.0) * np.ones_like(t),
            ],
            axis=1,
        )
        at = lambda s: Rotation.from_rotvec(cone * np.array([np.cos(w * s), np.sin(w * s), 0.0]))
        u = np.array([0.0, 0.0, 1.0])
        expected = (at(t[-1]).inv() * at(0.0)).apply(u)
        return float(np.linalg.norm(carry(u, rate, np.diff(t)) - expected))

    # The rate is linear between samples in the formula and a circle in truth: order two remains.
    assert error(0.01) < 1.5e-4 * w
    np.testing.assert_allclose(error(0.02) / error(0.01), 4.0, rtol=0.1)


def test_padding_turns_nothing():
    rng = np.random.default_rng(0)
    rate, step = rng.normal(size=(20, 3)), np.full(19, 0.01)
    padded = np.concatenate([rate, np.repeat(rate[-1:], 12, axis=0)])
    u = np.array([0.0, 0.6, 0.8])
    expected = carry(u, rate, step)
    np.testing.assert_array_equal(carry(u, padded, np.append(step, np.zeros(12))), expected)


def test_tilt_is_the_angle_off_and_grows_to_half_a_turn():
    up = np.array([0.0, 0.0, 1.0])
    first = np.asarray(across(up))[0]
    for angle in (1e-6, 0.01, 1.0, 3.0):
        predicted = np.cos(angle) * up + np.sin(angle) * first
        expected = [2.0 * np.tan(angle / 2.0), 0.0]
        np.testing.assert_allclose(tilt(predicted, up), expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("direction", [[0.0, 0.0, 1.0], [0.6, -0.8, 0.0], [1.0, 1.0, 1.0]])
def test_axes_across_are_orthonormal(direction):
    u = np.array(direction) / np.linalg.norm(direction)
    frame = np.vstack([across(u), u])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)


# From recordings to motions -------------------------------------------------------------------------


def _turns(recording, **settings):
    return with_motions([recording], reduce_to_dwells([recording]), **settings)


def test_motions_start_and_end_at_the_rests():
    rng = np.random.default_rng(2)
    recording, _ = _log(rng, num_rests=4, truth=_truth(rng), noise=1e-4)
    turns = _turns(recording)
    assert turns.statement == "3 motions between 4 rests" and turns.num_motions == 3
    motion = turns.dwells.motion
    assert list(motion.valid) == [False, True, True, True]
    moving = np.flatnonzero(recording.position < 0)
    # From the last sample of a rest to the first of the next: one step more than samples between.
    np.testing.assert_allclose(motion.step.sum(), STEP * (len(moving) + 3), rtol=1e-12)
    assert motion.step[0].sum() == 0.0 and motion.gyro.shape[1] in (224, 256, 320, 384, 448)


def test_motions_that_cannot_be_integrated_are_counted():
    rng = np.random.default_rng(3)
    recording, _ = _log(rng, num_rests=5, truth=_truth(rng), noise=1e-4)
    time, gyro = recording.time.copy(), recording.gyro.copy()
    middles = [int(np.mean(np.flatnonzero(b))) for b in _between(recording.position)]
    time[middles[0] :] += 1.0  # a pause in the stamps
    gyro[middles[1]] = [60.0, 0.0, 0.0]  # 0.6 rad a sample
    broken = Recording(
        time=time, accel=recording.accel, gyro=gyro, position=recording.position, name="broken"
    )
    turns = _turns(broken)
    assert turns.num_motions == 2
    assert "left out: 1 with a pause in the time stamps, 1 too fast for the sampling rate" in (
        turns.statement
    )


def test_motions_beyond_the_gyros_range_are_left_out_and_the_others_give_the_truth():
    """A turn that is faster than the range reads too little, and one such motion spoils all nine coefficients."""
    rng = np.random.default_rng(5)
    truth = _truth(rng)
    recording, _ = _log(rng, num_rests=16, truth=truth, noise=1e-4)
    range_end = 0.8 * np.abs(recording.gyro[:, 0]).max()
    narrow = Recording(
        time=recording.time, accel=recording.accel, name="narrow", position=recording.position,
        gyro=np.clip(recording.gyro, -range_end, range_end),
    )  # fmt: skip
    beyond = [np.any(np.abs(recording.gyro[b]) > range_end) for b in _between(recording.position)]
    assert 1 <= sum(beyond) <= 6
    turns = _turns(narrow)
    assert turns.num_motions == 15 - sum(beyond)
    assert f"left out: {sum(beyond)} with rates beyond the gyros' range" in turns.statement
    # Without them the estimate is that of the others; with them it was off by hundreds of its sigmas.
    (kept,) = calibrate(Campaign((narrow,), model=ModelChoice(gyro_estimator="gravity")))
    found = kept.calibration.gyro
    error = np.asarray(found.curve.coefficients)[0] - _vector(truth)
    assert np.abs(error / np.sqrt(np.diag(found.covariance))).max() < 4.0


def _between(position):
    for k in range(position.max()):
        after = np.flatnonzero(position == k)[-1]
        before = np.flatnonzero(position == k + 1)[0]
        rows = np.arange(len(position))
        yield (rows > after) & (rows < before)


def test_turning_about_the_vertical_is_refused_in_words():
    rng = np.random.default_rng(4)
    recording, _ = _log(rng, num_rests=8, truth=_truth(rng), noise=1e-4, vertical=True)
    turns = _turns(recording)
    assert "0 motions tilt the device by 10° or more" in str(shortfall(turns))
    name, reason = settle_gyro(Campaign((recording,)), turns)
    assert name == "static" and str(reason).startswith("gyros: 'static' because there is no ref")
    asked = Campaign((recording,), model=ModelChoice(gyro_estimator="gravity"))
    with pytest.raises(ValueError, match="gyro_estimator = 'gravity', but 0 motions tilt"):
        settle_gyro(asked, turns)


def test_dwells_of_other_recordings_are_refused():
    rng = np.random.default_rng(6)
    one, _ = _log(rng, num_rests=3, truth=_truth(rng))
    other, _ = _log(rng, num_rests=4, truth=_truth(rng))
    with pytest.raises(ValueError, match="the dwells are not those of these recordings"):
        with_motions([one], reduce_to_dwells([other]))


def test_bias_scatter_finds_the_wander_between_rests():
    rng = np.random.default_rng(7)
    recording, _ = _log(rng, num_rests=40, truth=_truth(rng), noise=1e-4)
    wander = rng.normal(0.0, 1e-3, (40, 3))
    gyro = recording.gyro + np.where(
        recording.position[:, None] >= 0, wander[recording.position], 0.0
    )
    shifted = Recording(
        time=recording.time, accel=recording.accel, gyro=gyro, position=recording.position
    )
    # 117 degrees of freedom: 1 sigma of the scatter is 6.5 %.
    assert abs(bias_scatter(reduce_to_dwells([shifted])) / 1e-3 - 1) < 0.2


# Recovery of simulated truth ------------------------------------------------------------------------


@pytest.mark.slow
def test_truth_with_g_sensitivity_comes_back_from_a_clean_log():
    rng = np.random.default_rng(8)
    truth = _truth(rng, d=1e-3)
    recording, force = _log(rng, num_rests=16, truth=truth)
    turns = _turns(recording, force=lambda _: force)
    estimator = GravityRotation(GRAVITY, scatter=1e-5, g_sensitivity=True)
    solution = joint_fit_one(estimator, Constant(), turns.dwells)
    assert bool(solution.succeeded)
    error = np.asarray(solution.curve.coefficients[0]) - _vector(truth, d=True)
    # What is left is the integration's own error over turns of a radian or two.
    assert np.max(np.abs(error[3:12])) < 2e-5
    assert np.max(np.abs(error[[0, 1, 2, *range(12, 21)]])) < 1e-7


def _padded_dwells(recording):
    dwells = jax.tree.map(np.asarray, _turns(recording).dwells)
    pad = 192 - dwells.motion.gyro.shape[1]  # one compilation for all

    def widen(x, mode):
        return np.pad(x, ((0, 0), (0, pad), (0, 0))[: x.ndim], mode=mode)

    motion = eqx.tree_at(
        lambda m: (m.gyro, m.step),
        dwells.motion,
        (widen(dwells.motion.gyro, "edge"), widen(dwells.motion.step, "constant")),
    )
    return eqx.tree_at(lambda d: d.motion, dwells, motion)


@pytest.mark.slow
def test_errors_are_what_the_covariance_says():
    alone, tilts, joint = [], [], []
    both = JointImu(Invariant(GRAVITY), GravityRotation(GRAVITY))
    runs = 24
    for seed in range(runs):
        rng = np.random.default_rng(1000 + seed)
        truth = _truth(rng)
        # The noise is a hundred times what steps of 1 ms leave of the generator's motions.
        recording, _ = _log(
            rng, num_rests=13, truth=truth, noise=2e-3, samples=(100, 180), parts=10
        )
        solution = joint_fit_one(GravityRotation(GRAVITY), Constant(), _padded_dwells(recording))
        assert bool(solution.succeeded), seed
        error = np.asarray(solution.curve.coefficients[0]) - _vector(truth)
        alone.append(error @ np.linalg.solve(np.asarray(solution.covariance), error))
        tilts.append(float(np.sum(np.square(solution.residuals[:, 3:]))))
        bias, lower = rng.normal(0.0, 0.1, 3), np.tril(rng.normal(0.0, 0.01, (3, 3)))
        raw = recording.accel @ (np.eye(3) + lower).T + bias
        recording = eqx.tree_at(lambda r: r.accel, recording, raw)
        found = fit_together(both, _padded_dwells(recording))
        assert found.converged, seed
        true = np.concatenate([bias, lower[np.tril_indices(3)], _vector(truth)])
        error = np.asarray(found.curve.coefficients[0]) - true
        joint.append(error @ np.linalg.solve(found.covariance, error))

    def within(values, freedom, low=4.0, high=3.0):
        """The mean of χ² over the runs, whose sigma is √(2 freedom / runs); a variance wrong by 40 % is outside."""
        sigma = np.sqrt(2.0 * freedom / runs)
        return freedom - low * sigma < np.mean(values) < freedom + high * sigma

    # The scatter of the bias is never estimated below zero, which makes sigmas a little too large.
    assert within(alone, 12), np.mean(alone)
    assert within(tilts, 15), np.mean(tilts)  # 24 tilts less 9 for Θ
    # Both triads in one least squares: 13 rests less nine unknowns leave the accelerometers' scatter a freedom of
    # four, with which any that chance does not exclude is counted; variances up to twice too large.
    assert within(joint, 21) or 0.5 * 21 < np.mean(joint) < 21, np.mean(joint)


# The Xsens recording of imu_tk ----------------------------------------------------------------------

IMU_TK_SCALE = np.array([4777.96, 4764.21, 4773.66])  # counts per rad/s
IMU_TK_BIAS = np.array([32777.1, 32459.8, 32511.8])  # counts, of the first rest, 50 s long
NOMINAL = np.array([4778.0, 4758.0, 4766.0])

XSENS = """
[site]
gravity = 9.81744
[recordings]
files = ["{folder}/xsens_acc.mat"]
gyro_files = ["{folder}/xsens_gyro.mat"]
[columns]
accel = {{ unit = "count", offset = 32768, scale = [415, 413, 415], scale_unit = "count per m/s^2" }}
gyro = {{ unit = "count", offset = 32768, scale = [4778, 4758, 4766], scale_unit = "count per rad/s" }}
"""


def _imu_tk_scale(gyro, accel_matrix):
    """Our Θ as imu_tk's inverse scales, counts per rad/s.

    Its frame is the one in which the accelerometers' inverse matrix is upper triangular (ours: lower),
    so with L = (E + Γ)⁻¹ = Q U it is turned by Qᵀ; there ω = T K (x − b) with unit diagonal of T, so
    that K is the diagonal of Qᵀ (E + Θ)⁻¹ / nominal.
    """
    lower = np.linalg.inv(np.eye(3) + np.asarray(accel_matrix))
    q, upper = np.linalg.qr(lower)
    q = jnp.asarray(q * np.sign(np.diagonal(upper)))
    matrix = jnp.linalg.inv(jnp.eye(3) + gyro[3:12].reshape(3, 3))
    return jnp.asarray(NOMINAL) / jnp.diagonal(q.T @ matrix)


@pytest.mark.slow
@pytest.mark.skipif(
    "INERTIAX_RECORDINGS" not in os.environ,
    reason="needs the imu_tk recording (set INERTIAX_RECORDINGS)",
)
def test_xsens_gyros_agree_with_imu_tk(tmp_path):
    folder = Path(os.environ["INERTIAX_RECORDINGS"]) / "imu_tk-xsens"
    (tmp_path / "campaign.toml").write_text(XSENS.format(folder=folder))
    campaign = load_campaign(tmp_path)
    (result,) = calibrate(campaign, method="joint")
    assert isinstance(result, DeviceResult) and result.gyro is not None
    assert any("'gravity' because there is no reference_gyro" in c for c in result.choices)
    assert result.calibration.gyro is not None and result.calibration.gyro.estimator == "gravity"
    gyro, covariance = (
        result.calibration.gyro.curve.coefficients[0],
        result.calibration.gyro.covariance,
    )
    accel_matrix = result.calibration.accel_errors(0.0).matrix
    convert = lambda v: _imu_tk_scale(v, accel_matrix)
    jacobian = np.asarray(jax.jacfwd(convert)(gyro))
    sigma = np.sqrt(np.diagonal(jacobian @ np.asarray(covariance) @ jacobian.T))
    assert np.all(sigma < 7.0)  # 0.15 %: the comparison has some power
    assert np.all(np.abs(np.asarray(convert(gyro)) - IMU_TK_SCALE) < 3.0 * sigma)
    # imu_tk holds the bias at the mean of the first rest; ours is one for all 38 rests, whose
    # means scatter by far more than their noise. So: its bias is ours of the first rest, ...
    dwells = reduce_to_dwells(campaign.recordings)
    own = np.sqrt(np.diagonal(np.asarray(dwells.gyro_covariance)[0])) * NOMINAL
    first = 32768 + np.asarray(dwells.gyro)[0] * NOMINAL
    assert np.all(np.abs(first - IMU_TK_BIAS) < 3.0 * own)
    # ... and from the bias of all rests it is no further than one rest may be.
    ours = 32768 + np.asarray(gyro[:3]) * NOMINAL
    assert np.all(np.abs(ours - IMU_TK_BIAS) < 3.0 * bias_scatter(dwells) * NOMINAL)
    # That scatter, at work during motions of 5 s too, accounts for what is left of gravity.
    assert result.gyro.misfit_unit == "rad" and result.gyro.rms < 6.5e-3
    assert 0.6 < result.gyro.chi2_per_dof < 1.5


@pytest.mark.slow
@pytest.mark.skipif(
    "INERTIAX_RECORDINGS" not in os.environ,
    reason="needs the imu_tk recording (set INERTIAX_RECORDINGS)",
)
def test_g_sensitivity_foretells_the_rates_of_a_pose_left_out(tmp_path):
    folder = Path(os.environ["INERTIAX_RECORDINGS"]) / "imu_tk-xsens"
    (tmp_path / "campaign.toml").write_text(XSENS.format(folder=folder))
    rests = reduce_to_dwells(load_campaign(tmp_path).recordings)
    rates = np.rad2deg(np.asarray(rests.gyro))

    def left_out(estimator: StaticGyro) -> np.ndarray:
        # The estimator is linear: rows of one pose's Jacobian, the rates as its misfit at zero.
        zero = jnp.zeros(estimator.num_parameters)
        rows = -np.asarray(
            jax.vmap(jax.jacfwd(lambda v, d: estimator.misfit(v, d)[0]), in_axes=(None, 0))(
                zero, jax.tree.map(jnp.asarray, rests)
            )
        )
        error = []
        for k in range(len(rates)):
            kept = np.arange(len(rates)) != k
            design = rows[kept].reshape(-1, rows.shape[2])
            fitted = np.linalg.lstsq(design, rates[kept].reshape(-1), rcond=None)[0]
            error.append(rates[k] - rows[k] @ fitted)
        return np.sqrt(np.mean(np.square(error), axis=0))

    # Raw accelerometer outputs tell the force to 1 %, which D does not notice.
    without = left_out(StaticGyro(gravity=GRAVITY))
    with_d = left_out(StaticGyro(gravity=GRAVITY, g_sensitivity=True))
    np.testing.assert_allclose(without, [0.051, 0.090, 0.073], atol=0.002)  # deg/s
    # 0.0188, 0.0187, 0.0156 with all of the rests; without three knocks of half a second 0.0185, 0.0193, 0.0155.
    # 38 rests tell such an rms to a ninth.
    assert np.all(with_d <= 0.0195)
