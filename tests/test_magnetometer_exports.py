"""Flight controllers' parameters of magnetometers, applied by their own formulas, written anew here."""

import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibration.calibration import Calibration
from inertiax.calibration.magnetometers import MagnetometerCalibration
from inertiax.calibration.triad import TriadCalibration
from inertiax.exports.registry import export
from inertiax.physics.temperature import Constant, Curve, Polynomial
from magnetometer_cases import DRIFT, HARD, SOFT, WARM, WIRE


LOW, HIGH = WARM - 20.0, WARM + 20.0


def _calibration():
    names = (
        *(f"mag.bias[{i}]" for i in range(3)),
        *(f"mag.matrix[{i},{j}]" for i in range(3) for j in range(3)),
        *(f"mag.current[{i}]" for i in range(3)),
    )
    constant = np.concatenate([HARD, SOFT.ravel(), WIRE])
    linear = np.concatenate([20.0 * DRIFT, np.zeros(12)])
    curve = Curve(Polynomial(1, LOW, HIGH), np.stack([constant, linear]))
    triad = TriadCalibration(curve, np.zeros((30, 30)), names, "field")
    return Calibration(
        9.81, temperature_range=(LOW, HIGH), mag=MagnetometerCalibration(triad, 48e-6)
    )


def _samples():
    rng = np.random.default_rng(1)
    return 5e-5 * rng.normal(size=(20, 3)), rng.uniform(LOW, HIGH, 20), rng.uniform(0.0, 20.0, 20)


def _sizes(outputs, temperature, current):
    mag = _calibration().mag
    assert mag is not None
    found = [
        mag(jnp.asarray(m), t, i) for m, t, i in zip(outputs, temperature, current, strict=True)
    ]
    return np.linalg.norm(found, axis=1)


def _symmetric(diagonal, beside):
    (a, b, c), (d, e, f) = diagonal, beside
    return np.array([[a, d, e], [d, b, f], [e, f, c]])


def test_px4_gives_the_magnitude():
    text = export(_calibration(), "px4", mag_id=7).content.decode()
    said = {f[2]: float(f[3]) for f in (line.split("\t") for line in text.splitlines())}
    axes = lambda key: np.array([said[f"CAL_MAG0_{a}{key}"] for a in "XYZ"])
    assert (said["TC_M_ENABLE"], said["TC_M0_ID"], said["CAL_MAG0_ID"]) == (1.0, 7.0, 7.0)
    outputs, temperature, current = _samples()
    difference = np.clip(temperature, said["TC_M0_TMIN"], said["TC_M0_TMAX"]) - said["TC_M0_TREF"]
    thermal = sum(
        np.array([said[f"TC_M0_X{k}_{i}"] for i in range(3)]) * difference[:, None] ** k
        for k in range(4)
    )
    gauss = 1e4 * outputs - thermal + axes("COMP") * current[:, None] / 1e3 - axes("OFF")
    field = gauss @ _symmetric(axes("SCALE"), axes("ODIAG")).T
    # Nine digits in the file.
    assert np.allclose(np.linalg.norm(field, axis=1), 1e4 * _sizes(*_samples()), rtol=1e-7)


def test_ardupilot_gives_the_magnitude_at_its_temperature():
    text = export(_calibration(), "ardupilot").content.decode()
    said = {name: float(value) for name, value in (line.split() for line in text.splitlines())}
    axes = lambda key: np.array([said[f"COMPASS_{key}_{a}"] for a in "XYZ"])
    outputs, _, current = _samples()
    there = np.full(20, np.clip(35.0, said["INS_TCAL1_TMIN"], said["INS_TCAL1_TMAX"]))
    milli = 1e7 * outputs + axes("OFS") + axes("MOT") * current[:, None]
    field = milli @ _symmetric(axes("DIA"), axes("ODI")).T
    assert said["COMPASS_MOTCT"] == 2.0
    assert np.allclose(
        np.linalg.norm(field, axis=1), 1e7 * _sizes(outputs, there, current), rtol=1e-7
    )


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_without_magnetometers_nothing_is_said_of_them(name):
    text = export(Calibration(9.81), name).content.decode()
    assert "MAG" not in text and "COMPASS" not in text and "TC_M" not in text


def test_a_format_without_a_place_for_them_says_so():
    with pytest.raises(
        ValueError, match="imu_tk: has no place for magnetometers, .* px4, ardupilot, inertiax"
    ):
        export(_calibration(), "imu_tk")
    names = tuple(f"accel.bias[{i}]" for i in range(3))
    accel = TriadCalibration(Curve(Constant(), np.zeros((1, 3))), np.zeros((3, 3)), names, "static")
    both = Calibration(9.81, accel=accel, mag=_calibration().mag, temperature_range=(LOW, HIGH))
    assert any("magnetometers" in loss for loss in export(both, "azure").losses)
