"""A converter whose step is coarser than the noise: told as that, and no certainty comes of rests that stand still."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from inertiax.data.recording import Campaign, Recording, Site
from inertiax.diagnose import diagnose
from inertiax.diagnose.observations.blocks import cut, join
from inertiax.plausibility import check_campaign


G = 9.81
RATE, REST, MOVE, RESTS = 100, 450, 150, 16
STEP = G / 64


def hand_log(seed: int, noise: float, step: float | None = STEP) -> Recording:
    """Rests with smooth turns between them, by a sensor of this noise (m/s²) and step."""
    rng = np.random.default_rng(seed)
    poses = Rotation.random(RESTS, random_state=seed)
    phase = (np.arange(MOVE) + 0.5) / MOVE
    smooth = phase - np.sin(2 * np.pi * phase) / (2 * np.pi)
    at = [np.full(REST, 0.0)]
    for k in range(1, RESTS):
        at += [k - 1 + smooth, np.full(REST, float(k))]
    attitude = Slerp(np.arange(RESTS), poses)(np.concatenate(at))
    n = len(attitude)
    accel = (
        1.003 * attitude.inv().apply([0, 0, G])
        + [0.1, -0.06, 0.04]
        + noise * rng.standard_normal((n, 3))
    )
    turned = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * RATE
    gyro = (
        np.vstack([turned, turned[-1:]])
        + [4e-3, -3e-3, 2e-3]
        + 1.5e-3 * rng.standard_normal((n, 3))
    )
    accel = accel if step is None else step * np.round(accel / step)
    return Recording(np.arange(n) / RATE, accel, gyro, name="hand.csv")


def campaign(recording: Recording) -> Campaign:
    return Campaign((recording,), Site(gravity=G))


def said(recording: Recording) -> list:
    return [f for f in check_campaign(campaign(recording)).findings if f.kind == "repeated_samples"]


@pytest.mark.parametrize("noise", [0.001, 0.004])
def test_a_step_coarser_than_the_noise_is_told_and_no_sample_is_held(noise):
    (found,) = said(hand_log(1, noise))
    assert (
        "step, 0.153 m/s², is coarser than the noise" in found.statement
        and "held" not in found.statement
    )
    assert dict(found.evidence)["step"] == pytest.approx(STEP, rel=1e-6)


def test_samples_that_are_held_are_told_as_held_whatever_the_step():
    """Each value twice; and one stand of four seconds in outputs that are coarse."""
    fine = hand_log(2, 0.02, step=G / 16384)
    twice = np.arange(len(fine.time)) // 2 * 2
    (found,) = said(Recording(fine.time, fine.accel[twice], fine.gyro, name="twice.csv"))
    assert "samples are held" in found.statement
    coarse = hand_log(3, 0.06)  # 0.4 of a step: values change all the time
    stuck = coarse.accel.copy()
    stuck[MOVE + REST + 300 : MOVE + REST + 700] = stuck[MOVE + REST + 300]
    (found,) = said(Recording(coarse.time, stuck, coarse.gyro, name="stuck.csv"))
    assert "samples are held, not measured" in found.statement


def test_noise_above_the_step_says_nothing():
    assert not said(hand_log(4, 0.2))


def test_a_rest_that_stands_still_is_known_no_better_than_rounding_lets_it():
    blocks = cut(join(campaign(hand_log(5, 0.001))))
    of_sample = blocks.accel_white * blocks.count[:, None]
    assert np.all(of_sample >= STEP**2 / 12 * (1 - 1e-9))
    fine = cut(join(campaign(hand_log(5, 0.02, step=None))))
    # 450 samples a rest in 16 rests know a variance to 2 %, the pool over blocks not worse than 5 %.
    usual = np.median(fine.accel_white * fine.count[:, None], axis=0)
    np.testing.assert_allclose(usual, 0.02**2, rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "noise"), [(6, 0.0005), (7, 0.004)])
def test_a_diagnosis_of_coarse_outputs_ends_and_states_no_ratio_to_a_noise_that_no_row_shows(
    seed, noise
):
    found = diagnose(campaign(hand_log(seed, noise)))
    assert "Allan deviation" not in found.summary and not found.noise_doubted
    assert {e.name for e in found.effects} <= {"quantization"}
    # It is there. Its size is known no better than 16 rests tell it, whose errors are rounding themselves.
    assert all(p.std > 0.02 for e in found.effects for _, p in e.parameters)
