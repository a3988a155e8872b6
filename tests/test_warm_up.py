"""A hand log at one temperature joined with a warm-up in one pose: a device made in NumPy, and a hand calculation."""

import json
from dataclasses import replace

import jax
import numpy as np
import pytest

from command_runs import run
from exports_cases import triad
from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate
from inertiax.calibration.calibration import Calibration, read_calibration, write_calibration
from inertiax.calibration.fitted_effects import FittedEffect
from inertiax.calibration.named_g_sensitivity import with_matrix_d
from inertiax.calibration.triad import TriadCalibration
from inertiax.calibration.turn_on import turn_on
from inertiax.calibration.warm_up import with_warm_up
from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.exports import export
from inertiax.physics.temperature import Constant, CubicSpline, Curve, Polynomial


G = 9.81
MATRIX = np.array([[0.01, 0.0, 0.0], [0.004, -0.008, 0.0], [-0.006, 0.003, 0.005]])


def bias(temperature):
    """m/s², a cubic of each accelerometer over −10 to 50 °C."""
    x = (np.asarray(temperature)[..., None] - 20.0) / 30.0
    shape = np.array([0.10, -0.05, 0.08]) * x + np.array([0.02, 0.03, -0.04]) * x**3
    return np.array([0.1, -0.2, 0.15]) + shape


def logs(seed, turn_on=(0.0, 0.0, 0.0)):
    """Eighteen poses of 4 s at 22 °C, and half an hour in one pose from −10 to 50 °C, `turn_on` (m/s²) off."""
    rng = np.random.default_rng(seed)
    up = rng.standard_normal((18, 3))
    up = np.repeat(up / np.linalg.norm(up, axis=1, keepdims=True), 200, axis=0)
    hand = {"position": np.repeat(np.arange(18), 200), "up": up, "temperature": np.full(3600, 22.0)}
    heat = np.linspace(-10.0, 50.0, 9000)
    warm = {
        "position": np.zeros(9000, int),
        "up": np.tile([0.6, 0.0, 0.8], (9000, 1)),
        "temperature": heat,
    }
    made = []
    for log in (hand, warm):
        accel = G * log["up"] @ (np.eye(3) + MATRIX).T + bias(log["temperature"])
        accel += 0.01 * rng.standard_normal(accel.shape) + (
            0.0 if log is hand else np.array(turn_on)
        )
        time = np.arange(len(accel)) * (0.02 if log is hand else 0.2)
        heat = log["temperature"][:, None] + 0.01 * rng.standard_normal((len(accel), 1))
        made.append(Recording(time=time, accel=accel, temperature=heat, position=log["position"]))
    return made


@pytest.fixture(scope="module")
def both():
    with jax.enable_x64(True):
        hand, warm = logs(1)
        poses = ModelChoice(accel_estimator="invariant", temperature_degree=0)
        pose = ModelChoice(accel_estimator="static", temperature_degree=3)
        (fixed,) = calibrate(Campaign((hand,), Site(G), model=poses))
        (moving,) = calibrate(Campaign((warm,), Site(G), model=pose))
        return fixed.calibration, moving.calibration


def test_what_a_power_cycle_changed_is_told_along_gravity(both):
    """The change's part along gravity, through the inverse of the device's own matrix, within its stated sigma."""
    shift = np.array([0.03, -0.02, 0.05])
    pose = ModelChoice(accel_estimator="static", temperature_degree=3)
    with jax.enable_x64(True):
        (warm,) = calibrate(Campaign((logs(3, shift)[1],), Site(G), model=pose))
    told = turn_on(both[0], warm.calibration, 22.0)
    force = np.linalg.inv(np.eye(3) + MATRIX) @ shift + G * np.array([0.6, 0.0, 0.8])
    change = np.linalg.norm(force) - G
    found, sigma = told.gravity
    assert abs(found - change) < 4.0 * sigma and sigma < 0.1 * change and told.seen
    notes = with_warm_up(both[0], warm.calibration).notes
    assert f"the force along gravity by {found:+.4f} m/s²" in notes[-1]
    assert "turn-on bias" in notes[-1] and "counted as bias along gravity" in notes[-2]
    same = turn_on(*both, 22.0)
    assert not same.seen and same.sentence.endswith("no more than their noise")


@pytest.mark.parametrize("warms", [True, False])
def test_of_a_warm_up_in_one_pose_the_next_step_is_named_once(warms):
    """Gyros beside it as well; of a log of many poses nothing of the kind is said."""
    hand, warm = logs(1)
    log = warm if warms else hand
    rng = np.random.default_rng(9)
    log = replace(log, gyro=1e-3 * rng.standard_normal(log.accel.shape))
    model = ModelChoice(
        accel_estimator="static" if warms else "invariant",
        gyro_estimator="static",
        temperature_degree=1 if warms else 0,
    )
    with jax.enable_x64(True):
        (found,) = calibrate(Campaign((log,), Site(G), model=model))
        quality = judge(found)
    named = [n for n in quality.next if "inertiax export HAND/calibration.json --warm-up" in n]
    assert len(named) == warms
    assert any("tilts by hand" in n for n in quality.next) is not warms
    assert any("a log turned by hand gives it" in w for w in found.warnings) is warms


def test_its_sigma_is_that_of_drawn_parameters(both):
    fixed, moving = both[0].accel, both[1].accel
    stated = turn_on(*both, 22.0).gravity.sigma
    rng = np.random.default_rng(8)
    phi = moving.curve.basis.rows(np.array([22.0]))[0]
    draws = []
    mean = (
        np.asarray(fixed.curve.coefficients).ravel(),
        np.asarray(moving.curve.coefficients).ravel(),
    )
    for p, c in zip(
        rng.multivariate_normal(mean[0], fixed.covariance, 4000),
        rng.multivariate_normal(mean[1], moving.covariance, 4000),
        strict=True,
    ):
        at = dict(zip(fixed.names, p, strict=True))
        matrix = np.array(
            [[at.get(f"accel.matrix[{i},{j}]", 0.0) for j in range(3)] for i in range(3)]
        )
        output = np.asarray(moving.mean_output) + phi @ c.reshape(len(phi), 3)
        draws.append(np.linalg.norm(np.linalg.solve(np.eye(3) + matrix, output - p[:3])))
    # 4000 draws tell a sigma to 1.1 %.
    assert stated == pytest.approx(np.std(draws), rel=0.05)


@pytest.mark.parametrize("named", [False, True])
def test_gyros_of_two_logs_differ_by_their_biases_and_not_by_the_force(named):
    """Δ = ν_w(T₀) − ν⁰ − D f / g in numbers of this test; the covariances add. A diagnosis names D, a fit has it."""
    names = tuple(f"gyro.bias[{i}]" for i in range(3))
    d = tuple(f"gyro.g_sensitivity[{i},{j}]" for i in range(3) for j in range(3))
    matrix = np.arange(9.0).reshape(3, 3) * 1e-4
    first = np.concatenate([[0.01, -0.02, 0.03], matrix.ravel()])[None]
    hand = TriadCalibration(Curve(Constant(), first), 4e-10 * np.eye(12), (*names, *d), "gravity")
    warm = np.array([[0.011, -0.02, 0.028], [0.002, 0.0, 0.0]])
    span = (-10.0, 50.0)
    still = TriadCalibration(Curve(Polynomial(1, *span), warm), 9e-10 * np.eye(6), names, "static")
    level = accel_of_one_pose(np.array([0.0, 0.0, G]), span)
    effects = ()
    if named:
        hand = TriadCalibration(
            Curve(Constant(), first[:, :3]), 4e-10 * np.eye(3), names, "gravity"
        )
        effects = tuple(
            FittedEffect(
                "g_sensitivity",
                "gyro",
                (i,),
                (("axes", "xyz"),),
                matrix[i],
                4e-10 * np.eye(3),
                "rad/s/g",
            )
            for i in range(3)
        )
    known = Calibration(gravity=G, gyro=hand, accel=unit_accel(), effects=effects)
    one_pose = Calibration(gravity=G, gyro=still, accel=level, temperature_range=span)
    told = turn_on(known, one_pose, 35.0)
    both = with_matrix_d(with_warm_up(known, one_pose, 35.0))
    assert both.effects == () and both.gyro.names == (*names, *d)
    np.testing.assert_allclose(both.gyro.parameters(-5.0)[12:], matrix.ravel(), atol=1e-9)
    _, sigma = both.gyro.over(np.array([-5.0]))
    np.testing.assert_allclose(sigma[0, 3:], 2e-5, rtol=1e-6)
    written = export(with_warm_up(known, one_pose, 35.0), "c")
    _, rate = written.applied(np.array([[0.0, 0.0, G]]), np.zeros((1, 3)), np.array([35.0]))
    np.testing.assert_allclose(rate[0], -first[0, :3] - matrix[:, 2], atol=1e-9)
    assert written.losses == ()
    # At 35 °C the polynomial's variable is 0.5.
    expected = np.array([0.012, -0.02, 0.028]) - [0.01, -0.02, 0.03] - matrix[:, 2]
    np.testing.assert_allclose(told.gyro.value, expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(told.gyro.sigma, np.sqrt(4e-10 + 9e-10 * 1.25), rtol=1e-6)
    assert told.gravity.value == pytest.approx(0.0, abs=1e-6)


def unit_accel():
    names = tuple(f"accel.bias[{i}]" for i in range(3))
    return TriadCalibration(
        Curve(Constant(), np.zeros((1, 3))), 1e-8 * np.eye(3), names, "invariant"
    )


def accel_of_one_pose(mean, span):
    names = tuple(f"accel.bias[{i}]" for i in range(3))
    curve = Curve(Polynomial(1, *span), np.zeros((2, 3)))
    return TriadCalibration(curve, 1e-8 * np.eye(6), names, "static", mean)


def test_the_mean_output_is_in_the_file(both, tmp_path):
    """Of 0.6 g, 0 and 0.8 g by the device's own matrix and its mean bias over the ramp."""
    write_calibration(both[1], tmp_path / "warm.json")
    again = read_calibration(tmp_path / "warm.json").accel.mean_output
    truth = G * (np.eye(3) + MATRIX) @ [0.6, 0.0, 0.8] + bias(np.linspace(-10.0, 50.0, 9000)).mean(
        0
    )
    # Rests weigh alike in the mean, whatever their length; they do not reach the ramp's ends.
    np.testing.assert_allclose(again, truth, atol=0.01)
    assert both[0].accel.mean_output is None


def test_biases_of_a_made_up_device_are_told_over_temperature(both):
    found = with_warm_up(*both)
    at = np.array([-10.0, 0.0, 22.0, 40.0, 50.0])
    values, sigmas = found.accel.over(at)
    error = values[:, :3] - bias(at)
    assert np.abs(error / sigmas[:, :3]).max() < 4.0
    assert np.abs(error).max() < 0.005  # of changes of 0.1 m/s² and more
    # Without the warm-up the biases of 22 °C are wrong elsewhere; the matrix is the hand log's.
    assert np.abs(both[0].accel.over(at)[0][:, :3] - bias(at)).max() > 0.1
    np.testing.assert_allclose(
        values[:, 3:], np.tile(both[0].accel.over(at)[0][0, 3:], (5, 1)), rtol=1e-9
    )
    assert found.temperature_range == both[1].temperature_range
    assert found.notes[-2].startswith(
        "biases over temperature from a warm-up in one pose, joined at 22.0"
    )


@pytest.mark.parametrize(
    "basis", [Polynomial(3, -10.0, 50.0), CubicSpline((-10.0, 5.0, 30.0, 50.0))]
)
def test_values_and_variances_are_those_of_the_equation(basis):
    """p + b(T) − b(T0); variance of p plus that of the difference, by hand from the warm-up's covariance."""
    rng = np.random.default_rng(2)
    fixed, moving = triad("accel", Constant(), seed=4), triad("accel", basis, seed=5)
    root = 1e-3 * rng.standard_normal((2, 48, 48))
    count = len(moving.names)
    fixed = replace_covariance(fixed, root[0][:count, :count] @ root[0][:count, :count].T)
    moving = replace_covariance(moving, root[1] @ root[1].T)
    warm = Calibration(gravity=G, accel=moving, temperature_range=(-10.0, 50.0))
    found = with_warm_up(Calibration(gravity=G, accel=fixed), warm, 15.0).accel
    at = np.array([-10.0, 15.0, 37.0])
    values, sigmas = found.over(at)
    change = moving.over(at)[0][:, :3] - moving.over(np.array([15.0]))[0][:, :3]
    expected = np.asarray(fixed.curve.coefficients)[0] + np.pad(change, ((0, 0), (0, count - 3)))
    np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-12)
    step = basis.rows(at) - basis.rows(np.array([15.0]))
    blocks = np.asarray(moving.covariance).reshape(basis.size, count, basis.size, count)
    for k in range(3):
        variance = fixed.covariance[k, k] + np.einsum("ta,ab,tb->t", step, blocks[:, k, :, k], step)
        np.testing.assert_allclose(sigmas[:, k], np.sqrt(variance), rtol=1e-9)
    np.testing.assert_allclose(sigmas[:, 5], np.sqrt(fixed.covariance[5, 5]), rtol=1e-9)


def test_one_pose_gives_gyros_that_are_missing_but_no_accelerometers(both):
    """Of gyros at rest the warm-up tells biases; of accelerometers only what they do with temperature."""
    basis = Polynomial(3, -10.0, 50.0)
    turning = triad("gyro", basis, seed=6)
    warm = replace(both[1], gyro=turning)
    assert with_warm_up(both[0], warm).gyro is turning
    alone = Calibration(gravity=G, gyro=triad("gyro", Constant(), seed=7))
    assert with_warm_up(alone, warm, 20.0).accel is None


def test_a_few_degrees_of_the_first_log_are_held_at_its_temperature(both):
    """Gyros with a slope over 20 to 24 °C: at 22 °C values and sigmas are theirs, by hand from the covariance."""
    basis = Polynomial(1, 20.0, 24.0)
    turning = triad("gyro", basis, seed=8)
    cross = np.zeros((len(both[0].accel.covariance), len(turning.covariance)))
    sloped = replace(both[0], gyro=turning, temperature_range=(20.0, 24.0), cross_covariance=cross)
    warm = replace(both[1], gyro=triad("gyro", Polynomial(3, -10.0, 50.0), seed=6))
    joined = with_warm_up(sloped, warm).gyro
    count = len(joined.names)
    values, sigmas = joined.over(np.array([22.0]))
    np.testing.assert_allclose(values[0], np.asarray(sloped.gyro.curve.coefficients)[0], rtol=1e-9)
    own = np.sqrt(
        np.diagonal(np.asarray(sloped.gyro.covariance))[:count]
    )  # T_1 is zero in the middle
    np.testing.assert_allclose(sigmas[0], own, rtol=1e-6)


def test_a_log_by_hand_may_be_a_little_warmer_than_the_warm_up(both):
    """At 52 °C beside −10 to 50 °C the constants are its own, and the curve's differences those of a polynomial."""
    fixed, moving = both
    joined = with_warm_up(replace(fixed, temperature_range=(51.0, 53.0)), moving)
    at = np.array([-10.0, 20.0, 52.0])
    values, sigmas = joined.accel.over(at)
    np.testing.assert_allclose(values[2, :3], fixed.accel.curve.coefficients[0, :3], rtol=1e-9)
    curve = np.polynomial.chebyshev.chebval(
        (2.0 * at - sum(moving.temperature_range)) / np.ptp(moving.temperature_range),
        np.asarray(moving.accel.curve.coefficients)[:, :3],
    ).T
    np.testing.assert_allclose(values[:, :3] - values[2, :3], curve - curve[2], atol=1e-9)
    assert np.all(sigmas[0, :3] > sigmas[2, :3])
    assert joined.temperature_range[1] == 52.0
    beyond = f"{52.0 - moving.temperature_range[1]:.1f}"
    assert any(f"continued by {beyond} °C" in n for n in joined.notes)


def replace_covariance(one, covariance):
    return type(one)(one.curve, covariance, one.names, one.estimator)


def test_what_does_not_fit_together_is_refused_in_one_line(both):
    fixed, moving = both
    cold = replace(fixed, temperature_range=(-30.0, -28.0))
    wide = replace(fixed, temperature_range=(0.0, 40.0))
    for one, other, words in (
        (moving, moving, "depends on temperature itself"),
        (fixed, fixed, "the warm-up has no biases over temperature"),
        (cold, moving, "made at -29.0 °C, outside of the warm-up's .*let a warm-up reach -29 °C"),
        (wide, moving, "covers 0.0 to 40.0 °C with constants"),
        (replace(fixed, temperature_range=None), moving, "has no temperature"),
        (fixed, replace(moving, temperature_range=None), "the warm-up has no temperatures"),
        (replace(fixed, device="A"), replace(moving, device="B"), "of device 'B'.*of 'A'"),
    ):
        with pytest.raises(ValueError, match=words):
            with_warm_up(one, other)


def test_the_export_command_joins_them(both, capsys, monkeypatch, tmp_path):
    write_calibration(both[0], tmp_path / "hand.json")
    write_calibration(both[1], tmp_path / "warm.json")
    out = tmp_path / "joined.json"
    status, said, _ = run(
        capsys, monkeypatch, "export", tmp_path / "hand.json", "--warm-up", tmp_path / "warm.json",
        "--to", "inertiax", "-o", out, "--json",
    )  # fmt: skip
    assert status == 0
    assert [n for n in json.loads(said)["notes"] if "no more than their noise" in n]
    expected, got = with_warm_up(*both), read_calibration(out)
    at = np.linspace(-10.0, 50.0, 7)
    np.testing.assert_allclose(
        got.accel.over(at)[0], expected.accel.over(at)[0], rtol=1e-6, atol=1e-9
    )
    status, _, err = run(
        capsys,
        monkeypatch,
        "export",
        tmp_path / "hand.json",
        "--at",
        "20",
        "--to",
        "px4",
        "-o",
        out,
    )
    assert status == 2 and "with --warm-up" in err
