"""Estimators without a reference for the motion use rests only, whichever call estimates: against SciPy's least squares
over the rests."""

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy.optimize import least_squares

import inertiax as ix
from inertiax.calibrate.pipeline import calibrate
from inertiax.data.recording import Campaign, ModelChoice, Site
from inertiax.fleet.reduce.stacked_dwells import stack_dwells
from inertiax.procedure.single_device import iterate_one, joint_fit_one


GRAVITY = 9.81123
RESTS, PLATEAUS = 24, 12
BIAS = np.array([0.05, -0.03, 0.02])
MATRIX = np.array([[1e-3, 0.0, 0.0], [-8e-4, 2e-3, 0.0], [5e-4, 1.2e-3, -1.5e-3]])
LEVER = np.array([0.05, 0.03, -0.02])  # m
NOISE = 2e-4  # m/s², of a mean
TRIAD = ix.Invariant(gravity=GRAVITY)


def _means(seed):
    """Rests in random poses, then a table that turns about the vertical; what a device with lever arms reads."""
    random = np.random.default_rng(seed)
    up = random.normal(size=(RESTS, 3))
    force = GRAVITY * up / np.linalg.norm(up, axis=1, keepdims=True)
    axes = np.eye(3)[np.arange(PLATEAUS) % 3]
    turns = axes * np.where(np.arange(PLATEAUS) % 2, 1.0, -1.0)[:, None]
    turns *= 1.0 + np.arange(PLATEAUS)[:, None] / 6.0
    turning = GRAVITY * axes + np.cross(turns, np.cross(turns, LEVER))
    force = np.concatenate([force, turning])
    rate = np.concatenate([np.zeros((RESTS, 3)), turns])
    accel = force @ (np.eye(3) + MATRIX).T + BIAS + NOISE * random.normal(size=force.shape)
    gyro = 1.01 * rate + 0.003 + 1e-5 * random.normal(size=rate.shape)
    return accel, gyro, rate


def _by_scipy(accel):
    """min Σ (‖(E + Γ)⁻¹ (a' − a⁰)‖ − g)² over the rows that are given, all of the same weight."""
    rows, columns = (0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2)

    def misfit(x):
        matrix = np.eye(3)
        matrix[rows, columns] += x[3:]
        return np.linalg.norm(np.linalg.solve(matrix, (accel - x[:3]).T), axis=0) - GRAVITY

    return least_squares(misfit, np.zeros(9), xtol=1e-15, ftol=1e-15, gtol=1e-15).x


def _dwells(accel, gyro, rate, **more):
    return ix.Dwells.from_arrays(accel, gyro, reference_gyro=rate, sigma=(NOISE, 1e-5), **more)


@pytest.fixture(scope="module")
def made():
    accel, gyro, rate = _means(3)
    dwells = _dwells(accel, gyro, rate)
    assert (dwells.position >= 0).sum() == RESTS
    return dwells, _by_scipy(accel[:RESTS]), _by_scipy(accel)


def test_the_plateaus_would_be_seen(made):
    _, rests, every = made
    assert abs(every[2] - rests[2]) > 1e-3  # m/s²: ω² r on a tenth of the range
    assert np.abs(rests[:3] - BIAS).max() < 5 * NOISE


@pytest.mark.slow
def test_fit_is_that_of_the_rests(made):
    dwells, want, _ = made
    fit = ix.fit(dwells, accel=TRIAD, gyro=ix.ReferenceGyro(gravity=GRAVITY))
    assert fit.succeeded and fit.dof == {"accel": RESTS - 9, "gyro": 3 * (RESTS + PLATEAUS) - 12}
    assert fit.accel.scatter == 0.0
    # Weights along the output are equal but for the outputs' directions: sigma is one number.
    np.testing.assert_allclose(fit.calibration.coefficients[:9], want, atol=1e-8)
    assert not fit.residuals["accel"][RESTS:].any() and fit.residuals["accel"][:RESTS].all()
    assert fit.residuals["gyro"].all()


@pytest.mark.parametrize("solve", [ix.joint_fit, joint_fit_one], ids=lambda f: f.__name__)
@pytest.mark.slow
def test_least_squares_are_those_of_the_rests(made, solve):
    dwells, want, _ = made
    found = solve(TRIAD, ix.Constant(), dwells)
    assert found.succeeded
    np.testing.assert_allclose(np.asarray(found.curve.coefficients)[0], want, atol=1e-8)
    assert not np.asarray(found.residuals)[RESTS:].any()
    # On the host, which compiles nothing for another number of rows; the two agree to 1e-6, plateaus would be tenths.
    alone = joint_fit_one(TRIAD, ix.Constant(), dwells[:RESTS])
    np.testing.assert_allclose(found.covariance, alone.covariance, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["paper", "gauss-newton", "host"])
def test_iterations_are_those_of_the_rests(made, how):
    dwells, want, _ = made
    if how == "host":
        found = iterate_one(TRIAD, ix.Constant(), dwells)
    else:
        paper = ix.PaperIteration.plan(TRIAD, ix.Constant(), dwells)
        own = ix.GaussNewtonIteration(TRIAD, ix.Constant())
        found = ix.iterate(paper if how == "paper" else own, dwells)
    assert found.succeeded
    # Refined outputs weigh a little otherwise: 5e-8 m/s², where plateaus would move the bias by 1e-3.
    np.testing.assert_allclose(np.asarray(found.curve.coefficients)[0], want, atol=1e-6)


@pytest.mark.slow
def test_traced_labels_are_obeyed(made):
    dwells, want, _ = made

    @jax.jit
    def bias(dwells):
        return ix.joint_fit(TRIAD, ix.Constant(), dwells).curve.coefficients[0]

    with jax.enable_x64(True):
        np.testing.assert_allclose(bias(jax.tree.map(jax.numpy.asarray, dwells)), want, atol=1e-8)


def test_a_batch_masks_each_devices_own(made):
    accel, gyro, rate = (np.stack(x) for x in zip(_means(3), _means(4), strict=True))
    valid = np.ones((2, RESTS + PLATEAUS), bool)
    valid[1, [2, 5, -1]] = False
    fit = ix.fit(
        _dwells(accel, gyro, rate, valid=valid), accel=TRIAD, gyro=ix.StaticGyro(gravity=GRAVITY)
    )
    assert fit.succeeded.all()
    assert fit.dof["accel"].tolist() == [RESTS - 9, RESTS - 2 - 9]
    for k in range(2):
        kept = valid[k, :RESTS]
        want = _by_scipy(accel[k, :RESTS][kept])
        np.testing.assert_allclose(fit.calibration.coefficients[k, :9], want, atol=1e-8)
        # Bias of gyros at rest: the mean of their outputs there.
        mean = gyro[k, :RESTS][kept].mean(axis=0)
        np.testing.assert_allclose(fit.calibration.coefficients[k, 9:], mean, atol=1e-12)


@pytest.mark.slow
def test_derivatives_are_those_of_the_rests(made):
    dwells = made[0]
    step = 1e-4
    table = ix.derivatives(
        ix.fit(dwells, accel=TRIAD), [ix.sources.gravity(step), ix.sources.output_noise()]
    )
    alone = ix.fit(dwells[:RESTS], accel=TRIAD)
    ends = [
        ix.fit(dwells[:RESTS], accel=ix.Invariant(gravity=GRAVITY + s)).calibration.coefficients
        for s in (step, -step)
    ]
    # The true g being larger than stated is the stated one being smaller; curvature is 1e-5 of it.
    want = (ends[1] - ends[0]) / 2.0
    np.testing.assert_allclose(table.by_source[0][:, 0], want, rtol=2e-3, atol=1e-10)
    own = np.sqrt(np.diag(alone.calibration.covariance))
    np.testing.assert_allclose(table.sigma[1], own, rtol=0.01)  # weighed along the output: 0.2 %


def test_a_fleets_stack_is_masked():
    devices = [_dwells(*_means(k)) for k in range(3)]
    together = stack_dwells([devices[0], devices[1][: RESTS + 3], devices[2]])
    used = TRIAD.usable(together)
    assert used.valid.sum(axis=1).tolist() == [RESTS] * 3
    by_reference = ix.ReferenceGyro(gravity=GRAVITY).usable(together)
    assert by_reference.valid.sum(axis=1).tolist() == [
        RESTS + PLATEAUS,
        RESTS + 3,
        RESTS + PLATEAUS,
    ]


def test_no_rests_are_said():
    accel, gyro, rate = _means(3)
    turning = _dwells(accel[RESTS:], gyro[RESTS:], rate[RESTS:])
    fit = ix.fit(turning, accel=TRIAD, gyro=ix.ReferenceGyro(gravity=GRAVITY))
    assert not fit.succeeded
    assert "0 dwells" in fit.reasons[0] and "not the 12 dwells of `position` -1" in fit.reasons[0]
    for solve in (
        lambda: ix.joint_fit(TRIAD, ix.Constant(), turning),
        lambda: ix.iterate(ix.GaussNewtonIteration(TRIAD, ix.Constant()), turning),
        lambda: ix.PaperIteration.plan(TRIAD, ix.Constant(), turning),
    ):
        with pytest.raises(ValueError, match="uses rests only, and none of the 12 dwells is one"):
            solve()


@pytest.mark.slow
def test_a_recording_is_calibrated_alike():
    accel, _, rate = _means(3)
    random = np.random.default_rng(8)
    each = 400
    whole = lambda rows: np.repeat(rows, each, axis=0)
    position = whole(np.where(np.arange(RESTS + PLATEAUS) < RESTS, np.arange(RESTS + PLATEAUS), -1))
    samples = whole(accel) + 2e-3 * random.normal(size=(len(position), 3))
    gyro = whole(1.001 * rate + 0.003) + 1e-4 * random.normal(size=samples.shape)
    recording = ix.Recording(
        time=np.arange(len(position)) / 100.0, accel=samples, gyro=gyro, position=position,
        reference_gyro=whole(rate),
    )  # fmt: skip
    model = ModelChoice(
        accel_estimator="invariant", gyro_estimator="reference", temperature_degree=0
    )
    (result,) = calibrate(Campaign((recording,), Site(GRAVITY), model=model))
    fit = ix.fit(
        ix.reduce_to_dwells(recording), accel=TRIAD, gyro=ix.ReferenceGyro(gravity=GRAVITY)
    )
    sigma = np.sqrt(np.diag(fit.calibration.covariance))
    np.testing.assert_allclose(
        (fit.calibration.coefficients - result.calibration.coefficients) / sigma, 0.0, atol=0.05
    )
    by_hand = _by_scipy(accel[:RESTS])
    np.testing.assert_allclose(
        (fit.calibration.coefficients[:9] - by_hand) / sigma[:9], 0.0, atol=4.0
    )


def test_rows_without_labels_of_a_reference_are_not_touched(made):
    dwells = made[0]
    swapped = eqx.tree_at(lambda d: d.position, dwells, np.zeros(RESTS + PLATEAUS, int))
    fit = ix.fit(swapped, accel=TRIAD)
    np.testing.assert_allclose(fit.calibration.coefficients, made[2], atol=1e-8)
