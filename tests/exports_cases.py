"""Made-up calibrations, samples and comparisons for the tests of exports."""

import json

import jax
import jax.numpy as jnp
import numpy as np

from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.physics.temperature import Constant, CubicSpline, Curve


GRAVITY = 9.815
LOW, HIGH = -40.0, 70.0
NOISE = {
    "kalibr": {
        "accelerometer_noise_density": 2e-3,
        "accelerometer_random_walk": 3e-5,
        "gyroscope_noise_density": 1e-4,
        "gyroscope_random_walk": 2e-6,
    },
    "basalt": {
        "accel_noise_std": 2e-3,
        "gyro_noise_std": 1e-4,
        "accel_bias_std": 3e-5,
        "gyro_bias_std": 2e-6,
    },
}
PAIRS = [(i, j) for i in range(3) for j in range(3)]


def triad(kind, basis, *, lower=False, diagonal=False, d=False, seed=0, bias=0.05):
    """Errors of a poor consumer device: percents of scale, tens of milliradians, large bias."""
    rng = np.random.default_rng(seed)
    pairs = [(i, j) for i, j in PAIRS if (i == j if diagonal else j <= i or not lower)]
    names = [f"{kind}.bias[{i}]" for i in range(3)]
    names += [f"{kind}.matrix[{i},{j}]" for i, j in pairs]
    size = [bias] * 3 + [0.02] * len(pairs)
    if d:
        names += [f"{kind}.g_sensitivity[{i},{j}]" for i, j in PAIRS]
        size += [1e-3] * 9
    decay = 1.0 if isinstance(basis, CubicSpline) else 4.0 ** np.arange(basis.size)[:, None]
    values = rng.standard_normal((basis.size, len(names))) * size / decay
    unknowns = values.size
    covariance = jnp.zeros((unknowns, unknowns))
    return TriadCalibration(Curve(basis, jnp.asarray(values)), covariance, tuple(names), "made up")


def calibration(basis=None, *, lower=False, diagonal=False, d=True, device="SN 7"):
    basis = Constant() if basis is None else basis
    return Calibration(
        gravity=GRAVITY,
        accel=triad("accel", basis, lower=lower, diagonal=diagonal, seed=1),
        gyro=triad("gyro", basis, d=d, diagonal=diagonal, seed=2),
        device=device,
        temperature_range=None if isinstance(basis, Constant) else (LOW, HIGH),
    )


def samples(count=200, seed=3):
    rng = np.random.default_rng(seed)
    accel = 10.0 * rng.standard_normal((count, 3))
    return accel, rng.standard_normal((count, 3)), rng.uniform(LOW, HIGH, count)


def ours(cal, accel, gyro, temperature):
    force, rate = jax.jit(jax.vmap(cal))(*map(jnp.asarray, (accel, gyro, temperature)))
    return np.asarray(force), np.asarray(rate)


def agree(found, expected, tolerance=2e-13):
    """To rounding: a few operations on numbers of about 30 m/s² and 3 rad/s."""
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * np.abs(b).max())


def at(cal, temperature):
    """The calibration's parameters frozen at one temperature."""

    def freeze(part):
        values = np.asarray(part.curve(temperature))[None]
        n = values.size
        return TriadCalibration(
            Curve(Constant(), jnp.asarray(values)), jnp.zeros((n, n)), part.names, "frozen"
        )

    return Calibration(gravity=cal.gravity, accel=freeze(cal.accel), gyro=freeze(cal.gyro))


def without_gyro_scale(cal):
    gyro = triad("gyro", cal.gyro.curve.basis, seed=2)
    keep = np.arange(len(gyro.names)) < 3
    n = gyro.curve.basis.size * 3
    curve = Curve(gyro.curve.basis, jnp.asarray(np.asarray(gyro.curve.coefficients)[:, keep]))
    reduced = TriadCalibration(curve, jnp.zeros((n, n)), gyro.names[:3], "bias only")
    return Calibration(
        gravity=cal.gravity,
        accel=cal.accel,
        gyro=reduced,
        temperature_range=cal.temperature_range,
    )


def constant_scale(cal):
    """Bias as before, matrix with its constant part only."""
    c = np.array(cal.accel.curve.coefficients)
    c[1:, 3:] = 0.0
    accel = TriadCalibration(
        Curve(cal.accel.curve.basis, jnp.asarray(c)), cal.accel.covariance, cal.accel.names, "x"
    )
    return Calibration(
        gravity=cal.gravity, accel=accel, gyro=cal.gyro, temperature_range=cal.temperature_range
    )


def azure_apply(content, kind, raw, temperature):
    name = {"accel": "Accelerometer", "gyro": "Gyro"}[kind]
    sensors = json.loads(content)["CalibrationInformation"]["InertialSensors"]
    (entry,) = [s for s in sensors if s["SensorType"] == f"CALIBRATION_InertialSensorType_{name}"]
    mixing, bias = entry["MixingMatrixTemperatureModel"], entry["BiasTemperatureModel"]
    result = []
    for x, t in zip(raw, temperature, strict=True):
        powers = np.array([1, t, t**2, t**3])
        m = np.array(
            [[np.dot(mixing[4 * (3 * i + j) :][:4], powers) for j in range(3)] for i in range(3)]
        )
        result.append(m @ x + [np.dot(bias[4 * i :][:4], powers) for i in range(3)])
    return np.array(result)
