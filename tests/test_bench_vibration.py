"""A line at all rests that outweighs the accelerometers' noise; logs by hand from NumPy."""

import numpy as np
import pytest

from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign


RATE, NOISE, G = 200.0, 0.01, 9.81  # Hz, m/s² of a sample, m/s²


def rests(shake, *, labelled=True, colour=False, seed=0):
    """Twenty rests of 8 s in several poses with a second between them; `shake(time)` along the room's x, m/s²."""
    rng = np.random.default_rng(seed)
    ups = np.concatenate([np.eye(3), -np.eye(3)])[np.arange(20) % 6]
    still, turn = int(8 * RATE), int(RATE)
    time = np.arange(20 * (still + turn)) / RATE
    accel, position = np.zeros((len(time), 3)), np.full(len(time), -1)
    for k, up in enumerate(ups):
        a = k * (still + turn)
        accel[a : a + still] = G * up
        position[a : a + still] = k
        across = np.roll(up, 1)
        accel[a : a + still] += np.outer(shake(time[a : a + still]), across)
        path = np.linspace(0.0, 1.0, turn)[:, None]
        then = ups[(k + 1) % 20]
        way = (1.0 - path) * up + path * then + 1e-3
        accel[a + still : a + still + turn] = G * way / np.linalg.norm(way, axis=1, keepdims=True)
    white = rng.standard_normal(accel.shape)
    if colour:  # a filter's, which falls towards half the rate
        for k in range(1, len(white)):
            white[k] += 0.8 * white[k - 1]
    log = Recording(time=time, accel=accel + NOISE * white, position=position if labelled else None)
    seen = check_campaign(Campaign((log,), Site(gravity=G)))
    return [f for f in seen.findings if f.kind == "vibration"]


def test_a_bench_that_vibrates_is_told_with_frequency_and_size():
    (told,) = rests(lambda t: 0.05 * np.sin(2 * np.pi * 64.0 * t))
    assert told.severity == "note" and "the bench vibrates" in told.statement
    # Bins of 1.6 Hz; 0.05 / √2 is 0.035 m/s², of which the band of seven bins has all but a percent.
    assert dict(told.evidence)["frequency"] == pytest.approx(64.0, abs=1.6)
    assert dict(told.evidence)["rms"] == pytest.approx(0.05 / np.sqrt(2.0), rel=0.1)
    assert dict(told.evidence)["noise"] == pytest.approx(NOISE * np.sqrt(3.0), rel=0.1)


@pytest.mark.parametrize(
    "shake",
    [
        lambda t: 0.0 * t,
        lambda t: 0.005 * np.sin(2 * np.pi * 64.0 * t),  # less than the noise
        lambda t: 0.1 * np.sin(2 * np.pi * 64.0 * t) * (t > 140.0),  # a fan in a few rests
    ],
)
def test_noise_faint_lines_and_a_few_rests_are_none(shake):
    assert rests(shake) == []


def test_a_filters_colour_is_no_line():
    assert rests(lambda t: 0.0 * t, colour=True) == []


def test_a_hands_tremor_is_no_bench():
    assert rests(lambda t: 0.05 * np.sin(2 * np.pi * 9.0 * t), labelled=False) == []
