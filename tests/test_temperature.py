"""Temperature bases against NumPy and SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import chebyshev, polynomial
from scipy.interpolate import CubicSpline as ScipySpline

from inertiax.physics.temperature import (
    chebyshev_rows,
    Constant,
    CubicSpline,
    Curve,
    Polynomial,
    to_powers,
)


TEMPERATURES = np.array([-55.0, -31.3, -5.0, 0.0, 2.5, 17.9, 60.0])


def test_polynomial_is_numpys_chebyshev_series():
    basis = Polynomial(6, -55.0, 60.0)
    coefficients = np.random.default_rng(0).normal(size=(7, 2))
    ours = jax.vmap(Curve(basis, coefficients))(TEMPERATURES)
    x = (2 * TEMPERATURES - 5.0) / 115.0
    np.testing.assert_allclose(ours, chebyshev.chebval(x, coefficients).T, rtol=1e-13)


@pytest.mark.parametrize("degree", [0, 1, 3, 6])
def test_powers_of_temperature_give_the_same_curve(degree):
    basis = Polynomial(degree, -40.0, 85.0)
    coefficients = np.random.default_rng(degree).normal(size=(degree + 1, 3))
    powers = to_powers(basis, coefficients, 25.0)
    expected = jax.vmap(Curve(basis, coefficients))(TEMPERATURES)
    np.testing.assert_allclose(
        polynomial.polyval(TEMPERATURES - 25.0, powers).T, expected, rtol=1e-11, atol=1e-11
    )


@pytest.mark.slow
@pytest.mark.parametrize("knots", [(-55.0, 60.0), (-55.0, -20.0, 5.0, 31.0, 60.0)])
def test_spline_is_scipys_natural_spline(knots):
    values = np.random.default_rng(1).normal(size=(len(knots), 2))
    ours = jax.vmap(Curve(CubicSpline(knots), values))(TEMPERATURES)
    if len(knots) == 2:
        expected = np.stack([np.interp(TEMPERATURES, knots, v) for v in values.T], axis=1)
    else:
        expected = ScipySpline(knots, values, bc_type="natural")(TEMPERATURES)
    np.testing.assert_allclose(ours, expected, rtol=1e-12, atol=1e-13)


@pytest.mark.slow
def test_spline_continues_as_a_straight_line():
    curve = Curve(CubicSpline((-20.0, 0.0, 30.0)), np.array([[1.0], [-2.0], [4.0]]))
    outside = jax.vmap(curve)(jnp.array([60.0, 70.0, 80.0]))[:, 0]
    np.testing.assert_allclose(outside[2] - outside[1], outside[1] - outside[0], rtol=1e-12)
    slope = jax.jacfwd(curve)(jnp.asarray(29.999999))[0]
    np.testing.assert_allclose((outside[1] - outside[0]) / 10.0, slope, rtol=1e-6)


def test_constant_never_looks_at_the_temperature():
    curve = Curve(Constant(), np.array([[3.0, 4.0]]))
    np.testing.assert_array_equal(curve(jnp.nan), [3.0, 4.0])


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Polynomial(-1, 0.0, 1.0), "must be 0 or more; got -1"),
        (lambda: Polynomial(3, 20.0, 20.0), "needs low < high in °C; got low=20.0, high=20.0"),
        (lambda: CubicSpline((1.0,)), "at least 2 increasing temperatures"),
        (lambda: CubicSpline((1.0, 1.0)), "at least 2 increasing temperatures"),
        (
            lambda: Curve(Constant(), np.zeros((2, 3))),
            "has 1 functions but the coefficients have 2",
        ),
    ],
)
def test_messages(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("degree", [0, 1, 6])
def test_rows_on_the_host_are_the_polynomial_and_its_cosines(degree):
    low, high = -30.0, 60.0
    temperature = np.linspace(low, high, 13)
    angle = np.arccos((2.0 * temperature - (low + high)) / (high - low))
    rows = chebyshev_rows(temperature, degree, low, high)
    np.testing.assert_allclose(rows, np.cos(np.outer(angle, np.arange(degree + 1))), atol=1e-13)
    basis = jax.vmap(Polynomial(degree, low, high))(jnp.asarray(temperature))
    np.testing.assert_allclose(rows, basis, rtol=0, atol=1e-13)
