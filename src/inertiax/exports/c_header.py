"""A C99 header with the compensation: static functions, no memory, no dependency beyond C.

`NAME_compensate(accel, gyro, temperature, force, rate)` is equation (3), exact: the parameters' Chebyshev
series by Clenshaw's recurrence (or their natural splines by pieces), then two 3 × 3 systems by Cramer's rule.
`NAME_compensate_mag(mag, temperature, current, field)` is the same of the magnetometers, where they are calibrated.
Temperatures are not clamped; `NAME_LOW` and `NAME_HIGH` are the calibrated range, to clamp them by.
"""

import re
from typing import Literal

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.triad import slot
from ..physics.temperature import AbstractBasis, Constant, CubicSpline, Polynomial
from ..storage.wrong_value import WrongValue
from .c_template import BODY, CHEBYSHEV, MAGNETOMETERS as MAGNETOMETER_BODY, SPLINE
from .export import Export, Settings as Common
from .parameters import temperature_span


NAME = "c"
MAGNETOMETERS = True  # are held
TITLE = "C99 header with the compensation, for firmware"
SUFFIX = ".h"
KEEPS = "the whole compensation of all three triads, in double or single precision"
LOSES = "uncertainties"

# Of a triad: bias 3, matrix 9 (by rows), then the gyros' g-sensitivity 9 or the field of a current 3.
_COUNTS = {"accel": 21, "gyro": 21, "mag": 15}
_REST = {"accel": "unused 9", "gyro": "g-sensitivity 9", "mag": "field of a current 3"}


class Settings(Common, frozen=True, kw_only=True):
    """`name` begins every C name; `dtype` is the precision of data and arithmetic."""

    name: str = "imu"
    dtype: Literal["float32", "float64"] = "float64"


def write(calibration: Calibration, settings: Settings) -> Export:
    """The header. Raises `WrongValue` for a name that is no C identifier."""
    name = settings.name
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,40}", name):
        raise WrongValue(f"c: name = {name!r} must be a C identifier of letters, digits and _.")
    real = "float" if settings.dtype == "float32" else "double"
    low, high = temperature_span(calibration)
    device = "".join(c for c in calibration.device if c.isalnum() or c in " .-_")
    mag = calibration.mag
    tables = [_curves(f"{name}_{kind}", part, real) for kind, part in _triads(calibration).items()]
    text = BODY.format(
        name=name,
        guard=f"{name.upper()}_CALIBRATION_H",
        upper=name.upper(),
        real=real,
        device=device or "not named",
        low=_literal(low, real),
        high=_literal(high, real),
        gravity=_literal(float(calibration.gravity), real),
        curves="\n".join(tables),
        magnetometers="" if mag is None else MAGNETOMETER_BODY.format(name=name, real=real),
    )
    dtype = np.dtype(settings.dtype)
    single = ("digits beyond single precision",) if real == "float" else ()
    return Export(
        files=(("", text.encode()),),
        applied=lambda *samples: _applied(calibration, dtype, *samples),
        applied_field=None if mag is None else lambda *s: _applied_field(mag.triad, dtype, *s),
        losses=single,
    )


def _literal(value: float, real: str) -> str:
    text = f"{value:.9g}" if real == "float" else repr(float(value))
    if not any(c in text for c in ".e"):
        text += ".0"
    return text + ("f" if real == "float" else "")


def _table(rows: Float[np.ndarray, "row column"], real: str) -> str:
    inner = ",\n".join("    {" + ", ".join(_literal(x, real) for x in row) + "}" for row in rows)
    return "{\n" + inner + "\n}"


def _triads(calibration: Calibration) -> dict[str, TriadCalibration | None]:
    """The triads that the header has curves of; magnetometers only where they are calibrated."""
    both = {"accel": calibration.accel, "gyro": calibration.gyro}
    return both if calibration.mag is None else both | {"mag": calibration.mag.triad}


def _rows(
    triad: TriadCalibration | None, size: int, kind: str
) -> Float[np.ndarray, "parameters size"]:
    """Coefficients of all parameters in the model's order; zero where not fitted."""
    rows = np.zeros((_COUNTS[kind], size))
    if triad is not None:
        for column, parameter in enumerate(triad.names):
            rows[slot(parameter)] = np.asarray(triad.curve.coefficients)[:, column]
    return rows


def _curves(prefix: str, triad: TriadCalibration | None, real: str) -> str:
    """C code that evaluates a triad's parameters at a temperature."""
    kind = prefix.rsplit("_", 1)[1]
    basis = Constant() if triad is None else triad.curve.basis
    rows = _rows(triad, basis.size, kind)
    if isinstance(basis, CubicSpline):
        return SPLINE.format(
            prefix=prefix,
            count=len(rows),
            rest=_REST[kind],
            real=real,
            pieces=len(basis.knots) + 1,
            edges=", ".join(_literal(k, real) for k in basis.knots),
            edge_count=len(basis.knots),
            table=_table(_pieces(np.asarray(basis.knots), rows).reshape(-1, 4), real),
        )
    low, high = (basis.low, basis.high) if isinstance(basis, Polynomial) else (-1.0, 1.0)
    return CHEBYSHEV.format(
        prefix=prefix,
        count=len(rows),
        rest=_REST[kind],
        real=real,
        terms=basis.size,
        middle=_literal(float(0.5 * (low + high)), real),
        half=_literal(float(0.5 * (high - low)), real),
        table=_table(rows, real),
    )


def _pieces(
    knots: Float[np.ndarray, " knot"], values: Float[np.ndarray, "parameters knot"]
) -> Float[np.ndarray, "piece parameters 4"]:
    """Powers of (T − piece's start) of each piece; the first and last are the straight continuations."""
    from scipy.interpolate import CubicSpline as Spline

    if len(knots) == 2:
        slope = (values[:, 1] - values[:, 0]) / (knots[1] - knots[0])
        zero = np.zeros(len(slope))
        inner = np.stack([values[:, 0], slope, zero, zero], axis=1)[None]
        last = np.stack([values[:, 1], slope, zero, zero], axis=1)
        return np.concatenate([inner, inner, last[None]])
    spline = Spline(knots, values, axis=1, bc_type="natural")
    inner = np.moveaxis(spline.c[::-1], (0, 1, 2), (2, 0, 1))  # [piece, parameter, power]
    ends = []
    for at in (knots[0], knots[-1]):
        value, slope = spline(at), spline(at, 1)
        ends.append(np.stack([value, slope, 0 * value, 0 * value], axis=1))
    return np.concatenate([ends[0][None], inner, ends[1][None]])


def _applied(
    calibration: Calibration,
    dtype: np.dtype,
    accel: np.ndarray,
    gyro: np.ndarray,
    temperature: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """The header's arithmetic in its precision, with NumPy."""
    p = _parameters(calibration.accel, "accel", dtype, temperature)
    q = _parameters(calibration.gyro, "gyro", dtype, temperature)
    specific = _solve(p, _rounded(accel, dtype) - p[:, :3], dtype)
    by_force = np.einsum("tij,tj->ti", q[:, 12:].reshape(-1, 3, 3), specific)
    by_force = by_force / float(calibration.gravity)
    return specific, _solve(q, _rounded(gyro, dtype) - q[:, :3] - by_force, dtype)


def _applied_field(
    triad: TriadCalibration,
    dtype: np.dtype,
    outputs: np.ndarray,
    temperature: np.ndarray,
    current: np.ndarray,
) -> np.ndarray:
    """The same of the magnetometers."""
    p = _parameters(triad, "mag", dtype, temperature)
    left = _rounded(outputs, dtype) - p[:, :3] - p[:, 12:] * _rounded(current, dtype)[:, None]
    return _solve(p, left, dtype)


def _rounded(values: np.ndarray, dtype: np.dtype) -> np.ndarray:
    return np.asarray(values, dtype).astype(float)


def _parameters(
    triad: TriadCalibration | None, kind: str, dtype: np.dtype, temperature: np.ndarray
) -> Float[np.ndarray, "sample parameters"]:
    basis = Constant() if triad is None else triad.curve.basis
    rows = _rounded(_rows(triad, basis.size, kind), dtype)
    return _evaluate(basis, rows, _rounded(temperature, dtype))


def _solve(
    parameters: Float[np.ndarray, "sample parameters"],
    left: Float[np.ndarray, "sample 3"],
    dtype: np.dtype,
) -> Float[np.ndarray, "sample 3"]:
    matrix = np.eye(3) + _rounded(parameters[:, 3:12], dtype).reshape(-1, 3, 3)
    return _rounded(np.linalg.solve(matrix, _rounded(left, dtype)[:, :, None])[:, :, 0], dtype)


def _evaluate(
    basis: AbstractBasis, rows: np.ndarray, temperature: np.ndarray
) -> Float[np.ndarray, "sample parameters"]:
    if isinstance(basis, Polynomial):
        x = (2 * temperature - basis.low - basis.high) / (basis.high - basis.low)
        return np.polynomial.chebyshev.chebval(x, rows.T).T
    if isinstance(basis, CubicSpline):
        knots = np.asarray(basis.knots)
        pieces = _pieces(knots, rows)
        which = np.searchsorted(knots, temperature, side="right")
        start = knots[np.maximum(which - 1, 0)]
        c, d = pieces[which], (temperature - start)[:, None]
        return c[..., 0] + d * (c[..., 1] + d * (c[..., 2] + d * c[..., 3]))
    return np.repeat(rows.T, len(temperature), axis=0)
