"""Lines in the samples of rests; data from plain NumPy."""

import json

import jax
import numpy as np
import pytest

from diagnose_data import G
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose.observations.blocks import join
from inertiax.diagnose.observations.rest_lines import find_lines, without_lines
from inertiax.diagnose.pipeline import diagnose_campaign


RATE = 50.0  # Hz
NOISE = 0.01  # m/s², one sample
MOVE, REST = 3.0, 9.0  # s


def attitudes(rests, seconds=REST, seed=0, added=None):
    """Rests in random attitudes, labelled, a few seconds apart, not in even steps; `added(time, since)` goes to x."""
    rng = np.random.default_rng(seed)
    force, position, since = [], [], []
    for k in range(rests):
        pose = rng.standard_normal(3)
        still = int((seconds + rng.uniform(-1.0, 1.0)) * RATE)
        moving = int((MOVE + rng.uniform(-1.0, 1.0)) * RATE)
        force += [pose / np.linalg.norm(pose)] * (moving + still)
        position += [-1] * moving + [k] * still
        since += [-1.0] * moving + list(np.arange(still) / RATE)
    time, force = np.arange(len(force)) / RATE, G * np.array(force)
    position, since = np.array(position), np.array(since)
    output = force @ (np.eye(3) + np.tril(3e-3 * rng.standard_normal((3, 3)))).T + 0.02
    output = output + NOISE * rng.standard_normal(output.shape)
    if added is not None:
        output[:, 0] += added(time, np.where(position >= 0, since, 0.0), position, rng)
    recording = Recording(time=time, accel=output, position=position)
    model = ModelChoice(accel_estimator="invariant", temperature_degree=0)
    return Campaign((recording,), Site(G), Rig(), model, "consumer")


def sine(amplitude, frequency):
    return lambda time, *_: amplitude * np.sin(2.0 * np.pi * frequency * time + 0.7)


@pytest.mark.parametrize("frequency", [0.06, 0.35, 7.3, 24.0])
def test_a_line_is_found_with_its_frequency_and_amplitude(frequency):
    log = join(attitudes(20, added=sine(0.02, frequency)))
    (line,) = find_lines(log, "accel").lines
    # 4 sigma: a chance of 1e-4
    assert line.name == "accel_x"
    assert abs(line.frequency - frequency) < 4.0 * line.frequency_std < 1e-3
    assert abs(line.amplitude - 0.02) < 4.0 * line.amplitude_std
    # Cramér and Rao's bound of an amplitude, σ √(2 / N), where the rests' means take nothing from it.
    if frequency > 1.0:
        bound = NOISE * np.sqrt(2.0 / int((log.position >= 0).sum()))
        assert line.amplitude_std == pytest.approx(
            bound, rel=0.3
        )  # noise known from 20 rests: 3 σ are half
    assert find_lines(without_lines(log, [line]), "accel").lines == ()


def tremor(time, since, position, rng):
    """0.2 Hz wide about 5 Hz, twice the noise, with a phase of its own in each rest."""
    phase = rng.uniform(0.0, 2.0 * np.pi, position.max() + 2)[position]
    speed = 5.0 + 0.2 * rng.standard_normal(position.max() + 2)[position]
    return 2.0 * NOISE * np.sin(2.0 * np.pi * speed * time + phase)


def fan(time, since, position, rng):
    """At one frequency and in each rest with a phase of its own."""
    return 2.0 * NOISE * np.sin(12.0 * np.pi * time + rng.uniform(0.0, 6.3, 99)[position])


def creep(time, since, position, rng):
    """A slope of its own in each rest, ten times the noise in all."""
    return NOISE * rng.standard_normal(position.max() + 2)[position] * since


@pytest.mark.parametrize(
    "added", [None, tremor, fan, creep], ids=["white", "tremor", "fan", "creep"]
)
def test_what_has_no_phase_of_the_log_is_no_line(added):
    for seed in range(3):
        found = find_lines(join(attitudes(20, seed=seed, added=added)), "accel")
        assert found.lines == ()


def test_what_settles_in_even_steps_is_no_line():
    step = int((MOVE + REST) * RATE)
    time = np.arange(20 * step) / RATE
    since = (np.arange(20 * step) % step - MOVE * RATE) / RATE
    position = np.where(since >= 0.0, np.arange(20 * step) // step, -1)
    rng = np.random.default_rng(1)
    output = NOISE * rng.standard_normal((len(time), 3)) + np.array([0.0, 0.0, G])
    output[:, 0] += 0.1 * np.exp(-np.maximum(since, 0.0) / 1.5)
    recording = Recording(time=time, accel=output, position=position)
    log = join(Campaign((recording,), Site(G), Rig(), ModelChoice(), "consumer"))
    assert find_lines(log, "accel").lines == ()


def test_a_slow_line_has_no_image_where_rests_follow_each_other():
    # Rests 13 s apart show a line of 0.0203 Hz at 0.057 Hz, too, with a quarter of its amplitude.
    log = join(attitudes(38, seconds=10.0, seed=3, added=sine(0.02, 0.0203)))
    assert find_lines(log, "accel").lines == ()


@pytest.mark.slow
def test_the_least_size_is_that_of_the_whole_band():
    clean = find_lines(join(attitudes(20)), "accel")
    size, (low, high) = clean.sizes[0], clean.band
    assert low < 0.05 and high == pytest.approx(RATE / 2)
    # Found nine times in ten where it shows worst, at the band's lower end: of eight all but four, a chance of 4e-4.
    seen = [
        len(find_lines(join(attitudes(20, seed=k, added=sine(size, 1.05 * low))), "accel").lines)
        for k in range(8)
    ]
    assert sum(seen) >= 4


@pytest.mark.slow
def test_a_line_that_moves_means_is_named_and_leaves_the_parameters_alone():
    clean = diagnose_campaign(attitudes(24, seed=2))
    with jax.enable_x64(True):
        found, calibration = diagnose_campaign(attitudes(24, seed=2, added=sine(0.1, 0.35)))
    assert found.verdict == "missing-physics"
    (effect,) = found.effects
    assert (effect.name, effect.channels) == ("interference", ("accel_x",))
    sizes = dict(effect.parameters)
    assert abs(sizes["frequency"].value - 0.35) < 4.0 * sizes["frequency"].std
    assert abs(sizes["peak"].value - 0.1) < 4.0 * sizes["peak"].std
    assert {(w.channel, w.driver) for w in found.where} == {("accel_x", "time")}
    (stored,) = calibration.effects
    assert stored.name == "interference" and dict(stored.settings)["frequency"] == pytest.approx(
        0.35, abs=1e-3
    )
    before, after = (
        np.ravel(np.asarray(c.accel.curve.coefficients)) for c in (clean[1], calibration)
    )
    sigma = np.sqrt(np.diag(np.asarray(clean[1].accel.covariance)))
    # An amplitude known to 0.3 % moves means by no more of what the line did, which was 20 sigma of a mean.
    assert np.max(np.abs(after - before) / sigma) < 0.3
    assert json.loads(found.to_json())["effects"][0]["name"] == "interference"


@pytest.mark.slow
def test_a_line_that_averages_out_is_a_note():
    found, calibration = diagnose_campaign(attitudes(24, seed=2, added=sine(0.01, 17.3)))
    assert found.verdict == "consistent" and calibration.effects == ()
    (note,) = (n for n in found.notes if n.startswith("accel_x: a line of 17.3 Hz"))
    assert "averages out" in note
    bands = [d.band for d in found.detectable if d.name == "interference"]
    assert len(bands) == 2 and max(b[1] for b in bands) == pytest.approx(RATE / 2)


@pytest.mark.slow
def test_a_slow_line_has_one_form():
    found, _ = diagnose_campaign(attitudes(38, seconds=10.0, seed=3, added=sine(0.02, 0.0203)))
    (effect,) = found.effects
    assert effect.name == "interference"
    assert sorted(dict(effect.parameters)) == ["coefficient[0]", "coefficient[1]", "frequency"]
