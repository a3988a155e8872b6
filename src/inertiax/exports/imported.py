"""A calibration from the numbers of another tool's file."""

import numpy as np
from jaxtyping import Float

from .._jax import jnp
from ..calibration.calibration import Calibration, TriadCalibration
from ..physics.temperature import AbstractBasis, Constant, Curve, interpolate


UNCERTAINTY_UNKNOWN = "imported; the file gives no uncertainties, so the covariances are zero"

_PAIRS = [(i, j) for i in range(3) for j in range(3)]


def triad(
    kind: str,
    matrix: Float[np.ndarray, "*node 3 3"],
    bias: Float[np.ndarray, "*node 3"],
    d: Float[np.ndarray, "*node 3 3"] | None = None,
    *,
    basis: AbstractBasis | None = None,
    source: str,
) -> TriadCalibration:
    """A triad from E + Γ (or E + Θ), the bias (SI) and D (rad/s per g), at the basis' nodes.

    **Arguments:** `kind` is "accel" or "gyro"; `source` the format's name. One set of values and
    no `basis` is a constant.
    """
    basis = Constant() if basis is None else basis
    values = [np.reshape(bias, (basis.size, 3)), np.reshape(matrix - np.eye(3), (basis.size, 9))]
    names = [f"{kind}.bias[{i}]" for i in range(3)]
    names += [f"{kind}.matrix[{i},{j}]" for i, j in _PAIRS]
    if d is not None:
        values.append(np.reshape(d, (basis.size, 9)))
        names += [f"{kind}.g_sensitivity[{i},{j}]" for i, j in _PAIRS]
    stacked = np.concatenate(values, axis=1)
    if not np.isfinite(stacked).all():
        raise ValueError(f"{source}: the {kind} numbers are not all finite.")
    unknowns = stacked.size
    curve = Curve(basis, interpolate(basis, jnp.asarray(stacked)))
    return TriadCalibration(curve, jnp.zeros((unknowns, unknowns)), tuple(names), source)


def calibration(
    accel: TriadCalibration | None,
    gyro: TriadCalibration | None,
    *,
    gravity: float = 9.80665,
    device: str = "",
    temperature_range: tuple[float, float] | None = None,
    notes: tuple[str, ...] = (),
) -> Calibration:
    """The calibration of an imported file, with a note that its uncertainties are unknown."""
    return Calibration(
        gravity=gravity,
        accel=accel,
        gyro=gyro,
        device=device,
        temperature_range=temperature_range,
        notes=(UNCERTAINTY_UNKNOWN, *notes),
    )


def numbers(values: object, shape: tuple[int, ...], where: str) -> Float[np.ndarray, "..."]:
    """A nested list from a file as an array of that shape. Raises `ValueError` naming the key."""
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError):
        raise ValueError(f"{where} must be {_words(shape)}; found {values!r:.60}.") from None
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{where} must be {_words(shape)}, all finite; found shape {array.shape}.")
    return array


def _words(shape: tuple[int, ...]) -> str:
    return "a number" if not shape else " × ".join(map(str, shape)) + " numbers"
