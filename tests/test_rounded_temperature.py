"""A probe in whole degrees: its course between the steps, and no effect named that only the steps make."""

import numpy as np
import pytest

from inertiax import reduce_to_dwells
from inertiax.calibrate.pipeline import calibrate
from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.diagnose import diagnose_campaign
from inertiax.plausibility import check_campaign
from inertiax.reduction.rounded_temperature import between_steps, hidden_by_steps, temperature_step


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


def settling(rng):
    """Ramps between soaks behind a thermal mass, and waves that turn somewhere: what a log may begin and end in."""
    ramp = np.interp(TIME, [0, 200, 900, 1500, 2200, 2400], [0, 0, 20, 20, 0, 0])
    ramp = rng.uniform(-20, 20) + rng.uniform(0.5, 1.5) * ramp
    kernel = np.exp(-np.arange(0.0, 600.0, 0.1) / rng.uniform(20, 100))
    padded = np.append(np.full(len(kernel), ramp[0]), ramp)
    yield np.convolve(padded, kernel / kernel.sum())[len(kernel) : len(padded)]
    wave = np.sin(TIME / rng.uniform(150, 400) + rng.uniform(0, 6))
    yield 22.0 + rng.uniform(5, 30) * (1 - np.exp(-TIME / 800.0)) + rng.uniform(0.5, 3) * wave


@pytest.mark.slow
def test_what_the_steps_hide_is_known_and_no_end_is_worse_than_its_reading():
    rng, ends, all_of_it, stated = np.random.default_rng(3), [], [], []
    for _ in range(20):
        for true in settling(rng):
            rounded = np.round(true)
            if temperature_step(rounded) == 0.0:
                continue
            left = between_steps(TIME, rounded) - true
            at = np.flatnonzero(np.diff(rounded))
            ends.append(np.mean(np.append(left[: at[0]], left[at[-1] + 1 :]) ** 2))
            all_of_it.append(np.mean(left**2))
            accel = np.zeros((len(TIME), 3))
            log = Recording(TIME, accel, temperature=rounded[:, None])
            stated.append(hidden_by_steps([log]) ** 2)
    # The reading itself is off by 1 / √12 = 0.29; a line through the last two changes left 0.35 here.
    assert np.sqrt(np.mean(ends)) < 0.28
    # Of 40 courses the mean square is known to a third.
    assert 0.7 < np.sqrt(np.mean(stated) / np.mean(all_of_it)) < 1.6
    smooth = Recording(TIME, np.zeros((len(TIME), 3)), temperature=course(TIME)[:, None])
    assert hidden_by_steps([smooth]) == 0.0


def test_check_says_the_step_and_what_is_left():
    accel = [0.0, 0.0, 9.81] + 4e-3 * np.random.default_rng(2).standard_normal((len(TIME), 3))
    for temperature, told in ((np.round(course(TIME)), 1), (course(TIME), 0)):
        recording = Recording(TIME, accel, temperature=temperature[:, None])
        seen = check_campaign(Campaign((recording,), Site(gravity=9.81)))
        notes = [f for f in seen.findings if f.kind == "temperature_step"]
        assert len(notes) == told
        if told:
            assert "in steps of 1 °C" in notes[0].statement and notes[0].severity == "note"


@pytest.mark.slow
def test_the_steps_are_in_what_depends_on_temperature():
    warm = (course(TIME) - 25.0)[:, None] * [2e-3, -1e-3, 4e-3]
    noise = 1e-4 * np.random.default_rng(2).standard_normal((len(TIME), 3))
    stds = []
    for temperature in (np.round(course(TIME)), course(TIME)):
        recording = Recording(
            TIME, [0.0, 0.0, 9.81] + warm + noise, temperature=temperature[:, None]
        )
        model = ModelChoice(accel_estimator="static")
        (found,) = calibrate(Campaign((recording,), Site(gravity=9.81), model=model))
        stds.append(np.sqrt(np.diag(found.calibration.accel.covariance))[2])
        hidden = hidden_by_steps([recording])
        assert stds[-1] >= 4e-3 * hidden  # of z, 4 mm/s² a °C
    assert stds[0] > 2.0 * stds[1]


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
@pytest.mark.parametrize(("seed", "every"), [(2, 2), (71, 1), (3, 1)])
def test_a_rounded_probe_makes_no_effect(seed, every):
    """Ten times a second the turn behind the last change, 0.2 °C of it, was more than noise."""
    rng = np.random.default_rng(seed)
    time = TIME[::every]
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
