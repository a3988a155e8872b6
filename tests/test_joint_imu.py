"""Both triads in one least squares, against truth simulated in NumPy and SciPy alone."""

from pathlib import Path

import equinox as eqx
import numpy as np
import pytest
import scipy.signal
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from inertiax.calibrate.fit_quality import judge, Quality
from inertiax.calibrate.goodness_of_fit import ATTENTION, Finding
from inertiax.calibrate.joint_imu_fit import fit_together
from inertiax.calibrate.pipeline import calibrate, DeviceFailure, DeviceResult
from inertiax.calibration.calibration import read_calibration, write_calibration
from inertiax.cli.next_step import after_calibrate
from inertiax.data.campaign import load_settings
from inertiax.data.recording import Campaign, ModelChoice, Recording, Site
from inertiax.estimators import Invariant, JointImu, ReferenceAccel, ReferenceGyro, size_effect
from inertiax.exports.compensated_recording import compensate_recording
from inertiax.physics.temperature import Constant
from inertiax.procedure.single_device import iterate_one
from inertiax.reduction.dwells import Dwells


G = 9.81
ACCEL_SIGMA, GYRO_SIGMA = 2e-4, 3e-5  # m/s² and rad/s, of a dwell's mean


# A rate table with a device whose accelerometers sit apart -------------------------------------------


def _force_at(place: np.ndarray, rate: np.ndarray, attitude: Rotation) -> np.ndarray:
    """Specific force (m/s², case axes) at a place of the turning case: second differences of its path."""
    step = 2e-3
    path = lambda t: attitude * Rotation.from_rotvec(rate * t)
    at = [path(t).apply(place) for t in (-step, 0.0, step)]
    acceleration = (at[0] - 2.0 * at[1] + at[2]) / step**2
    return path(0.0).inv().apply(acceleration + [0.0, 0.0, G])


def test_size_effect_is_the_acceleration_of_a_turning_place():
    rng = np.random.default_rng(0)
    for _ in range(5):
        rate, arms = rng.normal(0.0, 3.0, 3), rng.normal(0.0, 0.05, (3, 3))
        attitude = Rotation.random(random_state=int(rng.integers(1000)))
        centre = _force_at(np.zeros(3), rate, attitude)
        expected = [_force_at(arms[i], rate, attitude)[i] - centre[i] for i in range(3)]
        # Second differences of a circle fall short by (ω h)²/12, 1e-5 of it here.
        np.testing.assert_allclose(size_effect(arms, rate), expected, rtol=2e-4, atol=1e-8)


def _axes() -> np.ndarray:
    case = np.eye(3)
    inclined = np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1], [1, -1, 0]]) / np.sqrt(2.0)
    return np.vstack([case, inclined])


def _table(rng, *, arms: np.ndarray, temperatures=(20.0,), askew=5e-3) -> tuple[Dwells, dict]:
    """Rests in 14 attitudes and plateaus about 7 axes both ways, at each temperature, and the truth."""
    truth = {
        "accel_bias": rng.normal(0.0, 0.05, 3),
        "accel": rng.normal(0.0, askew, (3, 3)),
        "gyro_bias": rng.normal(0.0, 1e-3, 3),
        "gyro": rng.normal(0.0, 5e-3, (3, 3)),
        "d": rng.normal(0.0, 1e-4, (3, 3)),
        "slope": rng.normal(0.0, 1e-3, 3),  # m/s² per °C of the accelerometers' bias
    }
    rows = []
    for t in temperatures:
        ups = np.vstack([_axes(), -_axes()])
        rows += [(t, k, np.zeros(3), G * up) for k, up in enumerate(ups)]
        for axis in _axes():
            for rate in (3.0, -3.0, 1.5):
                # About the vertical, so that gravity stands still in the case.
                rows.append((t, -1, rate * axis, G * axis))
    temperature, position, rate, force = (np.array(x) for x in zip(*rows))
    matrix = np.eye(3) + truth["accel"]
    accel = np.empty_like(force)
    for i in range(3):  # what accelerometer i feels at its place, along its own axis
        felt = force + np.cross(rate, np.cross(rate, arms[i]))
        accel[:, i] = felt @ matrix[i] + truth["accel_bias"][i]
    accel += (temperature - 20.0)[:, None] * truth["slope"]
    gyro = rate @ (np.eye(3) + truth["gyro"]).T + truth["gyro_bias"] + force @ truth["d"].T / G
    count = len(rows)
    return Dwells(
        time=np.arange(count) * 10.0,
        duration=np.full(count, 5.0),
        count=np.full(count, 500.0),
        temperature=temperature,
        experiment=np.zeros(count, int),
        position=position,
        valid=np.ones(count, bool),
        accel=accel + ACCEL_SIGMA * rng.normal(size=accel.shape),
        accel_covariance=np.tile(ACCEL_SIGMA**2 * np.eye(3), (count, 1, 1)),
        gyro=gyro + GYRO_SIGMA * rng.normal(size=gyro.shape),
        gyro_covariance=np.tile(GYRO_SIGMA**2 * np.eye(3), (count, 1, 1)),
        reference_accel=force,
        reference_gyro=rate,
    ), truth


def _reference(**settings) -> JointImu:
    gyro = ReferenceGyro(gravity=G, g_sensitivity=True)
    return JointImu(ReferenceAccel(), gyro, **settings)


def _vector(truth: dict, arms: np.ndarray | None = None) -> np.ndarray:
    keys = ("accel_bias", "accel", "gyro_bias", "gyro", "d")
    parts = [truth[k].ravel() for k in keys] + ([] if arms is None else [arms.ravel()])
    return np.concatenate(parts)


def _turn(matrix):
    return Rotation.from_matrix(_polar(np.eye(3) + matrix))


@pytest.mark.slow
def test_covariance_of_both_triads_and_lever_arms_is_right():
    arms = np.array([[0.03, 0.01, -0.02], [0.0, -0.02, 0.01], [0.015, 0.02, 0.025]])
    squares, signed, rotations, runs = [], [], [], 80
    for seed in range(runs):
        dwells, truth = _table(np.random.default_rng(seed), arms=arms)
        found = fit_together(_reference(lever_arms=True), dwells)
        assert found.converged
        error = np.asarray(found.curve.coefficients)[0] - _vector(truth, arms)
        squares.append(error @ np.linalg.solve(found.covariance, error))
        signed.append(error / np.sqrt(np.diagonal(found.covariance)))
        between = (_turn(truth["gyro"]) * _turn(truth["accel"]).inv()).as_rotvec()
        alignment = found.alignment(20.0)
        off = np.asarray(alignment.rotation) - between
        rotations.append(off @ np.linalg.solve(alignment.covariance, off))
    variance, mean = np.mean(np.square(signed), axis=0), np.mean(signed, axis=0)
    # χ² with 42 degrees of freedom over the runs: 1 sigma of the mean √(84/80) = 1.02, four above; scatter that chance
    # does not exclude is counted, which makes variances a few per cent wide. All that are 15 % wrong are seen.
    assert 37.0 < np.mean(squares) < 46.1
    # Every parameter's own mean square, χ² of 80 degrees within its 1e-5 tails: a variance wrong by 2 is seen.
    low, high = chi2.ppf([1e-5, 1 - 1e-5], runs) / runs
    assert len(variance) == 42 and np.all((low < variance) & (variance < high)), variance
    assert np.all(np.abs(mean) < 3.5 / np.sqrt(runs))
    assert abs(np.mean(rotations) - 3.0) < 3.5 * np.sqrt(6.0 / runs)


@pytest.mark.slow
def test_biases_that_wander_widen_the_intervals_of_both_triads():
    """Each bias wanders by five standard deviations of a dwell within five minutes, 30 dwells, while the temperature
    goes through three settings: curves over temperature take part of it for their own. Intervals are of the log's mean.
    """
    arms, runs, squares = np.diag([0.03, -0.02, 0.025]), 24, []
    for seed in range(runs):
        rng = np.random.default_rng(100 + seed)
        dwells, truth = _table(rng, arms=arms, temperatures=(0.0, 20.0, 40.0))
        decay = np.exp(-10.0 / 300.0)
        drive = np.sqrt(1.0 - decay**2) * rng.normal(size=(dwells.num_dwells, 6))
        drive[0] = rng.normal(size=6)
        wander = 5.0 * scipy.signal.lfilter([1.0], [1.0, -decay], drive, axis=0)
        dwells.accel[:] += ACCEL_SIGMA * wander[:, :3]
        dwells.gyro[:] += GYRO_SIGMA * wander[:, 3:]
        found = fit_together(_reference(lever_arms=True), dwells, degrees=(1, 1))
        mean = wander.mean(axis=0)
        for part, bias, slope in (
            (found.accel, truth["accel_bias"] + ACCEL_SIGMA * mean[:3], truth["slope"]),
            (found.gyro, truth["gyro_bias"] + GYRO_SIGMA * mean[3:], np.zeros(3)),
        ):
            curve = part.solution.curve
            for t in (0.0, 40.0):
                phi = np.asarray(curve.basis(t))
                covariance = np.asarray(part.solution.covariance)
                blocks = covariance.reshape(phi.size, -1, phi.size, covariance.shape[0] // phi.size)
                sigma = np.sqrt(np.einsum("a,aibi,b->i", phi, blocks, phi)[:3])
                off = np.asarray(curve(t))[:3] - bias - (t - 20.0) * slope
                squares.append(np.square(off / sigma))
    # 288 numbers, of which those of one axis at two temperatures go together: 1 sigma of the mean is √(2/144) = 0.12;
    # the covariance is a mean over what one log's residuals leave possible. Without slow noise it is 19.
    assert 0.5 < np.mean(squares) < 1.5


def _polar(matrix: np.ndarray) -> np.ndarray:
    u, _, v = np.linalg.svd(matrix)
    return u @ v


@pytest.mark.slow
def test_lever_arms_that_are_left_out_bias_the_accelerometers():
    arms = np.diag([0.03, -0.02, 0.025])
    dwells, truth = _table(np.random.default_rng(1), arms=arms)
    without, within = (fit_together(_reference(lever_arms=k), dwells) for k in (False, True))
    error = lambda f: np.asarray(f.curve.coefficients)[0, :12] - _vector(truth)[:12]
    sigma = np.sqrt(np.diagonal(within.covariance))[:12]
    # −ω² R of accelerometer i at 3 rad/s is 0.3 m/s²; a part of it passes for bias and scale factor.
    assert np.max(np.abs(error(without)[:3])) > 0.02
    assert np.max(np.abs(error(without)) / sigma) > 100.0
    assert np.max(np.abs(error(within)) / sigma) < 4.0
    assert without.accel.chi2_per_dof > 1e4 and within.accel.chi2_per_dof < 1.5


@pytest.mark.slow
def test_lever_arms_stay_constant_over_temperature():
    arms = np.diag([0.03, -0.02, 0.025])
    dwells, truth = _table(np.random.default_rng(2), arms=arms, temperatures=(0.0, 20.0, 40.0))
    found = fit_together(_reference(lever_arms=True), dwells, degrees=(1, 0))
    shown, covariance = found.lever_arms
    assert np.all(np.abs(shown - arms).ravel() < 4.0 * np.sqrt(np.diagonal(covariance)))
    coefficients = np.asarray(found.curve.coefficients)
    assert coefficients.shape[0] == 2 and np.all(coefficients[1, -9:] == 0.0)
    assert found.gyro.solution.curve.basis.size == 1
    # The accelerometers' slope per °C is the linear coefficient over half the range.
    slope = np.asarray(found.accel.solution.curve.coefficients)[1, :3] / 20.0
    np.testing.assert_allclose(slope, truth["slope"], atol=5.0 * ACCEL_SIGMA / 20.0 / np.sqrt(30))


@pytest.mark.slow
def test_lever_arms_that_no_plateau_tells_are_held_at_zero_as_long_as_the_others():
    rng = np.random.default_rng(3)
    arms = rng.normal(0.0, 0.03, (3, 3))
    dwells, _ = _table(rng, arms=arms, askew=0.0)
    along = np.sum(np.asarray(dwells.reference_gyro) != 0.0, axis=1) <= 1
    found = fit_together(_reference(lever_arms=True), dwells[np.flatnonzero(along)])
    shown, covariance = found.lever_arms
    sigma = np.sqrt(np.diagonal(covariance)).reshape(3, 3)
    own = np.eye(3, dtype=bool)
    # By hand: a plateau about a case axis changes accelerometer i by −ω² R_ii alone, so that these are told.
    assert np.all(np.abs(shown - arms)[own] < 4.0 * sigma[own]) and np.all(sigma[own] < 1e-4)
    assert np.all(shown[~own] == 0.0)
    size = np.sqrt(np.mean(np.square(np.diagonal(shown)) + np.square(np.diagonal(sigma))))
    np.testing.assert_allclose(sigma[~own], size, rtol=1e-9)
    assert any("no plateau shows that along y, z" in line for line in found.statements)


@pytest.mark.slow
def test_lever_arms_show_along_other_axes_as_far_as_the_device_stands_askew():
    """Plateaus about case axes, of a device that stands a degree askew: by its misalignments they show all nine."""
    askew, off, told = np.deg2rad(1.0), [], 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        arms = rng.normal(0.0, 0.03, (3, 3))
        dwells, _ = _table(rng, arms=arms, askew=askew)
        along = np.sum(np.asarray(dwells.reference_gyro) != 0.0, axis=1) <= 1
        found = fit_together(_reference(lever_arms=True), dwells[np.flatnonzero(along)])
        shown, covariance = found.lever_arms
        off.append((shown - arms).ravel() / np.sqrt(np.diagonal(covariance)))
        told += np.sum(shown[~np.eye(3, dtype=bool)] != 0.0)
    # 2e-4 m/s² over (3 rad/s)² and a degree are 1.3 mm, a third of the arms' size 10 mm: most are told.
    assert told > 48
    # 108 numbers of unit variance: within three of its standard deviations, 0.41; those held are of the arms' size.
    assert 0.6 < np.mean(np.square(off)) < 1.4


def test_lever_arms_without_a_plateau_are_refused_in_words():
    dwells, _ = _table(np.random.default_rng(3), arms=np.zeros((3, 3)))
    resting = np.flatnonzero(np.asarray(dwells.position) >= 0)
    with pytest.raises(ValueError, match=r"do not determine .*inclined"):
        fit_together(_reference(lever_arms=True), dwells[resting])
    with pytest.raises(ValueError, match="JointImu.lever_arms=True.*ReferenceAccel"):
        JointImu(Invariant(gravity=G), ReferenceGyro(gravity=G), lever_arms=True)


def _campaign(dwells: Dwells, model: ModelChoice) -> Campaign:
    """A recording of 1.5 s of each dwell at 50 Hz, as noisy as the dwells' means say."""
    rng, samples = np.random.default_rng(9), 75
    long = lambda x: np.repeat(np.asarray(x), samples, axis=0)
    count = samples * dwells.num_dwells
    noise = lambda sigma: sigma * np.sqrt(samples) * rng.normal(size=(count, 3))
    recording = Recording(
        time=np.arange(count) * 0.02,
        accel=long(dwells.accel) + noise(ACCEL_SIGMA),
        gyro=long(dwells.gyro) + noise(GYRO_SIGMA),
        position=long(dwells.position),
        reference_accel=long(dwells.reference_accel),
        reference_gyro=long(dwells.reference_gyro),
        name="table",
    )
    return Campaign((recording,), Site(gravity=G), model=model)


def test_a_campaign_that_leaves_lever_arms_out_is_told_to_set_them():
    """3 cm at 3 rad/s are 0.27 m/s², a thousand times the noise: no wrong unit and no exchanged position."""
    dwells, _ = _table(np.random.default_rng(6), arms=0.03 * np.ones((3, 3)))
    (result,) = calibrate(_campaign(dwells, ModelChoice()))
    assert isinstance(result, DeviceResult), result
    quality = judge(result)
    assert quality.verdict == "doubtful"
    assert "set lever_arms = true" in quality.answer and "wrong units" not in quality.answer
    said = after_calibrate(quality, Path("C"), Path("R"), table=True)
    assert "lever_arms = true" in said and "campaign.toml" in said


def test_after_magnetometers_alone_no_diagnosis_is_named():
    """`next: inertiax diagnose` refused each of their campaigns: it is of accelerometers and gyros."""
    misfit = Finding("misfit", ATTENTION, "Magnetometers: 2 µT rms is left.")
    quality = Quality("usable", "", (misfit,), (), ())
    said = lambda triads: after_calibrate(quality, Path("C"), Path("R"), table=False, triads=triads)
    assert "inertiax diagnose" in said(True)
    assert said(False).startswith("next: inertiax compensate")


@pytest.mark.slow
def test_lever_arms_of_a_campaign_are_stored_and_taken_away(tmp_path):
    arms = np.array([[0.03, 0.01, -0.02], [0.0, -0.02, 0.01], [0.015, 0.02, 0.025]])
    dwells, truth = _table(np.random.default_rng(6), arms=arms)
    campaign = _campaign(dwells, ModelChoice(g_sensitivity=True, lever_arms=True))
    (result,) = calibrate(campaign)
    assert isinstance(result, DeviceResult), result
    assert any(c.startswith("accelerometer y: lever arm ") for c in result.choices)
    write_calibration(result.calibration, tmp_path / "calibration.json")
    calibration = read_calibration(tmp_path / "calibration.json")
    found = np.array([e.coefficients for e in calibration.effects])
    assert [e.channel_names for e in calibration.effects] == [(f"accel_{a}",) for a in "xyz"]
    sigma = np.sqrt([np.diagonal(e.covariance) for e in calibration.effects])
    # Twice the noise of the dwells: their own and that of the recording made of them.
    assert np.all(np.abs(found - arms) < 4.5 * np.sqrt(2.0) * sigma)
    (recording,) = campaign.recordings
    force, _, _ = compensate_recording(calibration, recording)
    inner = np.arange(recording.num_samples) % 75
    inside = (inner > 2) & (inner < 72)  # between plateaus the rate jumps, which no table does
    assert force is not None and recording.reference_accel is not None
    left = (force - recording.reference_accel)[inside]
    blocks = left.reshape(-1, 69, 3).mean(axis=1)
    assert np.max(np.abs(blocks)) < 5.0 * np.sqrt(2.0) * ACCEL_SIGMA


def test_settings_are_read_from_campaign_toml(tmp_path):
    keys = "together = true\nlever_arms = false\nmisalignment = false\n"
    text = f'[site]\ngravity = {G}\n[recordings]\nfiles = ["a.csv"]\n[model]\n{keys}'
    (tmp_path / "campaign.toml").write_text(text)
    model = load_settings(tmp_path)[0].model
    assert (model.together, model.lever_arms, model.misalignment) == (True, False, False)


@pytest.mark.parametrize(
    "model, words",
    [
        (ModelChoice(accel_estimator="invariant", lever_arms=True), "for both triads"),
        (ModelChoice(gyro_estimator="static", together=True), "'reference' or 'gravity'"),
        (ModelChoice(misalignment=False, together=False), "but together = false"),
    ],
)
def test_contradictory_settings_are_refused(model, words):
    dwells, _ = _table(np.random.default_rng(7), arms=np.zeros((3, 3)))
    (failure,) = calibrate(_campaign(dwells, model))
    assert isinstance(failure, DeviceFailure) and words in failure.reason


@pytest.mark.slow
def test_aligned_triads_leave_a_symmetric_matrix():
    dwells, truth = _table(np.random.default_rng(4), arms=np.zeros((3, 3)))
    symmetric = 0.5 * (truth["gyro"] + truth["gyro"].T)
    turned = np.asarray(dwells.reference_gyro) @ (symmetric - truth["gyro"]).T
    dwells = eqx.tree_at(lambda d: d.gyro, dwells, np.asarray(dwells.gyro) + turned)
    free, held = (fit_together(_reference(misalignment=k), dwells) for k in (True, False))
    matrix = np.asarray(held.gyro.solution.curve.coefficients)[0, 3:12].reshape(3, 3)
    np.testing.assert_array_equal(matrix, matrix.T)
    sigma = lambda f: np.sqrt(np.diagonal(f.gyro.solution.covariance))[3:12].reshape(3, 3)
    assert np.all(np.abs(matrix - symmetric) < 4.0 * sigma(held))
    # Two entries that are one: its variance is half of either's.
    off = ~np.eye(3, dtype=bool)
    np.testing.assert_allclose(sigma(held)[off], sigma(free)[off] / np.sqrt(2.0), rtol=0.15)
    np.testing.assert_allclose(sigma(held)[~off], sigma(free)[~off], rtol=0.05)


@pytest.mark.slow
def test_the_iterated_procedure_reaches_the_joint_answer():
    dwells, _ = _table(np.random.default_rng(5), arms=np.diag([0.03, -0.02, 0.025]))
    joint = fit_together(_reference(lever_arms=True), dwells)
    passes = iterate_one(joint.estimator, Constant(), dwells)
    assert bool(passes.succeeded)
    apart = np.asarray(passes.curve.coefficients - joint.curve.coefficients)[0]
    # Weights of compensated outputs differ by Γ, half a percent.
    assert np.max(np.abs(apart) / np.sqrt(np.diagonal(joint.covariance))) < 0.05
