"""Azure Kinect's and Windows Mixed Reality's `InertialSensors`: cubic polynomials in °C for everything.

CALIBRATED = MIXING(T) RAW + BIAS(T): `MixingMatrixTemperatureModel` is 9 elements by rows times 4
coefficients, low order first, `BiasTemperatureModel` 3 times 4. The mixing matrix is the inverse of
E + Γ(T), and the bias −(E + Γ)⁻¹ a⁰; both are fitted by cubics over the calibrated range.

**Reference:** Azure Kinect Sensor SDK, `calibration.h` and its device calibration JSON.
"""

import json

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration, TriadCalibration
from ..physics.temperature import Constant, Polynomial
from .cubic import cubic, cubic_misfit, fit_cubic, nodes
from .export import Export, Settings as Common
from .imported import calibration as imported, numbers, triad
from .parameters import g_sensitivity_loss, parameters_over, temperature_span


NAME = "azure"
TITLE = "Azure Kinect / Windows Mixed Reality InertialSensors JSON"
SUFFIX = ".azure.json"
KEEPS = "bias, full matrices, each as a cubic in temperature"
LOSES = "degrees above 3, g-sensitivity, uncertainties"

_TYPES = {
    "accel": "CALIBRATION_InertialSensorType_Accelerometer",
    "gyro": "CALIBRATION_InertialSensorType_Gyro",
}
_IMPORT_DEGREE = 6  # of the inverse of a cubic matrix; its error is checked


class Settings(Common, frozen=True, kw_only=True):
    """`sensor_id` names the chip in the file."""

    sensor_id: str = "CALIBRATION_InertialSensorId_LSM6DSM"


def write(calibration: Calibration, settings: Settings) -> Export:
    """The sensors' entries of a device calibration, both triads."""
    low, high = temperature_span(calibration)
    fits = {kind: _fit(calibration, kind, low, high) for kind in _TYPES}
    entries = [
        {
            "BiasTemperatureModel": bias.T.reshape(-1).tolist(),
            "BiasUncertainty": [0.0, 0.0, 0.0],
            "Id": settings.sensor_id,
            "MixingMatrixTemperatureModel": mixing.T.reshape(-1).tolist(),
            "ModelTypeMask": 16,
            "Noise": [0.0] * 6,
            "Rt": {
                "Rotation": np.eye(3).reshape(-1).tolist(),
                "Translation": [0.0, 0.0, 0.0],
            },
            "SecondOrderScaling": [0.0] * 9,
            "SensorType": _TYPES[kind],
            "TemperatureBounds": [low, high],
            "TemperatureC": 0.5 * (low + high),
        }
        for kind, (mixing, bias) in fits.items()
    ]

    def applied(accel: np.ndarray, gyro: np.ndarray, temperature: np.ndarray):
        def one(x: np.ndarray, kind: str):
            mixing, bias = (cubic(c, temperature) for c in fits[kind])
            return np.einsum("tij,tj->ti", mixing.reshape(-1, 3, 3), x) + bias

        return one(accel, "accel"), one(gyro, "gyro")

    content = {"CalibrationInformation": {"InertialSensors": entries}}
    return Export(
        files=(("", json.dumps(content, indent=2).encode() + b"\n"),),
        applied=applied,
        losses=(*_degree_loss(calibration, low, high), *g_sensitivity_loss(calibration)),
        notes=(
            "noise and bias uncertainty are written as zero",
            "some readers (Monado, Basalt's converters) use the coefficients at 0 °C alone",
        ),
    )


def _fit(
    calibration: Calibration, kind: str, low: float, high: float
) -> tuple[Float[np.ndarray, "4 9"], Float[np.ndarray, "4 3"]]:
    """Coefficients in °C of the mixing matrix's elements and of the bias."""
    mixing, bias = _mixing_and_bias(calibration, kind, low, high)
    if high > low:
        return fit_cubic(mixing, low, high, 0.0), fit_cubic(bias, low, high, 0.0)
    return np.pad(mixing, ((0, 3), (0, 0))), np.pad(bias, ((0, 3), (0, 0)))


def _mixing_and_bias(
    calibration: Calibration, kind: str, low: float, high: float
) -> tuple[Float[np.ndarray, "node 9"], Float[np.ndarray, "node 3"]]:
    """The mixing matrix's elements and the bias at the cubics' nodes."""
    p = parameters_over(calibration, nodes(low, high))
    matrix, offset = (
        (p.accel_matrix, p.accel_bias) if kind == "accel" else (p.gyro_matrix, p.gyro_bias)
    )
    mixing = np.linalg.inv(matrix)
    bias = -np.einsum("tij,tj->ti", mixing, offset)
    return mixing.reshape(-1, 9), bias


def _degree_loss(calibration: Calibration, low: float, high: float) -> tuple[str, ...]:
    curves = (x for kind in _TYPES for x in _mixing_and_bias(calibration, kind, low, high))
    if not any(cubic_misfit(values) for values in curves):
        return ()
    return ("what a cubic in temperature cannot follow (the inverse matrix and degrees above 3)",)


def read(content: bytes) -> Calibration:
    """The calibration in a device's `InertialSensors` (the first of each type).

    The inverse of a cubic matrix is no cubic: it is interpolated by a polynomial of degree 6 over the
    temperature bounds. Raises `ValueError` where second-order scaling is not zero.
    """
    said = json.loads(content)
    said = said.get("CalibrationInformation", said).get("InertialSensors", [])
    found: dict[str, dict] = {}
    for kind, name in _TYPES.items():
        match = [e for e in said if e.get("SensorType") == name]
        if not match:
            raise ValueError(f"azure: no InertialSensors entry of SensorType {name}.")
        found[kind] = match[0]
    ranges = [
        numbers(e.get("TemperatureBounds"), (2,), "azure: TemperatureBounds")
        for e in found.values()
    ]
    low, high = max(r[0] for r in ranges), min(r[1] for r in ranges)
    triads = {kind: _read_one(kind, entry, low, high) for kind, entry in found.items()}
    return imported(
        triads["accel"],
        triads["gyro"],
        temperature_range=(float(low), float(high)) if high > low else None,
    )


def _read_one(kind: str, entry: dict, low: float, high: float) -> TriadCalibration:
    where = f"azure: {entry['SensorType']}"
    second = numbers(
        entry.get("SecondOrderScaling", [0.0] * 9), (9,), f"{where} SecondOrderScaling"
    )
    if np.any(second != 0):
        raise ValueError(f"{where} SecondOrderScaling is not zero, which our model does not have.")
    key = "MixingMatrixTemperatureModel"
    mixing = numbers(entry.get(key), (36,), f"{where} {key}").reshape(9, 4).T
    bias = numbers(entry.get("BiasTemperatureModel"), (12,), f"{where} BiasTemperatureModel")
    bias = bias.reshape(3, 4).T
    constant = not (np.any(mixing[1:]) or np.any(bias[1:])) or not high > low
    basis = Constant() if constant else Polynomial(_IMPORT_DEGREE, float(low), float(high))
    at = np.array([0.5 * (low + high)]) if constant else np.asarray(basis.nodes)
    matrix = np.linalg.inv(cubic(mixing, at).reshape(-1, 3, 3))
    return triad(
        kind,
        matrix,
        -np.einsum("tij,tj->ti", matrix, cubic(bias, at)),
        basis=basis,
        source=NAME,
    )
