"""How far a tool that applies an exported calibration is from our own compensation."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration
from .export import Export
from .parameters import parameters_over, temperature_span


_TEMPERATURES = 41
RATE = 1.0  # rad/s, 57 °/s; the greatest rate that the error is searched for


class Loss(NamedTuple):
    """Greatest differences over the calibrated temperatures and over inputs in 26 directions."""

    force: float  # m/s², with specific forces of 0 and g
    force_at: float  # °C
    rate: float  # rad/s, with rates of 0 and `RATE`, and forces of 0 and g
    rate_at: float  # °C
    force_at_rest: float  # m/s², with no force: the part that acts like a bias
    rate_at_rest: float  # rad/s, with no rate and a force of 0 or g
    gravity: float  # m/s²
    low: float  # °C
    high: float  # °C

    @property
    def sentence(self) -> str:
        """The same in one line."""
        span = f"{self.low:g} to {self.high:g} °C" if self.high > self.low else "its temperature"
        return (
            f"over {span} the tool's result differs from the calibration's by up to "
            f"{self.force:.2g} m/s² (at {self.force_at:.0f} °C; specific force up to "
            f"{self.gravity:.2f} m/s²) and {self.rate:.2g} rad/s (at {self.rate_at:.0f} °C; rates up to "
            f"{RATE:g} rad/s); of this {self.force_at_rest:.2g} m/s² without force and "
            f"{self.rate_at_rest:.2g} rad/s at rest"
        )


def measure_loss(calibration: Calibration, export: Export) -> Loss:
    """Distort known inputs with the calibration's own model, equation (1), let the tool's formula
    compensate them, and compare with the known inputs (in the tool's frame)."""
    low, high = temperature_span(calibration)
    temperature = np.linspace(low, high, _TEMPERATURES if high > low else 1)
    gravity = float(calibration.gravity)
    force, rate = _inputs(gravity)
    model = parameters_over(calibration, temperature)
    # [temperature, input, 3]
    accel = force @ np.swapaxes(model.accel_matrix, 1, 2) + model.accel_bias[:, None]
    gyro = rate @ np.swapaxes(model.gyro_matrix, 1, 2) + model.gyro_bias[:, None]
    gyro = gyro + force @ np.swapaxes(model.gyro_by_force, 1, 2)
    shape = accel.shape
    tool_force, tool_rate = export.applied(
        accel.reshape(-1, 3), gyro.reshape(-1, 3), np.repeat(temperature, len(force))
    )
    error = lambda tool, true: np.linalg.norm(tool.reshape(shape) - true @ export.frame.T, axis=2)
    of_force, of_rate = error(tool_force, force), error(tool_rate, rate)
    no_force = np.linalg.norm(force, axis=1) == 0
    no_rate = np.linalg.norm(rate, axis=1) == 0
    worst = lambda e: float(temperature[np.argmax(e.max(axis=1))])
    return Loss(
        force=float(of_force.max()),
        force_at=worst(of_force),
        rate=float(of_rate.max()),
        rate_at=worst(of_rate),
        force_at_rest=float(of_force[:, no_force].max()),
        rate_at_rest=float(of_rate[:, no_rate].max()),
        gravity=gravity,
        low=low,
        high=high,
    )


def _inputs(
    gravity: float,
) -> tuple[Float[np.ndarray, "input 3"], Float[np.ndarray, "input 3"]]:
    """Every pair of a force and a rate: zero, and full size towards a cube's faces, edges, corners."""
    cube = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3)).reshape(3, -1).T
    unit = cube / np.maximum(np.linalg.norm(cube, axis=1), 1.0)[:, None]
    return np.repeat(gravity * unit, len(unit), axis=0), np.tile(RATE * unit, (len(unit), 1))
