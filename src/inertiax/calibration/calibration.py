"""The result: one pytree, callable on raw outputs, and its JSON form.

A `Calibration` goes anywhere a pytree goes: `jax.jit(calibration)`, `jax.vmap(calibration)` over
samples, `jax.jacfwd` with respect to its coefficients, inside `scan` in a navigation loop.
"""

import re
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Array, Bool, Float

from .._typing import AnyArray, Scalar, Vec3
from ..data.json_documents import decode, encode
from ..effects import CATALOGUE, Effect
from ..physics.error_model import AccelerometerErrors, compensate_accel, compensate_gyro, GyroErrors
from ..physics.temperature import AbstractBasis, Constant, CubicSpline, Curve, Polynomial
from ..storage.whole_files import write_atomically
from .fitted_effects import EffectEntry, FittedEffect, from_entry, to_entry


SCHEMA = "inertiax.calibration/1"

_SLOT = re.compile(
    r"(accel|gyro)\.(?:(bias)\[([0-2])\]|(matrix)\[([0-2]),([0-2])\])"
    r"|(gyro)\.(g_sensitivity)\[([0-2]),([0-2])\]"
)


def _slot(name: str) -> int:
    """Place of a named parameter in (bias 3, matrix 9, g-sensitivity 9)."""
    match = _SLOT.fullmatch(name)
    if match is None:
        raise ValueError(
            f"parameter name {name!r} is not one of accel|gyro . bias[i], matrix[i,j], "
            f"g_sensitivity[i,j] with i, j = 0, 1, 2."
        )
    kind, *index = [part for part in match.groups() if part is not None][1:]
    row, column = int(index[0]), int(index[-1])
    return {"bias": row, "matrix": 3 + 3 * row + column, "g_sensitivity": 12 + 3 * row + column}[
        kind
    ]


class TriadCalibration(eqx.Module):
    """One triad's error parameters as curves over temperature, with their covariance."""

    curve: Curve
    covariance: Float[
        AnyArray, "unknowns unknowns"
    ]  # of coefficients, row-major (size, parameters)
    names: tuple[str, ...] = eqx.field(static=True)  # of the curve's columns
    estimator: str = eqx.field(static=True)  # how it was estimated: invariant, reference, ...

    def __check_init__(self):
        for name in self.names:
            _slot(name)

    def parameters(self, temperature: Scalar | float) -> Float[Array, "21"]:
        """Bias (3), matrix (9) and g-sensitivity (9) at one temperature, °C; zero where not fitted."""
        values = self.curve(temperature)
        slots = jnp.array([_slot(n) for n in self.names])
        return jnp.zeros(21, values.dtype).at[slots].set(values)

    def standard_deviations(self, temperature: Scalar | float) -> Float[Array, " parameters"]:
        """1-sigma of the named parameters at one temperature: √diag(φ C φᵀ)."""
        phi = self.curve.basis(temperature)
        count = len(self.names)
        blocks = jnp.asarray(self.covariance).reshape(phi.size, count, phi.size, count)
        return jnp.sqrt(jnp.einsum("a,aibi,b->i", phi, blocks, phi))

    def over(
        self, temperatures: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n parameters"], Float[np.ndarray, "n parameters"]]:
        """The named parameters and their 1-sigma at many temperatures (°C), computed on the host."""
        phi = np.asarray(_basis_values(self.curve.basis, temperatures))
        size, count = phi.shape[1], len(self.names)
        blocks = np.asarray(self.covariance).reshape(size, count, size, count)
        variances = np.einsum("ta,aibi,tb->ti", phi, blocks, phi)
        return phi @ np.asarray(self.curve.coefficients), np.sqrt(variances)


@eqx.filter_jit
def _basis_values(
    basis: AbstractBasis, temperatures: Float[AnyArray, " n"]
) -> Float[Array, "n size"]:
    return jax.vmap(basis)(jnp.asarray(temperatures))


class Calibration(eqx.Module):
    """A device's calibration; calling it compensates one sample.

    `temperature_range` are the temperatures (°C) that the data covered; see `extrapolates`. `effects`
    are named effects beside the parameters; most depend on what went before, so a single sample's call
    leaves them out and `diagnose.augmented` applies them to a recording.
    """

    gravity: Scalar = eqx.field(converter=jnp.asarray)  # m/s²
    accel: TriadCalibration | None = None
    gyro: TriadCalibration | None = None
    device: str = eqx.field(static=True, default="")
    temperature_range: tuple[float, float] | None = eqx.field(static=True, default=None)
    notes: tuple[str, ...] = eqx.field(static=True, default=())
    effects: tuple[FittedEffect, ...] = ()

    def accel_errors(self, temperature: Scalar | float) -> AccelerometerErrors:
        """Accelerometer parameters at one temperature, °C; an ideal triad where not calibrated."""
        if self.accel is None:
            return AccelerometerErrors.zero()
        p = self.accel.parameters(temperature)
        return AccelerometerErrors(p[:3], p[3:12].reshape(3, 3))

    def gyro_errors(self, temperature: Scalar | float) -> GyroErrors:
        """Gyro parameters at one temperature, °C; an ideal triad where not calibrated."""
        if self.gyro is None:
            return GyroErrors.zero()
        p = self.gyro.parameters(temperature)
        return GyroErrors(p[:3], p[3:12].reshape(3, 3), p[12:].reshape(3, 3))

    def __call__(
        self, accel: Vec3, gyro: Vec3, temperature: Scalar | float
    ) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Equation (3), exact: specific force (m/s²) and rate (rad/s) of one sample of raw outputs.

        `vmap` it over samples. For a device with one triad pass zeros for the other.
        """
        force = compensate_accel(self.accel_errors(temperature), accel)
        rate = compensate_gyro(self.gyro_errors(temperature), gyro, force, self.gravity)
        return force, rate

    def extrapolates(self, temperature: Scalar | float) -> Bool[Array, ""]:
        """Whether a temperature (°C) is outside what the calibration data covered."""
        if self.temperature_range is None:
            return jnp.asarray(False)
        low, high = self.temperature_range
        t = jnp.asarray(temperature)
        return (t < low) | (t > high)


# The JSON form -----------------------------------------------------------------------------------


class _Basis(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    kind: str  # constant | chebyshev | natural-cubic-spline
    degree: int | None = None
    low: float | None = None
    high: float | None = None
    knots: list[float] | None = None


class _Triad(msgspec.Struct, forbid_unknown_fields=True):
    estimator: str
    names: list[str]
    units: list[str]
    basis: _Basis
    coefficients: list[list[float]]
    covariance: list[list[float]]


class _File(msgspec.Struct, forbid_unknown_fields=True):
    schema: str
    version: str
    device: str
    gravity: float
    gravity_unit: str
    temperature_range: tuple[float, float] | None
    temperature_unit: str
    accel: _Triad | None
    gyro: _Triad | None
    notes: list[str] = []
    effects: list[EffectEntry] | msgspec.UnsetType = msgspec.UNSET


def _unit(name: str) -> str:
    if ".matrix" in name:
        return "1"
    if name.startswith("accel"):
        return "m/s^2"
    return "rad/s/g" if "g_sensitivity" in name else "rad/s"


def _basis_to_json(basis: AbstractBasis) -> _Basis:
    if isinstance(basis, Polynomial):
        return _Basis("chebyshev", degree=basis.degree, low=basis.low, high=basis.high)
    if isinstance(basis, CubicSpline):
        return _Basis("natural-cubic-spline", knots=list(basis.knots))
    return _Basis("constant")


def _basis_from_json(basis: _Basis, where: str) -> AbstractBasis:
    if basis.kind == "constant":
        return Constant()
    if basis.kind == "chebyshev":
        if basis.degree is None or basis.low is None or basis.high is None:
            raise ValueError(f"{where}: a 'chebyshev' basis needs 'degree', 'low' and 'high'.")
        return Polynomial(basis.degree, basis.low, basis.high)
    if basis.kind == "natural-cubic-spline":
        if basis.knots is None:
            raise ValueError(f"{where}: a 'natural-cubic-spline' basis needs 'knots'.")
        return CubicSpline(tuple(basis.knots))
    raise ValueError(
        f"{where}: basis kind {basis.kind!r} is not known; it is one of 'constant', 'chebyshev', "
        f"'natural-cubic-spline'."
    )


def _triad_to_json(triad: TriadCalibration) -> _Triad:
    return _Triad(
        estimator=triad.estimator,
        names=list(triad.names),
        units=[_unit(n) for n in triad.names],
        basis=_basis_to_json(triad.curve.basis),
        coefficients=np.asarray(triad.curve.coefficients).tolist(),
        covariance=np.asarray(triad.covariance).tolist(),
    )


def _triad_from_json(triad: _Triad, where: str) -> TriadCalibration:
    try:
        basis = _basis_from_json(triad.basis, where)
    except ValueError as error:
        said = str(error)
        raise ValueError(said if said.startswith(where) else f"{where}: basis: {said}") from None
    count = len(triad.names)
    coefficients = _matrix(triad.coefficients, (basis.size, count), f"{where}.coefficients")
    unknowns = basis.size * count
    covariance = _matrix(triad.covariance, (unknowns, unknowns), f"{where}.covariance")
    for name in triad.names:
        if _SLOT.fullmatch(name) is None or not name.startswith(where.rsplit(" ", 1)[-1] + "."):
            raise ValueError(f"{where}: {name!r} is not the name of one of its parameters.")
    expected = [_unit(n) for n in triad.names]
    if triad.units != expected:
        raise ValueError(f"{where}: units are {triad.units} but must be {expected}.")
    return TriadCalibration(
        Curve(basis, jnp.asarray(coefficients)),
        jnp.asarray(covariance),
        tuple(triad.names),
        triad.estimator,
    )


def _matrix(rows: list[list[float]], shape: tuple[int, int], where: str) -> np.ndarray:
    if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
        raise ValueError(f"{where} must have {shape[0]} rows of {shape[1]} numbers.")
    return np.asarray(rows, float).reshape(shape)


def write_calibration(calibration: Calibration, path: Path) -> None:
    """Write `calibration.json`, beside its place and then renamed, so that it is never half there.

    Raises `ValueError` where a number is not finite: a calibration that failed is not written.
    """
    arrays = [x for x in jax.tree.leaves(calibration) if eqx.is_array(x)]
    if not all(np.isfinite(np.asarray(x)).all() for x in arrays):
        raise ValueError(
            f"calibration of device {calibration.device!r} has numbers that are not finite, so "
            f"{path} was not written; the estimation did not succeed."
        )
    content = _File(
        schema=SCHEMA,
        version=version("inertiax"),
        device=calibration.device,
        gravity=float(calibration.gravity),
        gravity_unit="m/s^2",
        temperature_range=calibration.temperature_range,
        temperature_unit="degC",
        accel=None if calibration.accel is None else _triad_to_json(calibration.accel),
        gyro=None if calibration.gyro is None else _triad_to_json(calibration.gyro),
        notes=list(calibration.notes),
        effects=[to_entry(e) for e in calibration.effects] or msgspec.UNSET,
    )
    write_atomically(path, encode(content, str(path), indent=1))


def read_calibration(path: Path, *, effects: Sequence[Effect] = CATALOGUE) -> Calibration:
    """Read `calibration.json`. Raises `ValueError`, one line naming file and key, for anything that
    is not exactly this schema, or for a named effect that the catalogue `effects` lacks."""
    path = Path(path)
    try:
        stored = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror}).") from error
    content = decode(stored, _File, str(path), "a calibration", SCHEMA)
    if not content.gravity > 0.0:
        raise ValueError(f"{path}: gravity is {content.gravity:g}; it must be above 0 m/s².")
    if content.temperature_range is not None:
        low, high = content.temperature_range
        if low > high:
            raise ValueError(
                f"{path}: temperature_range is {low:g} to {high:g} °C; write the lower one first."
            )
    for key, found, right in (
        ("gravity_unit", content.gravity_unit, "m/s^2"),
        ("temperature_unit", content.temperature_unit, "degC"),
    ):
        if found != right:
            raise ValueError(f"{path}: {key} is {found!r}; it must be {right!r}.")
    return Calibration(
        gravity=content.gravity,
        accel=None if content.accel is None else _triad_from_json(content.accel, f"{path}: accel"),
        gyro=None if content.gyro is None else _triad_from_json(content.gyro, f"{path}: gyro"),
        device=content.device,
        temperature_range=content.temperature_range,
        notes=tuple(content.notes),
        effects=tuple(from_entry(e, str(path), effects) for e in content.effects or ()),
    )
