"""Where the temperature's course is unknown within one recording; rows made by hand."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.calibration.fitted_effects import FittedEffect
from inertiax.data.recording import Campaign, Recording
from inertiax.diagnose.estimates.applied_effects import compensate
from inertiax.diagnose.observations.blocks import join
from inertiax.diagnose.observations.signals import since_anew, since_pause
from inertiax.effects import Moment, Signal
from inertiax.effects.effect import lag
from inertiax.effects.thermal_lag import EFFECT, element_behind
from inertiax.physics.temperature import Curve, Polynomial


@pytest.mark.parametrize(
    ("pause", "jump", "step", "paused"),
    [
        (1800.0, 40.0, 1.0, True),  # s, °C, s
        (1800.0, 0.0, 1.0, True),  # it may have gone and come back
        (300.0, 40.0, 1.0, True),
        (300.0, 2.0, 1.0, False),  # a straight line is as good
        (25.0, 40.0, 1.0, False),
        (1800.0, 40.0, 300.0, False),  # six usual steps: a log of few rows
    ],
)
def test_a_long_pause_at_whose_end_the_temperature_is_another_begins_anew(
    pause, jump, step, paused
):
    rows = np.arange(200) * step
    time = np.r_[rows, rows[-1] + pause + rows]
    recording = Recording(
        time=time, accel=np.tile([0.0, 0.0, 9.81], (400, 1)), position=np.zeros(400, int),
        temperature=np.r_[np.zeros(200), np.full(200, jump)][:, None],
    )  # fmt: skip
    found = since_pause(join(Campaign((recording,))))
    if not paused:
        assert found is None
        return
    np.testing.assert_allclose(found, np.r_[rows, rows])


def signal_of(time, temperature, since_anew) -> Signal:
    """A signal of which a lag asks nothing but these."""
    zero = np.zeros((len(time), 3))
    return Signal(
        triad="accel", time=time, input=zero, output=zero, since_power=time, since_start=time, since_move=time,
        move=zero, at_rest=time, temperature=temperature, since_anew=since_anew,
    )  # fmt: skip


def stretches(pause, change):
    """Two ramps of 0.02 °C/s with a pause between them, whose temperatures differ by so much, °C."""
    rows = np.arange(0.0, 600.0, 5.0)
    time = np.r_[rows, rows[-1] + pause + rows]
    probe = np.r_[0.02 * rows, 0.02 * rows[-1] + change - 0.02 * rows]
    return time, probe, len(rows)


@pytest.mark.parametrize(("pause", "change", "anew"), [(1800.0, 30.0, True), (40.0, 1.0, False)])
def test_elements_begin_anew_where_nobody_saw_the_probe_go(pause, change, anew):
    """The recordings of a chamber's settings: each begins in equilibrium, and ramps of minutes follow at once."""
    time, probe, rows = stretches(pause, change)
    parts = [
        Recording(time=time[s], accel=np.tile([0.0, 0.0, 9.81], (rows, 1)),
                  position=np.zeros(rows, int), temperature=probe[s][:, None])
        for s in (slice(rows), slice(rows, None))
    ]  # fmt: skip
    log = join(Campaign(tuple(parts)))
    signal = signal_of(log.time, log.temperature, since_anew(log))
    found = element_behind(signal, 150.0)
    second = lag(time[rows:], probe[rows:], 150.0) if anew else lag(time, probe, 150.0)[rows:]
    np.testing.assert_allclose(found[:rows], lag(time, probe, 150.0)[:rows], atol=1e-9)
    np.testing.assert_allclose(found[rows:], second, atol=1e-9)


@pytest.mark.parametrize(("pause", "change"), [(1800.0, 30.0), (40.0, 1.0)])
def test_a_pause_is_the_same_sample_by_sample(pause, change):
    time, probe, rows = stretches(pause, change)
    online, zero = EFFECT.online, np.zeros(3)
    assert online is not None
    settings: dict[str, Any] = {"time_constant": 150.0}
    state, elements = online.begin(settings, jnp.asarray(probe[0])), []
    for k, step in enumerate(np.diff(time, prepend=-5.0)):
        moment = Moment(
            triad="accel", time=time[k], step=step, first=np.array(k == 0), input=zero, force=zero, rate=zero,
            temperature=jnp.asarray(probe[k]), at_rest=np.array(True), at_temperature=lambda t: jnp.full(3, t),
        )  # fmt: skip
        state, _ = online.follow(state, moment, settings)
        elements.append(float(state[0]))
    since = None if pause < 600.0 else np.r_[time[:rows], time[rows:] - time[rows]]
    signal = signal_of(time, probe, since)
    # 1e-4 °C: rounding in 32 bits of 240 steps at tens of degrees
    np.testing.assert_allclose(elements, element_behind(signal, 150.0), atol=1e-4)


def test_compensation_begins_anew_behind_a_pause():
    """Biases of 1e-4 rad/s/°C by elements 150 s late, which are at the probe's temperature when recording goes on."""
    time, probe, rows = stretches(1800.0, 30.0)
    element = np.r_[lag(time[:rows], probe[:rows], 150.0), lag(time[rows:], probe[rows:], 150.0)]
    values = np.zeros((2, 12))
    values[:, :3] = 30.0 * 1e-4  # from 0 to 60 °C
    names = [f"gyro.bias[{i}]" for i in range(3)]
    names += [f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3)]
    curve = Curve(Polynomial(1, 0.0, 60.0), jnp.asarray(values))
    gyro = TriadCalibration(curve, jnp.zeros((24, 24)), tuple(names), "reference")
    effect = FittedEffect(
        "thermal_lag",
        "gyro",
        (0, 1, 2),
        (("time_constant", 150.0),),
        np.ones(1),
        np.zeros((1, 1)),
        "1",
    )
    calibration = Calibration(9.81, None, gyro, effects=(effect,), temperature_range=(0.0, 60.0))
    log = Recording(
        time=time, gyro=np.repeat(1e-4 * element[:, None], 3, axis=1), temperature=probe[:, None]
    )
    left = np.asarray(compensate(calibration, log).gyro)
    # A straight line over the pause is 2.5 °C behind at its end. In 32 bits 1e-3 °C is left.
    assert np.abs(left).max() < 1e-4 * 5e-3
