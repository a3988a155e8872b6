"""The calibration pytree and its JSON form."""

import inspect
import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibrate.observability import output_covariance
from inertiax.calibration.calibration import (
    Calibration,
    read_calibration,
    TriadCalibration,
    write_calibration,
)
from inertiax.estimators import Invariant, ReferenceGyro
from inertiax.physics.error_model import distort_accel, distort_gyro
from inertiax.physics.temperature import Constant, CubicSpline, Curve, Polynomial


GRAVITY = 9.8


def _drawn(getkey, *shape):
    """Normal numbers of NumPy's, whose drawing is not compiled for each shape."""
    return np.random.default_rng(np.asarray(getkey())).standard_normal(shape)


def _triad(getkey, estimator, name, basis):
    count = estimator.num_parameters
    unknowns = basis.size * count
    square = 1e-5 * _drawn(getkey, unknowns, unknowns)
    coefficients = jnp.asarray(1e-2 * _drawn(getkey, basis.size, count))
    covariance = jnp.asarray(square @ square.T)
    return TriadCalibration(Curve(basis, coefficients), covariance, estimator.names, name)


@pytest.fixture(params=[Constant(), Polynomial(3, -40.0, 70.0), CubicSpline((-40.0, 10.0, 70.0))])
def calibration(request, getkey):
    gyro = ReferenceGyro(gravity=GRAVITY, g_sensitivity=True)
    return Calibration(
        gravity=GRAVITY,
        accel=_triad(getkey, Invariant(gravity=GRAVITY), "invariant", request.param),
        gyro=_triad(getkey, gyro, "reference", Constant()),
        device="SN <7>",
        temperature_range=(-40.0, 70.0),
        notes=("chosen by hand",),
    )


@pytest.mark.slow
def test_compensates_what_the_model_distorts(calibration, getkey):
    force, rate = 5.0 * _drawn(getkey, 20, 3), _drawn(getkey, 20, 3)
    temperature = jnp.linspace(-40.0, 70.0, 20)

    def measured(f, w, t):
        errors, gyro = calibration.accel_errors(t), calibration.gyro_errors(t)
        return distort_accel(errors, f), distort_gyro(gyro, w, f, GRAVITY)

    accel, gyro = jax.jit(jax.vmap(measured))(force, rate, temperature)
    refined = jax.jit(lambda *samples: jax.vmap(calibration)(*samples))(accel, gyro, temperature)
    np.testing.assert_allclose(refined[0], force, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(refined[1], rate, rtol=1e-11, atol=1e-12)


@pytest.mark.slow
def test_goes_through_scan(calibration):
    samples = jnp.ones((5, 3)), jnp.ones((5, 3)), jnp.linspace(0.0, 20.0, 5)
    _, scanned = jax.lax.scan(lambda carry, x: (carry, calibration(*x)), None, samples)
    mapped = jax.jit(lambda *samples: jax.vmap(calibration)(*samples))(*samples)
    np.testing.assert_allclose(scanned[0], mapped[0], rtol=1e-14)


def test_json_round_trip_is_exact(calibration, tmp_path):
    path = tmp_path / "calibration.json"
    write_calibration(calibration, path)
    back = read_calibration(path)
    assert jax.tree.structure(back) == jax.tree.structure(calibration)
    for a, b in zip(jax.tree.leaves(back), jax.tree.leaves(calibration), strict=True):
        np.testing.assert_array_equal(a, b)
    assert [p.name for p in tmp_path.iterdir()] == ["calibration.json"]  # nothing left beside it


def test_file_says_units_and_range(calibration, tmp_path):
    path = tmp_path / "calibration.json"
    write_calibration(calibration, path)
    content = json.loads(path.read_text())
    assert content["schema"] == "inertiax.calibration/1"
    assert content["temperature_range"] == [-40.0, 70.0]
    assert content["accel"]["units"] == ["m/s^2"] * 3 + ["1"] * 6
    assert content["gyro"]["units"] == ["rad/s"] * 3 + ["1"] * 9 + ["rad/s/g"] * 9


def test_a_failed_calibration_is_not_written(calibration, tmp_path):
    bad = eqx.tree_at(
        lambda c: c.accel.curve.coefficients, calibration, replace_fn=lambda x: x / 0.0
    )
    path = tmp_path / "calibration.json"
    with pytest.raises(ValueError, match="numbers that are not finite, so .* was not written"):
        write_calibration(bad, path)
    with pytest.raises(ValueError, match="the calibration comes first"):
        inspect.unwrap(write_calibration)(path, calibration)  # tests check types before
    assert list(tmp_path.iterdir()) == []


def test_standard_deviations_by_numpy(calibration):
    triad = calibration.accel
    phi = np.asarray(triad.curve.basis(12.0))
    # Row-major (size, parameters): parameter i of the curve is the combination φ ⊗ e_i.
    for i in (0, 5):
        pick = np.kron(phi, np.eye(9)[i])
        expected = np.sqrt(pick @ np.asarray(triad.covariance) @ pick)
        np.testing.assert_allclose(triad.standard_deviations(12.0)[i], expected, rtol=1e-10)


@pytest.mark.slow
def test_output_covariance_is_that_of_sampled_calibrations(calibration, getkey):
    accel, gyro = jnp.array([1.0, -3.0, 9.0]), jnp.array([0.2, 0.1, -0.4])
    runs = 4000

    def draws(triad):
        covariance = np.asarray(triad.covariance)
        factor = np.linalg.cholesky(covariance + 1e-18 * np.eye(len(covariance)))
        shape = triad.curve.coefficients.shape
        return (_drawn(getkey, runs, len(factor)) @ factor.T).reshape(runs, *shape)

    def sampled(*drawn):
        where = lambda c: (c.accel.curve.coefficients, c.gyro.curve.coefficients)
        moved = [c + d for c, d in zip(where(calibration), drawn, strict=True)]
        return eqx.tree_at(where, calibration, moved)(accel, gyro, 12.0)

    drawn = draws(calibration.accel), draws(calibration.gyro)
    force, rate = jax.jit(jax.vmap(sampled))(*drawn)
    stated_of = eqx.filter_jit(lambda c: output_covariance(c, accel, gyro, 12.0))
    for samples, stated in zip((force, rate), stated_of(calibration), strict=True):
        expected = np.var(np.asarray(samples), axis=0)
        # Variances of 4000 samples: relative standard deviation √(2/4000) = 2.2 %.
        np.testing.assert_allclose(np.diagonal(stated), expected, rtol=0.1)


def test_extrapolation_is_flagged(calibration):
    flags = jax.vmap(calibration.extrapolates)(jnp.array([-40.1, -40.0, 0.0, 70.0, 70.1]))
    assert flags.tolist() == [True, False, False, False, True]


def _broken(change):
    def make(content):
        change(content)
        return json.dumps(content).encode()

    return make


BAD_FILES = {
    "truncated": (lambda c: json.dumps(c).encode()[:200], "not valid JSON"),
    "unknown key": (_broken(lambda c: c.update(colour="red")), "unknown key 'colour'"),
    "missing key": (_broken(lambda c: c.pop("gravity")), "key 'gravity' is missing"),
    "wrong type": (_broken(lambda c: c.update(gravity="9.8")), "'gravity': expected a number, found text"),
    "other schema": (_broken(lambda c: c.update(schema="inertiax.calibration/9")),
                     "this version reads 'inertiax.calibration/1'"),
    "unit": (_broken(lambda c: c.update(gravity_unit="g")), "gravity_unit is 'g'; it must be 'm/s\\^2'"),
    "parameter unit": (_broken(lambda c: c["gyro"]["units"].__setitem__(0, "deg/s")), "gyro: units are"),
    "parameter name": (_broken(lambda c: c["gyro"]["names"].__setitem__(0, "gyro.bias[7]")),
                       "'gyro.bias\\[7\\]' is not the name of one of its parameters"),
    "parameter twice": (_broken(lambda c: c["gyro"]["names"].__setitem__(1, "gyro.bias[0]")),
                        "gyro: 'gyro.bias\\[0\\]' stands twice"),
    "short matrix": (_broken(lambda c: c["gyro"]["covariance"].pop()),
                     "gyro.covariance must have 21 rows of 21 numbers"),
    "basis": (_broken(lambda c: c["gyro"]["basis"].update(kind="fourier")), "basis kind 'fourier' is not known"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_FILES)
def test_messages_name_file_and_key(name, calibration, tmp_path):
    make, message = BAD_FILES[name]
    path = tmp_path / "calibration.json"
    write_calibration(calibration, path)
    path.write_bytes(make(json.loads(path.read_text())))
    with pytest.raises(ValueError, match=message) as caught:
        read_calibration(path)
    assert "\n" not in str(caught.value)


def test_absent_file_is_named(tmp_path):
    with pytest.raises(ValueError, match="no.json: cannot be read"):
        read_calibration(tmp_path / "no.json")


def test_parameters_at_many_temperatures_are_those_at_each(calibration):
    temperatures = np.array([-50.0, -3.0, 20.5, 80.0])
    for triad in (calibration.accel, calibration.gyro):
        values, sigmas = triad.over(temperatures)
        for t, value, sigma in zip(temperatures, values, sigmas, strict=True):
            np.testing.assert_allclose(value, triad.curve(t), rtol=1e-12)
            np.testing.assert_allclose(sigma, triad.standard_deviations(t), rtol=1e-9)
