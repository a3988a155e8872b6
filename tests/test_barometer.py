"""A barometer over temperature: against a simulation by its own formula, and PX4's."""

import numpy as np
import pytest

from inertiax.calibrate.barometer import calibrate_barometer
from inertiax.calibration.calibration import Calibration, read_calibration, write_calibration
from inertiax.data.recording import Recording
from inertiax.exports.registry import export


MIDDLE, HALF = 25.0, 30.0  # °C
CUBIC = np.array([0.0, 80.0, -30.0, 15.0])  # Pa, powers of (T − 25 °C) / 30 °C
DRIFT = 40.0 / 3600.0  # Pa/s


def _curve(temperature):
    return np.polynomial.polynomial.polyval((temperature - MIDDLE) / HALF, CUBIC)


def _warming(seed=1, *, back=True, unit=1.0, start=0.0):
    """Two hours from −5 to 55 °C and, with `back`, down again, with 2 Pa of noise a second."""
    rng = np.random.default_rng(seed)
    time = start + np.arange(7200.0)
    x = np.linspace(-1.0, 3.0 if back else 1.0, 7200)
    x = np.where(x > 1.0, 2.0 - x, x)
    pressure = 98000.0 + np.polynomial.polynomial.polyval(x, CUBIC) + DRIFT * time
    pressure = pressure + 2.0 * rng.normal(size=7200)
    return Recording.from_arrays(
        time=time, accel=np.tile([0.0, 0.0, 9.81], (7200, 1)), temperature=MIDDLE + HALF * x,
        pressure=unit * pressure,
    )  # fmt: skip


def test_curve_and_drift():
    found = calibrate_barometer((_warming(),))
    assert found.calibration.curve.basis.degree == 3
    at = np.linspace(-5.0, 55.0, 13)
    offsets, sigmas = found.calibration.over(at)
    wanted = _curve(at) - _curve(float(found.calibration.reference))
    # Stretches shift a curve by its curvature over 0.6 °C, 2e-3 Pa; beyond, 4 sigma of thirteen values.
    assert np.all(np.abs(offsets - wanted) < 4.0 * sigmas + 0.01)
    assert 0.01 < sigmas.max() < 0.5  # 2 Pa over √7200 is 0.024 Pa
    # 2 Pa of noise over two hours tell a slope to 2 √12 / √7200 = 0.08 Pa in two hours, 1.1e-5 Pa/s.
    assert abs(found.drift - DRIFT) < 5e-5
    assert not found.warnings


def test_standard_deviations_over_many_logs():
    scores = []
    for seed in range(100):
        found = calibrate_barometer((_warming(seed),)).calibration
        (offset,), (sigma,) = found.over(np.array([50.0]))
        scores.append((offset - _curve(50.0) + _curve(float(found.reference))) / sigma)
    # A standard deviation of 100 is known to 7 %; 3 sigma.
    assert abs(np.std(scores) - 1.0) < 0.21


def test_one_way_says_that_weather_is_not_told_apart():
    found = calibrate_barometer((_warming(back=False),))
    assert found.drift is None
    assert "50 Pa/h would be 1e+02 Pa" in found.warnings[0]


def test_recordings_of_two_days_have_a_pressure_each():
    days = (_warming(1), _warming(2))
    apart = (days[0], Recording.from_arrays(
        time=days[1].time, accel=days[1].accel, temperature=days[1].temperature[:, 0],
        pressure=days[1].pressure + 500.0,
    ))  # fmt: skip
    offsets, _ = calibrate_barometer(apart).calibration.over(np.array([-5.0, 55.0]))
    # From −125 to 65 Pa. Up and down at one rate, the drift of 80 Pa cancels at every temperature; what it leaves hides
    # the third degree, 15 Pa at the ends. Were the days' 500 Pa taken for temperature, it would be far more.
    assert np.ptp(offsets) == pytest.approx(190.0, abs=30.0)


def test_a_wrong_unit_is_named():
    with pytest.raises(ValueError, match='unit = "hPa"'):
        calibrate_barometer((_warming(unit=0.01),))


def test_file_and_px4(tmp_path):
    found = calibrate_barometer((_warming(),)).calibration
    path = tmp_path / "calibration.json"
    write_calibration(Calibration(9.81, temperature_range=(-5.0, 55.0), baro=found), path)
    again = read_calibration(path)
    text = export(again, "px4", baro_id=3).content.decode()
    said = {f[2]: float(f[3]) for f in (line.split("\t") for line in text.splitlines())}
    assert (said["TC_B_ENABLE"], said["TC_B0_ID"]) == (1.0, 3.0)
    at = np.linspace(said["TC_B0_TMIN"], said["TC_B0_TMAX"], 9)
    difference = at - said["TC_B0_TREF"]
    offset = sum(said[f"TC_B0_X{k}"] * difference**k for k in range(6))
    assert np.allclose(offset, found.over(at)[0], rtol=0.0, atol=1e-5)  # nine digits of 100 Pa
    assert np.allclose(offset, [float(again.baro.offset(t)) for t in at], rtol=0.0, atol=1e-5)


def test_points_of_the_figure_are_what_the_simulation_added():
    found = calibrate_barometer((_warming(),))
    wanted = _curve(found.temperature) - _curve(float(found.calibration.reference))
    # Averages of 36 s have 2 / 6 Pa of noise; 5 sigma of two hundred.
    assert np.max(np.abs(found.offset - wanted)) < 5.0 * 2.0 / 6.0
    left = found.offset - found.calibration.over(found.temperature)[0]
    assert np.isclose(np.sqrt(np.mean(left**2)), found.rms, rtol=1e-9)
