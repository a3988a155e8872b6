"""`ix.fit` on arrays of many devices, and `ix.derivatives` of what it found."""

import equinox as eqx
import jax
import numpy as np
import pytest

import inertiax as ix
import inertiax.fleet.fit as fleet_fit
from inertiax.calibrate.goodness_of_fit import grade_matrix, matrix_mistakes, UNUSABLE
from inertiax.fleet.solve.batch import fit_fleet
from inertiax.physics.temperature import Constant


GRAVITY = 9.81
DEVICES, DWELLS = 40, 24
STEP = 1e-4  # m/s², of gravity


@pytest.fixture(scope="module")
def made():
    random = np.random.default_rng(5)
    up = random.normal(size=(DEVICES, DWELLS, 3))
    up *= GRAVITY / np.linalg.norm(up, axis=-1, keepdims=True)
    bias = 0.05 * random.normal(size=(DEVICES, 3))
    matrix = 0.01 * np.tril(random.normal(size=(DEVICES, 3, 3)))
    accel = up + np.einsum("nij,ndj->ndi", matrix, up) + bias[:, None]
    accel += 1e-4 * random.normal(size=accel.shape)
    rate = random.normal(size=(DEVICES, DWELLS, 3))
    gyro = 1.01 * rate + 0.02 + 1e-5 * random.normal(size=rate.shape)
    return accel, gyro, rate, bias


@pytest.fixture(scope="module")
def found(made):
    accel, gyro, rate, _ = made
    # A table that turns so slowly that its accelerometers are as good as at rest.
    dwells = ix.Dwells.from_arrays(
        accel, gyro, reference_gyro=rate, sigma=(1e-4, 1e-5), position=np.arange(DWELLS)
    )
    estimators = {"accel": ix.Invariant(gravity=GRAVITY), "gyro": ix.ReferenceGyro(gravity=GRAVITY)}
    return ix.fit(dwells, **estimators)


@pytest.fixture(scope="module")
def table(found):
    return ix.derivatives(found, [ix.sources.gravity(STEP), ix.sources.output_noise()])


@pytest.mark.slow
def test_truth_is_found_within_its_covariance(made, found):
    assert found.succeeded.shape == (DEVICES,) and found.succeeded.all()
    calibration = found.calibration
    assert calibration.covariance.shape == (DEVICES, 21, 21)
    assert not np.any(calibration.covariance[:, :9, 9:])
    block = calibration.block("accel.bias")
    sigma = np.sqrt(np.diagonal(block.covariance, axis1=1, axis2=2))
    z = (block.mean - made[3]) / sigma
    # 120 independent normals: their standard deviation is within 4 of its own sigmas of 1.
    assert abs(z.std() - 1.0) < 4.0 / np.sqrt(2.0 * z.size)
    np.testing.assert_allclose(calibration.block("gyro.scale").mean, 0.01, atol=2e-5)


@pytest.mark.slow
def test_a_device_alone_is_that_of_the_batch(made, found):
    accel = made[0]
    one = ix.fit(ix.Dwells.from_arrays(accel[3], sigma=1e-4), accel=ix.Invariant(gravity=GRAVITY))
    assert one.succeeded.shape == () and bool(one.succeeded)
    many = found.calibration.accel.curve.coefficients[3]
    np.testing.assert_allclose(one.calibration.accel.curve.coefficients, many, atol=1e-9)


@pytest.mark.slow
def test_padding_may_hold_anything(made):
    accel = made[0][:4].copy()
    valid = np.arange(DWELLS) < 20
    estimator = ix.Invariant(gravity=GRAVITY)
    want = ix.fit(ix.Dwells.from_arrays(accel[:, :20], sigma=1e-4), accel=estimator).calibration
    accel[:, 20:] = np.nan
    got = ix.fit(ix.Dwells.from_arrays(accel, sigma=1e-4, valid=valid), accel=estimator).calibration
    np.testing.assert_allclose(got.coefficients, want.coefficients, atol=1e-9)
    # The fleet's own entry, whose dwells are not checked.
    accel[:, 20:] = 0.0
    whole = ix.Dwells.from_arrays(made[0][:4], sigma=1e-4, valid=valid)
    zero = jax.tree.map(np.asarray, whole)
    object.__setattr__(zero, "accel", accel)
    fit = fit_fleet(estimator, Constant(), zero)
    np.testing.assert_allclose(fit.parameters, want.coefficients, atol=1e-9)


def test_positions_that_do_not_determine_the_model_do_not_succeed(made):
    four = np.tile(made[0][:2, :4], (1, 6, 1))
    fit = ix.fit(ix.Dwells.from_arrays(four, sigma=1e-4), accel=ix.Invariant(gravity=GRAVITY))
    assert not fit.succeeded.any() and "do not determine" in fit.reasons[0]


@pytest.mark.slow
def test_derivatives_by_gravity_are_those_of_solving_again(made, found, table):
    assert table.by_source[0].shape == (DEVICES, 21, 1)
    dwells = ix.Dwells.from_arrays(made[0], sigma=1e-4)
    ends = [
        ix.fit(dwells, accel=ix.Invariant(gravity=GRAVITY + s)).calibration.coefficients
        for s in (STEP, -STEP)
    ]
    # The true g being larger than stated is the stated one being smaller.
    np.testing.assert_allclose(
        table.by_source[0][:, :9, 0], (ends[1] - ends[0]) / 2.0, rtol=2e-3, atol=1e-9
    )
    # What the dwells' noise contributes is the fit's own covariance, but for scatter that was found.
    own = np.sqrt(np.diagonal(found.calibration.covariance[:, :9, :9], axis1=1, axis2=2))
    quiet = np.asarray(found.accel.scatter) == 0.0
    assert quiet.sum() > DEVICES // 4
    # The estimator weighs a dwell's noise along its output, as if the scale factors were one; these are off by 2 %.
    np.testing.assert_allclose(table.sigma[quiet, 1, :9], own[quiet], rtol=0.03)


@pytest.mark.slow
def test_derivatives_are_mapped_over_devices(found, table):
    sources = [ix.sources.gravity(STEP)]
    mapped = jax.jit(jax.vmap(lambda f: ix.derivatives(f, sources)))(found)
    np.testing.assert_allclose(mapped.by_source[0], table.by_source[0], rtol=1e-8, atol=1e-12)


@pytest.mark.slow
def test_derivatives_need_no_lapack(found):
    """Batched LAPACK calls of two triads wait for each other for good on two cores."""
    sources = [ix.sources.gravity(1e-4), ix.sources.output_noise()]
    traced = str(jax.make_jaxpr(jax.vmap(lambda f: ix.derivatives(f, sources)))(found))
    assert "dot_general" in traced
    for call in (" lu[", " cholesky[", " triangular_solve", " eigh[", " qr[", " svd["):
        assert call not in traced, call


def test_numbers_of_dwells_share_a_program_and_give_what_their_own_gives(monkeypatch):
    up = np.random.default_rng(6).normal(size=(25, 3))
    dwells = ix.Dwells.from_arrays(
        GRAVITY * up / np.linalg.norm(up, axis=1, keepdims=True), sigma=1e-4
    )
    shapes = []
    seen = lambda estimator, basis, d: (
        shapes.append(d.valid.shape) or fit_fleet(estimator, basis, d)
    )
    monkeypatch.setattr(fleet_fit, "fit_fleet", seen)
    shared = ix.fit(dwells)
    monkeypatch.setattr(fleet_fit, "FEW", 0)
    own = ix.fit(dwells)
    assert shapes == [(1, 32), (1, 25)]
    assert shared.dof == own.dof == {"accel": 25 - 9}
    # Sums in another order.
    for one, other in zip(jax.tree.leaves(shared), jax.tree.leaves(own), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


BY_SIZE = """repositioning day_to_day probe_noise probe_offset timing gravity positioning mounting table_rate""".split()


@pytest.mark.parametrize("name", BY_SIZE)
def test_a_source_of_another_size_shares_a_compiled_program(name):
    one, other = (getattr(ix.sources, name)(size) for size in (1e-4, 2e-4))
    (argument, fixed), (_, same) = (eqx.partition(s, eqx.is_array) for s in (one, other))
    assert jax.tree.leaves(argument) == [1e-4]
    assert jax.tree.structure(fixed) == jax.tree.structure(same)


def test_sigma_by_dwell_is_that_of_its_three_axes():
    accel = np.tile([0.0, 0.0, GRAVITY], (4, 5, 1))
    each = 1e-3 * (1.0 + np.arange(20.0).reshape(4, 5))
    whole = ix.Dwells.from_arrays(accel, sigma=np.repeat(each[..., None], 3, axis=-1))
    for given, expected in (
        (each, whole.accel_covariance),
        (each[:, :1], np.broadcast_to(whole.accel_covariance[:, :1], (4, 5, 3, 3))),
        (each[0], np.broadcast_to(whole.accel_covariance[0], (4, 5, 3, 3))),
    ):
        made = ix.Dwells.from_arrays(accel, sigma=given)
        np.testing.assert_array_equal(made.accel_covariance, expected)
    by_axis = ix.Dwells.from_arrays(accel[:, :3], sigma=[1e-3, 2e-3, 3e-3])
    np.testing.assert_allclose(by_axis.accel_covariance[1, 2], np.diag([1e-6, 4e-6, 9e-6]))


@pytest.fixture(scope="module")
def thermal():
    """References, temperatures and outputs of two devices: biases with a slope, scale factors without; noise."""
    random = np.random.default_rng(9)
    reference = random.normal(size=(2, 40, 3)) * GRAVITY
    temperature = random.uniform(-10.0, 50.0, (2, 40))
    bias = 0.1 + 1e-3 * (temperature - 20.0)
    accel = reference @ (np.eye(3) + 5e-3 * random.normal(size=(3, 3))).T + bias[..., None]
    return reference, temperature, accel + 1e-3 * random.normal(size=accel.shape)


@pytest.fixture(scope="module")
def sloped(thermal):
    reference, temperature, accel = thermal
    dwells = ix.Dwells.from_arrays(
        accel, temperature=temperature, reference_accel=reference, sigma=1e-3
    )
    return ix.fit(dwells, accel=ix.ReferenceAccel(), degree=1)


def _least_squares(sloped, thermal, k):
    """Columns and solution of device k with slopes of the biases alone, by NumPy: names, values, covariance, χ²."""
    reference, temperature, accel = (x[k] for x in thermal)
    basis = sloped.calibration.accel.curve.basis
    low, high = float(basis.low[k]), float(basis.high[k])
    x = (2.0 * temperature - low - high) / (high - low)
    columns = {}
    for i in range(3):
        unit = np.eye(3)[i]
        columns[f"accel.bias[{i}].c0"] = np.broadcast_to(unit, accel.shape)
        columns[f"accel.bias[{i}].c1"] = x[:, None] * unit
        for j in range(3):
            columns[f"accel.matrix[{i},{j}].c0"] = reference[:, j : j + 1] * unit
    design = np.stack([c.ravel() for c in columns.values()], axis=1) / 1e-3
    rows = (accel - reference).ravel() / 1e-3
    values = np.linalg.lstsq(design, rows)[0]
    return (
        list(columns),
        values,
        np.linalg.inv(design.T @ design),
        np.sum((rows - design @ values) ** 2),
    )


def test_conditioned_is_the_fit_without_the_blocks_columns(thermal, sloped):
    fewer = sloped.calibration.conditioned("accel.matrix.c1")
    for k in range(2):
        names, values, covariance, chi2 = _least_squares(sloped, thermal, k)
        place = [fewer.coefficient_names.index(n) for n in names]
        # The covariance includes the scatter that is found, to a noise of 1e-3 of every dwell.
        wider = 1.0 + (float(sloped.accel.scatter[k]) / 1e-3) ** 2
        covariance = wider * covariance
        np.testing.assert_allclose(fewer.coefficients[k][place], values, rtol=1e-9, atol=1e-12)
        own = fewer.covariance[k][np.ix_(place, place)]
        np.testing.assert_allclose(own, covariance, rtol=1e-7, atol=1e-9 * covariance.max())
        gone = [fewer.coefficient_names.index(f"accel.matrix[{i},{i}].c1") for i in range(3)]
        assert not fewer.coefficients[k][gone].any() and not fewer.covariance[k][gone].any()
        block = sloped.calibration.block("accel.matrix.c1")
        more = wider * block.mean[k] @ np.linalg.solve(block.covariance[k], block.mean[k])
        assert sloped.chi2["accel"][k] + more == pytest.approx(chi2, rel=1e-6)
        assert sloped.dof["accel"][k] == 120 - 24


def test_conditioned_goes_through_jit_and_takes_values(sloped):
    one = ix.unstack(sloped.calibration)[0]
    block = one.block("accel.bias.c1")
    known = one.conditioned(block, np.array([1e-3, 2e-3, 3e-3]))
    np.testing.assert_array_equal(known.block(block.names).mean, [1e-3, 2e-3, 3e-3])
    compiled = jax.jit(lambda c, v: c.conditioned("accel.bias.c1", v))(
        one, np.array([1e-3, 2e-3, 3e-3])
    )
    np.testing.assert_allclose(compiled.coefficients, known.coefficients, rtol=1e-9, atol=1e-12)
    both = one.conditioned(block, np.array([[1e-3, 2e-3, 3e-3], [0.0, 0.0, 0.0]]))
    for got, want in zip(ix.unstack(both), (known, one.conditioned(block)), strict=True):
        np.testing.assert_allclose(got.coefficients, want.coefficients, rtol=1e-12)
        np.testing.assert_allclose(got.covariance, want.covariance, rtol=1e-12)
    # At their means nothing moves.
    np.testing.assert_allclose(
        one.conditioned(block, block.mean).coefficients, one.coefficients, rtol=1e-12
    )


def test_residuals_are_those_of_the_reference(thermal, sloped):
    reference, temperature, accel = thermal
    compute = jax.vmap(jax.vmap(lambda c, f, t: c.distort(f, np.zeros(3), t)[0], (None, 0, 0)))
    left = accel - compute(sloped.calibration, reference, temperature)
    np.testing.assert_allclose(sloped.residuals["accel"], left, atol=1e-10)
    np.testing.assert_allclose(
        sloped.chi2["accel"], np.sum((left / 1e-3) ** 2, axis=(1, 2)), rtol=1e-9
    )


def test_a_fit_is_shown_in_one_line():
    accel = np.tile([0.0, 0.0, GRAVITY], (90, 12, 1))
    fit = ix.fit(ix.Dwells.from_arrays(accel, sigma=1e-3), accel=ix.Invariant(gravity=GRAVITY))
    assert repr(fit).startswith("Fit(90 devices, 0 succeeded; accel=Invariant; 90 × 'accel: ")
    assert len(repr(fit)) < 400


def test_a_block_is_shown_by_its_indices(sloped):
    shown = repr(ix.unstack(sloped.calibration)[0].block("accel.bias.c1"))
    assert shown.startswith("Block(indices=[12, 13, 14], names=[accel.bias[0].c1, ")


def test_a_source_answers_to_its_functions_name(found):
    table = ix.derivatives(found, ix.sources.gravity(1e-4))
    np.testing.assert_array_equal(table.covariance("gravity"), table.covariance("reference g"))
    with jax.enable_x64(False):
        assert table.sigma.dtype == np.float64
        assert table.covariance("gravity").dtype == np.float64
    with pytest.raises(ValueError, match="there are 'reference g'"):
        table.covariance("probe_noise")


def test_every_source_has_its_functions_name():
    made = {
        "output_noise": ix.sources.output_noise(),
        "table_angles": ix.sources.table_angles(1e-5, np.eye(3), np.eye(3)),
    }
    for function, name in ix.sources.NAMES.items():
        source = made.get(function) or getattr(ix.sources, function)(1e-5)
        assert source.name == name


@pytest.mark.slow
def test_four_temperatures_are_said_not_to_determine_degree_four(made):
    accel = made[0][:2]
    accel = np.concatenate([accel] * 4, axis=1) + 1e-4 * np.random.default_rng(2).normal(
        size=(2, 4 * DWELLS, 3)
    )
    temperature = np.repeat([-30.0, -5.0, 45.0, 70.0], DWELLS)[None].repeat(2, axis=0)
    dwells = ix.Dwells.from_arrays(accel, temperature=temperature, sigma=1e-4)
    fit = ix.fit(dwells, accel=ix.Invariant(gravity=GRAVITY), degree=4)
    assert not fit.succeeded.any()
    words = "4 temperatures (-30, -5, 45, 70 °C) cannot determine polynomials of degree 4"
    assert all(r is not None and words in r and "unit" not in r for r in fit.reasons)
    assert ix.fit(dwells, accel=ix.Invariant(gravity=GRAVITY), degree=3).succeeded.all()


def test_a_matrix_that_no_sensor_has_does_not_succeed(made):
    # Past the checks of units: the reference is put in after them.
    accel, gyro, rate, _ = made
    dwells = ix.Dwells.from_arrays(gyro=gyro[:4], reference_gyro=rate[:4], sigma=1e-5)
    scale = np.array([1.0, 1.05, 57.29578, 1.0])[:, None, None]
    swapped = rate[:4].copy()
    swapped[3] = swapped[3][:, [1, 0, 2]]
    wrong = eqx.tree_at(lambda d: d.reference_gyro, dwells, scale * swapped)
    fit = ix.fit(wrong, gyro=ix.ReferenceGyro(gravity=GRAVITY))
    assert fit.succeeded.tolist() == [True, True, False, False]
    # 1.01/57.3, and the first axis reads what the second turned by.
    assert "axis x reads 0.0176 times the truth; look at unit and range" in fit.reasons[2]
    assert "axis x reads much of axis y; are axes swapped or turned?" in fit.reasons[3]


@pytest.mark.parametrize(
    ("matrix", "topics"),
    [
        (np.zeros((3, 3)), []),
        (np.diag([0.09, -0.09, 0.0]), []),
        (np.diag([0.11, 0.0, -0.11]), ["unit", "unit"]),
        (np.diag([0.0, -2.01, 0.0]), ["sign"]),
        (np.array([[0.0, 0.29, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), []),
        (np.array([[0.0, 0.31, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), ["frame"]),
        (
            np.array([[-1.01, 1.0, 0.0], [1.0, -0.99, 0.0], [0.0, 0.0, 0.0]]),
            ["frame", "unit", "unit"],
        ),
    ],
)
def test_mistakes_are_those_beyond_the_limits(matrix, topics):
    names = (
        *(f"accel.bias[{i}]" for i in range(3)),
        *(f"accel.matrix[{i},{j}]" for i in range(3) for j in range(3)),
    )
    values = np.concatenate([np.full(3, 5.0), matrix.ravel()])
    assert [t for t, _ in matrix_mistakes(names, values, np.full(12, 1e-3))] == topics
    assert not matrix_mistakes(names, values, np.full(12, 9.0))  # not told at all
    assert (grade_matrix(names, np.stack([values, np.zeros(12)])) == UNUSABLE).tolist() == [
        bool(topics),
        False,
    ]
