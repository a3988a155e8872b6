"""A probe in whole degrees: its course between the steps, and no effect named that only the steps make."""

import numpy as np
import pytest

from inertiax import reduce_to_dwells
from inertiax.calibrate.pipeline import calibrate
from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.diagnose import diagnose_campaign
from inertiax.reduction.rounded_temperature import between_steps, temperature_step


def course(t):
    """A warm-up to 48 °C with the room's slow wave on it."""
    return 22.0 + 26.0 * (1.0 - np.exp(-t / 500.0)) + 1.5 * np.sin(t / 170.0)


TIME = np.arange(0.0, 2400.0, 0.1)


@pytest.mark.parametrize("step", [0.5, 1.0])
def test_the_course_between_steps_is_found(step):
    rounded = np.round(course(TIME) / step) * step
    assert temperature_step(rounded) == pytest.approx(step)
    left = between_steps(TIME, rounded) - course(TIME)
    # Rounding leaves step / √12; a cubic through the moments of change leaves the fourth order of the course.
    assert np.sqrt(np.mean(left**2)) < 0.1 * step
    assert np.all(np.abs(between_steps(TIME, rounded) - rounded) <= 0.5 * step + 1e-9)


def test_a_course_that_slows_down_is_followed_to_its_end():
    slow = 22.0 + 26.0 * (1.0 - np.exp(-TIME / 500.0))
    left = between_steps(TIME, np.round(slow)) - slow
    assert np.abs(left).max() < 0.25  # of a whole degree, in the last hold of 400 s


def test_a_soak_keeps_its_reading():
    ramp = np.interp(TIME, [0, 600, 1800, 2400], [20.2, 35.2, 35.2, 20.2])
    made = between_steps(TIME, np.round(ramp))
    np.testing.assert_allclose(made[(TIME > 900) & (TIME < 1500)], 35.0, atol=0.05)


@pytest.mark.parametrize("noise", [0.2, 0.5])
def test_readings_that_noise_dithers_and_fine_ones_stay_as_they_are(noise):
    rng = np.random.default_rng(1)
    dithered = np.round(course(TIME) + noise * rng.standard_normal(len(TIME)))
    fine = np.round(course(TIME) + 0.01 * rng.standard_normal(len(TIME)), 3)
    assert between_steps(TIME, dithered) is dithered and between_steps(TIME, fine) is fine


def test_dwells_have_the_course_that_a_diagnosis_judges():
    """`calibrate` and `fleet` took the readings, and `diagnose` the course: degrees 5 and 1 of one log."""
    rounded = np.round(course(TIME))
    accel = [0.0, 0.0, 9.81] + 4e-3 * np.random.default_rng(2).standard_normal((len(TIME), 3))
    recording = Recording(TIME, accel, temperature=rounded[:, None])
    dwells = reduce_to_dwells(recording)
    campaign = Campaign(
        (recording,), Site(gravity=9.81), model=ModelChoice(accel_estimator="static")
    )
    (result,) = calibrate(campaign)
    for mine in (dwells, result.accel.dwells):
        assert mine.rows is not None
        true = np.array([course(TIME[a:b]).mean() for _, a, b, _ in mine.rows])
        assert np.sqrt(np.mean((mine.temperature - true) ** 2)) < 0.1


@pytest.mark.slow
def test_a_rounded_probe_makes_no_effect():
    rng = np.random.default_rng(2)
    time = TIME[::2]
    warm = (course(time) - 25.0)[:, None]
    accel = (
        [0.1, -0.2, 9.83] + warm * [2e-3, -1e-3, 4e-3] + 4e-3 * rng.standard_normal((len(time), 3))
    )
    gyro = (
        [0.01, -0.02, 0.004]
        + warm * [1e-4, -2e-4, 5e-5]
        + 4e-4 * rng.standard_normal((len(time), 3))
    )
    recording = Recording(
        time, accel, gyro, temperature=np.round(course(time))[:, None], name="warm.csv"
    )
    model = ModelChoice(accel_estimator="static")
    campaign = Campaign((recording,), Site(gravity=9.80856), model=model)
    found, judged = diagnose_campaign(campaign)
    assert found.verdict == "consistent"
    (plain,) = calibrate(campaign)
    assert plain.calibration.model == judged.model
    for triad in ("accel", "gyro"):
        one, other = (getattr(c, triad).curve.coefficients for c in (plain.calibration, judged))
        np.testing.assert_array_equal(one, other)
