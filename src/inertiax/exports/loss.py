"""How far a tool that applies an exported calibration is from our own compensation."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration
from ..calibration.magnetometers import MagnetometerCalibration
from ..calibration.named_g_sensitivity import with_matrix_d
from .cubic import ROUNDING
from .export import AppliedField, Export
from .magnetometer_parameters import field_errors
from .parameters import parameters_over, temperature_span


_TEMPERATURES = 41
RATE = 1.0  # rad/s, 57 °/s; the greatest rate that the error is searched for
CURRENT = (
    10.0  # A, beside which the magnetometers' error is searched for; what a small multicopter draws
)
_FLAT = 0.99  # of the greatest error; where all temperatures come so near, none is named


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
    force_least: float = 0.0  # m/s², at the temperature where the difference is least
    rate_least: float = 0.0  # rad/s, likewise
    field: "FieldLoss | None" = None  # None: no magnetometers in the files

    @property
    def sentence(self) -> str:
        """The same in one line."""
        thermal = self.high > self.low
        span = f"over {self.low:.1f} to {self.high:.1f} °C" if thermal else "at its temperature"
        parts = []
        if self.force > ROUNDING * self.gravity:
            force = _stated(self.force, self.force_least, self.force_at, "m/s²")
            parts.append(f"{force} for specific forces up to {self.gravity:.2f} m/s²")
        if self.rate > ROUNDING * RATE:
            rate = _stated(self.rate, self.rate_least, self.rate_at, "rad/s")
            parts.append(f"{rate} for rates up to {RATE:g} rad/s")
        left = [
            f"{size:.2g} {unit} {without}"
            for size, unit, without, scale in (
                (self.force_at_rest, "m/s²", "also without specific force", self.gravity),
                (self.rate_at_rest, "rad/s", "also without rotation", RATE),
            )
            if size > ROUNDING * scale
        ]
        said = f"; of this {' and '.join(left)}" if left else "; the biases lose nothing"
        said = said if parts else ""
        if self.field is not None and self.field.vector > ROUNDING * self.field.size:
            parts.append(self.field.part)
        if not parts:
            return f"{span} the tool's results are the calibration's, but for rounding"
        listed = " and ".join([", ".join(parts[:-1]), parts[-1]] if parts[1:] else parts)
        return f"{span} the tool's results differ from the calibration's by up to {listed}{said}"


class FieldLoss(NamedTuple):
    """Greatest differences of the magnetometers' field over the same temperatures and directions."""

    vector: (
        float  # T, with the field of the place and, where it was calibrated, a current of `CURRENT`
    )
    magnitude: float  # T, of it along the field
    size: float  # T, the field of the place

    @property
    def part(self) -> str:
        """The same as a part of a sentence."""
        said = f"{1e6 * self.vector:.2g} µT for a field of {1e6 * self.size:.3g} µT"
        if self.magnitude > ROUNDING * self.size:
            return f"{said} ({1e6 * self.magnitude:.2g} µT of it in magnitude)"
        return f"{said} (its magnitude is kept)"


def _stated(size: float, least: float, at: float, unit: str) -> str:
    return f"{size:.2g} {unit}" + (f" (at {at:.0f} °C)" if least < _FLAT * size else "")


def measure_loss(calibration: Calibration, export: Export) -> Loss:
    """Distort known inputs with the calibration's own model, equation (1), let the tool's formula
    compensate them, and compare with the known inputs (in the tool's frame)."""
    calibration = with_matrix_d(calibration)
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
    field = None
    if calibration.mag is not None and export.applied_field is not None:
        field = _field_loss(calibration.mag, export.applied_field, temperature)
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
        force_least=float(of_force.max(axis=1).min()),
        rate_least=float(of_rate.max(axis=1).min()),
        field=field,
    )


def _field_loss(
    mag: MagnetometerCalibration,
    applied: AppliedField,
    temperature: Float[np.ndarray, " temperature"],
) -> FieldLoss:
    """The same for the magnetometers: outputs m' = (E + S) m + b + c I of known fields, compensated by the tool."""
    size = float(mag.field)
    errors = field_errors(mag, temperature)
    currents = np.array([0.0, CURRENT]) if errors.current.any() else np.zeros(1)
    field = size * _directions()
    # [temperature, current, direction, 3]
    outputs = (field @ np.swapaxes(np.eye(3) + errors.matrix, 1, 2))[:, None]
    outputs = outputs + errors.bias[:, None, None]
    outputs = outputs + (currents[:, None] * errors.current[:, None])[:, :, None]
    heat, flowing = (
        np.broadcast_to(x, outputs.shape[:3]).ravel()
        for x in (temperature[:, None, None], currents[:, None])
    )
    found = applied(outputs.reshape(-1, 3), heat, flowing).reshape(outputs.shape)
    length = np.linalg.norm(found, axis=-1) - np.linalg.norm(field, axis=-1)
    return FieldLoss(
        float(np.linalg.norm(found - field, axis=-1).max()), float(np.abs(length).max()), size
    )


def _inputs(
    gravity: float,
) -> tuple[Float[np.ndarray, "input 3"], Float[np.ndarray, "input 3"]]:
    """Every pair of a force and a rate: zero, and full size in each direction."""
    unit = _directions()
    return np.repeat(gravity * unit, len(unit), axis=0), np.tile(RATE * unit, (len(unit), 1))


def _directions() -> Float[np.ndarray, "27 3"]:
    """Zero, and unit vectors towards a cube's faces, edges and corners."""
    cube = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3)).reshape(3, -1).T
    return cube / np.maximum(np.linalg.norm(cube, axis=1), 1.0)[:, None]
