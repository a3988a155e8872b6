"""Parameters that depend on temperature: a basis of functions times coefficients.

Every temperature model here is linear in its coefficients,

$$p(T) = \\sum_k c_k\\, \\phi_k(T),$$

so a model is a *basis* (`Constant`, `Polynomial`, `CubicSpline`) and a `Curve` is a basis with its
coefficients. Temperatures are in °C and are scaled to $[-1, 1]$ inside a basis, which keeps a
polynomial of degree 6 well conditioned; powers of T appear only on export.
"""

import abc
from typing import Any

import numpy as np
from jaxtyping import Float

from .._jax import Array, eqx, jax, jnp
from .._typing import AnyArray, Scalar
from .celsius import not_celsius
from .leaves import as_array, as_leaf, as_plain, is_traced


class AbstractBasis(eqx.Module):
    """A family of functions of temperature, evaluated at one temperature."""

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of basis functions."""

    @property
    @abc.abstractmethod
    def nodes(self) -> tuple[Float[AnyArray, "*batch"] | float, ...]:
        """As many temperatures, °C, at which values determine the coefficients."""

    @property
    @abc.abstractmethod
    def at_nodes(self) -> Float[np.ndarray, "size size"]:
        """Values of all functions (columns) at the nodes (rows), whatever the scale of temperature."""

    @abc.abstractmethod
    def __call__(self, temperature: Scalar | float) -> Float[Array, " size"]:
        """Values $\\phi_k(T)$ of all basis functions at one temperature, °C; `vmap` it over many.

        Raises `ValueError` for an array of temperatures.
        """

    def rows(self, temperature: Float[np.ndarray, " row"]) -> Float[np.ndarray, "row size"]:
        """Values at many temperatures, °C, on the host; bases override it where NumPy spares a compilation."""
        return np.asarray(_rows(self, temperature))


@eqx.filter_jit
def _rows(basis: AbstractBasis, temperature: Float[AnyArray, " row"]) -> Float[Array, "row size"]:
    return jax.vmap(basis)(temperature)


def _one(temperature: Scalar | float) -> Float[Array, ""]:
    """The temperature as a real array of no axes."""
    t = jnp.asarray(temperature)
    if t.ndim:
        raise ValueError(
            f"`basis(temperature)`: takes one temperature but got shape {t.shape}; "
            f"use `jax.vmap(basis)` or `jax.vmap(curve)` for many."
        )
    return t if jnp.issubdtype(t.dtype, jnp.floating) else t.astype(jnp.result_type(float))


def held(value: AnyArray | float, dtype: Any = None) -> Array:
    """As an array that has no slope, so that an optimiser of a whole calibration does not move it."""
    return jax.lax.stop_gradient(jnp.asarray(value, dtype))


class Constant(AbstractBasis):
    """No temperature dependence: $\\phi_0 = 1$."""

    @property
    def size(self) -> int:
        return 1

    @property
    def nodes(self) -> tuple[Float[AnyArray, "*batch"] | float, ...]:
        return (0.0,)

    @property
    def at_nodes(self) -> Float[np.ndarray, "size size"]:
        return np.ones((1, 1))

    def __call__(self, temperature: Scalar | float) -> Float[Array, " size"]:
        # Built from the temperature so that the dtype follows it; never looks at its value, so a
        # recording without a probe may carry anything here.
        return jnp.ones((1,), _one(temperature).dtype)

    def rows(self, temperature: Float[np.ndarray, " row"]) -> Float[np.ndarray, "row size"]:
        return np.ones((len(temperature), 1))


class Polynomial(AbstractBasis):
    """Chebyshev polynomials $\\phi_k(T) = T_k(x)$, $x = (2T - T_{lo} - T_{hi})/(T_{hi} - T_{lo})$.

    Same functions as an ordinary polynomial of that degree, but with a condition number of about 1
    instead of $10^8$ at degree 6. Outside `[low, high]` the polynomial is simply continued, and
    grows fast: see `Calibration.extrapolates`.

    **Reference:** Trefethen, *Approximation Theory and Approximation Practice*, SIAM 2013, ch. 3.
    """

    degree: int = eqx.field(static=True, converter=as_plain)  # the highest
    # Leaves, so that devices of other ranges share compiled code.
    low: Float[AnyArray, "*batch"] | float = eqx.field(converter=as_leaf)  # °C, maps to x = -1
    high: Float[AnyArray, "*batch"] | float = eqx.field(converter=as_leaf)  # °C, maps to x = +1

    def __check_init__(self):
        if self.degree < 0:
            raise ValueError(f"`Polynomial(degree=...)` must be 0 or more; got {self.degree}.")
        if is_traced(self.low) or is_traced(self.high):
            return
        if not np.all(np.asarray(self.low) < np.asarray(self.high)):
            raise ValueError(
                f"`Polynomial(low=..., high=...)` needs low < high in °C; "
                f"got low={self.low}, high={self.high}."
            )
        wrong = not_celsius(np.array([self.low, self.high]))
        if wrong is not None:
            raise ValueError(f"`Polynomial(low=..., high=...)`: {wrong}.")

    @property
    def size(self) -> int:
        return self.degree + 1

    @property
    def nodes(self) -> tuple[Float[AnyArray, "*batch"] | float, ...]:
        # Zeros of T_{degree+1}: interpolation there is as well conditioned as the basis.
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return tuple(middle + half * zero for zero in self._zeros.tolist())

    @property
    def at_nodes(self) -> Float[np.ndarray, "size size"]:
        return np.polynomial.chebyshev.chebvander(self._zeros, self.degree)

    @property
    def _zeros(self) -> Float[np.ndarray, " size"]:
        return np.cos(np.pi * (np.arange(self.size) + 0.5) / self.size)

    def __call__(self, temperature: Scalar | float) -> Float[Array, " size"]:
        t = _one(temperature)
        low, high = held(self.low, t.dtype), held(self.high, t.dtype)
        x = (2.0 * t - (low + high)) / (high - low)
        # Ones that depend on x, so that under `vmap` they lie on the same accelerators as the others.
        values = [((x < 0.0) | ~(x < 0.0)).astype(x.dtype), x]
        for _ in range(2, self.size):
            values.append(2.0 * x * values[-1] - values[-2])  # T_k = 2 x T_{k-1} - T_{k-2}
        return jnp.stack(values[: self.size])

    def rows(self, temperature: Float[np.ndarray, " row"]) -> Float[np.ndarray, "row size"]:
        return chebyshev_rows(temperature, self.degree, float(self.low), float(self.high))


def chebyshev_rows(
    temperature: Float[np.ndarray, " row"], degree: int, low: float, high: float
) -> Float[np.ndarray, "row size"]:
    """`Polynomial(degree, low, high)` at many temperatures, °C, on the host: its second form, by NumPy."""
    x = (2.0 * temperature - (low + high)) / (high - low)
    return np.polynomial.chebyshev.chebvander(x, degree)


class CubicSpline(AbstractBasis):
    """Natural cubic spline in its cardinal basis: $\\phi_k$ is 1 at knot $k$, 0 at the others.

    The coefficients are therefore the parameter's values at the knots. Outside the knots the
    natural spline goes on as a straight line, so it extrapolates far more calmly than a polynomial.

    **Reference:** de Boor, *A Practical Guide to Splines*, Springer 2001, ch. IV.
    """

    # °C, increasing; leaves, so that devices with other knots share compiled code.
    knots: Float[AnyArray, "*batch size"] = eqx.field(converter=as_array)

    def __check_init__(self):
        if is_traced(self.knots) or not hasattr(self.knots, "shape"):
            return
        knots = np.asarray(self.knots)
        if knots.ndim == 0 or knots.shape[-1] < 2 or not np.all(np.diff(knots) > 0):
            raise ValueError(
                f"`CubicSpline(knots=...)` needs at least 2 increasing temperatures in °C; "
                f"got {tuple(knots.ravel().tolist())}."
            )
        wrong = not_celsius(knots)
        if wrong is not None:
            raise ValueError(f"`CubicSpline(knots=...)`: {wrong}.")

    @property
    def size(self) -> int:
        return self.knots.shape[-1]

    @property
    def nodes(self) -> tuple[Float[AnyArray, "*batch"] | float, ...]:
        return tuple(self.knots[..., k] for k in range(self.size))

    @property
    def at_nodes(self) -> Float[np.ndarray, "size size"]:
        return np.eye(self.size)

    def __call__(self, temperature: Scalar | float) -> Float[Array, " size"]:
        t = _one(temperature)
        knots = held(self.knots, t.dtype)
        second = held(_natural_spline_curvature(self.knots), t.dtype)
        inside = jnp.clip(t, knots[0], knots[-1])
        i = jnp.clip(jnp.searchsorted(knots, inside, side="right") - 1, 0, self.size - 2)
        h = jnp.diff(knots)[i]
        b = (inside - knots[i]) / h
        a = 1.0 - b
        identity = jnp.eye(self.size, dtype=b.dtype)
        value = a * identity[i] + b * identity[i + 1]
        value += ((a**3 - a) * second[i] + (b**3 - b) * second[i + 1]) * h**2 / 6.0
        # Straight-line continuation outside the knots, with the end slope.
        slope = (identity[i + 1] - identity[i]) / h
        slope += ((1.0 - 3.0 * a**2) * second[i] + (3.0 * b**2 - 1.0) * second[i + 1]) * h / 6.0
        return value + slope * (t - inside)


def _natural_spline_curvature(knots: Float[AnyArray, " size"]) -> Float[AnyArray, "size size"]:
    """Matrix from values at the knots to second derivatives there (zero at both ends).

    The inner ones solve h[k-1] m[k-1] + 2 (h[k-1] + h[k]) m[k] + h[k] m[k+1] = 6 (slope[k] − slope[k-1]), which is
    tridiagonal: eliminated from the first to the last, in NumPy for knots that are known.
    """
    xp = np if isinstance(knots, np.ndarray) else jnp
    n, h = knots.shape[-1], knots[1:] - knots[:-1]
    unit = xp.eye(n, dtype=knots.dtype)
    slopes = (unit[1:] - unit[:-1]) / h[:, None]
    pivots, right = [], []
    for k in range(1, n - 1):
        pivot, row = 2.0 * (h[k - 1] + h[k]), 6.0 * (slopes[k] - slopes[k - 1])
        if pivots:
            factor = h[k - 1] / pivots[-1]
            pivot, row = pivot - factor * h[k - 1], row - factor * right[-1]
        pivots.append(pivot)
        right.append(row)
    second = [xp.zeros(n, knots.dtype)]  # from the last to the first
    for k in range(n - 2, 0, -1):
        second.append((right[k - 1] - h[k] * second[-1]) / pivots[k - 1])
    return xp.stack([xp.zeros(n, knots.dtype), *second[::-1]])


class Curve(eqx.Module):
    """A vector of parameters as a function of temperature, $p(T) = \\phi(T)\\, C$."""

    basis: AbstractBasis  # functions of temperature
    coefficients: Float[AnyArray, "*batch size parameters"]  # a row for each function, SI

    def __check_init__(self):
        shape = getattr(self.coefficients, "shape", None)
        if shape is not None and len(shape) < 2:
            raise ValueError(
                f"`Curve(coefficients=...)`: shape {tuple(shape)}; it is (functions, parameters), a row for each "
                f"function of the basis."
            )
        if shape is not None and len(shape) == 2:
            if self.coefficients.shape[0] != self.basis.size:
                raise ValueError(
                    f"`Curve(basis, coefficients)`: the basis has {self.basis.size} functions but "
                    f"the coefficients have {self.coefficients.shape[0]} rows."
                )

    def __call__(self, temperature: Scalar | float) -> Float[Array, " parameters"]:
        """The parameters at one temperature (°C), shape `(parameters,)`, in their own units.

        Raises `ValueError` for an array of temperatures; `jax.vmap(curve)` takes many.
        """
        # Function by function: for many devices a compiler would turn their coefficients' matrices at every sample.
        phi, c = self.basis(temperature), jnp.asarray(self.coefficients)
        return sum((phi[k] * c[k] for k in range(1, self.basis.size)), phi[0] * c[0])


def interpolate(
    basis: AbstractBasis, values: Float[AnyArray, "size parameters"]
) -> Float[Array, "size parameters"]:
    """Coefficients of the curve that takes the given values at `basis.nodes`."""
    values = jnp.asarray(values)
    return jnp.asarray(np.linalg.inv(basis.at_nodes), values.dtype) @ values


def constant_one(basis: AbstractBasis) -> Float[np.ndarray, " size"]:
    """Coefficients of the constant function one."""
    rows = basis.rows(np.array([float(t) for t in basis.nodes]))
    return np.linalg.lstsq(rows, np.ones(len(rows)), rcond=None)[0]


def to_powers(
    basis: Polynomial, coefficients: Float[AnyArray, "size parameters"], reference: float
) -> Float[np.ndarray, "size parameters"]:
    """Coefficients $a_j$ of $\\sum_j a_j (T - T_{ref})^j$ equal to the Chebyshev series; for export.

    **Arguments:** `reference` is $T_{ref}$ in °C. **Returns** row $j$ in parameter unit per °C^j.
    """
    from numpy.polynomial import chebyshev, polynomial

    low, high = float(basis.low), float(basis.high)
    scale = 2.0 / (high - low)
    offset = scale * (reference - 0.5 * (low + high))
    columns = []
    for series in np.asarray(coefficients, float).T:
        in_x = np.atleast_1d(chebyshev.cheb2poly(series))
        # Substitute x = offset + scale (T - reference) by Horner's rule on polynomials.
        shifted = np.zeros(1)
        for coefficient in in_x[::-1]:
            shifted = polynomial.polyadd(
                polynomial.polymul(shifted, [offset, scale]), [coefficient]
            )
        columns.append(np.pad(shifted, (0, basis.size))[: basis.size])
    return np.stack(columns, axis=1)
