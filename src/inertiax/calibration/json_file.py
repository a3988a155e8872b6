"""The JSON form of a calibration: `calibration.json`, written whole or not at all."""

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from .._jax import eqx, jax
from ..data.json_documents import decode, encode
from ..effects import CATALOGUE, Effect
from ..model_selection.model_spec import ModelEntry, to_model_entry
from ..physics.leaves import is_traced
from ..physics.temperature import AbstractBasis, Constant, CubicSpline, Curve, Polynomial
from ..storage.whole_files import write_atomically
from .barometer import BarometerCalibration
from .fitted_effects import EffectEntry, from_entry, to_entry
from .magnetometers import MagnetometerCalibration
from .pytree import Calibration
from .triad import is_parameter, refuse_stacked, TriadCalibration, twice, unit_of


SCHEMA = "inertiax.calibration/1"


class _Basis(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """Functions of temperature, under `basis`."""

    kind: str  # constant | chebyshev | natural-cubic-spline
    degree: int | None = None  # of the polynomials
    low: float | None = None  # °C, at −1 of the polynomials
    high: float | None = None  # °C, at +1
    knots: list[float] | None = None  # °C, of a spline


class _Triad(msgspec.Struct, forbid_unknown_fields=True):
    """One triad, under `gyro`; the others hold the same and more."""

    estimator: str  # a name of `[model]`
    names: list[str]  # of the parameters
    units: list[str]  # SI, of each
    basis: _Basis  # functions of temperature
    # A row for each function of the basis, a column for each parameter
    coefficients: list[list[float]]
    covariance: list[list[float]]  # of the coefficients row by row, SI


class _Accelerometers(_Triad):
    """The accelerometers, under `accel`."""

    # m/s², where one pose had no reference: the outputs that the biases count from
    mean_output: tuple[float, float, float] | msgspec.UnsetType = msgspec.UNSET


class _Magnetometers(_Triad):
    """The magnetometers, under `mag`: parameters as of any triad, and the field that they rest on."""

    field: float  # in `field_unit`, magnitude at the test place
    field_unit: str  # T
    field_given: bool  # False: the scale is by convention
    frame: Literal["accel", "own"]  # in which the compensated field is
    dip: float | None = None  # rad, of the field below the horizontal; None: no vertical was known
    dip_std: float | None = None  # rad


class _Barometer(msgspec.Struct, forbid_unknown_fields=True):
    """The barometer over temperature, under `baro`: zero at the reference temperature."""

    basis: _Basis  # functions of temperature
    coefficients: list[float]  # of each, in `unit`
    covariance: list[list[float]]  # of the coefficients, Pa²
    unit: str  # Pa
    reference_temperature: float  # degC


class _File(msgspec.Struct, forbid_unknown_fields=True):
    """A device's calibration; a key that is not here is refused."""

    schema: str  # inertiax.calibration/1
    version: str  # of inertiax
    device: str  # serial number
    gravity: float  # in `gravity_unit`
    gravity_unit: str  # m/s^2
    temperature_range: tuple[float, float] | None  # that the data covered
    temperature_unit: str  # degC
    accel: _Accelerometers | None  # None: not calibrated
    gyro: _Triad | None  # None: not calibrated
    notes: list[str] = []  # what a user should know
    model: ModelEntry | msgspec.UnsetType = msgspec.UNSET  # as it was fitted
    effects: list[EffectEntry] | msgspec.UnsetType = msgspec.UNSET  # named by a diagnosis
    # Of the accelerometers' coefficients (rows) with the gyros', where both were estimated together.
    cross_covariance: list[list[float]] | msgspec.UnsetType = msgspec.UNSET
    mag: _Magnetometers | msgspec.UnsetType = msgspec.UNSET  # absent: not calibrated
    baro: _Barometer | msgspec.UnsetType = msgspec.UNSET  # absent: not calibrated


def _basis_to_json(basis: AbstractBasis) -> _Basis:
    if isinstance(basis, Polynomial):
        return _Basis(
            "chebyshev", degree=basis.degree, low=float(basis.low), high=float(basis.high)
        )
    if isinstance(basis, CubicSpline):
        return _Basis("natural-cubic-spline", knots=np.asarray(basis.knots, float).tolist())
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
        units=[unit_of(n) for n in triad.names],
        basis=_basis_to_json(triad.curve.basis),
        coefficients=np.asarray(triad.curve.coefficients).tolist(),
        covariance=np.asarray(triad.covariance).tolist(),
    )


def _accel_to_json(accel: TriadCalibration) -> _Accelerometers:
    mean = accel.mean_output
    return _Accelerometers(
        **msgspec.structs.asdict(_triad_to_json(accel)),
        mean_output=msgspec.UNSET if mean is None else tuple(np.asarray(mean, float).tolist()),
    )


def _accel_from_json(accel: _Accelerometers, where: str) -> TriadCalibration:
    found, mean = _triad_from_json(accel, where), accel.mean_output
    if isinstance(mean, msgspec.UnsetType):
        return found
    return TriadCalibration(
        found.curve, found.covariance, found.names, found.estimator, np.array(mean)
    )


def _mag_to_json(mag: MagnetometerCalibration) -> _Magnetometers:
    known = bool(np.isfinite(float(mag.dip)))
    return _Magnetometers(
        **msgspec.structs.asdict(_triad_to_json(mag.triad)),
        field=float(mag.field),
        field_unit="T",
        field_given=mag.field_given,
        frame="accel" if mag.frame == "accel" else "own",
        dip=float(mag.dip) if known else None,
        dip_std=float(mag.dip_sigma) if known else None,
    )


def _mag_from_json(mag: _Magnetometers, where: str) -> MagnetometerCalibration:
    if mag.field_unit != "T":
        raise ValueError(f"{where}: field_unit is {mag.field_unit!r}; it must be 'T'.")
    if not mag.field > 0.0:
        raise ValueError(f"{where}: field is {mag.field:g}; it must be above 0 T.")
    unknown = float("nan")
    return MagnetometerCalibration(
        _triad_from_json(mag, where),
        mag.field,
        unknown if mag.dip is None else mag.dip,
        unknown if mag.dip_std is None else mag.dip_std,
        mag.field_given,
        mag.frame,
    )


def _baro_to_json(baro: BarometerCalibration) -> _Barometer:
    return _Barometer(
        basis=_basis_to_json(baro.curve.basis),
        coefficients=np.asarray(baro.curve.coefficients, float)[:, 0].tolist(),
        covariance=np.asarray(baro.covariance).tolist(),
        unit="Pa",
        reference_temperature=float(baro.reference),
    )


def _baro_from_json(baro: _Barometer, where: str) -> BarometerCalibration:
    if baro.unit != "Pa":
        raise ValueError(f"{where}: unit is {baro.unit!r}; it must be 'Pa'.")
    basis = _basis_from_json(baro.basis, where)
    coefficients = _matrix(
        [[c] for c in baro.coefficients], (basis.size, 1), f"{where}.coefficients"
    )
    spread = _matrix(baro.covariance, (basis.size, basis.size), f"{where}.covariance")
    return BarometerCalibration(Curve(basis, coefficients), spread, baro.reference_temperature)


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
        if not is_parameter(name) or not name.startswith(where.rsplit(" ", 1)[-1] + "."):
            raise ValueError(f"{where}: {name!r} is not the name of one of its parameters.")
    again = twice(triad.names)
    if again is not None:
        raise ValueError(
            f"{where}: {again!r} stands twice among its names; each parameter has one."
        )
    expected = [unit_of(n) for n in triad.names]
    if triad.units != expected:
        raise ValueError(f"{where}: units are {triad.units} but must be {expected}.")
    return TriadCalibration(
        Curve(basis, coefficients),
        covariance,
        tuple(triad.names),
        triad.estimator,
    )


def _cross(
    content: _File, accel: TriadCalibration | None, gyro: TriadCalibration | None, where: str
) -> np.ndarray | None:
    if content.cross_covariance is msgspec.UNSET:
        return None
    if accel is None or gyro is None:
        raise ValueError(f"{where}: is of two triads, but the file has one.")
    return _matrix(content.cross_covariance, (len(accel.covariance), len(gyro.covariance)), where)


def _matrix(rows: list[list[float]], shape: tuple[int, int], where: str) -> np.ndarray:
    if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
        raise ValueError(f"{where} must have {shape[0]} rows of {shape[1]} numbers.")
    return np.asarray(rows, float).reshape(shape)


def write_calibration(calibration: Calibration, path: str | Path) -> None:
    """Write `calibration.json`, beside its place and then renamed, so that it is never half there.

    Raises `ValueError` where a number is not finite: a calibration that failed is not written; for stacked devices, and
    for anything but a calibration.
    """
    if not isinstance(calibration, Calibration):
        raise ValueError(
            "`write_calibration(calibration, path)`: the calibration comes first; it is a "
            f"{type(calibration).__name__}."
        )
    if any(is_traced(x) for x in jax.tree.leaves(calibration)):
        raise ValueError(
            "`write_calibration(calibration, path)`: its numbers are not known in traced code; write what came out."
        )
    refuse_stacked(calibration.triads, "write_calibration(calibration, path)")
    # The dip of the field is not a number where no vertical was known.
    judged = calibration.changed(mag=None if calibration.mag is None else calibration.mag.triad)
    arrays = [x for x in jax.tree.leaves(judged) if eqx.is_array(x)]
    if not all(np.isfinite(np.asarray(x)).all() for x in arrays):
        raise ValueError(
            f"calibration of device {calibration.device!r} has numbers that are not finite, so "
            f"{path} was not written; the estimation did not succeed."
        )
    cross = calibration.cross_covariance
    content = _File(
        schema=SCHEMA,
        version=version("inertiax"),
        device=calibration.device,
        gravity=float(calibration.gravity),
        gravity_unit="m/s^2",
        temperature_range=_range(calibration),
        temperature_unit="degC",
        accel=None if calibration.accel is None else _accel_to_json(calibration.accel),
        gyro=None if calibration.gyro is None else _triad_to_json(calibration.gyro),
        notes=list(calibration.notes),
        model=msgspec.UNSET if calibration.model is None else to_model_entry(calibration.model),
        effects=[to_entry(e) for e in calibration.effects] or msgspec.UNSET,
        cross_covariance=msgspec.UNSET if cross is None else np.asarray(cross).tolist(),
        mag=msgspec.UNSET if calibration.mag is None else _mag_to_json(calibration.mag),
        baro=msgspec.UNSET if calibration.baro is None else _baro_to_json(calibration.baro),
    )
    write_atomically(Path(path), encode(content, str(path), indent=1))


def _range(calibration: Calibration) -> tuple[float, float] | None:
    if calibration.temperature_range is None:
        return None
    low, high = calibration.temperature_range
    return float(low), float(high)


def read_calibration(path: str | Path, *, effects: Sequence[Effect] = CATALOGUE) -> Calibration:
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
    accel = None if content.accel is None else _accel_from_json(content.accel, f"{path}: accel")
    gyro = None if content.gyro is None else _triad_from_json(content.gyro, f"{path}: gyro")
    return Calibration(
        gravity=content.gravity,
        accel=accel,
        gyro=gyro,
        cross_covariance=_cross(content, accel, gyro, f"{path}: cross_covariance"),
        device=content.device,
        temperature_range=content.temperature_range,
        notes=tuple(content.notes),
        model=content.model.spec() if isinstance(content.model, ModelEntry) else None,
        effects=tuple(from_entry(e, str(path), effects) for e in content.effects or ()),
        mag=None
        if isinstance(content.mag, msgspec.UnsetType)
        else _mag_from_json(content.mag, f"{path}: mag"),
        baro=None
        if isinstance(content.baro, msgspec.UnsetType)
        else _baro_from_json(content.baro, f"{path}: baro"),
    )
