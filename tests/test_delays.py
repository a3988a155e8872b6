"""Delays told by the ramps of a rate table; data from plain NumPy."""

import json

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.calibration.calibration import write_calibration
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose
from inertiax.diagnose.observations.blocks import join
from inertiax.diagnose.observations.delay_ramps import find_delay
from inertiax.diagnose.observations.model_rows import calibrated
from inertiax.diagnose.pipeline import diagnose_campaign
from inertiax.effects import CATALOGUE
from inertiax.exports.compensated_recording import compensate_recording
from inertiax.plausibility import check_campaign


# What a delay could be taken for here: a scale factor that bends, or differs by sign, changes on the same ramps.
ALIKE = [e for e in CATALOGUE if e.name in ("time_delay", "rate_nonlinearity", "scale_asymmetry")]
NOISE = 2e-4  # rad/s, one sample


def rate_table(delay=(0.0, 0.0, 0.0), curve=0.0, rate=50.0, seed=0, earth=False):
    """Ramps to plateaus of both signs about three axes; `curve` is the change of a scale factor up to 100 deg/s.

    `earth` adds the Earth's rate, of 45° north, about an axis that turns with the table.
    """
    rng = np.random.default_rng(seed)
    corners, levels, still = [0.0], [np.zeros(3)], []
    for axis in np.eye(3):
        still.append((corners[-1], corners[-1] + 8.0))
        corners.append(corners[-1] + 8.0)
        levels.append(np.zeros(3))
        for speed in np.deg2rad([20, -20, 60, -60, 100, -100]):
            for seconds, level in ((1.0, speed), (6.0, speed), (1.0, 0.0), (2.0, 0.0)):
                corners.append(corners[-1] + seconds)
                levels.append(level * axis)
    time = np.arange(0.0, corners[-1], 1.0 / rate)
    value = lambda t, c: np.interp(t, corners, np.array(levels)[:, c])
    if earth:
        value = with_earth(value, corners[-1])
    given = np.stack([value(time, c) for c in range(3)], axis=1)
    late = np.stack([value(time - delay[c], c) for c in range(3)], axis=1)
    felt = late * (1.0 + curve * (late / np.deg2rad(100.0)) ** 2)
    output = felt @ (np.eye(3) + 1e-3 * rng.standard_normal((3, 3))).T + 1e-4
    output = output + NOISE * rng.standard_normal(output.shape)
    position = np.full(len(time), -1)
    for number, (start, end) in enumerate(still):
        position[(time >= start) & (time < end)] = number
    recording = Recording(
        time=time, gyro=output, temperature=np.full((len(time), 1), 25.0), position=position, reference_gyro=given,
    )  # fmt: skip
    model = ModelChoice(gyro_estimator="reference", temperature_degree=0)
    return Campaign((recording,), Site(9.81), Rig(None, 5e-6), model, "consumer")


def with_earth(rates, end):
    """The same with the Earth's rate in the case, which turns about x, then y, then z."""
    fine = np.arange(0.0, end, 0.01)
    angles = np.cumsum([rates(fine, c) for c in range(3)], axis=1).T * 0.01
    turned = (
        Rotation.from_euler("XYZ", angles)
        .inv()
        .apply(7.292115e-5 * np.sqrt(0.5) * np.array([0.0, 1.0, 1.0]))
    )
    return lambda t, c: rates(t, c) + np.interp(t, fine, turned[:, c])


def seen(campaign):
    """The delay of the one triad, as a diagnosis looks for it before all else."""
    with jax.enable_x64(True):
        fitted = calibrate_device(campaign, checked=True)
        (model,) = (m for m in (calibrated(fitted, t) for t in ("accel", "gyro")) if m is not None)
        return find_delay(join(campaign), model)


@pytest.mark.slow
def test_a_delay_of_two_gyros_is_named_and_sized_and_the_third_left_alone():
    with jax.enable_x64(True):
        found = diagnose(rate_table((3e-3, 0.0, -1e-3)))
    (effect,) = found.effects
    assert (effect.name, effect.channels) == ("time_delay", ("gyro_x", "gyro_z"))
    for (name, value), truth in zip(effect.parameters, (3e-3, -1e-3)):
        assert name.startswith("delay (gyro_")
        assert abs(value.value - truth) < 4.0 * value.std < 1e-4  # 4 sigma: a chance of 1e-4
    assert {w.driver for w in found.where} == {"rate_of_change"}
    assert effect.evidence.held_out_gain > 0.5
    assert "time_delay" not in found.not_testable


@pytest.mark.slow
def test_stated_errors_are_those_of_repetitions():
    pulls = []
    for seed in range(12):
        delay = seen(rate_table((2e-3, 2e-3, 2e-3), seed=seed))
        pulls.append((np.asarray(delay.value) - 2e-3) / delay.std)
    # 36 pulls of a t-distribution with about 20 degrees: a scatter of 1.05 ± 0.125; four of that, so that a factor of
    # two is seen.
    assert 0.55 < np.std(pulls) < 1.55
    assert abs(np.mean(pulls)) < 0.7  # 1.05 / sqrt(36), four of that


@pytest.mark.slow
@pytest.mark.parametrize("curve", [0.0, 2e-3])
def test_no_delay_is_found_where_there_is_none_even_if_the_scale_factor_bends(curve):
    delays = [seen(rate_table(curve=curve, seed=seed)) for seed in range(6)]
    assert all(d.found == () for d in delays)
    with jax.enable_x64(True):
        found = diagnose(rate_table(curve=curve), effects=ALIKE)
    assert "time_delay" not in {e.name for e in found.effects}
    least = [d for d in found.audit.detectable if d.name == "time_delay"]
    assert len(least) == 3 and all(d.unit == "s" for d in least)
    # What the bend leaves in the ramps hides delays that white noise alone would show.
    most = 3e-4 if curve == 0.0 else 5e-3
    assert all(1e-6 < d.size < most for d in least)


def test_a_coarse_log_has_no_ramps_to_show():
    assert seen(rate_table((0.1, 0.1, 0.1), rate=5.0)) is None


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.08, 0.4])
def test_rows_far_apart_tell_delays_of_several_rows_where_ramps_last_longer(delay):
    found = seen(rate_table((delay,) * 3, rate=12.5))
    assert found.found == (0, 1, 2)
    # A kink between two rows lies a twelfth of a row beside its chord at the most, in each of a ramp's corners.
    np.testing.assert_allclose(found.value, delay, atol=1e-3)
    with jax.enable_x64(True):
        named = diagnose(rate_table((delay,) * 3, rate=12.5, earth=True))
    assert [e.name for e in named.effects] == ["time_delay"]


def told(campaign):
    """What the checks say of the clocks."""
    return [f for f in check_campaign(campaign).findings if f.kind == "delay"]


@pytest.mark.parametrize("rate", [12.5, 50.0])
def test_the_checks_say_by_how_much_references_in_columns_are_early(rate):
    (early,) = told(rate_table((0.1,) * 3, rate=rate))
    evidence = dict(early.evidence)
    # 5 sigma: a chance of 1e-6; at 12.5 Hz 0.1 s lies between two rows, whose chord leaves out a kink.
    assert abs(evidence["seconds"] + 0.1) < max(5.0 * evidence["std"], 1e-3)
    assert "0.100 s early" in early.statement
    assert told(rate_table(rate=rate)) == []


def test_a_rate_that_was_told_is_no_motion_whose_clock_is_late():
    campaign = rate_table(rate=10.0)
    (recording,) = campaign.recordings
    given = recording.reference_gyro
    jumps = np.deg2rad(20.0) * np.round(given / np.deg2rad(20.0))  # holds and jumps, as a command
    assert np.abs(np.diff(jumps, axis=0)).max() > 0.3
    shown = Recording(
        time=recording.time, gyro=recording.gyro, temperature=recording.temperature, position=recording.position,
        reference_gyro=np.roll(jumps, -8, axis=0),
    )  # fmt: skip
    assert (
        told(Campaign((shown,), campaign.site, campaign.rig, campaign.model, campaign.grade)) == []
    )


@pytest.mark.slow
def test_the_augmented_calibration_takes_the_delay_away(tmp_path):
    campaign = rate_table((4e-3, 4e-3, 4e-3))
    with jax.enable_x64(True):
        _, calibration = diagnose_campaign(campaign, effects=ALIKE)
    write_calibration(calibration, tmp_path / "calibration.json")
    stored = json.loads((tmp_path / "calibration.json").read_text())["effects"]
    assert [e["name"] for e in stored] == ["time_delay"] * 3
    (recording,) = campaign.recordings
    rate = np.asarray(compensate_recording(calibration, recording)[1])
    given = recording.reference_gyro
    ramp = np.linalg.norm(np.gradient(given, axis=0), axis=1) > 1e-3
    # 4 ms of 100 deg/s² are 7 mrad/s; corners, of which the derivative knows nothing, and its noise are left.
    before = np.sqrt(np.mean((recording.gyro - given)[ramp] ** 2))
    after = np.sqrt(np.mean((rate - given)[ramp] ** 2))
    assert after < 0.35 * before


def tilting_table(delay, arm, seed=0):
    """Rests at quarter turns about x and about y, all in one sense, of an accelerometer beside the axes."""
    rng, rate = np.random.default_rng(seed), 100.0
    turn, still = [np.zeros(200)], [(0, 200)]
    for _ in range(9):
        s = np.arange(1, 251) / 250.0
        smooth = 10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5
        turn += [turn[-1][-1] + 0.5 * np.pi * smooth, np.full(300, turn[-1][-1] + 0.5 * np.pi)]
        end = sum(map(len, turn))
        still.append((end - 290, end - 10))
    angle = np.concatenate(turn)
    halves = []
    for axis in ("x", "y"):
        # From the case to the world, for a specific force of one g upwards.
        given = Rotation.from_euler(axis, angle[:, None]).inv().apply([0.0, 0.0, 9.81])
        omega = np.gradient(angle, 1.0 / rate)[:, None] * np.eye(3)["xy".index(axis)]
        swung = np.cross(np.gradient(omega, 1.0 / rate, axis=0), arm)
        swung += np.cross(omega, np.cross(omega, arm))
        halves.append((given, omega, given + swung))
    given, omega, felt = (np.concatenate(x) for x in zip(*halves))
    time = np.arange(len(given)) / rate
    late = np.stack([np.interp(time - delay, time, x) for x in felt.T], axis=1)
    output = late @ (np.eye(3) + 1e-3 * rng.standard_normal((3, 3))).T + 0.02
    position = np.full(len(time), -1)
    for number, (start, stop) in enumerate(still):
        for half in (0, 1):
            position[half * len(angle) + start : half * len(angle) + stop] = number + half * len(
                still
            )
    recording = Recording(
        time=time, accel=output + 2e-3 * rng.standard_normal(output.shape), position=position,
        temperature=np.full((len(time), 1), 25.0), reference_accel=given, reference_gyro=omega,
    )  # fmt: skip
    model = ModelChoice(accel_estimator="reference", temperature_degree=0)
    return Campaign((recording,), Site(9.81), Rig(5e-6, None), model, "consumer")


@pytest.mark.parametrize("delay", [0.0, 4e-3])
def test_an_accelerometer_beside_the_axes_is_not_late(delay):
    # Three centimetres under 1.5 rad/s² are what some tenths of a millisecond of delay would be.
    for seed, arm in enumerate(([0.0, 0.03, 0.0], [0.03, -0.02, 0.03], [-0.02, 0.0, -0.03])):
        found = seen(tilting_table(delay, np.array(arm), seed))
        assert found.found == ((0, 1, 2) if delay else ())
        assert np.all(np.abs(found.value - delay) < 4.0 * found.std)  # 4 sigma: a chance of 1e-4
        assert np.all(found.std < 2e-5)
