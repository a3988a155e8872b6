"""Plateaus of constant rate: without a reference force, and with one position error for a whole staircase of rates."""

import jax
import numpy as np
import pytest
import scipy.linalg
import scipy.stats

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.calibrate.split_covariance import Fit, split
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose.noise.common_mode import signatures
from inertiax.diagnose.observations.blocks import cut, join
from inertiax.diagnose.observations.model_rows import calibrated, usable
from inertiax.estimators import ReferenceAccel, ReferenceGyro
from inertiax.fleet.solve.batch import fit_fleet
from inertiax.physics.temperature import Polynomial
from inertiax.procedure.single_device import iterate_one, joint_fit_one
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.dwells import Dwells
from inertiax.reduction.positionings import shared_positionings
from inertiax.reduction.rig_errors import with_rig_errors
from inertiax.reduction.segments import segment


G = 9.81
X, Y, Z = np.eye(3)
ANGLE, NOISE, RATE = 1e-4, 1e-5, 1e-6  # rad, rad/s, of the rate
STAIRCASE = np.array([-2.0, -1.0, -0.3, 0.3, 1.0, 2.0])  # rad/s


@pytest.fixture(autouse=True)
def _double():
    with jax.enable_x64(True):
        yield


# --- without a reference force --------------------------------------------------------------------


PERFECT = Rig()


def turntable(reference_at_rates, rig=PERFECT):
    """Six faces, then a staircase about each axis, 10 Hz; the axis of rotation is horizontal."""
    rng = np.random.default_rng(4)
    faces, rates = np.concatenate([np.eye(3), -np.eye(3)]) * G, np.kron(np.eye(3), [[1.0], [-1.0]])
    turned = np.repeat(np.roll(rates, 1, axis=1), 100, axis=0) * G  # of some size, constant
    force = np.concatenate([np.repeat(faces, 100, axis=0), turned])
    rate = np.concatenate([np.zeros((600, 3)), np.repeat(rates, 100, axis=0)])
    stated = force.copy()
    if not reference_at_rates:
        stated[600:] = 0.0
    position = np.repeat([0, 1, 2, 3, 4, 5, -1, -1, -1, -1, -1, -1], 100)
    accel = 1.001 * force + [0.05, -0.02, 0.01] + 1e-3 * rng.standard_normal(force.shape)
    accel[600:] += 0.3 * force[600:]  # as lever arms would: the plateaus are not to be believed
    gyro = rate + 1e-4 * rng.standard_normal(rate.shape)
    recording = Recording(
        0.1 * np.arange(1200), accel=accel, gyro=gyro, position=position,
        reference_accel=stated, reference_gyro=rate,
    )  # fmt: skip
    return Campaign((recording,), Site(G), rig, ModelChoice(temperature_degree=0))


# A position that is off by 1e-7 rad shifts no weight; with one the gyros' plateaus share it, the rests do not.
@pytest.mark.parametrize("rig", [Rig(), Rig(position_uncertainty=1e-7)])
def test_plateaus_without_a_reference_force_have_no_part_in_the_accelerometers_fit(rig):
    campaign = turntable(reference_at_rates=False, rig=rig)
    found = calibrate_device(campaign, checked=True)
    assert found.calibration.accel is not None and found.accel is not None
    (recording,) = campaign.recordings
    rests = recording.accel[:600].reshape(6, 100, 3).mean(axis=1)
    design = np.column_stack([np.ones(6), recording.reference_accel[:600:100]])
    exact = np.linalg.lstsq(design, rests - design[:, 1:], rcond=None)[0]  # bias, then Γᵀ
    own = np.asarray(found.calibration.accel.curve.coefficients)[0]
    # Weights of the rests differ by what their own scatter says, some percent of 1e-4 m/s².
    np.testing.assert_allclose(own[:3], exact[0], atol=3e-5)
    np.testing.assert_allclose(own[3:].reshape(3, 3), exact[1:].T, atol=3e-6)
    assert found.accel.dwells.num_dwells == 6
    blocks = cut(join(campaign))
    model = calibrated(found, "accel")
    assert model is not None
    assert np.array_equal(usable(model.form, blocks), ~blocks.moving)
    assert usable(calibrated(found, "gyro").form, blocks).all()


def test_plateaus_with_a_reference_force_count():
    found = calibrate_device(turntable(reference_at_rates=True), checked=True)
    assert found.accel is not None and found.accel.dwells.num_dwells == 12


def test_a_fleet_leaves_the_same_plateaus_out():
    dwells = reduce_to_dwells(turntable(reference_at_rates=False).recordings)
    many = jax.tree.map(lambda x: np.stack([x, x]), dwells)
    kept = np.asarray(ReferenceAccel().usable(many).valid)
    assert np.array_equal(kept, np.asarray(many.position) >= 0)
    assert np.asarray(ReferenceGyro(G).usable(many).valid).all()


# --- one position error for a staircase -------------------------------------------------------------


def test_consecutive_plateaus_about_one_axis_are_of_one_positioning():
    position = np.array([1, 2, -1, -1, -1, -1, -1, 3, -1, -1, 5, -1])
    rate = np.array([0 * Z, 0 * Z, Z, -Z, 2 * Z, X, -X, 0 * X, X, -2 * X, 0 * X, Y])
    force = G * np.array([X, Z, Z, Z, Z, 0 * X, 0 * X, X, 0 * X, 0 * X, Y, Z])
    expected = [-1, -1, 0, 0, 0, 1, 1, -1, 2, 2, -1, -1]  # a rest with x upright; a plateau alone
    assert shared_positionings(position, rate, force).tolist() == expected
    # A rest with gravity at the same angle to the axis is of the same positioning, whatever its number.
    force[7] = G * Y
    expected = [-1, -1, 0, 0, 0, 1, 1, -1, 1, 1, -1, -1]
    assert shared_positionings(position, rate, force).tolist() == expected
    # Without a force the number of the position decides.
    assert shared_positionings(position, rate).tolist() == [-1, -1, 0, 0, 0, 1, 1, -1, 2, 2, -1, -1]
    both = shared_positionings(np.stack([position, position]), np.stack([rate, -rate]))
    assert both.tolist() == [[-1, -1, 0, 0, 0, 1, 1, -1, 2, 2, -1, -1]] * 2


def staircases(rng, *, shared, temperatures=(0.0, 20.0, 40.0)):
    """Dwells of a staircase about each case axis at each temperature, then four rests; errors drawn as `shared` says.

    Also the number of each dwell's positioning, −1 for the rests.
    """
    axes = [r * e for _ in temperatures for e in (X, Y, Z) for r in STAIRCASE]
    rate = np.concatenate([axes, np.tile([4e-5, 3e-5, 1e-5], (4, 1))])
    number = np.concatenate([np.repeat(np.arange(len(axes) // 6), 6), np.full(4, -1)])
    drawn = ANGLE * rng.standard_normal((len(rate), 3))
    angle = np.where((number >= 0)[:, None] & shared, drawn[number], drawn)
    seen = rate * (1.0 + RATE * rng.standard_normal((len(rate), 1))) + np.cross(angle, rate)
    dwells = Dwells.from_arrays(
        gyro=seen + NOISE * rng.standard_normal(rate.shape),
        reference_gyro=rate,
        temperature=np.append(np.repeat(temperatures, 18), np.resize(temperatures, 4)),
        position=np.where(number < 0, np.arange(len(rate)), -1),
        sigma=NOISE,
    )
    dwells = jax.tree.map(np.asarray, dwells)
    return with_rig_errors(dwells, Rig(position_uncertainty=ANGLE, rate_uncertainty=RATE)), number


ESTIMATOR, BASIS = ReferenceGyro(gravity=G), Polynomial(1, 0.0, 40.0)


def dense(dwells, number):
    """Generalised least squares with the full covariance, in NumPy."""
    rate, count = dwells.reference_gyro, len(number)
    phi = np.stack([np.ones(count), dwells.temperature / 20.0 - 1.0], axis=1)
    single = np.concatenate(
        [np.tile(np.eye(3), (count, 1, 1)), np.einsum("ij,nk->nijk", np.eye(3), rate).reshape(count, 3, 9)], axis=2
    )  # fmt: skip
    design = np.einsum("na,nri->nrai", phi, single).reshape(3 * count, -1)
    skew = lambda v: np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    turn = np.stack([skew(v) for v in rate])
    same = (number[:, None] == number[None, :]) & (number[:, None] >= 0) | np.eye(count, dtype=bool)
    whole = ANGLE**2 * same[:, None, :, None] * np.einsum("mij,nkj->mink", turn, turn)
    whole = whole.reshape(3 * count, -1)
    whole += scipy.linalg.block_diag(
        *(NOISE**2 * np.eye(3) + RATE**2 * np.outer(v, v) for v in rate)
    )
    inverse = np.linalg.inv(whole)
    covariance = np.linalg.inv(design.T @ inverse @ design)
    observed = (dwells.gyro - rate).reshape(-1)
    answer = covariance @ design.T @ inverse @ observed
    left = observed - design @ answer
    return answer, covariance, float(left @ inverse @ left)


def test_the_fit_is_generalised_least_squares_with_the_full_covariance():
    dwells, number = staircases(np.random.default_rng(1), shared=True)
    assert np.array_equal(dwells.positioning, number)
    answer, covariance, chi2 = dense(dwells, number)
    sigma = np.sqrt(np.diagonal(covariance))
    alone = joint_fit_one(ESTIMATOR, BASIS, dwells)
    many = fit_fleet(ESTIMATOR, BASIS, jax.tree.map(lambda x: np.stack([x, x]), dwells))
    for found, own in (
        (np.asarray(alone.curve.coefficients).ravel(), np.asarray(alone.covariance)),
        (many.parameters[0], many.covariance[0]),
    ):
        # Normal matrices of condition 1e6 and weights that differ by 1e3: 1e-16 of rounding times that.
        np.testing.assert_allclose((found - answer) / sigma, 0.0, atol=1e-6)
        np.testing.assert_allclose(
            own / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=1e-6
        )
    assert many.chi2_per_dof[0] == pytest.approx(chi2 / (number.size * 3 - 24), rel=1e-6)
    # The procedure's passes refine the outputs, but not what the shared angles do to them, which is off by 1e-4.
    passes = np.asarray(iterate_one(ESTIMATOR, BASIS, dwells).curve.coefficients).ravel()
    np.testing.assert_allclose((passes - answer) / sigma, 0.0, atol=0.02)


def test_the_budget_puts_what_plateaus_share_under_the_rig_s_positions():
    dwells, number = staircases(np.random.default_rng(2), shared=True)
    found = joint_fit_one(ESTIMATOR, BASIS, dwells)
    fit = Fit(ESTIMATOR, found.curve, np.asarray(found.covariance), dwells, 3 * number.size)
    rig = Rig(position_uncertainty=ANGLE, rate_uncertainty=RATE)
    parts = {p.source: np.diagonal(p.covariance) for p in split(fit, rig)}
    total = np.diagonal(found.covariance)
    np.testing.assert_allclose(sum(parts.values()), total, rtol=1e-9)
    # By hand: the mean of three positionings of one axis at three temperatures, for misalignment xy at the middle.
    assert np.sqrt(parts["rig position"][4]) == pytest.approx(ANGLE / np.sqrt(3.0), rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("shared", [True, False])
def test_intervals_cover_whether_the_error_is_drawn_for_an_axis_or_for_a_plateau(shared):
    rng, inside, squares = np.random.default_rng(3), 0, []
    for _ in range(60):
        dwells, _ = staircases(rng, shared=shared)
        found = joint_fit_one(ESTIMATOR, BASIS, dwells)
        z = np.asarray(found.curve.coefficients).ravel() / np.sqrt(np.diagonal(found.covariance))
        squares.append(np.mean(np.square(z[[4, 5, 6, 8, 9, 10]])))  # misalignments at the middle
        inside += int(np.sum(np.abs(z[[4, 5, 6, 8, 9, 10]]) < 1.96))
    # 360 values, 99.9 % of the time: a binomial of 95 %, χ² of the mean square. A draw for each plateau errs less.
    assert inside >= scipy.stats.binom.ppf(0.001, 360, 0.95)
    if shared:
        low, high = scipy.stats.chi2.ppf([0.0005, 0.9995], 360) / 360
        assert low < np.mean(squares) < high
    else:
        assert np.mean(squares) < 1.0


def test_a_diagnosis_sees_the_covariance_of_a_shared_rotation():
    reading = np.array([[0.0, 2.0, 0.0], [0.0, -1.0, 0.0], [0.0, -1.0, 0.0], [3.0, 0.0, 0.0]])
    made, own = signatures(
        reading,
        np.array([4, 5, 5, 7]),
        np.full((4, 3), 1e-14),
        np.full(4, ANGLE),
        RATE,
        np.array([0, 0, 0, -1]),
    )
    skew = lambda v: np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    for a in range(3):
        for b in range(3):
            expected = ANGLE**2 * skew(reading[a]) @ skew(reading[b]).T
            np.testing.assert_allclose(made[a] @ made[b].T, expected, rtol=1e-12, atol=1e-24)
    assert not made[3].any() and np.isnan(own[3]).all()
    # The rate's error is drawn for each plateau, and along an axis is one channel's own.
    np.testing.assert_allclose(own[:3], np.square(RATE * reading[:3]), rtol=1e-12)


@pytest.mark.parametrize("seconds", [6.0, 30.0])
def test_a_smooth_move_has_no_plateau(seconds):
    u = np.linspace(0.0, 1.0, round(50 * seconds))
    rate = np.concatenate(
        [np.zeros(500), 5.0 / seconds * (1.0 - np.cos(2 * np.pi * u)), np.zeros(500)]
    )
    known = rate[:, None] * Z
    time = np.arange(len(rate)) / 50.0
    accel = np.tile(G * Z, (len(rate), 1))
    recording = Recording(time, accel=accel, gyro=known, reference_gyro=known)
    found = segment(recording)
    assert list(found.resting) == [True, True]
