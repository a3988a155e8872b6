"""Prediction of stretches left out, and draws of the fitted noise."""

import jax
import numpy as np
import pytest

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose
from inertiax.diagnose.estimates.allan_check import allan_checks
from inertiax.diagnose.noise.draws import draw
from inertiax.diagnose.noise.observation_series import NoiseFit
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.noise.state_space import Chain, TIME_CONSTANTS, Variances, WANDER, whiten
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.selection.blocked_cross_validation import Foresight, skill, stretches
from inertiax.effects import CATALOGUE


@pytest.mark.slow
def test_draws_of_the_noise_have_the_covariance_of_its_formula():
    time = np.array([0.0, 2.0, 5.0, 40.0, 43.0, 50.0])
    gap = np.r_[0.0, np.diff(time)]
    white = np.array([0.5, 1.0, 0.7, 0.2, 0.4, 0.9])
    dwell = np.array([0, 0, 1, 1, 2, 2])
    cycle = np.array([0, 0, 0, 1, 1, 1])
    loads = np.array([[1.0, 0.2], [0.8, -0.5], [0.1, 1.0], [0.3, 0.3], [-0.7, 0.6], [0.9, 0.0]])
    mounting = np.array([0, 0, 0, 0, 1, 1])
    fresh, mounted, power = (
        np.r_[1.0, (np.diff(x) != 0).astype(float)] for x in (dwell, mounting, cycle)
    )
    heated = np.array([[0.5], [0.9], [-0.4], [1.3], [0.2], [-1.0]])
    chain = Chain(
        white, loads, gap, fresh, mounted, power, np.full(6, 0.3), np.full(6, 0.2), heated
    )
    v = Variances(*(np.array(x) for x in (1.2, 0.4, 0.05, 0.6, 0.8, 0.7, 0.9)))
    num = 40_000
    made = draw(chain, v, num, np.random.default_rng(1))
    lag = np.abs(time[:, None] - time)
    slow = 0.4 * sum(np.exp(-lag / tau) for tau in TIME_CONSTANTS)
    slow = slow + 0.05 * np.minimum(time[:, None], time) + 0.8 * (cycle[:, None] == cycle)
    expected = np.diag(1.2 * white) + (0.6 + 0.9 * 0.2) * (dwell[:, None] == dwell)
    expected = expected + 0.9 * 0.3 * (mounting[:, None] == mounting)
    expected = expected + (loads @ loads.T) * slow
    probe = 0.7 * (np.exp(-lag / WANDER) + (cycle[:, None] == cycle))
    expected = expected + (heated @ heated.T) * probe
    found = made @ made.T / num
    # The standard deviation of an element is at most sqrt(2 / num) of the diagonal's product; five of them.
    size = np.sqrt(np.diag(expected))
    white, logdet = whiten(v, chain, np.linalg.cholesky(expected))
    assert np.allclose(np.asarray(white), np.eye(6), atol=1e-12)
    assert np.isclose(float(logdet), np.linalg.slogdet(expected)[1])
    assert np.all(np.abs(found - expected) < 5.0 * np.sqrt(2.0 / num) * size[:, None] * size)


def test_the_error_of_stretches_left_out_is_that_of_plain_refits():
    rng = np.random.default_rng(2)
    num = 240
    time = np.sort(rng.uniform(0.0, 500.0, num))
    weight = rng.uniform(0.5, 2.0, num)
    base = np.stack([np.ones(num), time / 500.0], axis=1)
    column = np.sin(time / 40.0)[:, None]
    rows = base @ [0.3, -1.0] + 0.8 * column[:, 0] + 0.1 * rng.standard_normal(num)
    frame = np.linalg.qr(base * weight[:, None])[0]
    left = rows * weight
    left = left - frame @ (frame.T @ left)
    one = Foresight(weight, (stretches(time, 5), stretches(time, 8)), frame, left)
    errors = []
    for x in (base, np.concatenate([base, column], axis=1)):
        for number in (5, 8):
            total, part = 0.0, np.floor(number * (time - time[0]) / (time[-1] - time[0]))
            part[-1] = number - 1
            for k in range(number):
                out = part == k
                w = weight[~out]
                fitted = np.linalg.lstsq(x[~out] * w[:, None], rows[~out] * w, rcond=None)[0]
                total += np.sum(np.square((rows[out] - x[out] @ fitted) * weight[out]))
            errors.append(total)
    np.testing.assert_allclose(one.errors(None), errors[:2], rtol=1e-9)
    np.testing.assert_allclose(one.errors(column), errors[2:], rtol=1e-9)
    # Each column alone, all together: the same by elimination of the normal equations' border.
    several = np.concatenate([column, np.cos(time / 90.0)[:, None]], axis=1)
    each = one.errors_each(several)
    np.testing.assert_allclose(each[:, 0], errors[2:], rtol=1e-9)
    np.testing.assert_allclose(each[:, 1], one.errors(several[:, 1:]), rtol=1e-9)
    ratio = np.array(errors[:2]) / np.array(errors[2:])
    assert abs(skill(one, column) - np.mean(0.5 * np.log(ratio))) < 1e-9


def one_turn(seed, loop):
    """Gyros in one pose, cooled and heated once: a loop of width 4 °C of given sizes, and a walk in each."""
    rng = np.random.default_rng(seed)
    time = np.arange(3600.0)
    probe = np.interp(time, [0.0, 1500.0, 3600.0], [50.0, -15.0, 70.0])
    held, state = np.empty_like(probe), probe[0]
    for k, value in enumerate(probe):
        state = min(max(state, value - 2.0), value + 2.0)
        held[k] = state
    x = (probe - 20.0) / 40.0
    output = 1e-3 * np.stack([x, x**2 - x, 0.5 * x + x**3], axis=1)
    output = output + ((held - probe) / 2.0)[:, None] * np.asarray(loop)
    output = output + np.cumsum(3e-6 * rng.standard_normal(output.shape), axis=0)
    recording = Recording(
        time=time, gyro=output + 1e-4 * rng.standard_normal(output.shape), temperature=probe[:, None],
        position=np.zeros(3600, int),
    )  # fmt: skip
    model = ModelChoice(gyro_estimator="static", temperature_degree=3)
    return Campaign((recording,), Site(9.81), Rig(), model, "consumer")


# The loop and what looks like it; null campaigns with the whole catalogue are `benchmarks/null_campaigns.py`.
LIKE_A_LOOP = [
    e for e in CATALOGUE if e.name in ("thermal_hysteresis", "bias_step", "drift", "thermal_lag")
]


@pytest.mark.slow
def test_a_thermal_loop_that_channels_share_is_named_although_a_jump_at_its_turn_looks_alike():
    # Half a loop of 1e-3 rad/s against a walk that reaches 1.8e-4 rad/s in an hour.
    found = diagnose(one_turn(1, (1e-3, -8e-4, 0.0)), effects=LIKE_A_LOOP)
    named = {e.name: set(e.channels) for e in found.effects}
    assert {"gyro_x", "gyro_y"} <= named["thermal_hysteresis"]
    assert "gyro_z" not in named["thermal_hysteresis"]


@pytest.mark.slow
def test_walks_alone_are_not_taken_for_a_thermal_loop():
    assert diagnose(one_turn(2, (0.0, 0.0, 0.0)), effects=LIKE_A_LOOP).verdict == "consistent"


@pytest.mark.slow
def test_the_allan_deviation_agrees_with_the_fitted_noise_and_not_with_twice_its_white_part():
    with jax.enable_x64(True):
        (prepared,) = prepare(one_turn(3, (0.0, 0.0, 0.0)), ()).triads
        noise = fit_noise(prepared.system)
        checks = allan_checks(prepared, noise, [])
        louder = NoiseFit(
            tuple(t + np.log([2.0, 1, 1, 1, 1, 1, 1]) for t in noise.theta), noise.value
        )
        wrong = allan_checks(prepared, louder, [])
    assert {c.channel for c in checks} == {"gyro_x", "gyro_y", "gyro_z"}
    # Six intervals of 99 %: one miss is not unlikely, two are (0.14 %).
    assert sum(not c.agrees for c in checks) <= 1
    # One block: 1500 differences know the variance to some 5 %, against a factor of two.
    shortest = min(c.tau for c in wrong)
    assert all(not c.agrees for c in wrong if c.tau == shortest)
