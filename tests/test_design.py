"""Optimal plans against known optima, and their predicted precision against simulation."""

import json
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

from command_runs import run
from inertiax.cli import main
from inertiax.cli.app import app
from inertiax.data.formats.table_angles import ideal_readings
from inertiax.data.formats.turntable import Turntable
from inertiax.design import (
    effort_for,
    optimal_positions,
    optimal_temperatures,
    precision,
    score,
    shortest_order,
    TableLimits,
)
from inertiax.design.criteria import log_score, log_score_slope
from inertiax.design.information import host_rows, host_slopes, ideal_rows, sphere_average
from inertiax.design.positions import _slews
from inertiax.estimators import Invariant, ReferenceAccel, ReferenceGyro
from inertiax.physics.temperature import Constant, Curve, Polynomial
from inertiax.procedure.single_device import Problem
from inertiax.simulate.bench import simulate_dwells
from inertiax.simulate.chamber import Chamber
from inertiax.simulate.plan import Plan
from inertiax.simulate.programme import Programme, PROGRAMME_6, PROGRAMME_18, PROGRAMME_24, Table
from inertiax.simulate.triad import Device, draw_accelerometers
from refit import refitted


ESTIMATOR = Invariant(gravity=9.815179)
TABLE = Table()


def _information(programme):
    rows = np.asarray(host_rows(ESTIMATOR, TABLE, programme.angles))
    return np.einsum("nri,nrj->ij", rows, rows)  # M = Σ JᵀJ


@pytest.fixture(scope="module")
def best():
    return optimal_positions(ESTIMATOR, 18, starts=3)


def test_average_over_the_sphere_has_the_moments_of_a_uniform_direction():
    # Row of the invariant estimator: −(u, u_i u_j); E u_i² = 1/3, E u_i⁴ = 1/5, E u_i² u_j² = 1/15.
    expected = np.zeros((9, 9))
    expected[range(3), range(3)] = 1 / 3
    for k, (i, j) in enumerate([(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]):
        for m, (p, q) in enumerate([(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]):
            counts = np.bincount([i, j, p, q], minlength=3)
            if sorted(counts) == [0, 0, 4]:
                expected[3 + k, 3 + m] = 1 / 5
            elif sorted(counts) == [0, 2, 2]:
                expected[3 + k, 3 + m] = 1 / 15
    np.testing.assert_allclose(sphere_average(ESTIMATOR, TABLE), expected, atol=1e-14)


@pytest.mark.slow
def test_optimised_18_positions_reach_the_bound_that_no_plan_can_pass(best):
    # The model is the same whatever way the axes are turned, and log det is concave: no plan is better
    # per position than the uniform one over the sphere.
    weight = sphere_average(ESTIMATOR, TABLE)
    bound = score("D", weight, 1)
    found = score("D", _information(best), 18) / bound
    plain = score("D", _information(PROGRAMME_18), 18) / bound
    assert best.num_positions == 18
    assert 0.9999 < found < 1.0 + 1e-9
    assert found > plain
    assert plain == pytest.approx(0.9889, abs=1e-4)  # what the docs state
    assert score("D", _information(PROGRAMME_24), 24) / bound < plain


@pytest.mark.slow
def test_other_criteria_are_optimised_too():
    weight = sphere_average(ESTIMATOR, TABLE)
    scores = {
        c: score(
            c, _information(optimal_positions(ESTIMATOR, 12, criterion=c, starts=1)), 12, weight
        )
        for c in ("A", "I")
    }
    # I: uniform is optimal, by the same argument as for D; tr M⁻¹W = p there.
    assert scores["I"] == pytest.approx(1.0, abs=1e-3)
    # A: equal variances are not optimal, as scale factors and angles are known unequally well.
    assert scores["A"] > score("A", weight, 1) * 1.01


@pytest.mark.parametrize("criterion", ["D", "A", "I"])
def test_slope_of_a_criterion_is_its_derivative(criterion):
    rng = np.random.default_rng(0)
    root, other = rng.normal(size=(2, 5, 3))
    matrix, weight = root.T @ root, other.T @ other
    value, slope = log_score_slope(criterion, matrix, 5, weight)
    plain = lambda m: log_score(criterion, m, 5, weight)
    assert value == pytest.approx(float(plain(matrix)), abs=1e-12)
    h = 1e-6
    for i, j in ((0, 0), (1, 0), (2, 1)):
        step = np.zeros((3, 3))
        step[i, j] = step[j, i] = h
        numeric = float(plain(matrix + step) - plain(matrix - step)) / (2.0 * h)
        # Error of the difference: h² and ε/h, 1e-10 both.
        assert numeric == pytest.approx(np.sum(slope * step) / h, abs=1e-8)


def test_rows_over_positions_and_their_slopes_are_those_of_one_position():
    rng = np.random.default_rng(0)
    angles = rng.uniform(-3.0, 3.0, (70, 2))  # more than one call takes
    rows, slopes = host_slopes(ESTIMATOR, TABLE, angles)
    np.testing.assert_array_equal(rows.shape, host_rows(ESTIMATOR, TABLE, angles).shape)
    # −(u, u_i u_j) by hand, u the unit vector of gravity's reaction in the case.
    u = Programme("any", angles, np.arange(70)).directions()
    pairs = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]
    expected = -np.concatenate([u, np.stack([u[:, i] * u[:, j] for i, j in pairs], axis=1)], axis=1)
    np.testing.assert_allclose(rows[:, 0], expected, atol=1e-14)
    h = 1e-5
    for axis in (0, 1):
        ahead, behind = angles.copy(), angles.copy()
        ahead[:, axis], behind[:, axis] = angles[:, axis] + h, angles[:, axis] - h
        numeric = (host_rows(ESTIMATOR, TABLE, ahead) - host_rows(ESTIMATOR, TABLE, behind)) / (
            2 * h
        )
        np.testing.assert_allclose(slopes[..., axis], numeric, atol=1e-9)


def test_table_limits_and_step_are_kept():
    degree = np.deg2rad(1.0)
    limits = TableLimits(
        outer=(-100 * degree, 100 * degree), inner=(0.0, 270 * degree), step=degree
    )
    angles = np.asarray(optimal_positions(ESTIMATOR, 12, limits=limits, starts=1).angles) / degree
    np.testing.assert_allclose(angles, np.round(angles), atol=1e-9)
    assert np.all(np.abs(angles[:, 0]) <= 100.0) and np.all(
        (angles[:, 1] >= 0) & (angles[:, 1] <= 270)
    )


def test_order_of_positions_shortens_the_slews():
    rng = np.random.default_rng(0)
    mixed = Programme("mixed", PROGRAMME_18.angles[rng.permutation(18)], np.arange(18))
    length = lambda p: sum(_slews(np.asarray(p.angles))[np.arange(17), np.arange(1, 18)])
    ordered = shortest_order(mixed)
    assert length(ordered) < 0.7 * length(mixed)
    assert sorted(map(tuple, ordered.angles)) == sorted(map(tuple, mixed.angles))
    assert np.array_equal(ordered.angles, np.asarray(mixed.angles)[ordered.numbers])


def test_d_optimal_temperatures_are_the_zeros_of_legendre():
    # Seven points for degree 6: zeros of (1 − x²) P₆'(x) (Atkinson et al. 2007, ch. 11).
    zeros = np.array([-1, -0.830223896278567, -0.468848793470714, 0])
    expected = np.concatenate([zeros, -zeros[:3][::-1]])
    found = optimal_temperatures(Polynomial(6, -1.0, 1.0), 7, low=-1.0, high=1.0, starts=3)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_i_optimal_temperatures_predict_better_than_equal_steps():
    basis = Polynomial(6, -55.0, 60.0)
    grid = np.asarray(jax.vmap(basis)(jnp.linspace(-55.0, 60.0, 116)))

    def mean_variance(at):
        phi = np.asarray(jax.vmap(basis)(jnp.asarray(at)))
        return np.einsum("ga,ab,gb->g", grid, np.linalg.inv(phi.T @ phi), grid).mean()

    optimal = optimal_temperatures(basis, 13, low=-55.0, high=60.0, criterion="I", starts=4)
    assert mean_variance(optimal) < 0.95 * mean_variance(np.linspace(-55.0, 60.0, 13))


def _simulated(programme, device, runs):
    """The nine parameters of many calibrations at one temperature, with a dwell's noise of 1e-5 m/s²."""
    plan = Plan(programme, Chamber(jnp.array([20.0]), 0.0))
    clean, _ = simulate_dwells(None, plan, device)
    keys = jax.random.split(jax.random.PRNGKey(1), runs)
    accel = jax.jit(jax.vmap(lambda key: simulate_dwells(key, plan, device)[0].accel))(keys)
    start = Curve(Constant(), device.accel.curve(20.0)[None])
    temperature = np.tile(clean.temperature, (runs, 1))
    # From the truth one step is as good as two: they differ by 2e-5 standard deviations.
    return refitted(ESTIMATOR, start, clean, accel, temperature, steps=1)[:, 0]


@pytest.mark.slow
def test_predicted_precision_of_optimised_programme_is_the_simulated_one(best):
    device = Device(accel=draw_accelerometers(jax.random.PRNGKey(0), degree=1))
    determinants = []
    for programme in (best, PROGRAMME_18):
        answers = _simulated(programme, device, 32000)
        at = np.array([20.0])
        predicted = precision(ESTIMATOR, Constant(), programme, at, deviation=1e-5).deviation[0]
        # 32 000 runs know a deviation to 0.4 %; the device is within 1 % of an ideal one.
        np.testing.assert_allclose(answers.std(axis=0), predicted, rtol=0.05)
        determinants.append(np.linalg.slogdet(np.cov(answers.T))[1])
    # And the simulated ellipsoids have the stated efficiency: (det ratio)^(1/9) = 1 / 0.9889. A sample covariance
    # of n runs and p unknowns tells log det to √(2p / n), so the ninth root of the ratio is known to 0.37 %.
    ratio = np.exp((determinants[1] - determinants[0]) / 9)
    assert ratio == pytest.approx(1 / 0.9889, abs=3 * 0.0037)
    assert ratio > 1.0


@pytest.mark.slow
def test_precision_over_temperature_is_the_covariance_of_the_fit():
    at = np.array([-55.0, -20.0, 20.0, 60.0])
    plan = Plan(PROGRAMME_18, Chamber(jnp.asarray(at), 0.0))
    device = Device(accel=draw_accelerometers(jax.random.PRNGKey(0), degree=2))
    basis = device.accel.curve.series.basis
    dwells, _ = simulate_dwells(None, plan, device)
    problem = Problem(ESTIMATOR, basis, dwells)
    at_truth = problem.at(device.accel.curve.series.coefficients)
    covariance = np.linalg.inv(problem.normal(at_truth.jacobian))
    predicted = precision(
        ESTIMATOR, basis, PROGRAMME_18, at, deviation=1e-5, grid=np.array([0.0, 50.0])
    )
    for row, t in zip(predicted.deviation, (0.0, 50.0), strict=True):
        mix = np.kron(np.asarray(basis(jnp.asarray(t)))[None], np.eye(9))
        np.testing.assert_allclose(row, np.sqrt(np.diagonal(mix @ covariance @ mix.T)), rtol=0.02)


def test_effort_for_a_target_by_hand():
    # One temperature and faces only, full matrix from references: a scale factor is known from two
    # faces to σ/(g√2), so 1.96 σ/(√2 g) = target gives σ and, with white noise, the dwell time.
    target, density = 1e-5, 1e-3
    (found,) = effort_for(
        target, [PROGRAMME_6], ReferenceAccel(), Constant(), np.array([20.0]),
        density=density, shortest_dwell=0.1, slew_time=10.0,
    )  # fmt: skip
    sigma = target * 9.80665 * np.sqrt(2.0) / 1.959964
    assert found.dwell_time == pytest.approx((density / sigma) ** 2, rel=1e-6)
    assert found.hours == pytest.approx((6 * found.dwell_time + 50.0) / 3600.0)
    assert found.half_width == pytest.approx(target)
    # Re-positioning scatter above σ cannot be averaged out by longer dwells.
    (hopeless,) = effort_for(
        target, [PROGRAMME_6], ReferenceAccel(), Constant(), np.array([20.0]),
        density=density, repeatability=1.01 * sigma,
    )  # fmt: skip
    assert not hopeless.reachable and hopeless.hours == np.inf


def test_what_cannot_be_designed_is_refused():
    with pytest.raises(ValueError, match="8 equations cannot determine 9 parameters"):
        optimal_positions(ESTIMATOR, 8)
    with pytest.raises(ValueError, match="gyros need rates"):
        ideal_rows(ReferenceGyro(gravity=9.8), TABLE, np.zeros((1, 2)))
    with pytest.raises(ValueError, match="5 temperatures cannot determine curves with 7"):
        optimal_temperatures(Polynomial(6, -1.0, 1.0), 5, low=-1.0, high=1.0)
    with pytest.raises(ValueError, match="needs low < high in rad"):
        TableLimits(outer=(1.0, -1.0))


# The command ----------------------------------------------------------------------------------------


def told(*arguments):
    return CliRunner().invoke(app, ["design", *arguments])


@pytest.fixture
def own_cache(monkeypatch):
    # With this set the command leaves JAX's cache alone, which the other tests share.
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")


SMALL = "--optimise --positions 9 --experiments 3 --degree 1 --low -40 --high 60".split()


def test_command_optimises_within_the_tables_reach(own_cache):
    reach = ("--outer", "-100", "100", "--inner", "0", "270", "--step", "0.5")
    answer = told(*SMALL, *reach, "--target", "900", "--json", "-q")
    assert answer.exit_code == 0, answer.output
    found = json.loads(answer.stdout)
    angles = np.array(found["positions_deg"])
    assert found["schema"] == "inertiax.design/1" and angles.shape == (9, 2)
    assert np.all(np.abs(angles[:, 0]) <= 100.0)
    assert np.all((angles[:, 1] >= 0.0) & (angles[:, 1] <= 270.0))
    np.testing.assert_allclose(2.0 * angles, np.round(2.0 * angles), atol=1e-3)
    # The stated efficiency is that of the printed angles.
    own = score("D", _information(Programme("found", np.deg2rad(angles), np.arange(9))), 9)
    assert found["d_efficiency"] == pytest.approx(
        own / score("D", sphere_average(ESTIMATOR, TABLE), 1), abs=1e-6
    )
    # A line over [−1, 1] from three temperatures, by hand: both ends, one of them twice; det(ΦᵀΦ) is 8
    # there and 6 for equal steps, so those have an efficiency of √(6/8).
    ends = np.sort(np.abs(np.array(found["temperatures"]) - 10.0))
    np.testing.assert_allclose(ends, 50.0, atol=1e-3)
    assert found["equal_steps_efficiency"] == pytest.approx(np.sqrt(6.0 / 8.0), rel=1e-6)
    assert found["effort_temperatures"] == [-40.0, 10.0, 60.0] and found["efforts"]


def test_the_printed_angles_are_those_of_the_printed_table(own_cache):
    """What points up by the printed lines of campaign.toml, read as a log's are, is what is printed beside angles."""
    answer = told(*SMALL, "-q", "--json")
    found = json.loads(answer.stdout)
    lines = told(*SMALL).stdout.splitlines()
    rows = np.array([[float(x) for x in line.split()] for line in lines[2:11]])
    first = next(k for k, line in enumerate(lines) if line.endswith("into campaign.toml:")) + 1
    pasted = tomllib.loads("\n".join(lines[first : first + 5]))
    assert pasted["columns"]["table_angles"]["names"] == ["outer", "inner"]
    assert pasted["table"] == found["table"]
    table = Turntable(**{k: tuple(v) for k, v in pasted["table"].items()})
    force = ideal_readings(table, np.deg2rad(rows[:, :2]), None, 1.0, None).force
    # Angles are printed to 0.01°, directions to 0.001.
    np.testing.assert_allclose(rows[:, 2:], force, rtol=0, atol=7e-4)
    np.testing.assert_allclose(found["up_in_case"], force, rtol=0, atol=2e-4)
    assert any("R = R_east(outer) R_up(inner)" in line for line in lines)


def test_command_tells_hours_for_a_target(own_cache):
    answer = told(*SMALL, "--target", "10", "--density", "1e-3")
    assert answer.exit_code == 0, answer.output
    assert "10 ppm at 95 %" in answer.stdout and answer.stdout.count("h of measuring") == 3
    hopeless = told(*SMALL, "--positions", "10", "--target", "10", "--repeatability", "1e-2")
    # What cannot be reached is an answer, not a failure; told for the fewest positions, too.
    assert hopeless.exit_code == 0 and hopeless.stdout.count("not reachable") == 4
    assert "D-optimal 9: not reachable" in hopeless.stdout


def _hand_log(folder):
    """60 rests of 20 s at 50 Hz, white noise of 0.01 m/s² a sample, each rest 5 mm/s² off."""
    rng = np.random.default_rng(5)
    folder.mkdir()
    up = rng.standard_normal((60, 3))
    force = 9.81 * up / np.linalg.norm(up, axis=1)[:, None] + 5e-3 * rng.standard_normal((60, 3))
    accel = np.repeat(force, 1000, axis=0) + 0.01 * rng.standard_normal((60_000, 3))
    rows = np.column_stack([np.arange(60_000) / 50.0, accel, np.repeat(np.arange(60), 1000)])
    head = "time,accel_x,accel_y,accel_z,position"
    np.savetxt(folder / "log.csv", rows, "%.6g", ",", header=head, comments="")
    (folder / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["log.csv"]\n'
    )
    return str(folder)


def test_a_campaign_shows_noise_and_scatter_for_the_plan_to_come(tmp_path, own_cache):
    plan = _hand_log(tmp_path / "campaign")
    answer = told(plan, "--optimise", "--positions", "9", "--target", "900", "--json", "-q")
    assert answer.exit_code == 0, answer.output
    shown = json.loads(answer.stdout)["shown"]
    # By hand: 0.01 m/s² / √(50 Hz), and 5 mm/s² along gravity, known from 51 degrees of freedom to 10 %.
    assert shown["density"] == pytest.approx(0.01 / np.sqrt(50.0), rel=0.1)
    assert shown["repeatability"] == pytest.approx(5e-3, rel=0.4)
    assert (shown["degree"], shown["experiments"]) == (0, 1)
    # Less is taken from the campaign where an option says it.
    again = told(plan, "--optimise", "--positions", "9", "--target", "900", "--repeatability", "0")
    assert "scatter between rests" in again.stdout and "not reachable" not in again.stdout


@pytest.mark.parametrize(
    "arguments, said",
    [
        ((), "say what to do"),
        (("--audit", "--optimise"), "only one of them"),
        (("--audit",), "needs a campaign or a scenario"),
        (("--audit", "no-such-plan"), "'no-such-plan' does not exist"),
        (("--audit", "paper-check", "--positions", "12"), "'--positions': means nothing with --audit"),
        (("no-such-plan", "--optimise"), "'no-such-plan' does not exist"),
        (("--optimise", "-o", "x"), "'-o': means nothing with --optimise, which prints its answer"),
        (("--optimise", "--assumed-noise"), "'--assumed-noise': means nothing with --optimise"),
        (("--optimise", "--positions", "8"), "8 positions cannot determine 9 parameters"),
        (("--optimise", "--criterion", "Q"), "'Q' is none of D, A, I"),
        (("--optimise", "--outer", "10", "-10"), "10 is not below -10"),
        (("--optimise", "--low", "60"), "60 is not below 60"),
        (("--optimise", "--experiments", "3"), "3 temperatures cannot determine curves of degree 6"),
        (("--optimise", "--target", "0"), "0 is not above 0 ppm"),
    ],
)  # fmt: skip
def test_command_says_what_is_wrong_with_its_usage(arguments, said, capsys, monkeypatch):
    status, out, err = run(capsys, monkeypatch, "design", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert said in err


def test_command_says_in_one_line_what_is_wrong_with_a_campaign(tmp_path, capsys, own_cache):
    (tmp_path / "campaign.toml").write_text('[recordings]\nfiles = ["*.csv"]\nfile = 1\n')
    with pytest.raises(SystemExit) as exit:
        main(["design", "--audit", str(tmp_path)])
    said = capsys.readouterr()
    assert exit.value.code == 1 and said.out == ""
    assert said.err.count("\n") == 1 and "campaign.toml" in said.err and "'file'" in said.err
