"""`truth.json`: the true parameters of simulated devices, written and read."""

import json
from pathlib import Path

import jax.numpy as jnp

from ..physics.temperature import Curve, Polynomial
from .triad import (
    ACCEL_PARAMETERS,
    AccelerometerTriad,
    Device,
    GYRO_PARAMETERS,
    GyroTriad,
    RIPPLE_PERIOD,
    TrueCurve,
)


SCHEMA = "inertiax.truth/1"

_FORMULA = (
    "p(T) = sum_k coefficients[k] T_k(x) + ripple sin(2 pi T / period + phase), "
    "x = (2 T - low - high) / (high - low), T in degC; output = (E + matrix) input + bias"
)
_UNITS = {
    "accel": {"bias": "m/s^2", "matrix": "1"},
    "gyro": {"bias": "rad/s", "matrix": "1", "g_sensitivity": "rad/s per g"},
}
_NAMES = {"accel": ACCEL_PARAMETERS, "gyro": GYRO_PARAMETERS}


def truth_to_json(devices: dict[str, Device], scenario: dict[str, object], gravity: float) -> str:
    """The text of `truth.json` for devices by serial number, with the scenario they come from.

    `gravity` (m/s²) is what makes the specific force dimensionless in the g-sensitivity term.
    """
    content = {
        "schema": SCHEMA,
        "formula": _FORMULA,
        "gravity": gravity,
        "scenario": scenario,
        "devices": {serial: _device_to_json(device) for serial, device in devices.items()},
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _device_to_json(device: Device) -> dict[str, object]:
    content: dict[str, object] = {"lag": {"value": float(device.lag), "unit": "s"}}
    for name, triad in (("accel", device.accel), ("gyro", device.gyro)):
        if triad is not None:
            content[name] = _curve_to_json(name, triad.curve)
    return content


def _curve_to_json(triad: str, curve: TrueCurve) -> dict[str, object]:
    basis = curve.series.basis
    if not isinstance(basis, Polynomial):
        raise ValueError(
            f"`truth_to_json(...)`: the {triad} curve's basis is {type(basis).__name__}; only "
            "`Polynomial` can be written."
        )
    names = _NAMES[triad]
    return {
        "basis": {
            "kind": "chebyshev",
            "degree": basis.degree,
            "low": basis.low,
            "high": basis.high,
            "unit": "degC",
        },
        "parameters": list(names),
        "units": [_UNITS[triad][name.partition("[")[0]] for name in names],
        "coefficients": jnp.asarray(curve.series.coefficients).tolist(),
        "ripple": {
            "period": RIPPLE_PERIOD,
            "amplitude": jnp.asarray(curve.ripple).tolist(),
            "phase": jnp.asarray(curve.phase).tolist(),
        },
    }


def read_truth(path: Path | str) -> dict[str, Device]:
    """The devices of a `truth.json` by serial number. Raises `ValueError` where it is none."""
    try:
        content = json.loads(Path(path).read_text("utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"{path}: not a truth.json: {error}.") from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != SCHEMA:
        raise ValueError(f"{path}: schema is {repr(schema)[:60]}; '{SCHEMA}' is needed.")
    try:
        return {serial: _device(found) for serial, found in content["devices"].items()}
    except KeyError as error:
        raise ValueError(f"{path}: key {error} is missing; write the file anew.") from None
    # What converting runs into where a value is of another kind or size.
    except (TypeError, AttributeError, ValueError, IndexError, ArithmeticError) as error:
        reason = " ".join(f"{type(error).__name__} {error}".split())[:200]
        raise ValueError(f"{path}: not a truth.json: {reason}.") from None


def _device(found: dict) -> Device:
    accel, gyro = found.get("accel"), found.get("gyro")
    return Device(
        accel=None if accel is None else AccelerometerTriad(_curve(accel)),
        gyro=None if gyro is None else GyroTriad(_curve(gyro)),
        lag=found["lag"]["value"],
    )


def _curve(found: dict) -> TrueCurve:
    basis = found["basis"]
    series = Curve(
        Polynomial(basis["degree"], basis["low"], basis["high"]), jnp.asarray(found["coefficients"])
    )
    ripple = found["ripple"]
    return TrueCurve(series, jnp.asarray(ripple["amplitude"]), jnp.asarray(ripple["phase"]))
