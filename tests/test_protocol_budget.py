"""The fit's covariance by source against the error budget, which differentiates the answer; sources in closed form."""

import dataclasses
import math

import numpy as np
import pytest

from inertiax.analysis import sources
from inertiax.analysis.error_budget import error_budget
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.calibrate.split_covariance import (
    fit_of,
    NOISE,
    POSITION,
    residual_degrees,
    SCATTER,
    SLOW,
    split,
)
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.protocol.expanded_uncertainty import coverage_factor
from inertiax.protocol.make_record import record_of
from inertiax.protocol.record import StationRecord, TriadRecord
from inertiax.protocol.results import reference_temperatures, results_at
from inertiax.protocol.sources_at import contributions, symmetric
from inertiax.reduction.rounded_temperature import hidden_by_steps


GRAVITY, ANGLE = 9.81, 2e-4


def campaign(*, referenced: bool, moved: float, seed: int = 0, temperatures=(20.0,)) -> Campaign:
    """Fourteen rests at every temperature of an ideal triad with a bias that grows by 1e-3 m/s²/°C.

    `moved` is what each re-positioning does to the outputs, m/s², 1 sigma.
    """
    rng = np.random.default_rng(seed)
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    corners = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]) / math.sqrt(
        3
    )
    up = np.tile(np.concatenate([faces, corners]), (len(temperatures), 1))
    rests, samples = len(up), 40
    heat = np.repeat(temperatures, 14)[:, None]
    level = GRAVITY * up + 0.1 + 1e-3 * (heat - 20.0) + rng.normal(0.0, moved, up.shape)
    accel = np.repeat(level, samples, axis=0) + rng.normal(0.0, 1e-3, (rests * samples, 3))
    number = np.repeat(np.arange(rests), samples)
    recording = Recording(
        time=0.1 * np.arange(rests * samples) + number,
        accel=accel,
        position=number,
        temperature=np.repeat(np.repeat(temperatures, 14), samples)[:, None].astype(float),
        reference_accel=np.repeat(GRAVITY * up, samples, axis=0) if referenced else None,
    )
    rig = Rig(position_uncertainty=ANGLE) if referenced else Rig()
    return Campaign((recording,), Site(gravity=GRAVITY), rig=rig)


@pytest.fixture(scope="module")
def referenced():
    one = campaign(referenced=True, moved=0.0)
    return one, calibrate_device(one)


def test_the_parts_are_the_fits_covariance(referenced):
    one, result = referenced
    parts = {p.source: p for p in split(fit_of(result.accel), one.rig)}
    # The rows are white; what they do not exclude of slow noise is in it too.
    assert {NOISE, POSITION} <= set(parts) <= {NOISE, POSITION, SLOW}
    total = sum(p.covariance for p in parts.values())
    fitted = np.asarray(result.accel.solution.covariance)
    assert np.allclose(total, fitted, rtol=1e-9, atol=1e-12 * np.max(np.diag(fitted)))  # rounding


@pytest.mark.slow
def test_the_rigs_part_is_what_the_error_budget_derives(referenced):
    """`error_budget` moves every dwell's attitude and differentiates the answer; here the weights are taken apart."""
    one, result = referenced
    accel = result.accel
    budget = error_budget(
        accel.estimator, accel.solution.curve, accel.dwells, [sources.positioning(ANGLE)]
    )
    (part,) = (p for p in split(fit_of(accel), one.rig) if p.source == POSITION)
    assert math.isinf(part.degrees)
    expected = np.sqrt(np.diag(budget.covariance(0)))
    # The budget sends the reference through the device's own (E + Γ), |Γ| < 1e-4 here.
    assert np.allclose(np.sqrt(np.diag(part.covariance)), expected, rtol=1e-3)


def test_scatter_between_dwells_is_a_part_with_the_residuals_degrees():
    one = campaign(referenced=False, moved=0.02)
    result = calibrate_device(one).accel
    parts = {p.source: p for p in split(fit_of(result), one.rig)}
    assert set(parts) == {NOISE, SCATTER}
    # 14 magnitudes for 9 unknowns; noise of 1e-3/√40 is far below 0.02, so that nearly all is scatter.
    assert residual_degrees(fit_of(result)) == 5
    assert 4.9 < parts[SCATTER].degrees <= 5.0
    assert parts[NOISE].degrees == 14 * 39
    assert np.trace(parts[SCATTER].covariance) > 100 * np.trace(parts[NOISE].covariance)


def test_expanded_uncertainty_uses_the_few_degrees_of_the_scatter(tmp_path):
    one = campaign(referenced=False, moved=0.02)
    result = calibrate_device(one)
    (tmp_path / "calibration.json").write_text("{}")
    record = record_of(result, one, tmp_path, "inertiax calibrate", ())
    found = results_at(result.calibration, record, reference_temperatures(result.calibration))
    for r in found:
        assert r.degrees == pytest.approx(5.0, rel=0.05)
        assert r.expanded == pytest.approx(coverage_factor(r.degrees) * r.std)
        assert r.std == pytest.approx(math.hypot(*(std for _, std in r.budget)))


STATION = StationRecord(GRAVITY, None, None, 2e-5, 0.5)
NOTHING = TriadRecord(14, 0, 0.0, 0.0, "m/s^2", 5, ())


def test_probe_and_gravity_by_hand():
    one = campaign(referenced=False, moved=0.0, temperatures=(0.0, 20.0, 40.0))
    triad = calibrate_device(one).calibration.accel
    at = np.array([10.0, 30.0])
    found = {c.source: c.std for c in contributions(triad, NOTHING, STATION, 1e-4, at)}
    step = 1e-3
    slope = (triad.over(at + step)[0] - triad.over(at - step)[0]) / (2 * step)
    # Noise of 1e-3/√40 on 42 rests, 40 °C apart, leaves 1 % of the slope at most.
    assert np.allclose(slope[:, :3], 1e-3, rtol=0.03)
    # Central differences of a polynomial of at most degree 2 are exact but for rounding.
    assert np.allclose(found["probe offset"], 0.5 * np.abs(slope), rtol=1e-5, atol=1e-12)
    scale = [
        k for k, n in enumerate(triad.names) if n in ("accel.matrix[0,0]", "accel.matrix[2,2]")
    ]
    expected = 1e-4 / GRAVITY * (1.0 + triad.over(at)[0][:, scale])
    assert np.allclose(found["reference g"][:, scale], expected, rtol=1e-12)
    assert not found["reference g"][:, :3].any()


def test_an_error_of_g_does_what_its_source_says():
    """Calibrated again with g wrong by 1 sigma, the parameters move by the stated 1 sigma."""
    one = campaign(referenced=False, moved=0.0)
    sigma = 1e-3
    wrong = Campaign(one.recordings, Site(gravity=GRAVITY - sigma))
    right, moved = (calibrate_device(c).calibration.accel for c in (one, wrong))
    at = np.array([20.0])
    found = {c.source: c.std for c in contributions(right, NOTHING, STATION, sigma, at)}
    difference = np.abs(right.over(at)[0] - moved.over(at)[0])
    # First order in σ/g = 1e-4, and the weights of the fit change with g by as much.
    assert np.allclose(found["reference g"], difference, atol=1e-3 * sigma / GRAVITY)


def test_a_lower_triangle_is_its_matrix():
    full = np.array([[1.0, 2.0, 4.0], [2.0, 3.0, 5.0], [4.0, 5.0, 6.0]])
    assert np.array_equal(symmetric((1.0, 2.0, 3.0, 4.0, 5.0, 6.0)), full)


def test_temperatures_outside_the_range_are_refused():
    calibration = calibrate_device(
        campaign(referenced=False, moved=0.0, temperatures=(0.0, 20.0, 40.0))
    ).calibration
    with pytest.raises(
        ValueError, match=r"--at 50: outside the calibrated range, 0.00 to 40.00 °C"
    ):
        reference_temperatures(calibration, (20.0, 50.0))
    assert reference_temperatures(calibration, (5.0,)) == (5.0,)


def test_what_the_probes_steps_hide_has_its_line(tmp_path):
    """A log in whole degrees: the parts are the whole covariance again, and one of them is the steps'."""
    one = campaign(referenced=False, moved=0.0, temperatures=(0.0, 20.0, 40.0))
    (recording,) = one.recordings
    time = np.asarray(recording.time)
    whole = np.round(np.interp(time, [time[0], time[-1]], [0.0, 40.0]))[:, None]
    log, model = (
        dataclasses.replace(recording, temperature=whole),
        ModelChoice(temperature_degree=1),
    )
    stepped = Campaign((log,), one.site, model=model)
    result = calibrate_device(stepped)
    (tmp_path / "calibration.json").write_text("{}")
    record = record_of(result, stepped, tmp_path, "inertiax calibrate", ())
    triad = result.calibration.accel
    (at,) = results_at(result.calibration, record, (20.0,))[:1]
    hidden = hidden_by_steps(stepped.recordings)
    slope = float((triad.over(np.array([20.1]))[0] - triad.over(np.array([19.9]))[0])[0, 0]) / 0.2
    # Central differences of a polynomial of at most degree 2 are exact but for rounding.
    assert dict(at.budget)["probe steps"] == pytest.approx(hidden * abs(slope), rel=1e-4)
    basis = np.asarray(triad.curve.basis(20.0))
    own = [k * len(triad.names) for k in range(len(basis))]
    total = basis @ np.asarray(triad.covariance)[np.ix_(own, own)] @ basis
    assert at.std == pytest.approx(math.sqrt(float(total)), rel=1e-6)
