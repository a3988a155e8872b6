"""The covariance beside a lag is that of the elements' temperatures: by hand, where a ramp ends before they arrive."""

import jax
import numpy as np
import pytest

from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.diagnose.estimates.at_elements import (
    _normal,
    _placed,
    _places,
    extrapolated,
)
from inertiax.diagnose.problem import prepare
from inertiax.numerics.linear_algebra import scaled_inverse


TAU, G, REST = 200.0, 9.81, 20  # s, m/s², rows of a rest


@pytest.fixture(scope="module")
def ramp():
    """Rests in six positions at 2 Hz while the temperature goes up by 40 °C in 8 minutes, their elements behind it."""
    ups = np.concatenate([np.eye(3), -np.eye(3)])
    force = np.repeat(G * np.tile(ups, (8, 1)), REST, axis=0)
    rng = np.random.default_rng(5)
    time = 0.5 * np.arange(len(force))
    probe = 40.0 * time / time[-1]
    slope = probe[1] / 0.5
    element = probe - slope * TAU * (1.0 - np.exp(-time / TAU))
    accel = force + 1e-3 * element[:, None] + 2e-3 * rng.standard_normal(force.shape)
    log = Recording(
        time=time, accel=accel, reference_accel=force, temperature=probe[:, None],
        position=np.repeat(np.arange(48) % 6, REST),
    )  # fmt: skip
    model = ModelChoice(accel_estimator="reference", temperature_degree=1)
    with jax.enable_x64(True):
        problem = prepare(Campaign((log,), Site(G), model=model))
    return problem, element


def the_lag(prepared):
    lags = [t for t in prepared.candidates if t.name == "thermal_lag" and len(t.channels) == 3]
    return min(lags, key=lambda t: abs(np.log(t.setting / TAU)))


def test_what_is_added_is_that_of_the_estimator(ramp):
    """By hand: parameters by the elements' temperatures, and by the probe's of what those leave, M W⁻¹ Mᵀ."""
    problem, _ = ramp
    (prepared,) = problem.triads
    lag = the_lag(prepared)
    signal, form, blocks = prepared.signal, prepared.form, prepared.blocks
    probe = np.asarray(signal.temperature)
    late = behind_by(np.asarray(signal.time), probe, lag.setting)
    force, white = blocks.mean(np.asarray(signal.input)) * G, prepared.system.chains[1].white
    solve, columns = [], []
    for temperature in (late, probe):
        x = (2.0 * blocks.mean(temperature) - form.low - form.high) / (form.high - form.low)
        line = np.column_stack([np.ones_like(x), x])
        columns.append(
            np.concatenate([line, *(line * force[:, k : k + 1] for k in range(3))], axis=1)
        )
        solve.append(np.linalg.inv((columns[-1].T / white) @ columns[-1]) @ (columns[-1].T / white))
    by_elements, by_probe = solve
    both = by_elements + by_probe @ (np.eye(len(white)) - columns[0] @ by_elements)
    top = np.ones(2)  # bias of y at the end of the probe's range
    variance = lambda m: top @ (m @ (white[:, None] * m.T))[:2, :2] @ top
    ratio = variance(both) / variance(by_probe)
    assert ratio > 1.5  # the elements were 10 °C below it
    # The fit's own covariance, of white noise: zero but for y's bias, whose powers stand 12 apart.
    fit = _placed(scaled_inverse(_normal(prepared)), *_places(24, 12, 2), 24)
    more = extrapolated(prepared, [lag], fit, 12)
    own = np.ix_([1, 13], [1, 13])
    found = top @ (fit + more)[own] @ top / (top @ fit[own] @ top)
    # Where elements tell more than the probe's range does, at its cold end, nothing is taken off: 5 %.
    assert found == pytest.approx(ratio, rel=0.05)
    assert np.linalg.eigvalsh(more).min() > -1e-12 * np.abs(more).max()
    # What dwells differ by beyond white noise makes a fit's variances larger, and what is added with them.
    np.testing.assert_allclose(extrapolated(prepared, [lag], 4.0 * fit, 12), 4.0 * more, rtol=1e-6)


def behind_by(time, temperature, constant):
    """First order by exact steps of a temperature that is straight between rows."""
    made = np.empty_like(temperature)
    made[0] = temperature[0]
    for k, step in enumerate(np.diff(time)):
        slope = (temperature[k + 1] - temperature[k]) / step
        start = made[k] - (temperature[k] - slope * constant)
        made[k + 1] = temperature[k + 1] - slope * constant + start * np.exp(-step / constant)
    return made


def test_nothing_is_taken_where_no_element_lags(ramp):
    problem, _ = ramp
    (prepared,) = problem.triads
    fit = np.asarray(problem.plain.accel.solution.covariance)
    drift = next(t for t in prepared.candidates if t.name == "drift")
    assert not extrapolated(prepared, [drift], fit, 12).any()
