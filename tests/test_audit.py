"""The audit of a plan: what is absorbed, what looks alike, and how small an effect it still shows."""

import json

import equinox as eqx
import numpy as np
import pytest
import scipy.stats
from typer.testing import CliRunner

from diagnose_data import still, sweep, tumble
from inertiax.calibration.effect_units import customary
from inertiax.cli.app import app
from inertiax.diagnose import audit
from inertiax.diagnose.noise.observation_series import NoiseFit
from inertiax.diagnose.plan.degrees_of_freedom import deviations_for, Told
from inertiax.diagnose.plan.detectability import (
    assumed_noise,
    Audited,
    detectable_sizes,
    needed,
    sigma,
)
from inertiax.diagnose.plan.limits import Absorbed, Audit, POWER
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.selection.forward import GATE
from inertiax.diagnose.selection.multiple_testing import Count, Family
from inertiax.diagnose.selection.score_test import whiten_system
from inertiax.report.audit import audit_sections


G = 9.80665


QUIET = np.array([0.0, *6 * [-40.0]])  # log variances of white noise and nothing else


def scores_of(campaign, theta):
    """All scores of the first triad under given log variances of each chain."""
    (prepared, *_) = prepare(campaign).triads
    noise = NoiseFit(tuple(theta for _ in prepared.system.chains), (0.0,) * 3)
    return prepared, whiten_system(prepared.system, noise, prepared.candidates).scores


@pytest.mark.slow
def test_the_uncertainty_of_a_drift_is_that_of_a_straight_line():
    # Textbook: a slope fitted with a mean to N samples over T has σ √12 / (T √N), for N large.
    white, seconds = 1e-4, 2000.0
    _, scores = scores_of(still(seconds, white), QUIET)
    (drift,) = [
        s for s in scores if s.term.name == "drift" and s.term.channels == (0,)
        and s.term.variant.label == "bias"
    ]  # fmt: skip
    expected = white * np.sqrt(12.0) / (seconds * np.sqrt(2.0 * seconds))
    # The pooled scatter of 4000 samples is known to 1.1 %; blocks of a few seconds change less than 1e-3.
    assert sigma(drift) == pytest.approx(expected, rel=0.04)


@pytest.mark.slow
def test_the_size_of_a_step_is_its_uncertainty_times_the_passing_mark():
    white, seconds = 1e-4, 2000.0
    prepared, scores = scores_of(still(seconds, white), QUIET)
    one = Audited(
        prepared,
        tuple(s for s in scores if s.term.effect is not None),
        Family({("bias_step", (1,)): Count(50.0)}, 0.0),
        NoiseFit((QUIET,) * 3, (0.0,) * 3),
    )
    (size,) = [
        d.size
        for d in detectable_sizes(one)
        if d.name == "bias_step" and d.channels == ("accel_y",)
    ]
    # A step after the part q of N samples: the difference of two means, σ = w / √(N q (1 − q)); half of the moments.
    moments = [
        t.variant.settings["time"]
        for t in prepared.candidates
        if t.name == "bias_step" and t.channels == (1,)
    ]
    part = np.array(moments) / seconds
    step = np.median(white / np.sqrt(2.0 * seconds * part * (1.0 - part)))
    forms = len(moments)
    rows = prepared.blocks.num_blocks
    price = np.log(rows) + 2.0 * np.log(forms)
    chi2 = scipy.stats.chi2.isf(1.0 - (1.0 - GATE) ** (1.0 / 50.0), 1)
    mark = np.sqrt(max(price, chi2)) + scipy.stats.norm.ppf(0.9)
    assert size == pytest.approx(step * mark, rel=0.04)


def test_at_the_passing_mark_nine_draws_of_ten_pass():
    rng = np.random.default_rng(1)
    for size in (1, 3):
        z = needed(size, rows=1000, forms=5, tests=80.0)
        draws = rng.standard_normal((20000, size))
        draws[:, 0] += z
        threshold = max(
            scipy.stats.chi2.isf(1.0 - (1.0 - GATE) ** (1.0 / 80.0), size),
            size * np.log(1000.0) + 2.0 * np.log(5.0),
        )
        passed = np.mean(np.square(draws).sum(axis=1) > threshold)
        # Coefficients beside the first only help; 20000 draws know a rate to 0.4 %.
        assert POWER - 0.01 < passed < POWER + 0.08


@pytest.mark.parametrize("dwells", [8, 10, 15, 40])
def test_few_dwells_need_more_as_their_own_likelihood_says(dwells):
    """Student's t by draws: the restricted likelihood of levels whose scatter is unknown, with six parameters."""
    rng = np.random.default_rng(dwells)
    model = np.linalg.qr(rng.normal(size=(dwells, 7)))[0]
    freedom = dwells - 7
    least = 18.0
    z = deviations_for(least, 1, Told(freedom, 0.0))
    levels = rng.normal(size=(20000, dwells)) + z * model[:, 6]
    without = np.square(levels - levels @ model[:, :6] @ model[:, :6].T).sum(axis=1)
    beside = np.square(levels - levels @ model @ model.T).sum(axis=1)
    gain = (freedom + 1) * np.log(without / beside)
    # The normal form of the noncentral t errs on the safe side, by 0.045 at one degree of freedom; draws know 0.2 %.
    assert POWER - 0.01 < np.mean(gain > least) < POWER + 0.05
    assert z > np.sqrt(least) + scipy.stats.norm.ppf(0.9)


def test_what_dwells_show_within_them_asks_for_no_other_dwells():
    least, normal = 18.0, np.sqrt(18.0) + scipy.stats.norm.ppf(0.9)
    assert deviations_for(least, 1, Told(3.0, 1.0)) == pytest.approx(normal)
    assert deviations_for(least, 1, Told(0.0, 0.25)) == pytest.approx(2.0 * normal)
    assert np.isinf(deviations_for(least, 1, Told(0.0, 0.0)))
    assert (
        normal < deviations_for(least, 1, Told(3.0, 0.5)) < deviations_for(least, 1, Told(3.0, 0.1))
    )


def test_assumed_flicker_makes_everything_harder_to_see():
    prepared, quiet = scores_of(still(), QUIET)
    noisy = whiten_system(
        prepared.system, assumed_noise(prepared.system), prepared.candidates
    ).scores
    loud = {(s.term.name, s.term.channels, s.term.variant.label): sigma(s) for s in noisy}
    for s in quiet:
        key = s.term.name, s.term.channels, s.term.variant.label
        if key in loud:
            assert loud[key] > sigma(s)


@pytest.mark.slow
def test_six_positions_leave_three_combinations_unobserved_and_say_what_absorbs():
    found = audit(tumble(step=90.0, sessions=1))
    # Γ is lower triangular with 6 elements; with f along single axes only |a| feels its diagonal.
    assert len(found.unobservable) == 3
    by = {a.name: set(a.by) for a in found.absorbed}
    assert "accel.matrix[2,2]" in by["third_order"]
    assert {"accel.bias[0]", "accel.bias[1]", "accel.bias[2]"} <= by["second_order"]
    assert not {"second_order", "third_order"} & {d.name for d in found.detectable}


@pytest.mark.slow
def test_sets_name_all_that_looks_alike_once_and_the_experiments():
    found = audit(tumble(sessions=1))
    sets = {s.names: s for s in found.sets}
    kin = sets["second_order", "scale_asymmetry"]
    assert set(kin.channels) == {"accel_x", "accel_y", "accel_z"} and 0.95 < kin.r_squared <= 1.0
    assert any("centrifuge" in e for e in kin.experiments)
    assert len(sets) == len(found.sets)


@pytest.mark.slow
def test_nothing_is_detectable_that_the_recording_cannot_hold():
    found = audit(sweep())
    names = {d.name for d in found.detectable}
    # A gyro in one pose without reference: no rate, no change of force.
    assert not names & {
        "g_sensitivity",
        "rate_nonlinearity",
        "time_delay",
        "quantization",
        "supply",
    }
    assert {"thermal_lag", "thermal_hysteresis", "drift"} <= names
    reasons = dict(found.not_testable)
    assert "accelerometers" in reasons["second_order"] and "rate" in reasons["rate_nonlinearity"]
    (tau,) = {d.unit for d in found.detectable if d.name == "thermal_lag"}
    assert tau == "s"


def test_sizes_are_told_in_the_units_of_data_sheets():
    # Hand values: 1 mg = 9.80665e-3 m/s²; 1 °/h = 4.8481368e-6 rad/s; 10 arcsec = 48.481368 µrad.
    for size, unit, value, shown in (
        (9.80665e-5, "m/s^2/g^2", 10.0, "µg/g²"),
        (9.80665e-2, "m/s^2", 10.0, "mg"),
        (4.8481368e-6, "rad/s/g", 1.0, "°/h/g"),
        (48.481368e-6, "rad", 10.0, "arcsec"),
        (9.80665e-6 / 3600.0, "m/s^2/s", 1.0, "µg/h"),
        (2e-3, "s", 2.0, "ms"),
        (300.0, "s", 300.0, "s"),
        (1e-4, "(rad/s)/(rad/s)", 100.0, "ppm"),
        (4.8481368e-6 * (180.0 / np.pi) ** 2, "rad/s/(rad/s)^2", 1.0, "(°/h)/(°/s)²"),
    ):
        factor, name = customary(size, unit)
        assert (name, factor * size) == (shown, pytest.approx(value, rel=1e-6)), unit


def written(campaign, folder):
    """The campaign as files."""
    (recording,) = campaign.recordings
    columns = np.column_stack(
        [recording.time, recording.accel, recording.position, recording.experiment]
    )
    np.savetxt(
        folder / "log.csv", columns, delimiter=",", comments="", fmt="%.9g",
        header="time,accel_x,accel_y,accel_z,position,experiment",
    )  # fmt: skip
    (folder / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["*.csv"]\n'
        '[model]\naccel_estimator = "invariant"\ntemperature_degree = 0\n'
    )
    return folder


@pytest.mark.slow
def test_the_command_audits_a_campaign(tmp_path):
    folder = written(tumble(sessions=1), tmp_path)
    told = CliRunner().invoke(
        app, ["design", "--audit", "--assumed-noise", "-q", "--json", str(folder)]
    )
    assert told.exit_code == 0, told.output
    content = json.loads(told.stdout)
    assert content["schema"] == "inertiax.audit/1" and content["power"] == POWER
    sizes = {(d["name"], *d["channels"]): d["size"] for d in content["detectable"]}
    expected = audit(tumble(sessions=1))
    for d in expected.detectable:
        # Nine digits in the file; they turn nearly equal forms, and with them the draws that tell how many
        # independent tests the forms are (160 of them: 8 %, which is half a per cent of the size).
        assert sizes[d.name, *d.channels] == pytest.approx(d.size, rel=5e-3)


def test_the_command_says_what_is_wrong_with_its_usage(tmp_path):
    for arguments in (["design", str(tmp_path)], ["design", "--audit", "no-such-plan"]):
        assert CliRunner().invoke(app, arguments).exit_code == 2
    assert CliRunner().invoke(app, ["design", "--audit", str(tmp_path)]).exit_code == 2


@pytest.mark.slow
def test_the_page_has_no_row_for_what_is_not_there():
    sections = audit_sections(audit(still()))
    assert all(s.lines or s.tables for s in sections)
    assert not any("alike" in s.title and not s.tables for s in sections)


def test_what_the_calibration_estimates_itself_is_said_in_its_own_name():
    """Three effects of which a model holds two; and an arm that no plateau shows is no misalignment."""
    by = {
        "size_effect": ("accel.lever_arm[0,0]", "accel.lever_arm[1,1]"),
        "g_sensitivity": ("gyro.g_sensitivity[2,0]",),
        "gravity_error": ("accel.matrix[0,0]",),
    }
    made = Audit(
        not_testable=tuple((name, "the calibration itself absorbs it in this plan") for name in by),
        detectable=(), aliases=(), absorbed=tuple(Absorbed(n, ("accel_x",), p) for n, p in by.items()),
        unobservable=("accel.lever_arm[0,2]", "accel.matrix[0,2]"),
    )  # fmt: skip
    (blind,) = audit_sections(made)
    rows = {row[0]: row[1:] for row in blind.tables[0].rows}
    held = "the calibration estimates it as parameters of its own"
    assert rows["size_effect"] == rows["g_sensitivity"] == (held, "")
    assert "accelerometers' scale factor x" in rows["gravity_error"][0] and rows["gravity_error"][1]
    assert "accelerometers' lever arm xz; accelerometers' misalignment xz" in blind.lines[0]


def test_a_plan_is_not_said_to_lack_what_only_its_ramps_show():
    """Ramps are no rows of an audit, so that it cannot know whether they show a delay."""
    silent = {"time_delay": "it needs ramps", "quantization": "it needs noise below half a step"}
    made = Audit(not_testable=tuple(silent.items()), detectable=(), aliases=(), absorbed=())
    (blind,) = audit_sections(made)
    rows = {row[0]: row[1] for row in blind.tables[0].rows}
    assert "in the ramps" in rows["time_delay"] and "does not excite" not in rows["time_delay"]
    assert rows["quantization"] == "this plan does not excite it"


@pytest.mark.parametrize("moves", ["not at all", "by rounding", "within a step", "within the rest"])
def test_no_effect_of_temperature_is_told_from_what_hardly_moves(moves):
    campaign = still(200.0)
    (recording,) = campaign.recordings
    time = np.asarray(recording.time)
    course = {
        "not at all": 0.0 * time,
        "by rounding": 3e-15 * (np.arange(len(time)) % 3),
        "within a step": 0.1 * (np.arange(len(time)) % 7 == 0),
        "within the rest": np.round(0.3 * np.sin(time / 30.0), 2),
    }[moves]
    warmed = eqx.tree_at(
        lambda r: r.temperature, recording, 28.3 + course[:, None], is_leaf=lambda x: x is None
    )
    found = audit(eqx.tree_at(lambda c: c.recordings, campaign, (warmed,)))
    sizes = [d.size for d in found.detectable if d.name == "temperature_dependence"]
    if moves != "within the rest":
        reason = dict(found.not_testable)["temperature_dependence"]
        assert not sizes and "no more than the least step" in reason
    else:
        # 400 samples of 1e-4 m/s² tell a mean to 5e-6: no coefficient of a curve within [-1, 1] is told better.
        assert all(size > 5e-6 for size in sizes)
