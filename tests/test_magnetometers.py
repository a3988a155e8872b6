"""Hard and soft iron, in the frame of the accelerometers: against a simulation by its own formulas."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibrate.magnetic_directions import missing_directions
from inertiax.calibrate.magnetic_fit import Fit
from inertiax.calibrate.magnetometers import calibrate_magnetometers
from inertiax.calibrate.magnetometers_of_device import magnetometer_calibration
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.calibration.calibration import Calibration, read_calibration, write_calibration
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.estimators.magnetic_field import MagneticField, turn_to_vertical
from inertiax.physics.composition import compose_accel
from inertiax.physics.error_model import AccelerometerErrors
from inertiax.physics.magnetic_model import compensate_mag, distort_mag, MagnetometerErrors
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.field_rows import field_rows, sample_noise
from inertiax.report.calibration import figures_ahead
from magnetometer_cases import DIP, DRIFT, FIELD, field_of, HARD, rotations, rows, SOFT, WARM, WIRE


# Noise of 1e-12 T leaves 1e-12 / 48e-6 of a matrix element, and the solve stops within 1e-7 sigma of its optimum.
EXACT = 1e-6


def _exact(**kind):
    return rows(1, noise=0.0, tilt=0.0, **kind)


def _first(found, kind):
    names = found.estimator.names
    own = [k for k, n in enumerate(names) if n.startswith(f"mag.{kind}")]
    return np.asarray(found.curve.coefficients)[0, own]


def test_compensation_by_hand():
    # (26, 0, 0) µT less 10 µT of hard iron and 2 A at 0.5 µT/A, over a scale of 1.25: 12 µT.
    errors = MagnetometerErrors(
        jnp.array([1e-5, 0.0, 0.0]), 0.25 * jnp.eye(3), jnp.array([5e-7, 0.0, 0.0])
    )
    field = compensate_mag(errors, jnp.array([2.6e-5, 0.0, 0.0]), 2.0)
    assert np.allclose(field, [1.2e-5, 0.0, 0.0], rtol=0.0, atol=1e-18)
    assert np.allclose(distort_mag(errors, field, 2.0), [2.6e-5, 0.0, 0.0], rtol=0.0, atol=1e-18)


def test_parameters_without_noise():
    found = calibrate_magnetometers(_exact(), field=FIELD)
    assert found.frame == "accel"
    assert np.allclose(_first(found, "bias"), HARD, rtol=0.0, atol=EXACT * FIELD)
    assert np.allclose(_first(found, "matrix").reshape(3, 3), SOFT, rtol=0.0, atol=EXACT)
    dip = magnetometer_calibration(found, Rig()).dip
    assert np.isclose(float(dip), DIP, rtol=0.0, atol=EXACT)


def test_without_the_field_the_mean_scale_is_one():
    found = calibrate_magnetometers(_exact())
    product = np.eye(3) + _first(found, "matrix").reshape(3, 3)
    field = float(np.asarray(found.estimator.field))
    assert not found.field_given
    assert np.isclose(np.linalg.det(product), 1.0, rtol=0.0, atol=EXACT)
    # What is left of the convention: the matrix times the field.
    assert np.allclose(product * field, (np.eye(3) + SOFT) * FIELD, rtol=0.0, atol=EXACT * FIELD)


def test_without_a_vertical_the_frame_is_the_triads_own():
    found = calibrate_magnetometers(_exact(rests=0, moving=60), field=FIELD)
    product = np.eye(3) + _first(found, "matrix").reshape(3, 3)
    assert found.frame == "own"
    assert np.all(product[np.triu_indices(3, 1)] == 0.0)
    # The ellipsoid is the same: (E + S)(E + S)ᵀ is free of a rotation of the field.
    shape = (np.eye(3) + SOFT) @ (np.eye(3) + SOFT).T
    assert np.allclose(product @ product.T, shape, rtol=0.0, atol=EXACT)
    assert "their own frame" in found.warnings[0]


def test_current_as_covariate():
    found = calibrate_magnetometers(_exact(driven=True, wire=WIRE), field=FIELD)
    # 20 A make of 1e-6 of the field 2.4 pT/A.
    assert np.allclose(_first(found, "current"), WIRE, rtol=0.0, atol=EXACT * FIELD / 20.0)
    assert np.allclose(_first(found, "bias"), HARD, rtol=0.0, atol=EXACT * FIELD)


def test_hard_iron_over_temperature():
    found = calibrate_magnetometers(rows(3, warm=True, drift=DRIFT), field=FIELD)
    mag = magnetometer_calibration(found, Rig())
    assert (found.free[:, 0].sum(), found.free[:, 3].sum()) == (2, 1)
    for at in (5.0, 45.0):
        (values,), (sigmas,) = mag.triad.over(np.array([at]))
        wanted = np.concatenate([HARD + DRIFT * (at - WARM), SOFT.ravel()])
        # Twelve values within 4 sigma: chance leaves that in 1e-3 of seeds.
        assert np.all(np.abs(values - wanted) < 4.0 * sigmas)


@pytest.mark.parametrize("latitude", [None, np.radians(50.0)])
def test_an_inverted_triad_is_told_by_the_hemisphere_or_taken_for_an_upright_one(latitude):
    soft = -2.0 * np.eye(3) - SOFT  # E + S = −(E + SOFT)
    found = calibrate_magnetometers(_exact(soft=soft), field=FIELD, latitude=latitude)
    wanted = SOFT if latitude is None else soft
    assert np.allclose(_first(found, "matrix").reshape(3, 3), wanted, rtol=0.0, atol=EXACT)


def test_exchanged_axes_are_turned_and_told():
    exchange = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    found = calibrate_magnetometers(
        _exact(soft=exchange - np.eye(3)), field=FIELD, latitude=np.radians(50.0)
    )
    matrix = _first(found, "matrix").reshape(3, 3)
    assert np.allclose(matrix + np.eye(3), exchange, rtol=0.0, atol=EXACT)
    assert "x along +y, y along +x, z along −z" in found.warnings[0]


def test_a_mirrored_triad_in_closed_form():
    rng = np.random.default_rng(5)
    turns = rotations(20, rng)
    truth = rotations(1, rng)[0]
    fields, up = turns @ np.array([0.4, 0.0, -0.9]) @ truth, turns[:, :, 2]
    turn, vertical = turn_to_vertical(fields, up)
    # In 64 bits a singular vector of 20 rows is known to some 1e-14.
    assert np.allclose(turn, truth, rtol=0.0, atol=1e-10)
    assert np.isclose(vertical, -0.9, rtol=0.0, atol=1e-10)


def test_two_stages_are_one():
    names = MagneticField(field=FIELD, at=np.zeros(0), with_current=True)
    rng = np.random.default_rng(3)
    errors = [
        MagnetometerErrors(*(0.1 * rng.normal(size=s) for s in ((3,), (3, 3), (3,))))
        for _ in range(2)
    ]
    first, second = (names.pack(e) for e in errors)
    whole = names.unpack(names.compose(first, second))
    output, current = rng.normal(size=3), 0.7
    once = compensate_mag(whole, output, current)
    # The second stage's current is beside the field that the first has compensated.
    twice = compensate_mag(errors[1], compensate_mag(errors[0], output, current), current)
    assert np.allclose(once, twice, rtol=0.0, atol=1e-12)  # rounding of two 3 × 3 solves
    affine = compose_accel(*(AccelerometerErrors(e.bias, e.matrix) for e in errors))
    assert np.allclose(whole.bias, affine.bias, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("factor, unit", [(1e6, "uT"), (1e4, "gauss"), (1e9, "nT")])
def test_a_wrong_unit_is_named(factor, unit):
    wrong = eqx.tree_at(lambda d: d.mag, rows(1), factor * np.asarray(rows(1).mag))
    with pytest.raises(ValueError, match=f'unit = "{unit}"'):
        calibrate_magnetometers(wrong)


def test_turns_about_one_axis_do_not_determine_it():
    found = rows(1, rests=0, moving=40, noise=1e-9)
    angle = np.linspace(0.0, 6.0, 40)
    flat = FIELD * np.stack([np.cos(angle), np.sin(angle), np.zeros(40)], axis=1)
    with pytest.raises(ValueError, match="do not determine"):
        calibrate_magnetometers(eqx.tree_at(lambda d: d.mag, found, flat))


@pytest.mark.slow
def test_turns_about_one_axis_on_a_rough_road_neither():
    """Tilts of 2° and 0.6 µT of noise: noise in m does not enter the sigma of what 1 µT out of the plane tells."""
    rng = np.random.default_rng(3)
    found = rows(1, rests=0, moving=240, noise=6e-7)
    heading = np.linspace(0.0, 25.0, 240)
    tilt = np.radians(2.0) * rng.normal(size=240)
    level = np.stack([np.cos(heading), np.sin(heading), tilt - np.tan(DIP)], axis=1)
    outputs = FIELD * np.cos(DIP) * level + HARD + 6e-7 * rng.normal(size=(240, 3))
    with pytest.raises(ValueError, match="about one axis only"):
        calibrate_magnetometers(eqx.tree_at(lambda d: d.mag, found, outputs))


def test_noise_of_samples_in_motion_and_of_repeated_ones():
    rng = np.random.default_rng(1)
    angle = np.linspace(0.0, 20.0, 6000)
    slow = FIELD * np.stack([np.cos(angle), np.sin(angle), np.cos(2.0 * angle)], axis=1)
    mag = slow + 2e-7 * rng.normal(size=slow.shape)
    held = np.repeat(mag[::5], 5, axis=0)
    # A median of n squares is known to 1.17 √2 / √n: 2 % of a variance from 6000, 5 % from 1200; three sigma of half.
    assert np.allclose(sample_noise(mag), 2e-7, rtol=0.03)
    assert np.allclose(sample_noise(held), 2e-7, rtol=0.08)


def _waved(**columns):
    rng = np.random.default_rng(4)
    mag = field_waved(rng)
    return Campaign(
        (Recording.from_arrays(mag=mag, sample_rate=50.0, **columns),),
        Site(magnetic_field=FIELD),
    )


def field_waved(rng):
    """Outputs of a triad that is turned slowly all ways, T."""
    turn, rate, outputs = np.eye(3), np.zeros(3), []
    for _ in range(3000):
        rate = 0.99 * rate + 0.15 * rng.normal(size=3)
        cross = np.cross(np.eye(3), 0.02 * rate)
        turn = np.linalg.qr(turn + cross @ turn)[0] * np.sign(np.diag(np.linalg.qr(turn)[1]))
        outputs.append(turn @ (FIELD * np.array([np.cos(DIP), 0.0, -np.sin(DIP)])))
    outputs = np.array(outputs) @ (np.eye(3) + SOFT).T + HARD
    return outputs + 2e-7 * rng.normal(size=outputs.shape)


REST = 100  # rows of a rest, at 50 Hz


def _switched(amperes, *, logged=True, count=24, seed=5):
    """Rests in which a battery's current switches half-way, and the raw field without it, means over each rest."""
    rng = np.random.default_rng(seed)
    turns = rotations(count, rng)
    steady = np.einsum("kij,j->ki", turns, FIELD * np.array([np.cos(DIP), 0.0, -np.sin(DIP)]))
    steady = steady @ (np.eye(3) + SOFT).T + HARD
    number = np.repeat(np.arange(count), REST)
    current = np.where(np.arange(count * REST) % REST < 40 + number, 2.0, amperes)
    current = current + 0.1 * rng.normal(size=current.shape)
    mag = steady[number] + np.outer(current, WIRE) + 5e-8 * rng.normal(size=(len(number), 3))
    up = np.array([0.0, 0.0, 9.81])
    accel = np.einsum("kij,j->ki", turns, up)[number] + 1e-3 * rng.normal(size=mag.shape)
    recording = Recording.from_arrays(
        accel=accel,
        mag=mag,
        position=number,
        current=current if logged else None,
        sample_rate=50.0,
    )
    return recording, steady


def test_rests_in_which_a_logged_current_switches_are_rests():
    """40 A move the field by 11 µT, as a turn by 13° does."""
    recording, steady = _switched(42.0)
    dwells = reduce_to_dwells(recording, temperature_step=None)
    found = field_rows((recording,), dwells, [np.ones(recording.num_samples, bool)])
    rests = np.asarray(found.position) >= 0
    assert rests.sum() == len(steady)
    mean = np.asarray(found.mag)[rests] - np.outer(np.asarray(found.current)[rests], WIRE)
    # A hundred samples of 50 nT, and what 0.1 A of the current's noise moves: 5 sigma.
    np.testing.assert_allclose(mean, steady, rtol=0, atol=5 * 6e-9)
    sigma = np.sqrt(np.diagonal(np.asarray(found.mag_covariance)[rests], axis1=1, axis2=2))
    # Samples' noise over √100, not the 4 µT of the switching; of 24 rests' scatter.
    assert 3e-9 < np.median(sigma) < 2e-8


@pytest.mark.slow
def test_rests_with_a_current_that_nobody_logged_are_named():
    recording, _ = _switched(42.0, logged=False)
    campaign = Campaign((recording,), Site(9.81), model=ModelChoice(temperature_degree=0))
    found = calibrate_device(campaign)
    said = [w for w in found.warnings if "in their own frame" in w or "are not calibrated" in w]
    assert said and "rest in more orientations" not in said[0], said


def test_the_cure_of_rests_in_which_the_field_moves_is_a_steady_current():
    few = rows(3, rests=4)
    told = calibrate_magnetometers(few, field=FIELD, unsteady=20).warnings[0]
    assert "the field moves within 20 further rests by more than 2°" in told
    assert "keep it steady at rest, or log it" in told
    assert "rest in more orientations" in calibrate_magnetometers(few, field=FIELD).warnings[0]


def test_gaps_are_left_out_of_the_rows():
    campaign = _waved()
    mag = np.array(campaign.recordings[0].mag)
    mag[::2] = np.nan
    found = field_rows((Recording.from_arrays(mag=mag, sample_rate=50.0),), None)
    assert np.isfinite(np.asarray(found.mag)).all()
    assert np.all(np.asarray(found.position) == -1)


@pytest.mark.slow
def test_a_waved_log_of_magnetometers_alone(tmp_path):
    # Figures that the command begins meanwhile need outputs of accelerometers or gyros: there are none.
    found = calibrate_device(_waved(), seen=figures_ahead(_waved()))
    assert found.accel is None and found.gyro is None and found.mag is not None
    path = tmp_path / "calibration.json"
    write_calibration(found.calibration, path)
    again = read_calibration(path)
    assert again.mag is not None
    assert again.mag.frame == "own" and np.isnan(float(again.mag.dip))
    assert again.mag.triad.names == found.calibration.mag.triad.names
    assert np.array_equal(again.mag.triad.covariance, found.calibration.mag.triad.covariance)
    outputs = np.asarray(_waved().recordings[0].mag)[::300]
    sizes = [np.linalg.norm(again.mag(jnp.asarray(m), 20.0)) for m in outputs]
    # Ten samples with 0.2 µT of noise of 48 µT: 5 sigma.
    assert np.allclose(sizes, FIELD, rtol=0.0, atol=1e-6)


def test_a_calibration_without_magnetometers_is_written_as_before(tmp_path):
    path = tmp_path / "calibration.json"
    write_calibration(Calibration(9.81), path)
    assert '"mag"' not in path.read_text("utf-8")
    assert read_calibration(path).mag is None


def test_magnetometers_that_nobody_wants():
    wanted = dataclasses.replace(_waved(), model=ModelChoice(mag_estimator="none"))
    with pytest.raises(ValueError, match='mag_estimator = "none": nothing is left to calibrate'):
        calibrate_device(wanted)
    with pytest.raises(ValueError, match="mag_estimator = 'fields'"):
        calibrate_device(dataclasses.replace(_waved(), model=ModelChoice(mag_estimator="fields")))


@pytest.mark.slow
def test_normalised_errors_have_unit_variance():
    truth = np.concatenate([HARD, SOFT.ravel(), [-FIELD * np.sin(DIP)]])
    scores, chi2 = [], []
    for seed in range(80):
        found = calibrate_magnetometers(rows(seed, rests=20, moving=40), field=FIELD)
        error = np.asarray(found.curve.coefficients)[0] - truth
        spread = np.asarray(found.covariance)
        scores.append(error / np.sqrt(np.diagonal(spread)))
        chi2.append(error @ np.linalg.solve(spread, error) / len(truth))
    # χ²/13 has the variance 2/13: the mean of 80 is known to 0.044; 3 sigma above. Scatter that chance does
    # not exclude is counted, which makes variances up to a tenth wide. Variances 25 % too small or large are seen.
    assert 0.83 < np.mean(chi2) < 1.132
    # 95 % of 13 × 80 scores, about four independent ones a run: 1.2 %; 3 sigma. Sigmas 20 % too small are seen.
    assert abs(np.mean(np.abs(scores) < 1.96) - 0.95) < 0.037


def test_a_field_that_hardly_moves_is_told_in_microtesla_without_another_unit():
    """A phone on a table, in µT: it "moved by 1.31e-06", and gauss was advised."""
    found = rows(1, rests=0, moving=240, noise=0.0)
    still = np.array([1e-5, 2e-5, -4e-5]) + 1e-6 * np.random.default_rng(2).normal(size=(240, 3))
    with pytest.raises(ValueError, match=r"move by 1.\d+ uT about their middle.* all ways\.$"):
        calibrate_magnetometers(eqx.tree_at(lambda d: d.mag, found, still))
    with pytest.raises(ValueError, match='unit = "uT"'):
        calibrate_magnetometers(eqx.tree_at(lambda d: d.mag, found, 1e6 * still))


def test_outputs_that_keep_no_magnitude_are_told_so(monkeypatch):
    """Outputs of another sensor, after which the ellipsoid ran away: "the misfit is 1.6e+07 µT"."""
    judged = Fit.judged

    def ran_away(fit):
        misfit, *rest = judged(fit)
        return (np.full_like(misfit, 16.0), *rest)

    monkeypatch.setattr(Fit, "judged", ran_away)
    with pytest.raises(ValueError, match="no ellipsoid fits, for the outputs keep no magnitude"):
        calibrate_magnetometers(rows(1, rests=0, moving=240))


def test_directions_that_are_missing_are_said_with_how_to_turn(monkeypatch):
    """A device that was tilted by 60° at most spans a cap: the estimation "did not converge"."""
    turns = rotations(1500, np.random.default_rng(4))
    up = field_of(turns) @ np.linalg.inv(np.eye(3) + SOFT).T
    cap = up[up[:, 0] < -0.5 * FIELD]
    cap = cap + HARD + 5e-7 * np.random.default_rng(5).normal(size=cap.shape)
    monkeypatch.setattr(Fit, "converged", False)  # as where iron moves near by
    log = lambda mag: eqx.tree_at(lambda d: d.mag, rows(1, rests=0, moving=len(mag)), mag)
    with pytest.raises(ValueError, match="along x the field moves by .* with .x up, .* once round"):
        calibrate_magnetometers(log(cap))
    with pytest.raises(ValueError, match="did not converge; look for a wrong unit"):
        calibrate_magnetometers(log(up + HARD))
    assert missing_directions(np.asarray(up + HARD)) is None


def test_the_direction_that_is_missing_may_lie_between_axes():
    up = field_of(rotations(500, np.random.default_rng(4)))
    towards = np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0)
    said = missing_directions(up[np.abs(up @ towards) < 0.5 * FIELD])
    assert said is not None and "between +x and −z" in said
