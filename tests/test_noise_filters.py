"""Noise of filtered, held and rounded logs: N from below the corner, no false terms, nothing exported untold.

Logs are made by NumPy and SciPy alone.
"""

import json
import os
import re
from pathlib import Path

import allantools
import numpy as np
import pytest
from scipy.signal import butter, freqz, lfilter, sosfilt, sosfreqz, welch

from inertiax.allan import identify, logs, noise_of, read_triad_noise, spectrum, triad_noise
from inertiax.allan.process_noise import correlation_time
from inertiax.allan.repeats import own_samples
from inertiax.allan.sensor_filter import recursion_of
from inertiax.data.recording import Recording
from inertiax.exports import by_name
from inertiax.exports.noise import settings_from_noise
from inertiax.report.noise import noise_document


RATE, N = 200.0, 1e-4  # Hz; rad/s/√Hz


def white(seed, samples=24_000, rate=RATE):
    return N * np.sqrt(rate) * np.random.default_rng(seed).normal(size=samples)


def first_order(log, corner, rate=RATE):
    return sosfilt(butter(1, 2.0 * corner / rate, output="sos"), log)[2000:]


def second_order(log, corner, rate=RATE):
    return sosfilt(butter(2, 2.0 * corner / rate, output="sos"), log)[2000:]


@pytest.mark.parametrize(
    "log, corner",
    [(first_order(white(0), 40.0), 40.0), (second_order(white(1), 20.0), 20.0)],
    ids=["first order", "second order"],
)
def test_behind_a_low_pass_n_is_that_below_the_corner(log, corner):
    model = identify(log, rate=RATE)
    found = model.terms["N"]
    assert found.value == pytest.approx(N, rel=0.05) and found.lower < N < found.upper
    assert [k for k, term in model.terms.items() if term.shown] == ["N"]
    assert model.corner == pytest.approx(corner, rel=0.12)
    assert "behind a low-pass filter of" in model.statement and model.statement.startswith("N from")


def test_one_sample_behind_a_filter_scatters_less_than_n_says():
    """The variance of filtered white noise is σ² Σ h², h the impulse response; a fresh sample's is σ² itself."""
    rng = np.random.default_rng(5)
    raw = N * np.sqrt(RATE) * rng.normal(size=(30_000, 3))
    sections = butter(2, 2.0 * 40.0 / RATE, output="sos")
    response = sosfilt(sections, np.r_[1.0, np.zeros(500)])
    accel = np.array([0.0, 0.0, 9.8]) + sosfilt(sections, 10.0 * raw, axis=0)
    recording = Recording.from_arrays(accel=accel[2000:], gyro=raw[2000:], sample_rate=RATE)
    for channel in noise_of(recording).channels:
        factor = 10.0 * np.sqrt(response @ response) if channel.channel[0] == "a" else 1.0
        # 28 000 samples tell a standard deviation to 0.4 % (0.7 % where the filter makes neighbours alike).
        assert channel.sample == pytest.approx(factor * N * np.sqrt(RATE), rel=0.02)


@pytest.mark.parametrize("poles", [(0.6,), (0.5 + 0.3j, 0.5 - 0.3j), (0.7, -0.2, 0.1)])
def test_a_filters_recursion_follows_from_its_attenuation(poles):
    # SciPy's response of known poles, at as many frequencies as the polynomial has coefficients.
    wanted = np.real(np.poly(poles))
    upper = 60.0
    frequency = np.linspace(0.3, 1.0, len(poles)) * upper
    response = freqz([wanted.sum()], wanted, frequency, fs=RATE)[1]
    x = (np.sin(np.pi * frequency / RATE) / np.sin(np.pi * upper / RATE)) ** 2
    powers = x[:, None] ** np.arange(1, len(poles) + 1)
    attenuation = np.linalg.solve(powers, 1.0 / np.abs(response) ** 2 - 1.0)
    np.testing.assert_allclose(recursion_of(attenuation, upper, RATE), wanted[1:], atol=1e-9)


def test_no_attenuation_is_no_filter():
    assert recursion_of(np.zeros(2), 10.0, RATE) == ()
    assert recursion_of(np.zeros(0), 10.0, RATE) == ()


def test_no_filter_is_made_of_an_attenuation_that_is_none():
    assert recursion_of(np.array([-0.9]), 50.0, RATE) == ()


@pytest.mark.parametrize(
    "log, sections",
    [
        (first_order(white(0), 40.0), butter(1, 0.4, output="sos")),
        (second_order(white(1), 20.0), butter(2, 0.2, output="sos")),
    ],
    ids=["first order", "second order"],
)
def test_the_recursion_attenuates_as_the_logs_filter(log, sections):
    model = identify(log, rate=RATE)
    frequency = np.linspace(0.0, min(model.band[1], 45.0), 50)
    real = np.abs(sosfreqz(sections, frequency, fs=RATE)[1])
    recursion = np.array([1.0, *model.recursion])
    found = np.abs(freqz([recursion.sum()], recursion, frequency, fs=RATE)[1])
    # Amplitudes relate to that at zero frequency, which 22 000 samples tell to 2 %: three sigma.
    np.testing.assert_allclose(found, real, atol=0.06)


def test_a_random_walk_shows_beside_a_filter():
    rng = np.random.default_rng(2)
    walk = 2e-4 * np.cumsum(rng.normal(size=22_000)) / np.sqrt(RATE)
    model = identify(second_order(white(3), 20.0) + walk, rate=RATE)
    walked = model.terms["K"]
    assert walked.shown and walked.lower < 2e-4 < walked.upper
    assert model.terms["N"].lower < N < model.terms["N"].upper


@pytest.mark.parametrize("seed", [32, 80, 275])
def test_a_slope_throughout_the_band_is_no_filter_that_hides_n(seed):
    # A hand that begins to move: knocks in the last second of ten. N and a corner far below the band are one product.
    rng, t = np.random.default_rng(seed), np.arange(965)
    log = 9e-4 * rng.normal(size=len(t))
    for _ in range(5):
        height, middle, width = rng.uniform(0.02, 0.13), rng.uniform(870, 960), rng.uniform(1, 3)
        log += height * np.exp(-0.5 * ((t - middle) / width) ** 2)
    model = identify(log, rate=100.0)
    found = model.terms["N"]
    assert not found.shown or (found.value < 100 * N and np.isfinite(found.upper))
    assert model.corner is None or model.corner > model.band[0]


@pytest.mark.parametrize("backwards", [False, True])
def test_a_motion_at_an_end_of_a_rest_is_no_noise_of_it(backwards):
    rng = np.random.default_rng(7)
    accel = np.array([0.0, 0.0, 9.8]) + 0.05 * rng.normal(size=(965, 3))
    gyro = 9e-4 * rng.normal(size=(965, 3))
    gyro[-60:] += 0.01 * rng.normal(size=(60, 3))
    if backwards:
        gyro = gyro[::-1]
    channels = noise_of(Recording.from_arrays(accel=accel, gyro=gyro, sample_rate=100.0)).channels
    for channel in channels[3:]:
        found = channel.model.terms["N"]
        assert found.shown and found.lower < 9e-5 < found.upper < 1.2e-4
        # 865 samples tell a standard deviation to 2.4 %: three sigma.
        assert channel.sample == pytest.approx(9e-4, rel=0.075)


@pytest.mark.parametrize("rows, kept", [(2, 2.0), (3, 3.0), (1.5, 1.5)])
def test_of_held_samples_the_sensors_own_count(rows, kept):
    log = white(4)
    held = log[(np.arange(int(len(log) * rows)) / rows).astype(int)]
    model = identify(held, rate=RATE * rows)
    assert model.rate == pytest.approx(RATE, rel=1e-3)
    assert model.terms["N"].lower < N < model.terms["N"].upper
    assert model.terms["N"].value == pytest.approx(N, rel=0.05)


def test_coarse_rounding_is_not_taken_for_held_samples_nor_for_noise():
    step = 1.5 * N * np.sqrt(RATE)
    log = step * np.round((white(5) + 0.3 * step) / step)
    fine = identify(log, rate=RATE)  # a third of neighbours are alike by chance
    assert fine.rate == RATE and fine.rounding == pytest.approx(step)
    # Its variance of step²/12, a fifth of the sensor's, is not the sensor's.
    assert fine.terms["N"].value == pytest.approx(N, rel=0.03)
    coarse = 5.0 * N * np.sqrt(RATE)
    hidden = identify(coarse * np.round((white(6) + 0.4 * coarse) / coarse), rate=RATE)
    assert not any(term.shown for term in hidden.terms.values())


def test_a_line_is_left_out_and_named():
    log = first_order(white(7), 40.0)
    time = np.arange(len(log)) / RATE
    model = identify(log + 5 * N * np.sin(2 * np.pi * 3.0 * time), rate=RATE)
    assert model.terms["N"].value == pytest.approx(N, rel=0.05)
    assert re.search(r"a line at (2\.99|3) Hz left out", model.statement)
    assert model.chi2_per_dof > 10.0


def drifting(seed, seconds, drift):
    """White noise at 20 Hz and a drift over time in s."""
    time = np.arange(seconds * 20) / 20.0
    return white(seed, len(time), rate=20.0) + drift(time)


@pytest.mark.parametrize(
    ("seed", "seconds", "drift"),
    [
        (20, 1500, lambda t: 0.1 * np.exp(-t / 400.0)),
        (21, 1500, lambda t: 1e-3 * np.sin(2.0 * np.pi * t / 500.0)),
        # Up to 0.3 Hz it passes for a random walk, and N for 0.65 of what it is.
        (52, 750, lambda t: 2e-3 * N / 2.7e-4 * np.sin(2.0 * np.pi * t / 600.0)),
        # Left out as a line it would leave 0.54 of N, and a random walk of what it leaks.
        (3, 1500, lambda t: 3e-2 * N / 2.7e-4 * np.sin(2.0 * np.pi * t * 15.3 / 1500.0 + 1.0)),
    ],
    ids=["warm-up", "three periods", "weak", "fifteen periods"],
)
def test_a_drift_as_slow_as_the_log_is_no_line_and_tells_no_slow_term(seed, seconds, drift):
    model = identify(drifting(seed, seconds, drift), rate=20.0)
    assert "Hz left out" not in model.statement and "a drift" in model.statement
    assert model.terms["N"].lower < N < model.terms["N"].upper
    assert all(not model.terms[k].shown and model.terms[k].upper == np.inf for k in "BKR")


def test_what_goes_to_and_fro_fifty_times_in_the_log_is_a_line_and_no_random_walk():
    swing = lambda t: 1e-3 * np.sin(2.0 * np.pi * t / 30.0)
    model = identify(drifting(22, 1500, swing), rate=20.0)
    assert "a line at 0.0333 Hz left out" in model.statement
    assert model.terms["K"].value is None and model.terms["K"].upper < np.inf


@pytest.mark.slow
def test_a_transient_hides_the_slow_terms_but_not_n():
    log = second_order(white(8, 60_000), 20.0)
    model = identify(log + 0.1 * np.exp(-np.arange(len(log)) / RATE / 3.0), rate=RATE)
    assert model.band[0] > 0.0 and "B, K and R are not told" in model.statement
    assert model.terms["N"].value == pytest.approx(N, rel=0.05)
    assert not any(model.terms[k].shown for k in "BKR")
    assert model.terms["K"].upper == np.inf


def test_white_noise_up_to_half_the_rate_is_that_of_unaveraged_samples():
    log = white(23)
    read_slowly = identify(log[::5], rate=RATE / 5)  # one sample scatters as much
    model = identify(log, rate=RATE)
    assert model.white_throughout and model.recursion == () and read_slowly.white_throughout
    # √5 times the density, known from 4800 samples to 1 %.
    assert read_slowly.terms["N"].value == pytest.approx(np.sqrt(5.0) * N, rel=0.04)
    assert not identify(first_order(log, 20.0), rate=RATE).white_throughout


@pytest.mark.slow
def test_few_logs_of_white_noise_have_another_band_than_all_of_it_and_none_a_filter():
    found = [identify(white(5000 + k), rate=RATE) for k in range(400)]
    assert not any("filter" in m.statement for m in found)
    # One channel of 120, and 3.3 of 400: 9 or more are chance once in 100 times. At one of 20 they were 10.
    assert sum(m.statement != "N from 0 to 100 Hz" for m in found) < 9


def test_a_filter_is_named_where_chance_would_not_show_it_in_a_log_of_six_channels():
    """White noise and a relaxation of 100 s, two hours at 50 Hz; the band ends early in one of 20."""
    rng, rate = np.random.default_rng(9107), 50.0
    decay = np.exp(-1.0 / rate / 100.0)
    log = 5e-4 * np.sqrt(rate) * rng.normal(size=360_000)
    log += lfilter([1.0], [1.0, -decay], 5e-5 * np.sqrt(1.0 - decay**2) * rng.normal(size=360_000))
    assert identify(log, rate=rate, triad="accel").statement == "N from 0 to 25 Hz"


@pytest.mark.parametrize("seed", [20117, 20460, 20504])
def test_coefficients_that_gain_what_one_of_six_channels_may_end_no_band(seed):
    """Three of 600 white channels whose further coefficients gain more than 10 % of single ones do, at each order."""
    assert identify(white(seed, 8000), rate=RATE).statement == "N from 0 to 100 Hz"


def test_a_channel_that_vibrates_is_named_with_how_far_it_is_off():
    gyro = np.stack([white(30 + k, 6000) for k in range(3)], axis=1)
    time = np.arange(6000) / RATE
    gyro[:, 1] += 5.0 * N * np.sin(2.0 * np.pi * 3.0 * time)
    noted = noise_of(Recording(time=time, gyro=gyro, position=np.zeros(6000, int))).notes
    (said,) = [n for n in noted if "χ² per degree of freedom" in n]
    found = re.search(r"freedom: gyro_y \(([^)]+)\); look for vibration", said)
    assert found is not None and float(found[1]) > 10.0


# From a recording to other tools -----------------------------------------------------------------------


def recording(held=1):
    gyro = np.stack([first_order(white(10 + k, 10_000), 30.0) for k in range(3)], axis=1)
    gyro = np.repeat(gyro, held, axis=0)
    time = np.arange(len(gyro)) / (RATE * held)
    return Recording(time=time, gyro=gyro, position=np.zeros(len(time), int), device="A")


@pytest.fixture(scope="module")
def found():
    return noise_of(recording(held=2))


def test_a_document_says_null_and_the_band(found):
    text = json.dumps(noise_document([found]), allow_nan=False)
    channel = json.loads(text)["logs"][0]["channels"]["gyro_x"]
    assert channel["rate"]["value"] == pytest.approx(RATE, rel=1e-3)
    assert channel["terms"]["K"]["value"] is None and channel["terms"]["K"]["upper_95"] > 0.0
    assert channel["terms"]["Q"] | {"value": None, "upper_95": None} == channel["terms"]["Q"]
    assert channel["filter_corner"]["value"] == pytest.approx(30.0, rel=0.15)
    assert any("repeat the row before" in note for note in found.notes)
    assert any("does not determine random walk" in note for note in found.notes)


def test_what_is_not_determined_is_not_exported(found):
    content = json.dumps(noise_document([found])).encode()
    given = ["accelerometer_noise_density", "accelerometer_random_walk"]
    with pytest.raises(
        ValueError, match=r"gyroscope_random_walk \(K of gyro; at most .* at 95 %\)"
    ):
        settings_from_noise(content, by_name("kalibr"), "A", given)
    told = settings_from_noise(content, by_name("kalibr"), "A", [*given, "gyroscope_random_walk"])
    assert told.values["gyroscope_noise_density"] == pytest.approx(N, rel=0.07)


def test_a_triads_noise_is_the_same_from_memory_and_from_a_file(found, tmp_path):
    path = tmp_path / "noise.json"
    path.write_text(json.dumps(noise_document([found])))
    models = [c.model for c in found.channels]
    one, other = triad_noise((models[0], models[1], models[2])), read_triad_noise(path, "gyro")
    for name in ("white", "walk", "upper", "determined", "correlation_time", "bandwidth", "rate"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name), rtol=1e-12)
    assert np.all(one.walk == 0.0) and np.all(one.cautious.walk == one.upper[2])
    with pytest.raises(ValueError, match="accel_x, accel_y and accel_z are needed"):
        read_triad_noise(path, "accel")


def test_the_process_for_bias_instability_has_the_flickers_allan_deviation():
    # Flicker prevails from 1 / 0.4413 s to 3 · 0.4413 / 0.01 s: the middle is 17.32 s, and T that over 1.8926.
    ones, walk = np.ones(3), np.full(3, 0.1)
    time = correlation_time(ones, ones, walk, 1e6)
    assert time == pytest.approx(17.32 / 1.8926, rel=1e-3)
    # The Allan variance of a Gauss–Markov process in closed form (IEEE Std 952, C.1.1.3) at the same place.
    x = np.linspace(0.5, 5.0, 20_000)
    shape = np.sqrt(2.0 / x * (1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * x)))
    assert x[np.argmax(shape)] == pytest.approx(1.8926, abs=1e-3)
    std = np.sqrt(2.0 * np.log(2.0) / np.pi) / shape.max()
    assert std == pytest.approx(1.0760, abs=1e-3)


# Long logs ---------------------------------------------------------------------------------------------


def test_a_spectrum_in_two_parts_is_that_of_the_whole(monkeypatch):
    rng = np.random.default_rng(11)
    log = rng.normal(size=1 << 18) + 0.01 * np.cumsum(rng.normal(size=1 << 18))
    whole = spectrum.spectrum_of(log, 100.0)
    monkeypatch.setattr(spectrum, "_LONG", 1 << 16)
    parts = spectrum.spectrum_of(log, 100.0)
    assert np.all(np.diff(parts.frequency) > 0.0) and parts.upper[-1] == pytest.approx(50.0)
    for low, high in ((0.0, 0.05), (0.05, 0.7), (0.9, 10.0), (10.0, 51.0)):
        means = []
        for s in (whole, parts):
            inside = (s.frequency >= low) & (s.frequency < high)
            model = s.expected[:, 1] / 100.0 + 1e-4 * 100.0 * s.expected[:, 3]
            means.append(np.average((s.power / model)[inside], weights=s.width[inside]))
        count = (high - low) / 100.0 * len(log)
        # Both see the same noise; at the edges of parts they weigh it a little otherwise.
        assert means[0] == pytest.approx(means[1], abs=2.0 / np.sqrt(count)), (low, high)


def test_long_averaging_times_of_a_long_log_are_those_of_all_differences(monkeypatch):
    log = np.random.default_rng(12).normal(size=1 << 16)
    monkeypatch.setattr(logs, "_LONG", 1 << 15)
    curve = logs._curve(log, 100.0)
    theirs = allantools.oadev(log, rate=100.0, data_type="freq", taus=curve.tau)[1]
    short = curve.factor < logs._THINNED**2
    np.testing.assert_allclose(curve.deviation[short], theirs[short], rtol=1e-9)
    # A difference every sixteenth of its span instead of at every sample.
    np.testing.assert_allclose(curve.deviation[~short], theirs[~short], rtol=0.05)
    assert np.all(np.diff(curve.tau) > 0.0)


# Real recordings ---------------------------------------------------------------------------------------

RECORDINGS = os.environ.get("INERTIAX_RECORDINGS", "")


def _real():
    folder = Path(RECORDINGS)
    still = folder / "tomisuarez-mpu6050" / "example_data_tinit_calc.csv"
    counts = np.loadtxt(still, delimiter=",", skiprows=5)
    yield from (("tomisuarez-mpu6050", counts[:, k]) for k in range(6))
    for name in ("xsens_acc.mat", "xsens_gyro.mat"):
        columns = np.loadtxt(folder / "imu_tk-xsens" / name, max_rows=4900)
        yield from ((name, columns[:, k]) for k in (1, 2, 3))


@pytest.mark.slow
@pytest.mark.skipif(not RECORDINGS, reason="INERTIAX_RECORDINGS names no folder of recordings")
def test_n_of_real_logs_is_the_flat_part_of_their_spectrum():
    for name, log in _real():
        model = identify(log, rate=100.0)
        frequency, power = welch(log, 100.0, nperseg=1024)
        flat = (frequency > 0.5) & (frequency < 5.0)
        level = np.sqrt(0.5 * power[flat].mean())  # one-sided to two-sided
        # Welch's mean over 4.5 Hz of T seconds is known to half of √(1 / 4.5 T); ours not worse than three times that.
        tolerance = 0.02 + 3.0 * 0.5 / np.sqrt(4.5 * len(log) / 100.0)
        assert model.terms["N"].value == pytest.approx(level, rel=tolerance), name


# Coverage ----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("filtered", [first_order, second_order])
def test_the_limits_of_n_hold_behind_filters(filtered):
    inside, false, errors = 0, 0, []
    for seed in range(40):
        model = identify(filtered(white(100 + seed), 20.0), rate=RATE)
        found = model.terms["N"]
        inside += found.lower <= N <= found.upper
        false += model.terms["B"].shown or model.terms["K"].shown
        errors.append(found.value / N - 1.0)
    # Binomial limits that 1 in 1000 sets of 40 would leave.
    assert inside >= 33 and false <= 3
    assert np.abs(np.mean(errors)) < 4.0 * np.std(errors) / np.sqrt(40)


@pytest.mark.parametrize("held", [1.0, 1.3, 3.4, 10.5])
def test_repeats_by_chance_are_samples_and_those_of_a_quick_reader_are_not(held):
    """A coarse output less a correction by a rounded temperature shows no one step, and N was 3 % off."""
    random = np.random.default_rng(3)
    rows = (np.arange(20000) / held).astype(int)
    if held == 1.0:
        coarse = np.round(2.0 * random.standard_normal(len(rows)))
        log = coarse + 0.01 * np.round(np.linspace(0.0, 500.0, len(rows)))
        assert 0.1 < np.mean(np.diff(log) == 0.0) < 0.2
    else:
        log = random.standard_normal(rows[-1] + 1)[rows]
    assert own_samples([log]).rate(100.0, len(log)) == pytest.approx(100.0 / held, rel=1e-3)
