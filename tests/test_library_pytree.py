"""The calibration as a pytree: labels out of its structure, stacking, transformations, export."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline as ScipySpline
from scipy.stats import multivariate_normal

from hard_limit import run_limited
from inertiax.calibration.calibration import (
    Calibration,
    read_calibration,
    TriadCalibration,
    write_calibration,
)
from inertiax.calibration.fitted_effects import FittedEffect, known_effect
from inertiax.calibration.magnetometers import MagnetometerCalibration
from inertiax.calibration.stacking import stack, unstack
from inertiax.physics.temperature import Constant, CubicSpline, Curve, Polynomial


ACCEL = tuple(f"accel.bias[{i}]" for i in range(3)) + ("accel.matrix[0,0]", "accel.matrix[1,0]")
GYRO = tuple(f"gyro.bias[{i}]" for i in range(3)) + ("gyro.matrix[0,1]",)


def device(seed, *, effects=(), joint=True):
    """A device of one model with its own numbers, ranges and labels."""
    random = np.random.default_rng(seed)
    basis = Polynomial(2, -40.0 - seed, 70.0 + seed)
    root = 1e-4 * random.standard_normal((27, 27))
    covariance = root @ root.T
    triad = lambda names, rows: TriadCalibration(
        Curve(basis, 1e-2 * random.standard_normal((3, len(names)))),
        covariance[rows, rows],
        names,
        "reference",
    )
    return Calibration(
        gravity=9.8 + 0.01 * seed,
        accel=triad(ACCEL, slice(0, 15)),
        gyro=triad(GYRO, slice(15, 27)),
        device=f"SN {seed}",
        temperature_range=(-40.0 - seed, 70.0),
        notes=(f"note {seed}",),
        effects=effects,
        cross_covariance=covariance[:15, 15:] if joint else None,
    )


def effect(name, settings=(), coefficients=(1e-3,), triad="accel", **extent):
    unit = known_effect(name, "").unit(triad, dict(settings))
    covariance = 1e-8 * np.eye(len(coefficients))
    return FittedEffect(
        name, triad, (1,), settings, np.array(coefficients), covariance, unit, **extent
    )


SAMPLE = (np.array([0.3, -9.7, 0.8]), np.array([0.1, -0.2, 0.05]), np.float64(33.0))


def by_hand(calibration, accel, gyro, temperature):
    """Equation (3) in NumPy, with NumPy's own Chebyshev series."""
    basis = calibration.accel.curve.basis
    x = (2 * temperature - basis.low - basis.high) / (basis.high - basis.low)
    at = lambda t: np.polynomial.chebyshev.chebval(x, np.asarray(t.curve.coefficients))
    a, w = at(calibration.accel), at(calibration.gyro)
    m = np.eye(3)
    m[0, 0] += a[3]
    m[1, 0] += a[4]
    n = np.eye(3)
    n[0, 1] += w[3]
    return np.linalg.solve(m, accel - a[:3]), np.linalg.solve(n, gyro - w[:3])


@pytest.mark.slow
def test_second_device_of_a_model_is_not_compiled_again():
    traces = []

    @jax.jit
    def compensate(calibration, accel, gyro, temperature):
        traces.append(None)
        return calibration(accel, gyro, temperature)

    for seed in range(3):
        calibration = device(seed, effects=(effect("second_order", greatest_input=1.0 + seed),))
        got = compensate(calibration, *SAMPLE)
        want = calibration(*SAMPLE)
        np.testing.assert_allclose(got[0], want[0], rtol=1e-12)
    assert len(traces) == 1


def test_a_calibration_itself_can_be_compiled():
    force, rate = jax.jit(device(1))(*SAMPLE)
    want = by_hand(device(1), *SAMPLE)
    np.testing.assert_allclose(force, want[0], rtol=1e-12)
    np.testing.assert_allclose(rate, want[1], rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("basis", [Polynomial(1, -40.0, 70.0), CubicSpline((-40.0, 0.0, 70.0))])
def test_what_decides_the_meaning_of_coefficients_has_no_slope(basis):
    names = ("gyro.bias[0]", "gyro.g_sensitivity[0,1]")
    curve = Curve(basis, np.full((basis.size, 2), 1e-2))
    one = Calibration(9.81, gyro=TriadCalibration(curve, np.eye(2 * basis.size), names, "static"))
    slope = jax.grad(lambda c: c(*SAMPLE)[1].sum())(jax.tree.map(jnp.asarray, one))
    assert not np.any(slope.gravity)
    assert not any(np.any(x) for x in jax.tree.leaves(slope.gyro.curve.basis))
    assert np.all(slope.gyro.curve.coefficients != 0.0)


def test_labels_go_with_tree_map_and_never_to_another_device():
    one, two = device(1), device(2)
    assert jax.tree.structure(one) == jax.tree.structure(two)
    assert jax.tree.map(np.asarray, two).device == "SN 2"
    halved = jax.jit(lambda c: jax.tree.map(lambda x: 0.5 * x, c))
    # The program was traced with the first device; its result is nobody's by name.
    assert halved(one).device == "" == halved(two).device
    assert halved(two).notes == ()


def test_people_are_shown_magnetometers_and_a_table_without_triads_is_empty():
    names = tuple(f"mag.bias[{i}]" for i in range(3))
    iron = Curve(Constant(), np.array([[2e-5, 0.0, -1e-5]]))
    mag = MagnetometerCalibration(TriadCalibration(iron, 1e-16 * np.eye(3), names, "field"), 48e-6)
    both = device(1).changed(mag=mag)
    assert repr(both).endswith("gyro=reference (3, 4), mag=field (1, 3))")
    assert "mag   hard iron z              -10.000 ± 0.010      µT" in both.summary()
    assert "hard iron z" in both._repr_html_()
    table = both.to_frame([20.0])
    assert table.rows()[-1] == (20.0, "mag.bias[2]", -1e-5, 1e-8, "T")
    nothing = Calibration(9.81).to_frame()
    assert nothing.is_empty() and nothing.schema == table.schema


def test_stacked_devices_are_mapped_like_each_alone():
    devices = [device(k) for k in range(4)]
    many = stack(devices)
    force, rate = jax.vmap(lambda c: c(*SAMPLE))(many)
    for k, one in enumerate(devices):
        want = by_hand(one, *SAMPLE)
        np.testing.assert_allclose(force[k], want[0], rtol=1e-12)
        np.testing.assert_allclose(rate[k], want[1], rtol=1e-11, atol=1e-14)
    for one, back in zip(devices, unstack(many), strict=True):
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(back), strict=True):
            np.testing.assert_array_equal(a, b)
    outside = jax.vmap(lambda c: c.extrapolates(-41.5))(many)
    assert outside.tolist() == [True, True, False, False]
    assert devices[0].extrapolates(np.nan)


@pytest.mark.slow
def test_a_thousand_read_calibrations_stack(tmp_path):
    path = tmp_path / "calibration.json"
    write_calibration(device(1), path)
    text = path.read_text()
    many = []
    for k in range(1000):
        path.write_text(text.replace('"SN 1"', f'"SN {k}"'))
        many.append(read_calibration(path))
    assert many[7].device == "SN 7"
    force, _ = jax.jit(jax.vmap(lambda c: c(*SAMPLE)))(stack(many))
    assert force.shape == (1000, 3)
    np.testing.assert_allclose(force[999], by_hand(device(1), *SAMPLE)[0], rtol=1e-12)


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (lambda: device(1).changed(gyro=None), "gyro"),
        (lambda: device(1, effects=(effect("second_order"),)), "effects"),
        (lambda: device(1, joint=False), "cross_covariance"),
        (
            lambda: device(1).changed(
                accel=TriadCalibration(
                    Curve(Constant(), np.zeros((1, 5))), np.zeros((5, 5)), ACCEL, "reference"
                )
            ),
            "accel.curve.basis",
        ),
    ],
)
def test_devices_of_other_models_do_not_stack_and_the_message_says_why(other, words):
    with pytest.raises(ValueError, match=f"number 1 differs .*{words}"):
        stack([device(0), other()])


@pytest.mark.slow
def test_scan_checkpoint_and_cond_take_a_calibration():
    calibration = device(3)
    want = by_hand(calibration, *SAMPLE)[0]
    carried, forces = jax.lax.scan(lambda c, s: (c, c(*s)[0]), calibration, _twice(SAMPLE))
    np.testing.assert_allclose(forces[1], want, rtol=1e-12)
    assert jax.tree.structure(carried) == jax.tree.structure(calibration)
    chosen = jax.lax.cond(jnp.asarray(True), lambda a, b: a, lambda a, b: b, calibration, device(4))
    np.testing.assert_array_equal(chosen.gravity, calibration.gravity)
    size = lambda c: jnp.sum(c(*SAMPLE)[0] ** 2)
    plain, kept = jax.grad(size)(calibration), jax.grad(jax.checkpoint(size))(calibration)
    for a, b in zip(jax.tree.leaves(plain), jax.tree.leaves(kept), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-15)


def _twice(sample):
    return jax.tree.map(lambda x: np.stack([x, x]), sample)


def test_exported_program_takes_another_device(tmp_path):
    from inertiax.calibration.exportable import register

    register()
    calibration = device(
        1, effects=(effect("dead_band", (("width", 1e-3), ("form", "zone")), triad="gyro"),)
    )
    exported = jax.export.export(jax.jit(lambda c, a, w, t: c(a, w, t)))(calibration, *SAMPLE)
    again = jax.export.deserialize(exported.serialize())
    other = device(2, effects=calibration.effects)
    for got, want in zip(again.call(other, *SAMPLE), other(*SAMPLE), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-12)


def test_explicit_sharding_of_devices():
    mesh = jax.make_mesh((1,), ("devices",), axis_types=(jax.sharding.AxisType.Explicit,))
    spread = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("devices"))
    many = jax.tree.map(lambda x: jax.device_put(x, spread), stack([device(0), device(1)]))
    force, _ = jax.jit(jax.vmap(lambda c: c(*SAMPLE)))(many)
    np.testing.assert_allclose(force[1], by_hand(device(1), *SAMPLE)[0], rtol=1e-12)


@pytest.mark.slow
def test_effects_of_a_sample_take_part_both_ways():
    # K2 of 1e-3 m/s²/g² on y, and the gyro's odd nonlinearity on y.
    effects = (
        effect("second_order", coefficients=(2e-3,)),
        effect("rate_nonlinearity", (("power", 3),), (0.02,), triad="gyro"),
    )
    calibration, plain = device(1, effects=effects), device(1)
    force, rate = np.array([1.0, 9.6, -2.0]), np.array([0.4, 1.5, -0.3])
    accel, gyro = calibration.distort(force, rate, 20.0)
    bare = plain.distort(force, rate, 20.0)
    np.testing.assert_allclose(accel[1] - bare[0][1], 2e-3 * (9.6 / 9.81) ** 2, rtol=1e-9)
    np.testing.assert_allclose(gyro[1] - bare[1][1], 0.02 * 1.5**3, rtol=1e-12)
    np.testing.assert_allclose(accel[0], bare[0][0], rtol=1e-15)
    back = jax.vmap(calibration)(*(jnp.stack([x, x]) for x in (accel, gyro)), jnp.full(2, 20.0))
    np.testing.assert_allclose(back[0][1], force, rtol=1e-10)
    np.testing.assert_allclose(back[1][1], rate, rtol=1e-10)


@pytest.mark.parametrize(
    "name, settings",
    [
        ("thermal_lag", (("time_constant", 100.0),)),
        ("warm_up", (("start", "each"), ("time_constant", 100.0))),
        ("supply", (("nominal", 5.0),)),
    ],
)
def test_an_effect_with_memory_is_an_error_that_says_so(name, settings):
    calibration = device(1, effects=(effect(name, settings),))
    with pytest.raises(ValueError, match=f"'{name}' on accel_y depends on more than one sample"):
        jax.vmap(calibration)(*_twice(SAMPLE))
    with pytest.raises(ValueError, match=f"'{name}' on accel_y"):
        calibration.distort(*SAMPLE)
    left_out = calibration.without_effects(name)(*SAMPLE)
    np.testing.assert_allclose(left_out[0], by_hand(device(1), *SAMPLE)[0], rtol=1e-12)


def test_file_keeps_the_joint_covariance_and_settings(tmp_path):
    path = tmp_path / "calibration.json"
    settings = (("time_constant", 123.25),)
    made = device(2, effects=(effect("thermal_lag", settings, clock=(1.0, 2.0)),))
    write_calibration(made, path)
    back = read_calibration(path)
    np.testing.assert_array_equal(back.covariance, made.covariance)
    assert dict(back.effects[0].settings) == {"time_constant": 123.25}
    stored = json.loads(path.read_text())
    stored["cross_covariance"] = [[0.0]]
    path.write_text(json.dumps(stored))
    with pytest.raises(ValueError, match="cross_covariance must have 15 rows of 12 numbers"):
        read_calibration(path)


@pytest.mark.slow
@pytest.mark.parametrize(
    "basis", [Constant(), Polynomial(2, -40.0, 70.0), CubicSpline((-40.0, 20.0, 70.0))]
)
def test_as_many_temperatures_as_functions_are_not_mixed(basis):
    curve = Curve(basis, np.ones((basis.size, 2)))
    with pytest.raises((ValueError, TypeError)):
        curve(np.full(basis.size, 20.0))
    assert jax.vmap(curve)(jnp.full(basis.size, 20.0)).shape == (basis.size, 2)


def test_splines_with_other_knots_share_code_and_stack():
    traces = []
    values = np.random.default_rng(8).normal(size=(4, 2))
    names = ("accel.bias[0]", "accel.bias[1]")

    def spline(knots):
        triad = TriadCalibration(Curve(CubicSpline(knots), values), np.eye(8), names, "static")
        return Calibration(gravity=9.81, accel=triad)

    @jax.jit
    def parameters(calibration, temperature):
        traces.append(None)
        return calibration.accel.curve(temperature)

    knots = (-40.0, -10.0, 25.0, 70.0), (-30.0, 0.0, 20.0, 60.0)
    devices = [spline(k) for k in knots]
    temperatures = np.array([-50.0, -10.0, 22.0, 65.0])
    together = jax.vmap(lambda c: jax.vmap(c.accel.curve)(temperatures))(stack(devices))
    for k, (device, own) in enumerate(zip(devices, knots)):
        inside = np.clip(temperatures, own[0], own[-1])
        known = ScipySpline(own, values, bc_type="natural")
        # A natural spline goes on as a straight line.
        expected = known(inside) + known(inside, 1) * (temperatures - inside)[:, None]
        found = np.stack([parameters(device, t) for t in temperatures])
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(together[k], expected, rtol=1e-10, atol=1e-12)
    assert len(traces) == 1


# The Gaussian's support ---------------------------------------------------------------------------


def _conditioned(bits):
    """A device two of whose coefficients are held, their places, SciPy's density of the others, a point on it."""
    known = device(3).conditioned(["accel.matrix.c1", "gyro.bias[0].c2"], 1e-3)
    held = known.block(["accel.matrix.c1", "gyro.bias[0].c2"]).indices
    free = np.setdiff1d(np.arange(27), held)
    spread = known.covariance[np.ix_(free, free)]
    scale = np.sqrt(np.diag(spread))
    others = multivariate_normal(
        np.zeros(len(free)), spread / np.outer(scale, scale), allow_singular=False
    )
    point = known.coefficients.copy()
    point[free] += scale * others.rvs(random_state=1)
    point = point.astype(bits)
    want = others.logpdf((point[free] - known.coefficients[free]) / scale) - np.log(scale).sum()
    return known, held, free, want, point


@pytest.mark.slow
@pytest.mark.parametrize("bits", [np.float64, np.float32])
def test_the_density_of_a_conditioned_calibration_is_that_of_the_others(bits):
    known, held, _, want, point = _conditioned(bits)
    assert (point[held] == np.asarray(1e-3, bits)).all()
    for density in (known.log_density, jax.jit(known.log_density)):
        # The correlation's condition is 1e4: of 32 bits a few digits are left.
        np.testing.assert_allclose(density(point), want, rtol=1e-9 if bits == np.float64 else 1e-3)
        for k in held:
            off = point.copy()
            off[k] += 1e-6
            assert density(off) == -np.inf
    both = jax.vmap(known.log_density)(np.stack([point, point + np.eye(27, dtype=bits)[held[0]]]))
    assert np.isfinite(both[0]) and both[1] == -np.inf


def test_its_slope_is_that_of_the_others_and_finite_off_the_support():
    known, held, free, _, point = _conditioned(np.float64)
    slope = jax.grad(known.log_density)(point)
    want = -np.linalg.solve(
        known.covariance[np.ix_(free, free)], (point - known.coefficients)[free]
    )
    np.testing.assert_allclose(slope[free], want, rtol=1e-6, atol=1e-6 * np.abs(want).max())
    point[held[0]] += 1.0
    assert np.isfinite(jax.grad(known.log_density)(point)).all()


def test_draws_are_on_the_support():
    known = _conditioned(np.float64)[0]
    drawn = known.samples(jax.random.PRNGKey(0), 200)
    assert np.isfinite(jax.vmap(known.log_density)(drawn)).all()
    # A covariance of rank 5 whose coefficients all vary.
    root = 1e-4 * np.random.default_rng(2).normal(size=(27, 5))
    thin = device(3).with_covariance(root @ root.T)
    drawn = thin.samples(jax.random.PRNGKey(1), 200)
    assert np.isfinite(jax.vmap(thin.log_density)(drawn)).all()
    assert thin.log_density(np.asarray(drawn[0]) + 1e-5 * np.eye(27)[4]) == -np.inf


MANY_GAUSSIANS = """
import inertiax as ix

places = [f"bias[{i}]" for i in range(3)] + [f"matrix[{i},{j}]" for i in range(3) for j in range(3)]

def triad(name, seed):
    root = np.random.default_rng(seed).normal(size=(36, 36))
    own = tuple(f"{name}.{p}" for p in places)
    curve = ix.Curve(ix.Polynomial(2, -40.0, 70.0), np.full((3, 12), 1e-3))
    return ix.TriadCalibration(curve, 1e-6 * (root @ root.T / 36.0 + np.eye(36)), own, "reference")

made = [ix.Calibration(9.81, triad("accel", k), triad("gyro", k + 1)) for k in range(10)]
many = jax.tree.map(lambda x: jnp.concatenate([x] * 100), ix.stack(made))

def one(calibration, key):
    halves = [calibration.conditioned(f"{n}.*", 1e-3) for n in ("accel", "gyro")]
    density = calibration.log_density(calibration.coefficients)
    return [calibration.samples(key, 2), density, *(h.covariance for h in halves)]

keys = jax.random.split(jax.random.PRNGKey(0), 1000)
mapped = jax.jit(jax.vmap(one))
for _ in range(6):
    found = jax.block_until_ready(mapped(many, keys))
alone = one(made[3], keys[3])
for a, b in zip(found, alone):
    np.testing.assert_allclose(a[3], b, rtol=1e-8, atol=1e-12)
"""


@pytest.mark.slow
def test_gaussians_of_many_devices_do_not_wait_for_each_other():
    # Two batched calls of LAPACK in one program hang on two cores, at the third run at the latest of the four tried.
    run_limited(MANY_GAUSSIANS, seconds=240.0)
