"""Flight controllers' parameters of magnetometers, applied by their own formulas, written anew here."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibration.calibration import Calibration
from inertiax.calibration.magnetometers import MagnetometerCalibration
from inertiax.calibration.triad import TriadCalibration
from inertiax.exports.loss import measure_loss
from inertiax.exports.registry import by_name, export
from inertiax.physics.temperature import Constant, Curve, Polynomial
from magnetometer_cases import DRIFT, HARD, SOFT, WARM, WIRE


LOW, HIGH = WARM - 20.0, WARM + 20.0


NAMES = (
    *(f"mag.bias[{i}]" for i in range(3)),
    *(f"mag.matrix[{i},{j}]" for i in range(3) for j in range(3)),
    *(f"mag.current[{i}]" for i in range(3)),
)


def _calibration():
    constant = np.concatenate([HARD, SOFT.ravel(), WIRE])
    linear = np.concatenate([20.0 * DRIFT, np.zeros(12)])
    curve = Curve(Polynomial(1, LOW, HIGH), np.stack([constant, linear]))
    triad = TriadCalibration(curve, np.zeros((30, 30)), NAMES, "field")
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


def _constant(soft=SOFT, span=(LOW, HIGH), frame="own"):
    """The magnetometers of one temperature in a calibration that covers a wide range."""
    curve = Curve(Constant(), np.concatenate([HARD, soft.ravel(), WIRE])[None])
    triad = TriadCalibration(curve, np.zeros((15, 15)), NAMES, "field")
    mag = MagnetometerCalibration(triad, 48e-6, frame=frame)
    return Calibration(9.81, temperature_range=span, mag=mag)


def _accel():
    names = tuple(f"accel.bias[{i}]" for i in range(3))
    return TriadCalibration(Curve(Constant(), np.zeros((1, 3))), np.zeros((3, 3)), names, "static")


def _px4(calibration):
    text = export(calibration, "px4", mag_id=7).content.decode()
    said = {f[2]: float(f[3]) for f in (line.split("\t") for line in text.splitlines())}
    return said, lambda key: np.array([said[f"CAL_MAG0_{a}{key}"] for a in "XYZ"])


def test_px4_gives_the_magnitude():
    said, axes = _px4(_calibration())
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

    # Firmware without TC_M* has the hard iron in the middle of the range.
    np.testing.assert_allclose(axes("OFF"), 1e4 * HARD, rtol=1e-7)


def test_px4_has_static_offsets_of_magnetometers_that_do_not_move():
    """As with --warm-up, whose range is wider than the one the magnetometers were turned at."""
    said, axes = _px4(_constant())
    assert said["TC_M_ENABLE"] == 0 and not any(name.startswith("TC_M0_") for name in said)
    np.testing.assert_allclose(axes("OFF"), 1e4 * HARD, rtol=1e-7)  # nine digits in the file


def test_px4_corrects_over_the_magnetometers_own_temperatures():
    wide = dataclasses.replace(_calibration(), temperature_range=(LOW - 30.0, HIGH + 30.0))
    said, _ = _px4(wide)
    assert (said["TC_M0_TMIN"], said["TC_M0_TMAX"]) == (LOW, HIGH)


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_the_stated_error_is_the_rotation_that_is_lost(name):
    """Of a matrix that is a rotation by 20 mrad a symmetric one keeps nothing: 2 sin(θ/2) of the field."""
    c, s = np.cos(0.02), np.sin(0.02)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    cal = _constant(turn - np.eye(3), frame="accel")
    result = export(cal, name)
    (loss,) = result.losses
    assert loss == "the magnetometers' rotation of 1.1° against the accelerometers"
    stated = measure_loss(cal, result).field
    assert stated is not None
    assert stated.vector == pytest.approx(2.0 * np.sin(0.01) * 48e-6, rel=1e-6)
    assert stated.magnitude < 1e-7 * 48e-6
    assert (
        "0.96 µT for a field of 48 µT (its magnitude is kept)" in measure_loss(cal, result).sentence
    )


def test_ardupilots_stated_error_is_what_the_hard_iron_drifts_from_its_temperature():
    cal = _calibration()
    result = export(cal, "ardupilot")
    assert "temperature dependence of the hard iron: it is that at 35 °C" in result.losses
    stated = measure_loss(cal, result).field
    assert stated is not None
    # At its lower end, `LOW` = 5 °C, the hard iron is 30 °C of drift away; without the small rotation that is lost,
    # 2 sin(θ/2) of the field and of what the current makes, the error is that through the soft iron's inverse.
    moved = np.linalg.norm(np.linalg.inv(np.eye(3) + SOFT) @ (30.0 * DRIFT))
    left, _, right = np.linalg.svd(np.linalg.inv(np.eye(3) + SOFT))
    angle = np.arccos(0.5 * (np.trace(left @ right) - 1.0))
    assert abs(stated.vector - moved) <= 2.0 * np.sin(0.5 * angle) * (48e-6 + moved)


def _correct_field(said, raw, current):
    """ArduPilot's `AP_Compass_Backend::correct_field`, line by line: mgauss, one sample a row."""
    axes = lambda key: np.array([said[f"COMPASS_{key}_{a}"] for a in "XYZ"])
    mag = raw + axes("OFS")
    if 1.0 / 1.5 <= said["COMPASS_SCALE"] <= 1.5:  # `have_scale_factor`
        mag = mag * said["COMPASS_SCALE"]
    mag = mag @ _symmetric(axes("DIA"), axes("ODI")).T
    assert said["COMPASS_MOTCT"] == 2.0  # AP_COMPASS_MOT_COMP_CURRENT
    return mag + axes("MOT") * current[:, None]


def _ardupilot(calibration):
    text = export(calibration, "ardupilot").content.decode()
    return {name: float(value) for name, value in (line.split() for line in text.splitlines())}


def test_ardupilot_gives_the_magnitude_at_its_temperature():
    outputs, _, current = _samples()
    there = np.full(20, np.clip(35.0, LOW, HIGH))
    field = _correct_field(_ardupilot(_calibration()), 1e7 * outputs, current)
    # Nine digits in the file.
    assert np.allclose(
        np.linalg.norm(field, axis=1), 1e7 * _sizes(outputs, there, current), rtol=1e-7
    )


def test_ardupilots_stated_error_is_that_of_its_own_formula():
    """`applied` computes what `correct_field` does with the numbers in the file, the current's field included."""
    cal = _calibration()
    outputs, temperature, current = _samples()
    applied = export(cal, "ardupilot").applied_field
    assert applied is not None
    expected = 1e-7 * _correct_field(_ardupilot(cal), 1e7 * outputs, current)
    # The file's nine digits: 5e-9 of each of some numbers that make fields of 1e-4 T.
    np.testing.assert_allclose(applied(outputs, temperature, current), expected, rtol=0, atol=2e-12)


def test_magnetometers_alone_leave_ardupilots_imus_as_they_are():
    assert all(name.startswith("COMPASS_") for name in _ardupilot(_calibration()))


def test_a_compass_has_the_vehicles_axes_and_an_imu_its_own():
    """`rotate_field` turns before the offsets of a compass, `_rotate_and_correct_accel` behind those of an IMU."""
    compass, imu = "axes of the compass must be the vehicle's, after", "must be the sensor's own"
    (said,) = [n for n in export(_calibration(), "ardupilot").notes if "axes" in n]
    assert compass in said and imu not in said
    both = dataclasses.replace(_calibration(), accel=_accel())
    first, second = [n for n in export(both, "ardupilot").notes if "axes" in n]
    assert imu in first and compass in second


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_what_a_parameter_file_says_of_magnetometers_is_said_not_to_be_read(name):
    both = dataclasses.replace(_calibration(), accel=_accel())
    told = lambda cal: [
        n for n in by_name(name).read(export(cal, name).content).notes if "not read" in n
    ]
    (said,) = told(both)
    assert ("COMPASS_*" if name == "ardupilot" else "CAL_MAG*") in said
    assert not told(dataclasses.replace(both, mag=None))


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_without_magnetometers_nothing_is_said_of_them(name):
    text = export(Calibration(9.81), name).content.decode()
    assert "MAG" not in text and "COMPASS" not in text and "TC_M" not in text


def test_a_format_without_a_place_for_them_says_so():
    with pytest.raises(
        ValueError, match="imu_tk: has no place for magnetometers, .* px4, ardupilot, c, inertiax"
    ):
        export(_calibration(), "imu_tk")
    both = Calibration(9.81, accel=_accel(), mag=_calibration().mag, temperature_range=(LOW, HIGH))
    assert any("magnetometers" in loss for loss in export(both, "azure").losses)
