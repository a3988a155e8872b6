"""True parameters of a simulated device as smooth functions of temperature.

No data sheet of the founding paper's A-100 is at hand. Every figure below is an **assumption**: the
order of size that makers state for quartz pendulous accelerometers of navigation grade (bias of a
few mg with some ten µg/°C, scale factor with about 100 ppm/°C, axes within about 1 mrad), and for
the other grades the order of tactical and consumer units. A device's own values are drawn around them.

The truth is a Chebyshev series over −75…+80 °C (wide enough for every drift of the paper's plans)
of degree 6 by default, so that a degree-6 fit can represent it exactly and differences between
fits show the procedure, not the basis; `ripple` adds a sine that no polynomial represents.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from .._typing import AnyArray, Scalar
from ..physics.error_model import AccelerometerErrors, GyroErrors
from ..physics.temperature import Curve, Polynomial


TRUTH_RANGE = (-75.0, 80.0)  # °C, the truth's basis; wider than any plan's temperatures

_DECAY = 0.35  # ratio of successive Chebyshev coefficients: degree 6 is 0.5 % of the slope's
RIPPLE_PERIOD = 55.0  # °C, about two periods over the paper's range


class Figures(eqx.Module):
    """Order of size of a triad's parameters. In m/s² for accelerometers, rad/s for gyros."""

    bias: float = eqx.field(static=True)
    bias_slope: float = eqx.field(static=True)  # per °C
    scale: float = eqx.field(static=True)  # relative
    scale_slope: float = eqx.field(static=True)  # per °C
    misalignment: float = eqx.field(static=True)  # rad
    misalignment_slope: float = eqx.field(static=True)  # rad/°C
    density: float = eqx.field(static=True)  # white noise, per √Hz
    g_sensitivity: float = eqx.field(static=True, default=0.0)  # rad/s per g, gyros
    g_sensitivity_slope: float = eqx.field(static=True, default=0.0)  # per °C


ACCEL_FIGURES = {
    "navigation": Figures(
        bias=3e-2,  # 3 mg
        bias_slope=3e-4,  # 30 µg/°C
        scale=1e-3,
        scale_slope=8e-5,  # 80 ppm/°C
        misalignment=1e-3,
        misalignment_slope=3e-6,
        # 1e-5 m/s² on the mean over a minute, the founding demo's noise; 8 µg/√Hz.
        density=1e-5 * 60.0**0.5,
    ),
    "tactical": Figures(
        bias=5e-2,
        bias_slope=5e-4,
        scale=2e-3,
        scale_slope=1e-4,
        misalignment=2e-3,
        misalignment_slope=5e-6,
        density=5e-4,  # 50 µg/√Hz
    ),
    "consumer": Figures(
        bias=0.5,  # 50 mg
        bias_slope=5e-3,  # 0.5 mg/°C
        scale=1e-2,
        scale_slope=2e-4,
        misalignment=1e-2,
        misalignment_slope=1e-5,
        density=1.5e-3,  # 150 µg/√Hz
    ),
}

GYRO_FIGURES = {
    "navigation": Figures(
        bias=2.4e-6,  # 0.5 °/h
        bias_slope=5e-8,  # 0.01 °/h/°C
        scale=5e-4,
        scale_slope=2e-5,
        misalignment=1e-3,
        misalignment_slope=2e-6,
        density=1.5e-6,  # 0.005 °/√h
        g_sensitivity=2.4e-6,  # 0.5 °/h/g, a mechanical gyro
        g_sensitivity_slope=2e-8,
    ),
    "tactical": Figures(
        bias=1e-4,  # 20 °/h
        bias_slope=2.4e-6,  # 0.5 °/h/°C
        scale=1e-3,
        scale_slope=3e-5,
        misalignment=1e-3,
        misalignment_slope=5e-6,
        density=3e-5,  # 0.1 °/√h
        g_sensitivity=2.4e-5,  # 5 °/h/g
        g_sensitivity_slope=2e-7,
    ),
    "consumer": Figures(
        bias=2e-2,  # 1 °/s
        bias_slope=5e-4,  # 0.03 °/s/°C
        scale=1e-2,
        scale_slope=2e-4,
        misalignment=1e-2,
        misalignment_slope=2e-5,
        density=1.2e-4,  # 0.007 °/s/√Hz
        g_sensitivity=1.7e-3,  # 0.1 °/s/g
        g_sensitivity_slope=1e-5,
    ),
}


class TrueCurve(eqx.Module):
    """Parameters over temperature: a polynomial, plus a sine of the temperature if asked for,

    $$p(T) = \\sum_k c_k T_k(x) + r \\sin(2\\pi T / P + \\varphi).$$
    """

    series: Curve
    ripple: Float[AnyArray, " parameters"]  # r, in the parameters' units
    phase: Float[AnyArray, " parameters"]  # φ, rad

    def __call__(self, temperature: Scalar | float) -> Float[Array, " parameters"]:
        """The parameters at one temperature, °C."""
        angle = 2.0 * jnp.pi / RIPPLE_PERIOD * jnp.asarray(temperature)
        return self.series(temperature) + jnp.asarray(self.ripple) * jnp.sin(angle + self.phase)


class AccelerometerTriad(eqx.Module):
    """Three accelerometers. The matrix is lower triangular: they define the case frame."""

    curve: TrueCurve  # bias (3), then the lower triangle of Γ by rows (6)

    def errors(self, temperature: Scalar | float) -> AccelerometerErrors:
        """True parameters at a temperature of the sensing elements, °C."""
        p = self.curve(temperature)
        o = jnp.zeros_like(p[0])
        matrix = jnp.stack(
            [jnp.stack([p[3], o, o]), jnp.stack([p[4], p[5], o]), jnp.stack([p[6], p[7], p[8]])]
        )
        return AccelerometerErrors(p[:3], matrix)


class GyroTriad(eqx.Module):
    """Three gyros with full matrices Θ and D."""

    curve: TrueCurve  # bias (3), Θ by rows (9), D by rows (9)

    def errors(self, temperature: Scalar | float) -> GyroErrors:
        """True parameters at a temperature of the sensing elements, °C."""
        p = self.curve(temperature)
        return GyroErrors(p[:3], p[3:12].reshape(3, 3), p[12:].reshape(3, 3))


ACCEL_PARAMETERS = (
    *(f"bias[{i}]" for i in range(3)),
    *(f"matrix[{i},{j}]" for i in range(3) for j in range(i + 1)),
)
GYRO_PARAMETERS = (
    *(f"bias[{i}]" for i in range(3)),
    *(f"matrix[{i},{j}]" for i in range(3) for j in range(3)),
    *(f"g_sensitivity[{i},{j}]" for i in range(3) for j in range(3)),
)


def _sizes(names: tuple[str, ...], figures: Figures) -> tuple[list[float], list[float]]:
    """Order of size of value and slope of each named parameter."""
    values, slopes = [], []
    for name in names:
        if name.startswith("bias"):
            pair = figures.bias, figures.bias_slope
        elif name.startswith("g_sensitivity"):
            pair = figures.g_sensitivity, figures.g_sensitivity_slope
        elif name[7] == name[9]:
            pair = figures.scale, figures.scale_slope
        else:
            pair = figures.misalignment, figures.misalignment_slope
        values.append(pair[0])
        slopes.append(pair[1])
    return values, slopes


def _draw(
    key: PRNGKeyArray, names: tuple[str, ...], figures: Figures, degree: int, ripple: float
) -> TrueCurve:
    basis = Polynomial(degree, *TRUTH_RANGE)
    values, slopes = (jnp.asarray(s) for s in _sizes(names, figures))
    # Greatest slope term: the slope times half the basis' range.
    swing = slopes * (0.5 * (TRUTH_RANGE[1] - TRUTH_RANGE[0]))
    sign, size, phase = jax.random.split(key, 3)
    shape = (degree + 1, len(names))
    # Between a half and all of the figure, of either sign: no device is perfect by chance.
    factor = jax.random.uniform(size, shape, minval=0.5, maxval=1.0)
    factor = factor * jax.random.rademacher(sign, shape, dtype=factor.dtype)
    rows = [values] + [swing * _DECAY ** (k - 1) for k in range(1, degree + 1)]
    angles = jax.random.uniform(phase, (len(names),), maxval=2.0 * jnp.pi)
    return TrueCurve(Curve(basis, factor * jnp.stack(rows)), ripple * swing, angles)


def draw_accelerometers(
    key: PRNGKeyArray, *, grade: str = "navigation", degree: int = 6, ripple: float = 0.0
) -> AccelerometerTriad:
    """A random accelerometer triad; the default grade is like the founding paper's A-100.

    **Arguments:** `degree` of the truth's polynomial; `ripple`, the amplitude of what no polynomial
    represents, as a fraction of each parameter's swing over the temperature range.
    """
    return AccelerometerTriad(
        _draw(key, ACCEL_PARAMETERS, _figures(ACCEL_FIGURES, grade), degree, ripple)
    )


def draw_gyros(
    key: PRNGKeyArray, *, grade: str = "navigation", degree: int = 6, ripple: float = 0.0
) -> GyroTriad:
    """A random gyro triad with g-sensitivity; arguments as of `draw_accelerometers`."""
    return GyroTriad(_draw(key, GYRO_PARAMETERS, _figures(GYRO_FIGURES, grade), degree, ripple))


def _figures(table: dict[str, Figures], grade: str) -> Figures:
    if grade not in table:
        raise ValueError(f"grade {grade!r}: no such grade; it is one of {list(table)}.")
    return table[grade]


class Noise(eqx.Module):
    """Noise of a device's outputs: white, with these one-sided densities, and of its probe."""

    accel: float = ACCEL_FIGURES["navigation"].density  # m/s²/√Hz
    gyro: float = GYRO_FIGURES["navigation"].density  # rad/s/√Hz
    probe: float = 0.0  # °C, standard deviation of one reading


NAVIGATION_NOISE = Noise()


def typical_noise(grade: str, *, probe: float = 0.0) -> Noise:
    """White noise of a grade's order of size."""
    accel, gyro = _figures(ACCEL_FIGURES, grade), _figures(GYRO_FIGURES, grade)
    return Noise(accel.density, gyro.density, probe)


class Device(eqx.Module):
    """A simulated device: its triads and the lag of its sensing elements behind the probe."""

    accel: AccelerometerTriad | None = None
    gyro: GyroTriad | None = None
    lag: Scalar | float = 0.0  # s, first-order, from probe to sensing elements
