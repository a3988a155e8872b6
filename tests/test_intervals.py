"""Rests, plateaus and dwell means: found where they are, with covariances that are right."""

# Columns are optional in the types, and these recordings have them:
# pyright: reportOptionalSubscript=false, reportOptionalMemberAccess=false
# pyright: reportOptionalOperand=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportOperatorIssue=false

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from inertiax.data.formats import ColumnMap, Layout, read_recordings
from inertiax.data.formats.columns import TimeColumn, TriadColumns
from inertiax.data.recording import Recording
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.mean_noise import (
    converter_steps,
    fit_noise_shape,
    NoiseShape,
    quantisation_floor,
    quantisation_step,
)
from inertiax.reduction.segments import segment


REAL = os.environ.get("INERTIAX_RECORDINGS")
needs_recordings = pytest.mark.skipif(
    REAL is None, reason="INERTIAX_RECORDINGS does not point at the real recordings"
)


def _poses(rng, *, rate=100.0, rests=6, rest=8.0, move=2.0, noise=0.01):
    """Rests joined by turns of the gravity vector, as by hand; returns the recording and true rests."""
    count, per = int(rate * (rest + move)) * rests, int(rate * rest)
    t = np.arange(count) / rate
    turns = np.clip((t % (rest + move) - rest) / move, 0, 1)
    angle = (t // (rest + move) + 3 * turns**2 - 2 * turns**3) * 1.1
    accel = 9.81 * np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    gyro = np.stack([0 * angle, 0 * angle, -np.gradient(angle, t)], axis=1)
    accel += noise * rng.standard_normal(accel.shape)
    gyro += 0.002 * rng.standard_normal(gyro.shape)
    starts = np.arange(rests) * int(rate * (rest + move))
    return Recording(time=t, accel=accel, gyro=gyro), starts, starts + per


def _variances(covariance):
    return np.einsum("kii->ki", covariance)


# --- segments ------------------------------------------------------------------------------------


def test_runs_of_one_position_are_rests():
    position = np.array([-1, 0, 0, 0, -1, 1, 1, 2, 2, -1])
    r = Recording(time=np.arange(10.0), accel=np.zeros((10, 3)), position=position)
    s = segment(r)
    np.testing.assert_array_equal(s.start, [1, 5, 7])
    np.testing.assert_array_equal(s.stop, [4, 7, 9])
    np.testing.assert_array_equal(s.position, [0, 1, 2])


def test_a_new_experiment_or_a_pause_ends_a_rest():
    t = np.concatenate([np.arange(10.0), 500 + np.arange(10.0)])
    r = Recording(time=t, accel=np.zeros((20, 3)), position=np.zeros(20, int))
    np.testing.assert_array_equal(segment(r).start, [0, 10])
    experiment = np.repeat([1, 2], 10)
    r = Recording(
        time=np.arange(20.0),
        accel=np.zeros((20, 3)),
        position=np.zeros(20, int),
        experiment=experiment,
    )
    np.testing.assert_array_equal(segment(r).start, [0, 10])


def test_constant_rates_between_rests_are_plateaus_and_ramps_are_not():
    rate = np.concatenate([np.zeros(500), np.linspace(0, 2, 200), np.full(400, 2.0)])
    rate = np.concatenate([rate, np.linspace(2, -2, 400), np.full(400, -2.0)])
    t = np.arange(len(rate)) / 100.0
    earth = 7.3e-5 * np.stack([np.cos(2 * t), np.sin(2 * t)], axis=1)  # turns with the case
    reference = np.column_stack([rate, earth])
    position = np.where(np.arange(len(rate)) < 500, 0, -1)
    r = Recording(time=t, gyro=reference.copy(), reference_gyro=reference, position=position)
    s = segment(r)
    np.testing.assert_array_equal(s.position, [0, -1, -1])
    # A ramp of 2 rad/s² moves 0.02 rad/s a sample, so the edges are exact to one sample.
    assert np.all(np.abs(s.start - [0, 700, 1500]) <= 1)
    assert np.all(np.abs(s.stop - [500, 1100, 1900]) <= 1)


@pytest.mark.parametrize("held", [False, True])
def test_rests_are_found_in_the_data_within_half_a_window(held):
    """After the first, on a table, a hand may hold the others, trembling by 6 deg/s."""
    rng = np.random.default_rng(0)
    r, starts, stops = _poses(rng, rests=8, move=1.0)
    if held:
        tremor = 0.1 * rng.standard_normal((len(r.time), 3)) * (r.time[:, None] > 8.0)
        r = Recording(time=r.time, accel=r.accel, gyro=r.gyro + tremor)
    s = segment(r)
    assert s.num_segments == 8
    assert s.threshold is not None and f"{7 if held else 8} rests found" in s.statement
    assert held == ("1 rest found" in s.statement)
    # The window is 1 s: up to half of it is cut off each end, and as much may creep in
    # where the smooth turn has hardly begun.
    assert np.all(s.start >= starts - 50) and np.all(s.start <= starts + 110)
    assert np.all(s.stop <= stops + 50) and np.all(s.stop >= stops - 110)


@pytest.mark.parametrize("triad", ["accel", "gyro"])
def test_one_triad_is_enough_to_find_rests(triad):
    r, _, _ = _poses(np.random.default_rng(1))
    one = Recording(time=r.time, **{triad: getattr(r, triad)})
    assert segment(one).num_segments == 6


def test_a_log_without_motion_is_one_rest():
    rng = np.random.default_rng(2)
    accel = [0, 0, 9.81] + 0.01 * rng.standard_normal((20_000, 3))
    gyro = 0.002 * rng.standard_normal((20_000, 3))
    s = segment(Recording(time=np.arange(20_000) / 100, accel=accel, gyro=gyro))
    np.testing.assert_array_equal([s.start, s.stop], [[0], [20_000]])


def test_a_bias_that_drifts_is_no_motion():
    rng = np.random.default_rng(3)
    t = np.arange(0, 4000, 0.5)
    gyro = 3e-4 * rng.standard_normal((len(t), 3)) + 0.03 * np.sin(t / 600)[:, None]
    accel = [0, 0, 9.81] + 0.01 * rng.standard_normal((len(t), 3))
    assert segment(Recording(time=t, accel=accel, gyro=gyro)).num_segments == 1


def test_a_slow_turn_about_the_vertical_is_no_rest():
    # Accelerometers cannot see it; 3 deg/s for 20 s between two rests.
    rng = np.random.default_rng(4)
    t = np.arange(0, 80, 0.01)
    gyro = 0.002 * rng.standard_normal((len(t), 3))
    gyro[(t > 30) & (t < 50), 2] += 0.052
    accel = [0, 0, 9.81] + 0.01 * rng.standard_normal((len(t), 3))
    s = segment(Recording(time=t, accel=accel, gyro=gyro))
    assert s.num_segments == 2
    assert s.stop[0] <= 3010 and s.start[1] >= 4990


def test_a_knock_at_the_start_of_a_rest_is_cut_off():
    rng = np.random.default_rng(5)
    r, starts, _ = _poses(rng, rests=4, rest=20.0)
    accel = r.accel.copy()
    after = r.time - r.time[starts[1]]
    accel[:, 2] += np.where(after >= 0, 0.08 * np.exp(-np.maximum(after, 0) / 0.7), 0)
    s = segment(Recording(time=r.time, accel=accel, gyro=r.gyro))
    assert s.num_segments == 4
    assert r.time[s.start[1]] - r.time[starts[1]] > 0.7
    # What is left of the transient, 0.08 e^(-t/0.7), averaged over a rest of 20 s, is below the
    # mean's own noise of 0.01 / sqrt(1900) times three.
    assert abs(accel[s.start[1] : s.stop[1], 2].mean()) < 3 * 0.01 / np.sqrt(1900)


@needs_recordings
def test_xsens_recording_has_38_rests():
    folder = Path(str(REAL)) / "imu_tk-xsens"
    counts = ColumnMap(
        accel=TriadColumns(
            unit="count",
            scale=(415.0, 413.0, 415.0),
            scale_unit="count per m/s^2",
            offset=32768.0,
        ),
        gyro=TriadColumns(
            unit="count",
            scale=(4778.0, 4758.0, 4766.0),
            scale_unit="count per rad/s",
            offset=32768.0,
        ),
    )
    (accel,) = read_recordings(folder / "xsens_acc.mat", counts)
    (gyro,) = read_recordings(folder / "xsens_gyro.mat", counts, Layout(triad="gyro"))
    r = Recording(time=accel.time, accel=accel.accel, gyro=gyro.gyro)
    s = segment(r)
    assert abs(s.num_segments - 38) <= 2
    assert r.time[s.start[0]] < 2 and r.time[s.stop[0]] > 45  # the 50 s of rest at the beginning
    if s.num_segments == 38:
        published = np.loadtxt(folder / "interval_means.txt")
        means = reduce_to_dwells([r]).accel * [415, 413, 415] + 32768
        # Other ends of the same rests: noise of 4 counts over some 400 samples is 0.2 counts.
        assert np.sqrt(np.mean((means - published) ** 2)) < 0.25


@needs_recordings
@pytest.mark.parametrize("number", [0, 1, 2])
def test_mpu9150_recordings_have_22_or_23_rests(number):
    names = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")
    (r,) = read_recordings(
        Path(str(REAL)) / f"mikoff-mpu9150/imu{number}.log",
        ColumnMap(time=TimeColumn(rate=100.0)),
        Layout(names=names),
    )
    assert segment(r, handling=False).num_segments in (22, 23)


# --- means and blocks ----------------------------------------------------------------------------


def _labelled(values, position, **others):
    count = len(values)
    return Recording(time=np.arange(count) * 0.5, accel=values, position=position, **others)


def test_dwells_hold_the_means_of_every_column():
    rng = np.random.default_rng(6)
    position = np.repeat([0, -1, 1], [10, 3, 20])
    accel, temperature = rng.standard_normal((33, 3)), rng.standard_normal((33, 2))
    r = _labelled(accel, position, temperature=temperature, experiment=np.full(33, 7))
    d = reduce_to_dwells([r], temperature_step=None)
    np.testing.assert_allclose(d.accel, [accel[:10].mean(0), accel[13:].mean(0)], rtol=1e-12)
    np.testing.assert_allclose(
        d.temperature, [temperature[:10, 0].mean(), temperature[13:, 0].mean()]
    )
    np.testing.assert_allclose(d.time, [2.25, 11.25])
    np.testing.assert_array_equal(d.duration, [5.0, 10.0])
    np.testing.assert_array_equal(d.count, [10, 20])
    np.testing.assert_array_equal(d.position, [0, 1])
    np.testing.assert_array_equal(d.experiment, [7, 7])
    assert d.gyro is None and d.valid.all()


def test_recordings_without_experiments_are_numbered_by_file():
    r = _labelled(np.random.default_rng(7).standard_normal((20, 3)), np.zeros(20, int))
    d = reduce_to_dwells([r, r, r])
    np.testing.assert_array_equal(d.experiment, [0, 1, 2])


def test_found_rests_of_different_recordings_have_different_positions():
    r, _, _ = _poses(np.random.default_rng(8))
    d = reduce_to_dwells([r, r])
    np.testing.assert_array_equal(d.position, np.arange(12))


def test_dwells_are_cut_into_blocks_of_at_most_the_longest():
    r = _labelled(np.random.default_rng(9).standard_normal((100, 3)), np.repeat([0, 1], 50))
    d = reduce_to_dwells([r], longest=10.0)
    np.testing.assert_array_equal(d.position, np.repeat([0, 1], 3))
    np.testing.assert_array_equal(d.count, [16, 17, 17] * 2)
    assert d.duration.max() <= 10.0


def test_a_sweep_in_one_pose_is_cut_by_temperature():
    temperature = np.linspace(-40, 60, 6000)[:, None] + 0.05 * np.sin(np.arange(6000.0))[:, None]
    r = _labelled(np.zeros((6000, 3)) + 9.8, np.zeros(6000, int), temperature=temperature)
    d = reduce_to_dwells([r])
    assert 100 <= d.num_dwells <= 110  # 100 °C in steps of at most 1 °C
    assert reduce_to_dwells([r], temperature_step=None).num_dwells == 1


def test_a_noisy_probe_does_not_cut_dwells():
    rng = np.random.default_rng(10)
    temperature = 20 + 0.5 * rng.standard_normal((4000, 1))
    r = _labelled(np.zeros((4000, 3)) + 9.8, np.zeros(4000, int), temperature=temperature)
    assert reduce_to_dwells([r]).num_dwells == 1


# --- covariances ---------------------------------------------------------------------------------


def _red(rng, decay, shape):
    """Gauss-Markov noise of unit variance along the middle axis, past its start."""
    white = rng.standard_normal((shape[0], shape[1] + 2000, shape[2]))
    return lfilter([np.sqrt(1 - decay**2)], [1, -decay], white, axis=1)[:, 2000:]


@pytest.mark.slow
@pytest.mark.parametrize("decay", [0.0, 0.5, 0.9, 0.97])
def test_covariance_of_a_mean_is_right_for_correlated_noise(decay):
    # Theory by brute force: 1ᵀ R 1 / n² with the Toeplitz matrix R of the autocorrelation.
    dwells, n, repeats = 40, 500, 8
    theory = toeplitz(decay ** np.arange(n)).sum() / n**2
    rng = np.random.default_rng(11)
    stated, errors = [], []
    for _ in range(repeats):
        x = _red(rng, decay, (dwells, n, 3)) * 0.02
        d = reduce_to_dwells([_labelled(x.reshape(-1, 3), np.repeat(np.arange(dwells), n))])
        stated.append(_variances(d.accel_covariance) / 0.02**2)
        errors.append(d.accel / 0.02)
    # The stated variance against theory: what is known of it rests on the slowest averages, 40
    # dwells of n / 170 independent stretches each, that is to about 6 %, less over 8 repeats
    # and 3 axes; 0.9 to 1.1 is three sigma.
    assert 0.9 < np.mean(stated) / theory < 1.1
    # And against the scatter of the means: 960 errors know their variance to 4.6 %.
    assert 0.85 < np.mean(np.square(errors)) / np.mean(stated) < 1.15


def test_channels_correlate_as_they_do_in_the_samples():
    rng = np.random.default_rng(12)
    mix = np.array([[1.0, 0, 0], [0.8, 0.6, 0], [0, 0, 1.0]])
    x = rng.standard_normal((200 * 50, 3)) @ mix.T
    d = reduce_to_dwells([_labelled(x, np.repeat(np.arange(200), 50))])
    c = d.accel_covariance[0] * 50
    np.testing.assert_allclose(
        c, mix @ mix.T, atol=0.06
    )  # 10 000 samples: 1 % of 1, 4 sigma + shape


def test_steady_drift_in_a_dwell_is_no_noise():
    rng = np.random.default_rng(13)
    t = np.tile(np.arange(100.0), 30)[:, None]
    x = 0.1 * rng.standard_normal((3000, 3))
    calm = reduce_to_dwells([_labelled(x, np.repeat(np.arange(30), 100))])
    drifting = reduce_to_dwells([_labelled(x + 0.05 * t, np.repeat(np.arange(30), 100))])
    np.testing.assert_allclose(drifting.accel_covariance, calm.accel_covariance, rtol=1e-6)


def test_a_quiet_dwell_by_chance_gets_no_great_weight():
    rng = np.random.default_rng(14)
    x = rng.standard_normal((60 * 5, 3))  # 5 samples a dwell: own variances scatter by 70 %
    d = reduce_to_dwells([_labelled(x, np.repeat(np.arange(60), 5))])
    v = _variances(d.accel_covariance)
    assert v.max() / v.min() < 2.0


def test_a_noisy_dwell_keeps_its_own_variance():
    rng = np.random.default_rng(15)
    x = rng.standard_normal((20 * 400, 3))
    x[:400] *= 10.0
    d = reduce_to_dwells([_labelled(x, np.repeat(np.arange(20), 400))])
    v = _variances(d.accel_covariance) * 400
    assert np.all(v[0] > 70) and np.all(v[0] < 130)  # 100, known to 7 % from 400 samples
    assert np.all(v[1:] > 0.7) and np.all(v[1:] < 1.4)


def test_single_samples_take_the_pooled_variance_or_none():
    rng = np.random.default_rng(16)
    x = rng.standard_normal((1000, 3))
    d = reduce_to_dwells([_labelled(x, np.concatenate([np.repeat(np.arange(9), 111), [9]]))])
    v = _variances(d.accel_covariance)
    assert d.count[-1] == 1
    np.testing.assert_allclose(v[-1], v[:-1].mean(0) * 111, rtol=0.25)
    alone = reduce_to_dwells([_labelled(x[:5], np.arange(5))])
    np.testing.assert_array_equal(alone.accel_covariance, 0.0)


def test_plateaus_are_judged_against_their_reference():
    # The rate changes by the plan within the plateau; that is no noise.
    rng = np.random.default_rng(17)
    t = np.arange(4000) / 100
    wobble = 1e-4 * np.sin(t)[:, None] * [0, 1, 1]
    reference = np.where(t < 20, 1.0, -1.0)[:, None] * [1, 0, 0] + wobble
    gyro = reference + 1e-5 * rng.standard_normal((4000, 3))
    r = Recording(time=t, gyro=gyro, reference_gyro=reference, position=np.full(4000, -1))
    d = reduce_to_dwells([r])
    np.testing.assert_array_equal(d.position, [-1, -1])
    deviation = np.sqrt(_variances(d.gyro_covariance) * 2000)
    np.testing.assert_allclose(deviation, 1e-5, rtol=0.15)


def test_quantised_constant_signal_has_the_error_of_rounding():
    steps = np.round(np.linspace(-1, 1, 21) * 100) / 100 + 0.001  # another constant in each dwell
    x = np.repeat(np.round(steps / 0.01) * 0.01, 50)[:, None] * np.ones(3)
    d = reduce_to_dwells([_labelled(x, np.repeat(np.arange(21), 50))])
    v = _variances(d.accel_covariance)
    lsb = 0.1  # the smallest difference that the recording shows
    np.testing.assert_allclose(v, lsb**2 / 12, rtol=0.05)


@pytest.mark.parametrize("sigma", [0.0, 0.1, 0.25, 0.6])
def test_rounding_error_of_a_mean_follows_widrow(sigma):
    rng = np.random.default_rng(18)
    truth = rng.uniform(-0.5, 0.5, 4000)
    samples = truth[:, None] + sigma * rng.standard_normal((4000, 400))
    rounded = np.round(samples)
    error = rounded.mean(axis=1) - truth
    white = rounded.var(axis=1, ddof=1).mean() / 400
    floor = quantisation_floor(np.array(1.0), np.array(sigma**2 + 1 / 12))
    # 4000 values know a variance to 2.2 %; three sigma.
    np.testing.assert_allclose(np.mean(error**2), floor + white, rtol=0.08)


def test_step_of_a_converter_is_found_only_where_there_is_one():
    rng = np.random.default_rng(19)
    x = rng.standard_normal(5000)
    assert quantisation_step(x) == 0.0
    assert quantisation_step(np.round(x / 0.03) * 0.03) == pytest.approx(0.03, rel=1e-6)
    triad = np.stack([x, np.round(x / 0.03) * 0.03, np.round(x / 0.5) * 0.5], axis=1)
    for _ in range(2):  # the second time as it was kept
        np.testing.assert_allclose(converter_steps(triad), [0.0, 0.03, 0.5], rtol=1e-6)
    np.testing.assert_allclose(converter_steps(triad[:, ::-1].copy()), [0.5, 0.03, 0.0], rtol=1e-6)


def test_noise_shape_sums_as_the_toeplitz_matrix():
    band = 0.7 * np.exp(1.1j)
    shape = NoiseShape(white=0.2, differenced=0.1, red=(0.4, 0.3), decay=(0.8, complex(band)))
    h = np.arange(30)
    red = lambda h: 0.4 * 0.8**h + 0.3 * 0.7**h * np.cos(1.1 * h)
    rho = 0.2 * (h == 0) + 0.1 * ((h == 0) - 0.5 * (h == 1)) + red(h)
    matrix = toeplitz(rho)
    assert shape.sum_variance(np.array([30]))[0] == pytest.approx(matrix.sum(), rel=1e-12)
    u = (h - 14.5) / np.linalg.norm(h - 14.5)
    assert shape.slope_variance(30) == pytest.approx(u @ matrix @ u, rel=1e-12)
    far = np.arange(1, 400)
    rho = -0.05 * (far == 1) + red(far)
    assert shape.squared_sum == pytest.approx(1 + 2 * np.sum(rho**2), rel=1e-9)


@pytest.mark.parametrize("frequency", [0.06, 0.18])  # cycles a sample
def test_a_tremor_averages_out_as_fast_as_its_spectrum_says(frequency):
    rng, rests, samples, decay = np.random.default_rng(22), 24, 300, np.exp(-1.0 / 8.0)
    pole = decay * np.exp(2j * np.pi * frequency)
    drive = rng.standard_normal((40, rests * samples)) + 1j * rng.standard_normal(
        (40, rests * samples)
    )
    tremor = 2.0 * np.real(lfilter([np.sqrt(1.0 - decay**2)], [1.0, -pole], drive))
    outputs = (tremor + rng.standard_normal(tremor.shape)).reshape(40, rests, samples)
    deviations = outputs - outputs.mean(axis=2, keepdims=True)
    starts = np.arange(0, rests * samples, samples)
    found = [
        fit_noise_shape(d.ravel(), starts).mean_factor(np.array([samples]))[0] for d in deviations
    ]
    # 960 means know their variance to 5 %, three sigma.
    true = samples * outputs.mean(axis=2).var() / outputs.var()
    assert np.mean(found) == pytest.approx(true, rel=0.15)


def test_white_noise_is_called_white():
    rng = np.random.default_rng(20)
    called = [
        fit_noise_shape(rng.standard_normal(2000), np.arange(0, 2000, 100)).red for _ in range(50)
    ]
    # A component is added for a gain of 9 in χ²: rarely by chance.
    assert sum(len(red) > 0 for red in called) <= 5


def _calls(rests, rows):
    """How many functions are called, Python's and C's, to reduce rests of so many rows."""
    rng = np.random.default_rng(21)
    count, called = rests * rows, 0
    r = Recording(
        time=np.arange(count) * 0.01,
        accel=rng.standard_normal((count, 3)),
        gyro=rng.standard_normal((count, 3)),
        position=np.repeat(np.arange(rests), rows),
    )

    def count_call(frame, event, argument):
        nonlocal called
        called += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(count_call)
    try:
        reduce_to_dwells([r])
    finally:
        sys.setprofile(before)
    return called


def test_the_work_is_by_the_rest_and_not_by_the_row():
    # A million rows in a thousand rests take seconds because no row is a call of its own.
    _calls(2, 100)  # what is imported or compiled once does not count
    short, long = _calls(20, 100), _calls(20, 2000)
    # Scores are looked at where they are large, a few more of them in more rows; a call a row would be 25 times.
    assert long < 1.5 * short
    assert _calls(40, 100) < 2.5 * short


# --- what is refused -----------------------------------------------------------------------------


def test_recordings_that_do_not_go_together_are_refused():
    a = _labelled(np.ones((20, 3)), np.zeros(20, int), device="A", name="a.csv")
    b = _labelled(np.ones((20, 3)), np.zeros(20, int), device="B", name="b.csv")
    with pytest.raises(ValueError, match=r"2 devices \['A', 'B'\]; reduce each alone"):
        reduce_to_dwells([a, b])
    c = _labelled(
        np.ones((20, 3)), np.zeros(20, int), device="A", name="c.csv", temperature=np.ones((20, 1))
    )
    with pytest.raises(ValueError, match="recording 'a.csv' has no temperature but 'c.csv' has"):
        reduce_to_dwells([a, c])


def test_nothing_at_rest_is_an_error_that_says_what_is_needed():
    r = _labelled(np.ones((20, 3)), np.full(20, -1), name="a.csv")
    with pytest.raises(ValueError, match="a.csv: no rest and no plateau of constant rate"):
        reduce_to_dwells([r])


@pytest.mark.parametrize("setting", ["longest", "temperature_step"])
def test_settings_must_be_positive(setting):
    r = _labelled(np.ones((20, 3)), np.zeros(20, int))
    with pytest.raises(ValueError, match=rf"`reduce_to_dwells\({setting}=...\)` must be positive"):
        reduce_to_dwells([r], **{setting: 0.0})
