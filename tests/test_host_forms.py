"""NumPy forms of the estimators equal the JAX forms, Jacobians by hand those by automatic differentiation."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.estimators import (
    GravityRotation,
    Invariant,
    ReferenceAccel,
    ReferenceGyro,
    StaticAccel,
    StaticGyro,
)
from inertiax.estimators.host_forms import host_form
from inertiax.reduction.dwells import Dwells
from inertiax.reduction.motions import Motions


G = 9.81


@pytest.fixture(autouse=True)
def _double():
    with jax.enable_x64(True):
        yield


def _covariances(rng, count, size):
    root = size * rng.normal(size=(count, 3, 3))
    return root @ np.swapaxes(root, 1, 2) + size**2 * np.eye(3)


def _dwells(rng, count=12, *, motion=False, force_in_motion=False, reference=True) -> Dwells:
    unit = rng.normal(size=(count, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    samples = 37  # no square, so that the last block of the products is filled up
    start = np.roll(unit, 1, axis=0)
    turning = Motions(
        gyro=rng.normal(scale=1.5, size=(count, samples, 3)),
        step=rng.uniform(0.005, 0.02, size=(count, samples - 1)),
        start_force=G * start,
        start_covariance=_covariances(rng, count, 2e-3),
        noise=rng.uniform(1e-7, 1e-6, count),
        valid=np.arange(count) % 4 != 0,
        force=rng.normal(scale=G, size=(count, samples, 3)) if force_in_motion else None,
    )
    return Dwells(
        time=np.arange(count, dtype=float),
        duration=np.full(count, 5.0),
        count=np.full(count, 500.0),
        temperature=rng.uniform(-20.0, 50.0, count),
        experiment=np.zeros(count, int),
        position=np.arange(count),
        valid=np.arange(count) != 5,
        accel=G * unit + rng.normal(scale=0.05, size=(count, 3)),
        accel_covariance=_covariances(rng, count, 1e-3),
        gyro=rng.normal(scale=0.01, size=(count, 3)),
        gyro_covariance=_covariances(rng, count, 1e-5),
        reference_accel=G * unit if reference else None,
        reference_gyro=rng.normal(scale=0.5, size=(count, 3)) if reference else None,
        motion=turning if motion else None,
    )


CASES = {
    "invariant": (Invariant(G, scatter=2e-3), {}),
    "invariant without misalignments": (Invariant(G, misalignments=False), {}),
    "invariant, robust": (Invariant(G, scatter=1e-2, robust=1.5), {}),
    "reference accel": (ReferenceAccel(scatter=1e-3), {}),
    "reference accel, robust": (ReferenceAccel(robust=2.0), {}),
    "reference gyro": (ReferenceGyro(G, scatter=1e-5), {}),
    "reference gyro with D": (ReferenceGyro(G, g_sensitivity=True), {}),
    "static accel": (StaticAccel(np.array([0.1, 0.2, 9.8])), {"reference": False}),
    "static accel, reference": (StaticAccel(np.zeros(3), scatter=1e-3), {}),
    "static gyro": (StaticGyro(G), {"reference": False}),
    "static gyro with D": (StaticGyro(G, g_sensitivity=True), {}),
    "gravity": (GravityRotation(G, scatter=1e-3), {"motion": True, "reference": False}),
    "gravity, robust": (GravityRotation(G, scatter=1e-3, robust=1.0), {"motion": True}),
    "gravity with D": (
        GravityRotation(G, g_sensitivity=True),
        {"motion": True, "force_in_motion": True, "reference": False},
    ),
}


def _jax_form(estimator, vectors, dwells):
    def one(vector, dwell):
        rows = estimator.residual(vector, dwell)
        return rows, jax.jacfwd(estimator.residual)(vector, dwell), *estimator.misfit(vector, dwell)

    # One program: a hundred small ones take five times as long to compile.
    return [np.asarray(x) for x in jax.jit(jax.vmap(one))(jnp.asarray(vectors), dwells)]


@pytest.mark.parametrize("name", CASES)
def test_both_forms_linearise_alike(name):
    estimator, kind = CASES[name]
    rng = np.random.default_rng(1)
    dwells = _dwells(rng, **kind)
    vectors = rng.normal(scale=0.02, size=(dwells.num_dwells, estimator.num_parameters))
    residual, jacobian, misfit, sigma = _jax_form(estimator, vectors, dwells)
    found = host_form(estimator).linearise(vectors, dwells)
    valid = dwells.valid
    # Rounding of sums of some forty products; the series of a rotation leave 2e-11.
    close = lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())
    close(found.residual[valid], residual[valid])
    close(found.jacobian[valid], jacobian[valid])
    close(found.misfit, misfit)
    close(found.sigma, sigma)
    assert not np.any(found.residual[~valid]) and not np.any(found.jacobian[~valid])


@pytest.mark.parametrize("name", CASES)
def test_both_forms_compensate_compose_and_start_alike(name):
    estimator, kind = CASES[name]
    rng = np.random.default_rng(2)
    dwells = _dwells(rng, **kind)
    first, second = rng.normal(scale=0.02, size=(2, dwells.num_dwells, estimator.num_parameters))
    form = host_form(estimator)
    # Rounding of a 3 × 3 inverse, some ulp of the largest number.
    close = lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-13 * np.abs(b).max())
    refined = jax.jit(lambda *each: jax.vmap(estimator.compensate)(*each))(
        jnp.asarray(first), dwells
    )
    for a, b in zip(jax.tree.leaves(form.compensate(first, dwells)), jax.tree.leaves(refined)):
        if np.issubdtype(np.asarray(b).dtype, np.floating):
            close(np.asarray(a), np.asarray(b))
        else:
            assert np.array_equal(a, b)
    composed = jax.jit(lambda *each: jax.vmap(estimator.compose)(*each))(
        jnp.asarray(first), jnp.asarray(second)
    )
    close(form.compose(first, second), np.asarray(composed))
    # The ellipsoid's normal matrix has a condition number of 10⁴ on these random positions.
    start = np.asarray(jax.jit(lambda d: estimator.start(d))(dwells))
    np.testing.assert_allclose(form.start(dwells), start, rtol=1e-9, atol=1e-10)


def test_long_motions_are_taken_a_few_at_a_time(monkeypatch):
    from inertiax.estimators.host_forms import gravity_rotation

    estimator = GravityRotation(G)
    rng = np.random.default_rng(3)
    dwells = _dwells(rng, motion=True)
    vectors = rng.normal(scale=0.02, size=(dwells.num_dwells, estimator.num_parameters))
    whole = host_form(estimator).linearise(vectors, dwells)
    monkeypatch.setattr(gravity_rotation, "_SAMPLES_AT_ONCE", 1)
    apart = host_form(estimator).linearise(vectors, dwells)
    for a, b in zip(whole, apart, strict=True):
        # The order of additions inside a matrix product may differ with the number of motions.
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12 * np.abs(b).max())


def test_positions_without_an_ellipsoid_start_at_zero():
    rng = np.random.default_rng(4)
    dwells = _dwells(rng)
    alike = eqx.tree_at(lambda d: d.accel, dwells, np.tile([0.0, 0.0, G], (12, 1)))
    assert not np.any(host_form(Invariant(G)).start(alike))


def test_a_subclass_keeps_its_own_residual():
    class Doubled(StaticAccel):
        def residual(self, vector, dwell):
            return 2.0 * super().residual(vector, dwell)

    assert host_form(Doubled(np.zeros(3))) is None
