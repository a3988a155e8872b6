"""From campaigns to calibrations: the Xsens recording, simulated campaigns, and what is refused."""

import json
import os
import shutil
from pathlib import Path

import jax
import numpy as np
import pytest

from command_runs import run_in
from imu_tk_data import GRAVITY, needs_recordings, PUBLISHED, SIGMAS, to_imu_tk
from inertiax.calibrate.pipeline import calibrate, DeviceFailure, DeviceResult
from inertiax.calibration.calibration import read_calibration
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, ModelChoice, Site
from inertiax.diagnose.pipeline import diagnose_campaign
from inertiax.procedure.single_device import Problem
from inertiax.simulate import Device, draw_accelerometers, paper_set, simulate_recordings
from inertiax.simulate.plan import PAPER_GRAVITY


COUNTS = 'unit = "count", offset = 32768, scale = [415, 413, 415], scale_unit = "count per m/s^2"'


def _xsens(name: str) -> Path:
    return Path(os.environ["INERTIAX_RECORDINGS"]) / "imu_tk-xsens" / name


def _in_imu_tk_units(calibration, covariance=None):
    """Parameters in imu_tk's convention with their standard deviations."""
    vector = calibration.accel.curve.coefficients[0]
    jacobian = np.asarray(jax.jacfwd(to_imu_tk)(vector))
    ours = np.asarray(calibration.accel.covariance if covariance is None else covariance)
    return np.asarray(to_imu_tk(vector)), np.sqrt(np.diagonal(jacobian @ ours @ jacobian.T))


PUBLISHED_VECTOR = np.concatenate([PUBLISHED[k] for k in ("misalignment", "scale", "bias")])


@pytest.mark.slow
@needs_recordings
def test_command_reproduces_the_published_optimum_on_the_given_means(tmp_path, capfd, monkeypatch):
    counts = np.loadtxt(_xsens("interval_means.txt"))
    rows = "\n".join(f"{k},{k},{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(counts.tolist()))
    (tmp_path / "means.csv").write_text("time,position,x,y,z\n" + rows + "\n")
    (tmp_path / "campaign.toml").write_text(
        f'[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ["means.csv"]\n'
        f'[columns]\naccel = {{ names = ["x", "y", "z"], {COUNTS} }}\n'
    )
    status, said, told = run_in("calibrate . -o out", tmp_path, capfd, monkeypatch)
    assert status == 0, told
    written = read_calibration(tmp_path / "out" / "calibration.json")
    ours, stated = _in_imu_tk_units(written)
    np.testing.assert_allclose(ours, PUBLISHED_VECTOR, rtol=1e-6)
    # The published sigmas take rests for independent, which those of this log are not: their biases wander. What
    # neighbours have in common is in the mean of the log, which is better known.
    (device,) = calibrate(load_campaign(tmp_path))
    accel = device.accel
    problem = Problem(accel.estimator, accel.solution.curve.basis, accel.dwells)
    alone = problem.covariance(np.asarray(accel.solution.curve.coefficients))
    _, deviations = _in_imu_tk_units(written, alone)
    deviations[3:6] /= PUBLISHED_VECTOR[3:6]
    deviations /= np.sqrt(1.0 + 2.0 / 28.0)  # what our scatter adds for 37 rests less nine unknowns
    np.testing.assert_allclose(deviations, SIGMAS, rtol=0.05)  # two digits are published
    assert "dwells that follow one another err alike" in said
    assert np.all(stated[6:] < deviations[6:])


@pytest.mark.slow
@needs_recordings
def test_command_calibrates_the_raw_recording_with_its_own_rests(tmp_path, capfd, monkeypatch):
    shutil.copy(_xsens("xsens_acc.mat"), tmp_path)
    (tmp_path / "campaign.toml").write_text(
        f'[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ["xsens_acc.mat"]\n'
        f"[columns]\naccel = {{ {COUNTS} }}\n"
    )
    status, said, told = run_in("calibrate . -o out --json", tmp_path, capfd, monkeypatch)
    assert status == 0, told
    json.loads(said)
    ours, deviations = _in_imu_tk_units(read_calibration(tmp_path / "out" / "calibration.json"))
    assert np.all(np.abs(ours - PUBLISHED_VECTOR) < 3.0 * deviations)
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000


@needs_recordings
def test_own_detection_finds_38_rests(tmp_path):
    from inertiax.data.campaign import load_campaign
    from inertiax.reduction.dwell_means import reduce_to_dwells

    shutil.copy(_xsens("xsens_acc.mat"), tmp_path)
    (tmp_path / "campaign.toml").write_text(
        f'[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ["xsens_acc.mat"]\n'
        f"[columns]\naccel = {{ {COUNTS} }}\n"
    )
    dwells = reduce_to_dwells(load_campaign(tmp_path).recordings)
    assert len(np.unique(dwells.position[dwells.position >= 0])) in range(36, 41)


# Simulated campaigns ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recordings():
    # Degree 4, which five temperatures can carry.
    device = Device(accel=draw_accelerometers(jax.random.PRNGKey(5), degree=4))
    plan = paper_set(2, temperatures=(-40.0, -15.0, 10.0, 35.0, 60.0))
    made, _ = simulate_recordings(jax.random.PRNGKey(6), plan, device, sample_rate=2.0, serial="A")
    return device, made


def _without_references(recording, serial="A", rows=slice(None)):
    kept = type(recording)(
        time=recording.time,
        accel=recording.accel,
        temperature=recording.temperature,
        experiment=recording.experiment,
        position=recording.position,
        device=serial,
        name=recording.name,
    )
    return kept[rows]


@pytest.mark.slow
def test_campaign_to_calibration_within_its_uncertainty(recordings):
    device, made = recordings
    campaign = Campaign(
        tuple(_without_references(r) for r in made),
        Site(gravity=PAPER_GRAVITY),
        model=ModelChoice(accel_estimator="invariant", temperature_degree=4),
    )
    (result,) = calibrate(campaign)
    assert isinstance(result, DeviceResult)
    triad = result.calibration.accel
    # Five sets of 18 dwells with 1e-5 m/s² of noise each, nothing else between them.
    assert result.accel.scatter < 1e-5
    for temperature in (-30.0, 0.0, 20.0, 50.0):
        error = triad.curve(temperature) - device.accel.curve(temperature)
        assert np.all(np.abs(error) < 5.0 * triad.standard_deviations(temperature))
    low, high = result.calibration.temperature_range
    assert low == pytest.approx(-42.0, abs=0.5) and high == pytest.approx(62.0, abs=0.5)


@pytest.mark.slow
def test_what_was_chosen_is_said(recordings):
    _, made = recordings
    campaign = Campaign(tuple(_without_references(r) for r in made), Site(gravity=PAPER_GRAVITY))
    (result,) = calibrate(campaign)
    assert isinstance(result, DeviceResult)
    assert "accelerometers: 'invariant' because there is no reference_accel" in result.choices
    # Five temperatures carry degree 4 at most, and this truth needs it.
    assert any("temperature degree 4 by BIC" in c for c in result.choices)


@pytest.mark.slow
def test_a_bad_device_does_not_stop_the_others(recordings):
    _, made = recordings
    good = tuple(_without_references(r) for r in made)
    # Device B stood in three positions only; C in six, the first time: 18 equations for 18 unknowns.
    few = [_without_references(r, "B", r.position < 3) for r in made]
    just = [_without_references(r, "C", r.position < 3 + 3 * (k == 0)) for k, r in enumerate(made)]
    campaign = Campaign(
        (*few, *just, *good),
        Site(gravity=PAPER_GRAVITY),
        model=ModelChoice(accel_estimator="invariant", temperature_degree=1),
    )
    bad, exact, fine = calibrate(campaign)
    assert isinstance(bad, DeviceFailure) and bad.device == "B"
    assert isinstance(exact, DeviceFailure) and exact.device == "C"
    assert "18 dwells give 18 equations, so that nothing is left to judge the fit" in exact.reason
    assert isinstance(fine, DeviceResult) and fine.calibration.device == "A"
    assert "too few positions: 15 dwells give 15 equations for 18 unknowns" in bad.reason


@pytest.mark.slow
def test_positions_that_do_not_determine_the_model_are_named(recordings):
    _, made = recordings
    # All positions in the xy plane, more than enough of them: the z axis is never excited.
    flat = [r for r in made]
    rows = [np.abs(r.reference_accel[:, 2]) < 1.0 for r in flat]
    campaign = Campaign(
        tuple(_without_references(r, "A", k) for r, k in zip(flat, rows, strict=True)),
        Site(gravity=PAPER_GRAVITY),
        model=ModelChoice(accel_estimator="invariant", temperature_degree=0),
    )
    (failure,) = calibrate(campaign)
    assert isinstance(failure, DeviceFailure)
    assert "the positions do not determine" in failure.reason
    assert "accel.matrix[2,2]" in failure.reason or "accel.bias[2]" in failure.reason


REFUSED = {
    "reference without reference": (
        ModelChoice(accel_estimator="reference"),
        "accel_estimator = 'reference' needs the columns reference_accel_x/y/z",
    ),
    "gyros not recorded": (
        ModelChoice(gyro_estimator="static"),
        "gyro_estimator = 'static', but no gyro columns were recorded",
    ),
    "g-sensitivity without gyros": (
        ModelChoice(g_sensitivity=True),
        "g_sensitivity = true, but no gyro columns were recorded",
    ),
    "nothing to calibrate": (
        ModelChoice(accel_estimator="none"),
        r'accel_estimator = "none": nothing is left to calibrate',
    ),
    "unknown estimator": (
        ModelChoice(accel_estimator="magic"),
        r"accel_estimator = 'magic': it must be one of invariant, reference, static, none",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_contradictory_models_are_refused(name, recordings):
    import re

    model, message = REFUSED[name]
    _, made = recordings
    campaign = Campaign(tuple(_without_references(r) for r in made), Site(), model=model)
    (failure,) = calibrate(campaign)
    assert isinstance(failure, DeviceFailure)
    assert re.search(message, failure.reason)
    assert "\n" not in failure.reason


def test_a_diagnosis_of_nothing_is_refused(recordings):
    _, made = recordings
    nothing = ModelChoice(accel_estimator="none", gyro_estimator="none")
    with pytest.raises(ValueError, match="nothing is left to calibrate"):
        diagnose_campaign(Campaign(made, model=nothing))


def test_unknown_method_is_refused(recordings):
    _, made = recordings
    with pytest.raises(ValueError, match="method must be one of"):
        calibrate(Campaign(made), method="magic")


@pytest.mark.slow
def test_a_solve_that_runs_away_is_said_in_words(recordings, monkeypatch):
    from inertiax.procedure import single_device

    _, made = recordings
    step = single_device.solve_on_host

    def runs_away(linearise, start):
        found = step(linearise, start)
        return found._replace(unknowns=np.full_like(found.unknowns, np.nan), converged=False)

    monkeypatch.setattr(single_device, "solve_on_host", runs_away)
    campaign = Campaign(tuple(_without_references(r) for r in made), Site(gravity=PAPER_GRAVITY))
    (failed,) = calibrate(campaign)
    assert isinstance(failed, DeviceFailure)
    assert "did not converge" in failed.reason and "\n" not in failed.reason
