"""The simulated bench: table, chamber, triads, and what they write."""

import tomllib
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import polars as pl
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from inertiax.data.campaign import load_campaign
from inertiax.physics import rotation
from inertiax.physics.earth import EARTH_RATE
from inertiax.physics.error_model import compensate_accel, compensate_gyro
from inertiax.simulate.bench import Readout, simulate_dwells, simulate_recordings
from inertiax.simulate.campaign import write_campaign
from inertiax.simulate.chamber import (
    Chamber,
    DRIFTS,
    first_order_lag,
    PAPER_CHANGES,
    PAPER_TEMPERATURES,
)
from inertiax.simulate.motion import move, turns_about_three_axes
from inertiax.simulate.plan import paper_check, paper_set, Plan
from inertiax.simulate.programme import (
    PROGRAMME_6,
    PROGRAMME_8,
    PROGRAMME_18,
    PROGRAMME_24,
    programme_from_directions,
    reordered,
    Table,
)
from inertiax.simulate.scenario import (
    check_scenario,
    devices_of,
    DeviceTable,
    load_scenario,
    plan_of,
    Scenario,
    SCENARIOS,
)
from inertiax.simulate.triad import (
    ACCEL_FIGURES,
    Device,
    draw_accelerometers,
    draw_gyros,
    Noise,
    TRUTH_RANGE,
)
from inertiax.simulate.truth import read_truth


def device(seed=0, **settings):
    accel, gyro = jax.random.split(jax.random.key(seed))
    return Device(draw_accelerometers(accel, **settings), draw_gyros(gyro, **settings))


def accel(rows):
    assert rows.accel is not None
    return np.asarray(rows.accel)


def gyro(rows):
    assert rows.gyro is not None
    return np.asarray(rows.gyro)


@eqx.filter_jit
def _compensated(triad, gyros, gravity, temperature, accel, gyro):
    """Specific forces and rates, by the truth."""

    def one(t, a, w):
        force = compensate_accel(triad.errors(t), a)
        return force, compensate_gyro(gyros.errors(t), w, force, gravity)

    return jax.vmap(one)(temperature, accel, gyro)


# --- the table -------------------------------------------------------------------------------


@pytest.mark.slow
def test_attitude_is_outer_then_inner_rotation():
    # SciPy: upper-case letters are intrinsic rotations, here about x and then the carried z.
    angles = np.random.default_rng(0).uniform(-3, 3, (10, 2))
    ours = jax.jit(jax.vmap(Table().attitude))(*jnp.asarray(angles).T)
    expected = Rotation.from_euler("XZ", angles).as_matrix()
    np.testing.assert_allclose(ours, expected, atol=1e-15)


def test_turning_is_the_derivative_of_attitude():
    # dR/dt = R [ω]×, with dR/dt by automatic differentiation.
    table = Table()
    angles, speeds = jnp.array([0.7, -1.9]), jnp.array([0.3, -0.8])
    attitude = lambda a: table.attitude(a[0], a[1])
    value, derivative = jax.jvp(attitude, (angles,), (speeds,))
    rate = table.turning(angles[1], speeds[0], speeds[1])
    np.testing.assert_allclose(value.T @ derivative, rotation.skew(rate), atol=1e-15)


@pytest.mark.parametrize(
    "programme, count, faces, edges, corners",
    [
        (PROGRAMME_6, 6, 6, 0, 0),
        (PROGRAMME_8, 8, 0, 0, 8),
        (PROGRAMME_18, 18, 6, 12, 0),
        (PROGRAMME_24, 24, 12, 12, 0),  # faces twice
    ],
)
def test_programmes_are_the_directions_they_say(programme, count, faces, edges, corners):
    u = np.asarray([Table().attitude(*a).T @ np.array([0.0, 0, 1]) for a in programme.angles])
    np.testing.assert_allclose(programme.directions(), u, atol=1e-15)
    kinds = np.count_nonzero(np.abs(u) > 1e-9, axis=1)
    assert [np.sum(kinds == k) for k in (1, 2, 3)] == [faces, edges, corners]
    assert programme.num_positions == count
    np.testing.assert_allclose(np.linalg.norm(u, axis=1), 1.0)
    distinct = len(np.unique(u.round(9) + 0.0, axis=0))
    assert distinct == min(count, 18)
    # Balanced: no direction is preferred, so the mean is zero and the spread isotropic.
    if programme is not PROGRAMME_24:
        np.testing.assert_allclose(u.mean(0), 0.0, atol=1e-15)
        np.testing.assert_allclose(u.T @ u / count, np.eye(3) / 3, atol=1e-15)


def test_any_direction_can_be_pointed():
    u = np.random.default_rng(1).normal(size=(50, 3))
    expected = u / np.linalg.norm(u, axis=1, keepdims=True)
    np.testing.assert_allclose(
        programme_from_directions("any", u).directions(), expected, atol=1e-15
    )


def test_orders_visit_every_position_once():
    for order in ("given", "reversed", "shuffled"):
        p = reordered(PROGRAMME_18, order, seed=3)
        assert sorted(p.numbers) == list(range(18))
        np.testing.assert_array_equal(p.angles, PROGRAMME_18.angles[p.numbers])
    assert list(reordered(PROGRAMME_18, "reversed").numbers) == list(range(17, -1, -1))
    shuffled = [tuple(reordered(PROGRAMME_18, "shuffled", seed=s).numbers) for s in (0, 0, 1)]
    assert shuffled[0] == shuffled[1] != shuffled[2]
    with pytest.raises(ValueError, match="order='random'.*given.*reversed.*shuffled"):
        reordered(PROGRAMME_18, "random")


# --- the chamber -----------------------------------------------------------------------------


def test_paper_temperatures_fit_what_the_paper_prints():
    assert len(PAPER_TEMPERATURES) == 13
    assert (PAPER_TEMPERATURES[0], PAPER_TEMPERATURES[-1]) == (-55.0, 60.0)
    assert set(np.diff(PAPER_TEMPERATURES)[:-1]) == {10.0}


@pytest.mark.parametrize("drift", DRIFTS)
def test_every_drift_has_the_stated_peak_to_peak(drift):
    chamber = Chamber(jnp.array([10.0, 20.0]), 15.0, drift)
    u = jnp.linspace(0.0, 1.0, 1001)
    for experiment in (0, 1):
        path = jax.vmap(lambda x, e=experiment: chamber.temperature(e, x))(u)
        # 1001 points hit both ends of every path exactly, and the quarter points of the sine.
        np.testing.assert_allclose(np.ptp(path), 15.0, rtol=1e-12)


@pytest.mark.parametrize(
    "drift, even, odd",
    [
        ("centred", (-7.5, 7.5), (-7.5, 7.5)),
        ("one-sided", (0.0, 15.0), (0.0, 15.0)),
        ("alternating", (0.0, 15.0), (0.0, -15.0)),
        ("alternating-centred", (-7.5, 7.5), (7.5, -7.5)),
        ("settling", (-15.0, 0.0), (-15.0, 0.0)),
        ("sinusoid", (0.0, 0.0), (0.0, 0.0)),
    ],
)
def test_drifts_start_and_end_where_they_say(drift, even, odd):
    chamber = Chamber(jnp.zeros(2), 15.0, drift)
    for experiment, ends in ((0, even), (1, odd)):
        found = [chamber.temperature(experiment, u) for u in (0.0, 1.0)]
        np.testing.assert_allclose(found, ends, atol=1e-12)


def test_an_unknown_drift_is_named():
    with pytest.raises(ValueError, match="drift='wobble'.*centred.*sinusoid"):
        Chamber(jnp.zeros(1), 1.0, "wobble")


def test_the_check_warms_at_two_degrees_a_minute():
    plan = paper_check()
    start, end = (plan.chamber.temperature(0, u) for u in (0.0, 1.0))
    np.testing.assert_allclose([start, end], [20.0, 30.0])
    np.testing.assert_allclose((end - start) / (plan.experiment_time / 60.0), 2.0)
    assert plan.programme.num_positions == 8


def test_lag_solves_its_differential_equation():
    tau = 120.0
    path = lambda t: 10.0 + 0.02 * t + 3.0 * np.sin(t / 200.0)
    time = np.linspace(0.0, 1000.0, 2001)
    solved = solve_ivp(
        lambda t, y: (path(t) - y) / tau, (0, 1000), [path(0.0)], t_eval=time, rtol=1e-10
    )
    ours = first_order_lag(time, path(time), tau)
    # Linear between samples 0.5 s apart: curvature 7.5e-5 °C/s² times 0.5²/8.
    np.testing.assert_allclose(ours, solved.y[0], atol=5e-6)


@pytest.mark.slow
def test_no_lag_is_the_probe_and_its_gradient_is_finite():
    time, path = np.arange(5.0), np.array([1.0, 2.0, 4.0, 4.0, 3.0])
    np.testing.assert_array_equal(first_order_lag(time, path, 0.0), path)
    slope = jax.jacfwd(lambda tau: first_order_lag(time, path, tau))(0.0)
    assert np.isfinite(slope).all()


# --- the triads ------------------------------------------------------------------------------


def test_accelerometers_define_the_frame():
    matrix = draw_accelerometers(jax.random.key(0)).errors(20.0).matrix
    np.testing.assert_array_equal(np.triu(matrix, 1), 0.0)
    assert np.all(np.tril(matrix)[np.tril_indices(3)] != 0.0)


@pytest.mark.slow
def test_drawn_sizes_are_the_stated_figures():
    # Offset and slope coefficients lie between a half and all of the figure, of either sign.
    figures = ACCEL_FIGURES["navigation"]
    half_range = 0.5 * (TRUTH_RANGE[1] - TRUTH_RANGE[0])
    drawn = [draw_accelerometers(k) for k in jax.random.split(jax.random.key(1), 40)]
    bias = np.array([d.curve.series.coefficients[:2, :3] for d in drawn])
    scale = np.array([d.curve.series.coefficients[1, jnp.array([3, 5, 8])] for d in drawn])
    for values, size in (
        (bias[:, 0], figures.bias),
        (bias[:, 1], figures.bias_slope * half_range),
        (scale, figures.scale_slope * half_range),
    ):
        assert np.all((np.abs(values) >= 0.5 * size) & (np.abs(values) <= size))
        assert (values > 0).any() and (values < 0).any()


@pytest.mark.slow
def test_a_polynomial_represents_the_truth_and_not_the_ripple():
    temperatures = np.linspace(-62.5, 67.5, 200)
    left = {}
    for ripple in (0.0, 0.01):
        curve = draw_accelerometers(jax.random.key(2), ripple=ripple).curve
        values = np.asarray(jax.vmap(curve)(temperatures))
        fit = np.polynomial.Chebyshev.fit(temperatures, values[:, 0], 6)
        left[ripple] = np.abs(fit(temperatures) - values[:, 0]).max() / np.ptp(values[:, 0])
    assert left[0.0] < 1e-12
    assert left[0.01] > 1e-3


def test_an_unknown_grade_is_named():
    with pytest.raises(ValueError, match="'space'.*navigation.*tactical.*consumer"):
        draw_accelerometers(jax.random.key(0), grade="space")


# --- dwell means -----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3])
def test_paper_sets_are_the_papers(number):
    dwells, _ = simulate_dwells(jax.random.key(0), paper_set(number), device())
    assert dwells.num_dwells == 13 * 18
    temperature = np.asarray(dwells.temperature).reshape(13, 18)
    change = np.ptp(temperature, axis=1)
    assert np.all(change <= PAPER_CHANGES[number - 1])
    # Dwell middles leave half a dwell at both ends: (1250 − 60)/1250 of the change.
    np.testing.assert_allclose(change, PAPER_CHANGES[number - 1] * 1190 / 1250)
    np.testing.assert_allclose(temperature.mean(1), PAPER_TEMPERATURES, atol=1e-10)


@pytest.mark.slow
def test_a_level_device_reads_equation_one_by_hand():
    # Bias 0.1 m/s² and 1 % scale on z, 2 mrad of z into y is not possible (lower triangular);
    # position 0 is level, so an ideal triad reads (0, 0, g) and (0, Ω cos φ, Ω sin φ).
    plan = Plan(PROGRAMME_6, Chamber(jnp.array([20.0]), 0.0), gravity=9.8, latitude=np.pi / 6)
    ideal = device()
    assert ideal.accel is not None
    curve = ideal.accel.curve
    zero = eqx.tree_at(lambda c: c.series.coefficients, curve, 0.0 * curve.series.coefficients)
    row = zero.series.coefficients.at[0].set([0, 0, 0.1, 0, 0, 0, 0, 0, 0.01])
    made = eqx.tree_at(lambda c: c.series.coefficients, zero, row)
    plain = eqx.tree_at(lambda d: d.accel.curve, ideal, made)
    dwells, truth = simulate_dwells(None, plan, plain)
    np.testing.assert_allclose(accel(dwells)[0], [0, 0, 9.8 * 1.01 + 0.1], atol=1e-14)
    cos, sin = np.sqrt(3) / 2, 0.5
    np.testing.assert_allclose(
        truth.rate[0], [0, EARTH_RATE * cos, EARTH_RATE * sin], rtol=1e-12, atol=1e-20
    )


@pytest.mark.slow
def test_compensating_with_the_truth_gives_the_references():
    unit = device(5)
    triad, gyros = unit.accel, unit.gyro
    assert triad is not None and gyros is not None
    plan = paper_set(1, turns=turns_about_three_axes(0.5))
    dwells, truth = simulate_dwells(None, plan, unit)
    samples = dwells.temperature, dwells.accel, dwells.gyro
    force, rate = _compensated(triad, gyros, plan.gravity, *samples)
    # Roundings of 9.8 m/s² and 0.5 rad/s through a 3 × 3 solve.
    np.testing.assert_allclose(force, truth.force, atol=1e-14)
    np.testing.assert_allclose(rate, truth.rate, atol=1e-15)
    np.testing.assert_array_equal(truth.force, np.asarray(dwells.reference_accel))
    np.testing.assert_array_equal(truth.rate, np.asarray(dwells.reference_gyro))
    rests = np.asarray(dwells.position) >= 0
    np.testing.assert_allclose(np.linalg.norm(truth.force[rests], axis=1), plan.gravity, rtol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(truth.rate[rests], axis=1), EARTH_RATE, rtol=1e-12)


@pytest.mark.slow
def test_noise_has_the_stated_covariance():
    plan = paper_set(3, temperatures=(0.0, 20.0))
    unit = device()
    draw = jax.jit(jax.vmap(lambda k: simulate_dwells(k, plan, unit, noise=Noise(probe=0.5))[0]))
    drawn = draw(jax.random.split(jax.random.key(0), 400))
    quiet, _ = simulate_dwells(None, plan, unit)
    for name in ("accel", "gyro"):
        error = np.asarray(getattr(drawn, name) - getattr(quiet, name)[None])
        promised = np.asarray(getattr(quiet, f"{name}_covariance"))
        white = error / np.sqrt(np.diagonal(promised, axis1=1, axis2=2))
        # 43 200 numbers: the variance's standard error is 0.7 %, the correlations' 0.9 %.
        assert abs(np.mean(white**2) - 1.0) < 0.03
        assert np.abs(np.corrcoef(white.reshape(-1, 3).T) - np.eye(3)).max() < 0.04
    np.testing.assert_allclose(
        np.sqrt(np.asarray(quiet.accel_covariance)[0, 0, 0]), 1e-5, rtol=1e-12
    )
    # Probe: 600 readings a dwell; 14 400 numbers, standard error 0.6 %.
    probe = np.asarray(drawn.temperature - quiet.temperature[None])
    np.testing.assert_allclose(probe.std(), 0.5 / np.sqrt(600), rtol=0.03)


@pytest.mark.slow
def test_seeds_repeat_and_differ():
    plan = paper_set(2, temperatures=(20.0,))
    a, b, c = (accel(simulate_dwells(jax.random.key(s), plan, device())[0]) for s in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert np.all(a != c)


@pytest.mark.slow
def test_the_lag_moves_the_elements_behind_the_probe():
    plan = paper_set(1, temperatures=(20.0,))
    unit = eqx.tree_at(lambda d: d.lag, device(), 100.0)
    dwells, truth = simulate_dwells(None, plan, unit)
    # Behind a ramp s the lag settles at s τ; the last dwell lies 12 time constants in.
    slope = 15.0 / plan.experiment_time
    np.testing.assert_allclose(
        dwells.temperature[-1] - truth.temperature[-1], slope * 100.0, rtol=1e-4
    )
    errors = unit.accel.errors(truth.temperature[-1])
    np.testing.assert_allclose(
        compensate_accel(errors, accel(dwells)[-1]), truth.force[-1], atol=1e-14
    )


# --- recordings ------------------------------------------------------------------------------


def short_plan(**settings):
    return Plan(
        PROGRAMME_8,
        Chamber(jnp.array([0.0, 30.0]), 4.0, "one-sided"),
        dwell_time=10.0,
        slew_time=4.0,
        **settings,
    )


@pytest.mark.slow
def test_integrated_rate_is_the_attitude():
    plan = short_plan(turns=turns_about_three_axes(1.0))
    step = 0.005
    time = np.arange(0.0, plan.experiment_time, step)
    motion = move(plan.segments(), time)
    midpoint = move(plan.segments(), time[:-1] + 0.5 * step)
    rate = jax.jit(jax.vmap(plan.table.turning))(
        *(jnp.asarray(x) for x in (midpoint.angles[:, 1], *midpoint.rates.T))
    )
    steps = Rotation.from_rotvec(np.asarray(rate) * step).as_matrix()
    expected = Rotation.from_euler("XZ", motion.angles).as_matrix()
    attitude = expected[0]
    found = [attitude := attitude @ s for s in steps]
    # Mid-point rule: the error per second is ω̈ h²/24 + ω ω̇ h²/12, both under 3 rad/s³ here, over
    # some 60 s in which the table turns.
    np.testing.assert_allclose(found, expected[1:], atol=60 * 3 * step**2 / 12)


def test_rates_are_zero_at_rest_and_never_jump():
    plan = short_plan(turns=turns_about_three_axes(1.0))
    time = np.arange(0.0, plan.experiment_time, 0.01)
    motion = move(plan.segments(), time)
    rest = motion.position >= 0
    assert rest.sum() == pytest.approx(8 * 10.0 * 100, abs=8)
    assert np.all(motion.rates[rest] == 0.0)
    # Largest acceleration: a slew of π in 4 s, 2π · π/4² = 1.23 rad/s², so 0.0123 a step.
    assert np.abs(np.diff(motion.rates, axis=0)).max() < 0.013


@pytest.mark.slow
def test_recordings_agree_with_the_dwell_means():
    # A revolution in 6 s, so that every stretch is a whole number of samples.
    plan = short_plan(turns=turns_about_three_axes(2 * np.pi / 6))
    unit = device(1)
    dwells, _ = simulate_dwells(None, plan, unit)
    recordings, _ = simulate_recordings(None, plan, unit, sample_rate=100.0)
    for row in range(dwells.num_dwells):
        log = recordings[int(dwells.experiment[row])]
        rows = np.abs(log.time - dwells.time[row]) < 0.5 * dwells.duration[row]
        assert log.position is not None and log.temperature is not None
        np.testing.assert_array_equal(log.position[rows], dwells.position[row])
        # At rest only the parameters' curvature within 0.2 °C is left. Turning, force and parameters
        # move together: 1.2e-3 m/s²/°C over the 0.1 °C of a turn, and its like for the gyros.
        turning = dwells.position[row] < 0
        atol = 2e-4 if turning else 1e-7
        np.testing.assert_allclose(accel(log)[rows].mean(0), accel(dwells)[row], atol=atol)
        atol = 1e-8 if turning else 1e-11
        np.testing.assert_allclose(gyro(log)[rows].mean(0), gyro(dwells)[row], atol=atol)
        np.testing.assert_allclose(log.temperature[rows].mean(), dwells.temperature[row], rtol=1e-9)


@pytest.mark.slow
def test_recordings_are_noisy_as_stated():
    plan = short_plan()
    noise = Noise(accel=1e-3, gyro=1e-5, probe=0.2)
    quiet, _ = simulate_recordings(None, plan, device(), sample_rate=100.0)
    noisy, _ = simulate_recordings(
        jax.random.key(0), plan, device(), sample_rate=100.0, noise=noise
    )
    for name, std in (("accel", 1e-2), ("gyro", 1e-4), ("temperature", 0.2)):
        for a, b in zip(noisy, quiet, strict=True):
            error = getattr(a, name) - getattr(b, name)
            # 10 800 rows at least: the standard error of a standard deviation is 0.7 %.
            np.testing.assert_allclose(error.std(), std, rtol=0.03)
    first, second = ((accel(a) - accel(b)) for a, b in zip(noisy, quiet, strict=True))
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.03


@pytest.mark.slow
def test_readout_rounds_to_steps():
    readout = Readout(accel=1e-3, gyro=1e-6, temperature=0.25)
    recordings, truth = simulate_recordings(None, short_plan(), device(), readout=readout)
    quiet, _ = simulate_recordings(None, short_plan(), device())
    for name, step in (("accel", 1e-3), ("gyro", 1e-6), ("temperature", 0.25)):
        values = getattr(recordings[0], name)
        np.testing.assert_allclose(values / step, np.round(values / step), atol=1e-6)
        assert np.abs(values - getattr(quiet[0], name)).max() <= 0.5 * step * (1 + 1e-9)
    np.testing.assert_array_equal(recordings[0].reference_accel, truth[0].force)


def test_effects_are_applied_in_order_before_the_readout():
    add = lambda r, truth: eqx.tree_at(
        lambda x: x.accel, r, r.accel + 0.01 * truth.temperature[:, None]
    )
    double = lambda r, truth: eqx.tree_at(lambda x: x.accel, r, 2.0 * r.accel)
    plain, truth = simulate_recordings(None, short_plan(), device())
    changed, _ = simulate_recordings(None, short_plan(), device(), effects=(add, double))
    expected = 2.0 * (accel(plain[1]) + 0.01 * truth[1].temperature[:, None])
    np.testing.assert_allclose(accel(changed[1]), expected, rtol=1e-14)


def test_a_plan_without_time_is_refused():
    with pytest.raises(ValueError, match="dwell_time.*got 0.0"):
        Plan(PROGRAMME_8, Chamber(jnp.zeros(1), 0.0), dwell_time=0.0)


# --- scenarios -------------------------------------------------------------------------------


SMALL = """
[plan]
programme = "6"
temperatures = [0.0, 30.0]
change = 4.0
dwell_time = 4.0
slew_time = 2.0
turn_rate = 90.0

[device]
count = 2
seed = 3
triads = ["accel", "gyro"]

[recording]
rate = 20.0

[rig]
position_uncertainty = 20.0

[model]
g_sensitivity = true
lever_arms = false
"""


def small(tmp_path, text=SMALL):
    file = tmp_path / "scenario.toml"
    file.write_text(text, "utf-8")
    return load_scenario(file)


@pytest.mark.slow
def test_a_written_campaign_is_read_back_by_the_package(tmp_path):
    folder = write_campaign(small(tmp_path), tmp_path / "out")
    campaign = load_campaign(folder)
    assert campaign.devices == ("SIM0001", "SIM0002")
    assert len(campaign.recordings) == 4
    assert campaign.site.gravity == 9.815179
    assert campaign.rig.position_uncertainty is not None
    np.testing.assert_allclose(campaign.rig.position_uncertainty, 20.0 * np.pi / 180 / 3600)
    assert (campaign.model.g_sensitivity, campaign.grade) == (True, "navigation")
    assert campaign.model.lever_arms is False
    assert campaign.notes == ()
    first = campaign.recordings[0]
    # 6 rests of 4 s and 5 slews of 2 s, then six times slew 2, spin up 2, turn 4, spin down 2 s.
    assert first.num_samples == 20 * (6 * 4 + 5 * 2 + 6 * 10)
    assert first.position is not None
    assert list(np.unique(first.position)) == [-1, 0, 1, 2, 3, 4, 5]


@pytest.mark.slow
def test_truth_compensates_what_was_written(tmp_path):
    quiet = SMALL.replace("rate = 20.0", "rate = 20.0\nnoise = false")
    folder = write_campaign(small(tmp_path, quiet), tmp_path / "out")
    truth = read_truth(folder / "truth.json")
    for recording in load_campaign(folder).recordings:
        triad, gyros = truth[recording.device].accel, truth[recording.device].gyro
        assert triad is not None and gyros is not None
        assert recording.temperature is not None
        t = jnp.asarray(recording.temperature[:, 0])
        force, rate = _compensated(triad, gyros, 9.815179, t, accel(recording), gyro(recording))
        np.testing.assert_allclose(force, np.asarray(recording.reference_accel), atol=1e-13)
        np.testing.assert_allclose(rate, np.asarray(recording.reference_gyro), atol=1e-14)


def test_positioning_errors_are_in_the_truth_and_not_in_the_references():
    plan = eqx.tree_at(lambda p: p.position_error, paper_set(3), 1e-4)
    dwells, truth = simulate_dwells(jax.random.key(0), plan, device())
    planned, _ = simulate_dwells(None, plan, device())
    reference = np.asarray(dwells.reference_accel)
    np.testing.assert_array_equal(reference, np.asarray(planned.reference_accel))
    off = (np.asarray(truth.force) - reference) / plan.gravity
    # The outer angle moves gravity by its whole error, the inner one by sin(outer) of it: the
    # programme's mean of sin² is 2/3 by isotropy. 234 rows: 5 % standard error of a deviation.
    np.testing.assert_allclose(
        np.sqrt(np.mean(np.sum(off**2, axis=1))), 1e-4 * np.sqrt(1 + 2 / 3), rtol=0.2
    )


def test_recordings_and_dwells_have_the_same_size_of_positioning_error():
    plan = eqx.tree_at(lambda p: p.position_error, short_plan(), 1e-3)
    recordings, truths = simulate_recordings(jax.random.key(0), plan, device())
    for recording, truth in zip(recordings, truths, strict=True):
        position = np.asarray(recording.position)
        off = np.asarray(truth.force) - np.asarray(recording.reference_accel)
        at = [off[position == p] for p in range(8)]
        assert all(np.ptp(rows, axis=0).max() < 1e-12 for rows in at)  # constant at rest
        sizes = [np.linalg.norm(rows[0]) / 9.8 for rows in at]
        assert 2e-4 < np.mean(sizes) < 3e-3


def test_device_n_does_not_depend_on_the_count():
    two = devices_of(msgspec.structs.replace(Scenario(), device=DeviceTable(count=2)))
    one = devices_of(Scenario())
    for a, b in zip(jax.tree.leaves(one["SIM0001"]), jax.tree.leaves(two["SIM0001"]), strict=True):
        np.testing.assert_array_equal(a, b)
    first, second = two["SIM0001"].accel, two["SIM0002"].accel
    assert first is not None and second is not None
    assert np.all(first.errors(20.0).bias != second.errors(20.0).bias)


def test_the_example_in_the_docs_is_the_default():
    page = (Path(__file__).parents[1] / "docs" / "reference" / "simulator.md").read_text("utf-8")
    raw = tomllib.loads(page.partition("```toml\n")[2].partition("```")[0])
    assert msgspec.convert(raw, Scenario) == Scenario()
    # Every key is shown, in a line of its own or in a comment.
    for table in msgspec.structs.fields(Scenario):
        for key in msgspec.structs.fields(table.type):
            if table.name != "model":
                assert f"\n{key.name} = " in page or f"\n# {key.name} = " in page


@pytest.mark.parametrize("name", SCENARIOS)
def test_built_in_scenarios_are_sound(name):
    scenario = load_scenario(name)
    check_scenario(scenario)
    plan = plan_of(scenario)
    if name.startswith("paper-set"):
        expected = paper_set(int(name[-1]))
    elif name == "paper-check":
        expected = paper_check()
    else:
        return
    assert plan.experiment_time == expected.experiment_time
    for a, b in zip(jax.tree.leaves(plan), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-15)


@pytest.mark.parametrize(
    "text, message",
    [
        ("[plan]\ndwel_time = 3", r"\[plan\] unknown key 'dwel_time'; did you mean 'dwell_time'\?"),
        ("[plans]", r"unknown table \[plans\]; did you mean 'plan'\?"),
        ("plan = 3", r"\[plan\] must be a table; found 3"),
        ("[plan]\nprogramme = '19'", r"\[plan\] programme: .*one of 6, 8, 18, 24; found '19'"),
        ("[plan]\ndrift = 'centered'", r"\[plan\] drift: did you mean 'centred'\?"),
        ("[plan]\norder = 'random'", r"\[plan\] order: .*one of given, reversed, shuffled"),
        ("[plan]\ndwell_time = 0", r"\[plan\] dwell_time = 0 must be above 0 s"),
        ("[plan]\ntemperatures = []", r"\[plan\] temperatures is empty"),
        ("[plan]\ntemperatures = ['a']", r"\[plan\] temperatures.*Expected float, got str"),
        ("[device]\ngrade = 'space'", r"\[device\] grade: Invalid enum value 'space'"),
        ("[device]\nlag = -1", r"\[device\] lag = -1 must be 0 or more"),
        ("[recording]\nrate = nan", r"\[recording\] rate = nan must be above 0 Hz"),
        ("[recording]\ncolumns = ['temp']", r"\[recording\] columns: .*found 'temp'"),
        ("[site]\ngravity = 1.0", r"\[site\] gravity = 1 is not on Earth"),
        ("[site", "not valid TOML"),
    ],
)
def test_a_wrong_scenario_is_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(ValueError, match=message) as caught:
        small(tmp_path, text)
    assert "scenario.toml: " in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_scenario_names_the_built_in_ones(tmp_path):
    with pytest.raises(ValueError, match="does not exist.*paper-set-1"):
        load_scenario(tmp_path / "none.toml")


def test_a_full_folder_is_left_alone(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="not an empty folder"):
        write_campaign(small(tmp_path), tmp_path / "out")
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["notes.txt"]


def test_a_run_cut_short_leaves_nothing(tmp_path):
    def stop(text):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_campaign(small(tmp_path), tmp_path / "out", progress=stop)
    assert [p.name for p in tmp_path.iterdir()] == ["scenario.toml"]


def test_only_the_columns_asked_for_are_written(tmp_path):
    text = SMALL.replace("rate = 20.0", 'rate = 20.0\ncolumns = ["temperature"]')
    folder = write_campaign(small(tmp_path, text), tmp_path / "out")
    names = pl.read_parquet(folder / "SIM0002-01.parquet").columns
    triads = [f"{t}_{axis}" for t in ("accel", "gyro") for axis in "xyz"]
    assert names == ["time", "temperature", *triads]


@pytest.mark.parametrize(
    "text, message",
    [("{", "not a truth.json"), ("[]", "schema is None"), ('{"schema": "x/1"}', "schema is 'x/1'")],
)
def test_another_file_is_no_truth(tmp_path, text, message):
    (tmp_path / "truth.json").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_truth(tmp_path / "truth.json")
