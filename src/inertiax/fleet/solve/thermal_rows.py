"""Rows of the invariant accelerometer problem over temperature and their sums, for a batch of devices.

Parameters are curves θ(T) = φ(T) C. A dwell's Jacobian by the coefficients C is the Kronecker product
φ(T) ⊗ g of the basis and the nine-parameter row g, so

    gradient = Σ φ gᵀ r,    normal matrix = Σ φφᵀ ⊗ ggᵀ,

two matrix products per device: the second form of `procedure.thermal_iterations.normal_matrix` for
`estimators.Invariant`, held to it by `tests/test_fleet.py` through the fits (1e-5 sigma) and to the Kronecker rows by
`tests/test_fleet_moments.py`.

Devices stand last in every array, and what is worked out element by element stands in one row of dwells and devices:
products of small matrices and short loops cost more than their arithmetic. Only the sums of a normal matrix are
products of matrices.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...numerics.lane_cholesky import invert_lanes_by_blocks, product_of
from ...numerics.own_kernels import kept
from ...physics.temperature import AbstractBasis, Polynomial
from .moments import products, squares


Coefficients = Float[Array, "size 9 batch"]  # in g and per unit
Matrices = Float[Array, "unknowns unknowns batch"]


class Rows(NamedTuple):
    """Of every dwell and device, in one row, at some coefficients."""

    residual: Float[Array, " row"]  # weighted
    turned: Float[Array, "3 row"]  # minus the derivatives of the force's length by the bias
    force: Float[Array, "3 row"]


class ThermalRows:
    """The dwells of a batch of devices, in one precision; arguments as for `fit_thermal_invariant`."""

    def __init__(
        self,
        outputs: Float[Array, "batch dwells 3"],
        temperature: Float[Array, "batch dwells"],
        weights: Float[Array, "batch dwells"],
        gravity: Float[Array, ""],
        basis: AbstractBasis,
    ):
        self._over, self.pairs = _products_of(basis)
        self.temperature = temperature.T  # devices last, where they fill the vector lanes
        self.phi = _of_all(basis, self.temperature)
        # What is worked out element by element, in one row: loops of few devices are no vectors.
        self.outputs = jnp.transpose(outputs, (2, 1, 0)).reshape(3, -1) / gravity
        self.weights = (weights.T * gravity).reshape(-1)
        self.shape = weights.T.shape
        self.size = basis.size
        self.total = self._sum_of_squares(self.weights)

    @property
    def over(self) -> Float[Array, "products dwells batch"]:
        """All functions of temperature of a normal matrix."""
        return _of_all(self._over, self.temperature)

    def at(self, c: Coefficients) -> Rows:
        """The rows at the curves φ(T) C."""
        theta = _along(self.phi, c).reshape(9, -1)
        over_scale = _reciprocals(theta)
        force = _forces(theta, self.outputs, over_scale)
        back = jax.lax.rsqrt(_square(force))
        residual = (_square(force) * back - 1.0) * self.weights
        return Rows(residual, _turned(theta, force, back, over_scale), force)

    def at_zero(self) -> Rows:
        """`at` zero, where a row g is (a, a aᵀ)/‖a‖."""
        a = self.outputs
        back = jax.lax.rsqrt(_square(a))
        return Rows((_square(a) * back - 1.0) * self.weights, a * back[None], a)

    def cost(self, rows: Rows) -> Float[Array, " batch"]:
        """Sum of squares of each device."""
        return self._sum_of_squares(rows.residual)

    def columns(self, rows: Rows) -> Float[Array, "9 dwells batch"]:
        """Weighted g."""
        return _columns(rows.turned, rows.force, self.weights).reshape(9, *self.shape)

    def slope(self, rows: Rows) -> Coefficients:
        """Minus half of the gradient of the cost, Σ φ gᵀ r."""
        pulls = _columns(rows.turned, rows.force, rows.residual * self.weights)
        return products(self.phi, pulls.reshape(9, *self.shape))

    def inverse(self, rows: Rows) -> tuple[Matrices, Coefficients]:
        """Inverse normal matrices, and the roots of the diagonals of these matrices themselves."""
        normal = normal_matrices(self.over, self.columns(rows), self.pairs)
        scale = jnp.sqrt(jnp.stack([normal[k, k] for k in range(len(normal))]))
        return invert_lanes_by_blocks(normal, 9), scale.reshape(self.size, 9, -1)

    def step(self, rows: Rows, inverse: Matrices) -> Coefficients:
        """Of Gauss and Newton, with this inverse normal matrix."""
        slope = self.slope(rows).astype(inverse.dtype)
        return _of_each(inverse, slope.reshape(self.size * 9, -1)).reshape(slope.shape)

    def step_as_if_apart(self, rows: Rows) -> Coefficients:
        """A step for a basis and rows g that have nothing to do with each other, as long as the linear problem asks.

        Σ w² φφᵀ ⊗ ggᵀ is then the product of Σ w² φφᵀ / Σ w² and Σ w² ggᵀ, as on a plan in which all attitudes come
        again at all temperatures.
        """
        columns, slope = self.columns(rows), self.slope(rows)
        squared = jnp.square(self.weights).reshape(1, *self.shape)
        means = products(squared, self.over)[0] / self.total[None]
        one, other = self.pairs
        of_basis = invert_lanes_by_blocks(0.5 * (means[one] + means[other]), self.size)
        step = product_of(of_basis, product_of(slope, invert_lanes_by_blocks(squares(columns), 9)))
        foreseen = self._sum_of_squares(_dot(columns, _along(self.phi, step)))
        return step * (jnp.sum(step * slope, axis=(0, 1)) / foreseen)[None, None]

    def _sum_of_squares(self, row: Array) -> Float[Array, " batch"]:
        of_device = row.reshape(1, *self.shape)
        return products(of_device, of_device)[0, 0]


def _of_all(basis: Callable[[Array], Array], temperature: Array) -> Array:
    return jax.vmap(jax.vmap(basis, out_axes=1), out_axes=1)(temperature)


# --- element by element: second form of `invariant.predicted`, in one row of dwells and devices ----------------


@kept
def _reciprocals(theta: Float[Array, "9 row"]) -> Float[Array, "3 row"]:
    return 1.0 / (1.0 + jnp.stack([theta[3], theta[5], theta[8]]))


@kept
def _forces(theta: Array, a: Array, over_scale: Array) -> Float[Array, "3 row"]:
    b0, b1, b2, _, g10, _, g20, g21, _ = theta
    d0, d1, d2 = over_scale
    f0 = (a[0] - b0) * d0
    f1 = (a[1] - b1 - g10 * f0) * d1
    return jnp.stack([f0, f1, (a[2] - b2 - g20 * f0 - g21 * f1) * d2])


@kept
def _square(force: Array) -> Float[Array, " row"]:
    return force[0] * force[0] + force[1] * force[1] + force[2] * force[2]


@kept
def _turned(theta: Array, force: Array, back: Array, over_scale: Array) -> Float[Array, "3 row"]:
    """(E + Γ)⁻ᵀ f/‖f‖: minus the derivatives of ‖f‖ by the bias."""
    _, _, _, _, g10, _, g20, g21, _ = theta
    d0, d1, d2 = over_scale
    v2 = force[2] * back * d2
    v1 = (force[1] * back - g21 * v2) * d1
    return jnp.stack([(force[0] * back - g10 * v1 - g20 * v2) * d0, v1, v2])


@kept
def _columns(turned: Array, force: Array, weight: Array) -> Float[Array, "9 row"]:
    """Minus the derivatives by the nine parameters, times a weight."""
    v = turned * weight[None]
    return jnp.concatenate([v, v[:1] * force[:1], v[1:2] * force[:2], v[2:] * force])


# --- sums ---------------------------------------------------------------------------------------------------------


@kept
def _along(phi: Array, c: Array) -> Float[Array, "9 dwells batch"]:
    """Parameters at every dwell, φ C."""
    terms = (phi[k][None] * c[k][:, None] for k in range(len(phi)))
    return functools.reduce(jnp.add, terms)


@kept
def _dot(x: Array, y: Array) -> Array:
    return functools.reduce(jnp.add, (x[k] * y[k] for k in range(len(x))))


@kept
def _of_each(matrix: Array, vector: Array) -> Array:
    """Each device's matrix times its vector, in parts."""
    parts = [
        functools.reduce(jnp.add, (matrix[:, k] * vector[None, k] for k in range(s, s + 9)))
        for s in range(0, len(vector), 9)
    ]
    return functools.reduce(jnp.add, parts)


def normal_matrices(
    over: Float[Array, "products dwells batch"],
    rows: Float[Array, "parameters dwells batch"],
    pairs: Int[np.ndarray, "2 size size"],
) -> Float[Array, "unknowns unknowns batch"]:
    """Σ φφᵀ ⊗ ggᵀ of each device, from the products above the diagonals only; for `pairs` see `_products_of`."""
    size, parameters = pairs.shape[1], len(rows)
    place, least = _places(parameters), int(pairs.min())
    right, left = _own_products(_device_first(rows)), _device_first(over[least:])
    sums = _device_last(jnp.matmul(right, jnp.swapaxes(left, 1, 2)))
    one, other = pairs - least
    each = 0.5 * (sums[:, one] + sums[:, other])
    full = jnp.transpose(each[place], (2, 0, 3, 1, 4))
    return full.reshape(size * parameters, size * parameters, -1)


@kept
def _device_first(x: Array) -> Array:
    return jnp.moveaxis(x, 2, 0)


@kept
def _device_last(x: Array) -> Array:
    return jnp.moveaxis(x, 0, 2)


@kept
def _own_products(rows: Array) -> Float[Array, "batch pairs dwells"]:
    return jnp.concatenate(
        [rows[:, i, None] * rows[:, : i + 1] for i in range(rows.shape[1])], axis=1
    )


def _products_of(
    basis: AbstractBasis,
) -> tuple[Callable[[Array], Array], Int[np.ndarray, "2 size size"]]:
    """Functions of temperature, first those of the basis, and the two of them whose mean is each product φ_k φ_l.

    Chebyshev's polynomials have T_k T_l = (T_{k+l} + T_{|k−l|})/2, so twice as many make all products.
    """
    k, l = np.indices((basis.size, basis.size))
    if isinstance(basis, Polynomial):
        twice = Polynomial(2 * basis.degree, basis.low, basis.high)
        return twice, np.stack([k + l, np.abs(k - l)])
    i, j = np.tril_indices(basis.size)

    def with_products(temperature: Array) -> Array:
        phi = basis(temperature)
        return jnp.concatenate([phi, phi[i] * phi[j]])

    place = basis.size + _places(basis.size)
    return with_products, np.stack([place, place])


def _places(n: int) -> Int[np.ndarray, "n n"]:
    """Where each of the n² pairs is found among those with i ≥ j."""
    i, j = np.tril_indices(n)
    place = np.zeros((n, n), int)
    place[i, j] = place[j, i] = np.arange(len(i))
    return place
