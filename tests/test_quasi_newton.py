"""The bounded quasi-Newton search against SciPy's, and what a carried curvature saves."""

import numpy as np
import pytest
import scipy.optimize

from inertiax.numerics.quasi_newton import minimise


EXACT = {"tolerance": 1e-14, "max_steps": 500}


def _rosenbrock(x):
    return float(scipy.optimize.rosen(x)), scipy.optimize.rosen_der(x)


@pytest.mark.parametrize(
    "bounds",
    [[(-5.0, 5.0)] * 4, [(-5.0, 0.7)] * 4, [(-5.0, 5.0), (1.2, 3.0), (-1.0, 0.5), (-2.0, 2.0)]],
)
def test_it_finds_the_minimum_that_scipy_finds(bounds):
    start = np.array([-1.2, 1.3, -0.5, 0.8])
    found = minimise(_rosenbrock, start, bounds, **EXACT)
    options = {"ftol": 1e-15, "gtol": 1e-10, "maxiter": 1000}
    peer = scipy.optimize.minimize(
        _rosenbrock, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options
    )
    # Square roots of the tolerances on the values; the valley's curvature is 1000 times flatter along it.
    assert found.value == pytest.approx(peer.fun, abs=1e-8)
    np.testing.assert_allclose(found.x, peer.x, atol=1e-4)


def test_it_stays_in_the_box_and_at_a_bound_that_holds_it():
    slope = np.array([1.0, -2.0])
    found = minimise(lambda x: (float(slope @ x), slope), np.zeros(2), [(-1.0, 2.0)] * 2, **EXACT)
    assert np.array_equal(found.x, [-1.0, 2.0])


def test_a_carried_curvature_takes_one_step_to_a_quadratics_minimum():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(7, 7))
    curvature, centre = root @ root.T + np.eye(7), rng.uniform(-1.0, 1.0, 7)

    def quadratic(x):
        return float(0.5 * (x - centre) @ curvature @ (x - centre)), curvature @ (x - centre)

    box = [(-5.0, 5.0)] * 7
    cold = minimise(quadratic, np.zeros(7), box, **EXACT)
    warm = minimise(quadratic, np.zeros(7), box, curvature=cold.curvature, **EXACT)
    known = minimise(quadratic, np.zeros(7), box, curvature=curvature, **EXACT)
    np.testing.assert_allclose(cold.x, centre, atol=1e-6)
    assert known.evaluations == 2 and warm.evaluations < cold.evaluations / 2


def test_no_lower_value_ends_it():
    found = minimise(lambda x: (0.0, np.ones(2)), np.ones(2), [(-5.0, 5.0)] * 2, **EXACT)
    assert np.array_equal(found.x, [1.0, 1.0])
