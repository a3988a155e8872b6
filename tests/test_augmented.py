"""A calibration with named effects: it takes them away from recordings and puts them on ideal inputs.

Every effect here is written in plain NumPy, not with the catalogue's code.
"""

import dataclasses
import json

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import polars as pl
import pytest

from diagnose_data import only, tumble as measured
from inertiax.calibration.calibration import (
    Calibration,
    read_calibration,
    TriadCalibration,
    write_calibration,
)
from inertiax.calibration.fitted_effects import FittedEffect
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.diagnose import diagnose_campaign
from inertiax.diagnose.estimates.applied_effects import compensate, simulate
from inertiax.diagnose.estimates.calibration_chain import succeeding, taken_away
from inertiax.diagnose.observations.blocks import join
from inertiax.diagnose.problem import with_outputs
from inertiax.effects import CATALOGUE
from inertiax.exports.compensated_recording import compensate_file, compensate_recording
from inertiax.physics.temperature import Constant, Curve, Polynomial


G = 9.81
WHITE = 2e-4  # m/s², one sample
LOWER = tuple((i, j) for i in range(3) for j in range(i + 1))
FULL = tuple((i, j) for i in range(3) for j in range(3))
BIAS = np.array([0.02, -0.03, 0.01])
MATRIX = np.array([[1e-3, 0, 0], [2e-3, -2e-3, 0], [-1e-3, 1e-3, 3e-3]])


def triad(name, bias, matrix, elements=LOWER):
    """A triad without temperature dependence."""
    values = np.r_[bias, [matrix[i, j] for i, j in elements]]
    names = [f"{name}.bias[{i}]" for i in range(3)]
    names += [f"{name}.matrix[{i},{j}]" for i, j in elements]
    curve = Curve(Constant(), jnp.asarray(values[None, :]))
    return TriadCalibration(curve, jnp.zeros((len(values),) * 2), tuple(names), "reference")


def fitted(name, channels, coefficients, unit, triad_name="accel", settings=(), **extent):
    values = np.atleast_1d(np.asarray(coefficients, float))
    covariance = np.zeros((len(values),) * 2)
    return FittedEffect(
        name, triad_name, channels, tuple(sorted(settings)), values, covariance, unit, **extent
    )


def calibrated(*effects, **others):
    return Calibration(G, triad("accel", BIAS, MATRIX), effects=effects, **others)


def tumble(seed=0, rests=40, samples=60):
    """Random poses at rest, 4 Hz: time, specific force (m/s²), positions, white noise."""
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal((rests, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    force = G * np.repeat(direction, samples, axis=0)
    time = 0.25 * np.arange(len(force))
    noise = WHITE * rng.standard_normal(force.shape)
    return time, force, np.repeat(np.arange(rests), samples), noise


def left(calibration, recording, truth):
    """Greatest rms over the axes of what compensation leaves."""
    force, _, _ = compensate_recording(calibration, recording)
    return np.sqrt(np.mean((force - truth) ** 2, axis=0)).max()


# White noise of 2e-4 m/s² over 2400 rows has an rms known to 1.4 %; the matrix changes it by 0.3 %.
NOISE = 1.05 * WHITE


@pytest.mark.slow
def test_second_order_is_taken_away_down_to_the_noise():
    time, force, position, noise = tumble()
    k2 = 4e-3  # m/s²/g²
    output = force @ (np.eye(3) + MATRIX).T + BIAS + noise
    output[:, 1] += k2 * (force[:, 1] / G) ** 2
    recording = Recording(time, accel=output, position=position)
    effect = fitted("second_order", (1,), k2, "m/s^2/g^2")
    assert left(calibrated(), recording, force) > 5.0 * NOISE
    assert left(calibrated(effect), recording, force) < NOISE


@pytest.mark.slow
def test_a_bias_step_is_taken_away_at_its_moment_by_the_recorded_clock():
    time, force, position, noise = tumble(seed=1)
    output = force @ (np.eye(3) + MATRIX).T + BIAS + noise
    step, moment = 3e-3, 1250.0
    clock = time + 1000.0
    output[:, 2] += np.where(clock >= moment, step, 0.0)
    effect = fitted(
        "bias_step", (2,), step, "m/s^2", settings=(("time", moment - 1000.0),),
        clock=(1000.0, float(clock[-1])),
    )  # fmt: skip
    whole = Recording(clock, accel=output, position=position)
    assert left(calibrated(), whole, force) > 5.0 * NOISE
    assert left(calibrated(effect), whole, force) < NOISE
    # A part of it knows the moment too: the clock is the campaign's.
    part = Recording(clock[900:1500], accel=output[900:1500], position=position[900:1500])
    assert left(calibrated(effect), part, force[900:1500]) < NOISE


def test_outputs_go_back_to_recordings_that_are_listed_in_another_order_than_their_clocks():
    made = []
    for later in (1, 0):
        time, force, position, noise = tumble(later, rests=8 + later)
        made.append(Recording(time=time + 1e4 * later, accel=force + noise, position=position))
    campaign = Campaign(tuple(made), Site(gravity=G))
    log = join(campaign)
    assert np.all(np.diff(log.time) > 0) and log.recording[0] == 0
    twice = with_outputs(campaign, dataclasses.replace(log, accel=2.0 * log.accel))
    for recording, given in zip(twice.recordings, made, strict=True):
        np.testing.assert_array_equal(recording.accel, 2.0 * given.accel)
        np.testing.assert_array_equal(recording.time, given.time)


def test_after_the_campaign_a_bias_step_stays_and_this_is_said():
    time, force, position, noise = tumble(seed=2)
    output = force @ (np.eye(3) + MATRIX).T + BIAS + noise
    output[:, 2] += 3e-3
    effect = fitted(
        "bias_step", (2,), 3e-3, "m/s^2", settings=(("time", 250.0),), clock=(0.0, 500.0)
    )
    later = Recording(time + 9000.0, accel=output, position=position)
    made = compensate(calibrated(effect), later)
    assert np.sqrt(np.mean((made.accel - force)[:, 2] ** 2)) < NOISE
    assert len(made.notes) == 1 and "clock" in made.notes[0]


def lagged(probe, time, tau):
    """First-order lag, by the recursion for a piecewise constant input between close samples."""
    state, made = probe[0], np.empty_like(probe)
    before = probe[0]
    for k, value in enumerate(probe):
        step = time[k] - time[k - 1] if k else 0.0
        middle = 0.5 * (value + before)
        state = middle + (state - middle) * np.exp(-step / tau)
        made[k], before = state, value
    return made


def thermal_device(lag):
    """A gyro triad with biases quadratic in temperature, 0…50 °C, whose x element lags the probe."""
    names = tuple(f"gyro.bias[{i}]" for i in range(3))
    series = np.array([[1e-3, 2e-3, 0.0], [4e-4, -2e-4, 1e-4], [-1e-4, 0.0, 2e-4]])
    curve = Curve(Polynomial(2, 0.0, 50.0), jnp.asarray(series))
    effects = (fitted("thermal_lag", (0,), 1.0, "1", "gyro", (("time_constant", lag),)),)
    known = TriadCalibration(curve, jnp.zeros((9, 9)), names, "static")
    return Calibration(
        G, None, known, temperature_range=(0.0, 50.0), effects=effects if lag else ()
    )


@pytest.mark.slow
def test_a_thermal_lag_is_taken_away_down_to_the_noise():
    rng = np.random.default_rng(3)
    time = np.arange(4000) * 1.0
    probe = np.interp(time, [0, 300, 1500, 2000, 3500, 4000], [2, 2, 48, 48, 5, 5])
    element = lagged(probe, time, 120.0)

    def bias(temperature):
        x = (temperature - 25.0) / 25.0
        return np.stack(
            [1e-3 + 4e-4 * x - 1e-4 * (2 * x**2 - 1), 2e-3 - 2e-4 * x,
             1e-4 * x + 2e-4 * (2 * x**2 - 1)], axis=1
        )  # fmt: skip

    output = bias(probe)
    output[:, 0] = bias(element)[:, 0]
    output += 2e-6 * rng.standard_normal(output.shape)
    recording = Recording(time, gyro=output, temperature=probe[:, None])
    before = compensate_recording(thermal_device(0.0), recording)[1]
    after = compensate_recording(thermal_device(120.0), recording)[1]
    assert np.sqrt(np.mean(before[:, 0] ** 2)) > 1e-5
    # 2e-6 rad/s of noise, its rms known to 1.1 %, and what smoothing of the probe's corners leaves.
    assert np.sqrt(np.mean(after[:, 0] ** 2)) < 2.1e-6
    np.testing.assert_array_equal(after[:, 1:], before[:, 1:])


@pytest.mark.slow
def test_g_sensitivity_is_taken_away_with_the_compensated_specific_force():
    time, force, position, noise = tumble(seed=4)
    rng = np.random.default_rng(5)
    d = np.array([3e-4, -2e-4, 1e-4])  # rad/s/g, row of the z gyro
    accel = force @ (np.eye(3) + MATRIX).T + BIAS + noise
    gyro = 1e-6 * rng.standard_normal(force.shape)
    gyro[:, 2] += (force / G) @ d
    effect = fitted("g_sensitivity", (2,), d, "rad/s/g", "gyro", (("axes", "xyz"),))
    calibration = Calibration(
        G, triad("accel", BIAS, MATRIX), triad("gyro", np.zeros(3), np.zeros((3, 3)), FULL),
        effects=(effect,),
    )  # fmt: skip
    _, rate, _ = compensate_recording(calibration, Recording(time, accel=accel, gyro=gyro))
    # 1e-6 rad/s of its own noise; D times the accelerometers' noise is 1e-8.
    assert np.sqrt(np.mean(rate**2, axis=0)).max() < 1.05e-6


def test_hysteresis_keeps_the_scale_of_the_recordings_it_was_fitted_on():
    time = np.arange(3000) * 1.0
    whole = np.interp(time, [0, 1000, 2000, 3000], [-20.0, 60.0, -20.0, 20.0])
    half, radius, h = 40.0, 0.1, 2e-5
    width = 2.0 * radius * half
    played = np.empty_like(whole)
    state = whole[0]
    for k, value in enumerate(whole):
        state = min(max(state, value - width), value + width)
        played[k] = state
    gyro = np.zeros((3000, 3))
    gyro[:, 0] = h * (played - whole) / width
    effect = fitted(
        "thermal_hysteresis", (0,), h, "rad/s", "gyro",
        (("radius", radius), ("loop", "play"), ("on", "bias")), temperature=(-20.0, 60.0),
    )  # fmt: skip
    gyros = triad("gyro", np.zeros(3), np.zeros((3, 3)), FULL)
    calibration = Calibration(G, None, gyros, effects=(effect,))
    # The first 900 s alone do not reach 60 °C; the loop's width must be the campaign's all the same.
    part = Recording(time[:900], gyro=gyro[:900], temperature=whole[:900, None])
    rate = compensate(calibration, part).gyro
    # The probe is smoothed over 20 s, which moves the play's corners by less than 1 % of the loop.
    assert np.abs(rate[:, 0]).max() < 0.01 * h < 0.1 * np.abs(gyro[:900, 0]).max()


def test_a_higher_degree_is_of_the_polynomials_it_was_fitted_beside():
    # Beside a cubic on −20…60 °C the next term is T4(x) = 8x⁴ − 8x² + 1; the calibration here is constant.
    time = np.arange(900.0)
    probe = np.linspace(-20.0, 60.0, 900)
    x = (probe - 20.0) / 40.0
    gyro = np.zeros((900, 3))
    gyro[:, 1] = 3e-5 * (8 * x**4 - 8 * x**2 + 1)
    effect = FittedEffect(
        "temperature_order", "gyro", (1,), (("on", "bias"), ("terms", 1)), np.array([3e-5]),
        np.zeros((1, 1)), "rad/s", degree=3, scale=(-20.0, 60.0),
    )  # fmt: skip
    gyros = triad("gyro", np.zeros(3), np.zeros((3, 3)), FULL)
    calibration = Calibration(G, None, gyros, effects=(effect,), temperature_range=(0.0, 10.0))
    rate = compensate(calibration, Recording(time, gyro=gyro, temperature=probe[:, None])).gyro
    np.testing.assert_allclose(rate, 0.0, atol=1e-11)  # a straight ramp is not changed by smoothing


def test_settling_follows_each_move_of_the_recording():
    time, force, position, noise = tumble(seed=6)
    tau, size = 4.0, 2e-3
    since = time - np.repeat(time[::60], 60)
    output = force @ (np.eye(3) + MATRIX).T + BIAS + noise
    output[:, 0] += size * np.exp(-since / tau)
    effect = fitted(
        "settling", (0,), size, "m/s^2", settings=(("time_constant", tau), ("size", "equal"))
    )
    recording = Recording(time, accel=output, position=position)
    assert left(calibrated(), recording, force) > 2.0 * NOISE
    assert left(calibrated(effect), recording, force) < NOISE


def test_simulation_puts_the_effects_on_ideal_inputs_and_compensation_takes_them_off():
    time, force, position, _ = tumble(seed=7)
    effects = (
        fitted("second_order", (1,), 4e-3, "m/s^2/g^2"),
        fitted("third_order", (0,), -2e-3, "m/s^2/g^3"),
        fitted("drift", (2,), 1e-6, "m/s^2/s", settings=(("on", "bias"),), clock=(0.0, 700.0)),
    )  # fmt: skip
    calibration = calibrated(*effects)
    made = simulate(calibration, Recording(time, accel=force, position=position))
    expected = force @ (np.eye(3) + MATRIX).T + BIAS
    expected[:, 1] += 4e-3 * (force[:, 1] / G) ** 2
    expected[:, 0] -= 2e-3 * (force[:, 0] / G) ** 3
    expected[:, 2] += 1e-6 * (time - 350.0)
    np.testing.assert_allclose(made.accel, expected, rtol=0, atol=1e-12)
    back = compensate(calibration, Recording(time, accel=made.accel, position=position))
    np.testing.assert_allclose(back.accel, force, rtol=0, atol=1e-10)


def test_an_effect_of_one_sample_takes_part_in_its_compensation():
    plain, augmented = calibrated(), calibrated(fitted("second_order", (1,), 0.1, "m/s^2/g^2"))
    raw = jnp.array([1.0, 9.0, 2.0]), jnp.zeros(3), 20.0
    force = eqx.filter_jit(augmented)(*raw)[0]
    # The y output without 0.1 m/s² (f / g)² is what the parameters alone compensate.
    bare = raw[0].at[1].add(-0.1 * (force[1] / augmented.gravity) ** 2)
    np.testing.assert_allclose(eqx.filter_jit(plain)(bare, *raw[1:])[0], force, rtol=1e-12)


@pytest.mark.parametrize(
    ("effect", "reason"),
    [
        (fitted("gravity_error", (0, 1, 2), 1e-4, "1"), "test station"),
        (fitted("quantization", (0,), 1.0, "1"), "rounding"),
        (fitted("interference", (0,), [1e-4, 0.0], "m/s^2", settings=(("frequency", 0.01),)), "phase"),
        (fitted("drift", (0,), 1e-6, "m/s^2/s", settings=(("on", "bias"),)), "no common clock"),
        (
            fitted("temperature_rate", (0,), 1e-4, "m/s^2/(degC/min)",
                   settings=(("time_constant", 0.0), ("on", "bias"))),
            "temperature",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_taken_away_is_said_in_one_line(effect, reason, tmp_path):
    time, force, _, _ = tumble()
    pl.DataFrame(
        {"time": time} | {f"accel_{a}": force[:, k] for k, a in enumerate("xyz")}
    ).write_csv(tmp_path / "log.csv")
    made = compensate_file(calibrated(effect), tmp_path / "log.csv")
    lines = [n for n in made.notes if effect.name in n]
    assert len(lines) == 1 and reason in lines[0] and "\n" not in lines[0]
    plain = compensate_file(calibrated(), tmp_path / "log.csv")
    assert made.table.equals(plain.table)


def test_the_file_keeps_effects_exactly(tmp_path):
    effect = FittedEffect(
        "thermal_lag", "accel", (0,), (("time_constant", 120.5),), np.array([0.97]),
        np.array([[1e-4]]), "1", (10.0, 900.0), (-40.0, 60.0), 1.25, 3, (-39.5, 59.5),
    )  # fmt: skip
    write_calibration(calibrated(effect), tmp_path / "c.json")
    (back,) = read_calibration(tmp_path / "c.json").effects
    assert back.name == effect.name and back.settings == effect.settings
    assert (back.clock, back.temperature, back.greatest_input) == (
        (10.0, 900.0),
        (-40.0, 60.0),
        1.25,
    )
    assert (back.degree, back.scale) == (3, (-39.5, 59.5))
    np.testing.assert_array_equal(back.coefficients, effect.coefficients)
    np.testing.assert_array_equal(back.covariance, effect.covariance)
    write_calibration(calibrated(), tmp_path / "plain.json")
    assert "effects" not in json.loads((tmp_path / "plain.json").read_text())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "warp"}, "warp"),
        ({"settings": {"tau": 1.0}}, "settings"),
        ({"unit": "g"}, "unit"),
        ({"channels": ["accel_x", "gyro_x"]}, "channels"),
        ({"channels": []}, "channels"),
        ({"coefficients": [1.0, 2.0]}, "covariance"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_a_wrong_entry_is_one_clear_error(change, said, tmp_path):
    write_calibration(
        calibrated(fitted("second_order", (1,), 1e-3, "m/s^2/g^2")), tmp_path / "c.json"
    )
    content = json.loads((tmp_path / "c.json").read_text())
    content["effects"][0] |= change
    (tmp_path / "c.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=said) as caught:
        read_calibration(tmp_path / "c.json")
    assert "\n" not in str(caught.value) and "c.json" in str(caught.value)


def test_an_effect_of_ones_own_is_read_with_the_catalogue_that_has_it(tmp_path):
    k2 = next(e for e in CATALOGUE if e.name == "second_order")
    write_calibration(
        calibrated(fitted("second_order", (1,), 1e-3, "m/s^2/g^2")), tmp_path / "c.json"
    )
    with pytest.raises(ValueError, match="catalogue"):
        read_calibration(tmp_path / "c.json", effects=[e for e in CATALOGUE if e is not k2])
    assert read_calibration(tmp_path / "c.json", effects=[k2]).effects[0].name == "second_order"


@pytest.mark.slow
def test_a_diagnosis_after_a_known_calibration_gives_one_calibration_for_raw_outputs():
    # Truth: raw = M0 (M1 a + b1 + e) + b0, with e = K2 f² on y; the second stage is what is left after M0.
    rng = np.random.default_rng(8)
    names = tuple(f"accel.bias[{i}]" for i in range(3))
    names += tuple(f"accel.matrix[{i},{j}]" for i, j in FULL)
    low, high = -20.0, 60.0

    def stage(size, degree):
        series = size * rng.standard_normal((degree + 1, 12))
        curve = Curve(Polynomial(degree, low, high), jnp.asarray(series))
        count = series.size
        known = TriadCalibration(curve, 1e-12 * jnp.eye(count), names, "reference")
        return Calibration(G, known, temperature_range=(low, high)), series

    (first, c0), (second, c1) = stage(1e-2, 2), stage(1e-3, 1)
    k2 = 3e-3
    second = eqx.tree_at(
        lambda c: c.effects, second, (fitted("second_order", (1,), k2, "m/s^2/g^2"),)
    )
    time, force, position, _ = tumble(seed=9)
    temperature = np.linspace(low, high, len(time))
    x = (2.0 * temperature - (low + high)) / (high - low)
    cheb = np.polynomial.chebyshev.chebvander(x, 2)
    at0, at1 = cheb @ c0, cheb[:, :2] @ c1

    def put_out(values, inputs):
        matrix = np.eye(3) + values[:, 3:].reshape(-1, 3, 3)
        return np.einsum("tij,tj->ti", matrix, inputs) + values[:, :3]

    left_over = put_out(at1, force)
    left_over[:, 1] += k2 * (force[:, 1] / G) ** 2
    recording = Recording(
        time, accel=put_out(at0, left_over), temperature=temperature[:, None], position=position
    )
    pair = succeeding(first, second)
    back, _, _ = compensate_recording(pair, recording)
    # The effect's 3e-3 m/s² is scaled by the first stage's factor at mid temperature only: ±1 % of it.
    assert np.abs(back - force).max() < 0.03 * k2
    exact = succeeding(first, eqx.tree_at(lambda c: c.effects, second, ()))
    plain = Recording(
        time, accel=put_out(at0, put_out(at1, force)), temperature=temperature[:, None]
    )
    np.testing.assert_allclose(compensate_recording(exact, plain)[0], force, rtol=0, atol=1e-10)
    # Independent stages of 1e-6 each: √2 as uncertain, but for the matrices' percent and the
    # polynomials' larger span.
    sigma = np.asarray(exact.accel.standard_deviations(20.0))
    alone = np.hypot(
        np.asarray(first.accel.standard_deviations(20.0)),
        np.asarray(second.accel.standard_deviations(20.0)),
    )
    np.testing.assert_allclose(sigma[3:], alone[3:], rtol=0.1)


def test_taking_a_known_calibration_away_needs_the_temperature_it_depends_on():
    time, force, position, _ = tumble()
    campaign = Campaign((Recording(time, gyro=force, position=position),))
    with pytest.raises(ValueError, match="temperature"):
        taken_away(campaign, thermal_device(60.0))


@pytest.mark.slow
def test_a_diagnosis_after_its_own_calibration_finds_nothing():
    truth = 8e-4

    def k2(f, t):
        return only(1, truth * f[:, 1] ** 2)

    campaign = measured(seed=4, effect=k2)
    found, augmented = diagnose_campaign(campaign)
    assert [e.name for e in found.effects] == ["second_order"]
    (effect,) = augmented.effects
    assert effect.channels == (1,)
    sigma = float(np.sqrt(np.asarray(effect.covariance)[0, 0]))
    assert abs(float(np.asarray(effect.coefficients)[0]) - truth) < 3.0 * sigma
    # The campaign carries its effect no longer, and what is applied to raw outputs stays one file.
    again, pair = diagnose_campaign(campaign, calibration=augmented)
    assert again.verdict == "consistent"
    assert [e.name for e in pair.effects] == ["second_order"]
    raw = campaign.recordings[0]
    one, two = (compensate(c, raw).accel for c in (augmented, pair))
    # The second fit moves the parameters by less than the noise of one sample.
    assert np.abs(one - two).max() < WHITE
