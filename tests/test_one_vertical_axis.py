"""A device on face after face of a fixture, on a table that turns about the vertical alone: what `init` says, and that
it leads to the right calibration. Logs in NumPy."""

import re
import tomllib
from pathlib import Path

import jax
import numpy as np
import polars as pl
import pytest

from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate
from inertiax.campaign_draft.pipeline import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.diagnose.noise.common_mode_fit import RIG
from inertiax.diagnose.noise.observation_series import NoiseFit
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.observations.blocks import cut
from inertiax.diagnose.observations.model_rows import calibrated
from inertiax.diagnose.observations.signals import specific_force
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.selection.score_test import whiten_system
from inertiax.diagnose.selection.thermal import remember


GRAVITY, EARTH = 9.81246, 7.292115e-5 * np.sin(np.radians(52.27))
NAMES = ("xup", "xdn", "yup", "ydn", "zup", "zdn")
HERTZ, SEAT = 50, 3e-4  # Hz; rad, of each mounting
BIAS, TURN = np.array([0.2, -0.15, 0.1]), np.array([0.01, -0.02, 0.015])
SCALE = np.array([[1.003, 0.002, -0.001], [0.0, 0.996, 0.003], [0.002, -0.001, 1.005]])
GYROS = np.array([[0.995, -0.002, 0.003], [0.001, 1.004, -0.001], [-0.003, 0.002, 1.002]])


def logs(folder, rng):
    """Six logs with rests and both signs of three rates, g and °/s, a device 2 cm beside the axis."""
    held = np.array([0.0, 30.0, -30.0, 90.0, -90.0, 180.0, -180.0, 0.0])
    for name in NAMES:
        up = np.zeros(3)
        up["xyz".index(name[0])] = 1.0 if name[1:] == "up" else -1.0
        up += np.cross(SEAT * rng.standard_normal(3), up)
        rate = np.repeat(np.radians(held), 8 * HERTZ)
        out = np.roll(up, 1) - up * (np.roll(up, 1) @ up)
        force = GRAVITY * up - 0.02 * np.square(rate)[:, None] * out
        accel = force @ SCALE.T + BIAS + 3e-3 * rng.standard_normal(force.shape)
        gyro = np.outer(rate + EARTH, up) @ GYROS.T + TURN + 1e-3 * rng.standard_normal(force.shape)
        columns = {"t": np.arange(len(rate)) / HERTZ}
        columns |= {f"a{k} [g]": v for k, v in zip("xyz", accel.T / 9.80665)}
        columns |= {f"g{k} [deg/s]": v for k, v in zip("xyz", np.degrees(gyro).T)}
        pl.DataFrame(columns | {"table_rate": np.degrees(rate)}).write_csv(folder / f"{name}.csv")


def drafted(folder, names, tables=(), rig=""):
    """The campaign that `init` drafts of these files, with its statement about seats."""
    first, *others = [folder / f"{name}.csv" for name in names]
    drawn = draft_campaign(first, folder, latitude=52.27, others=others, table=tables).text
    assert "goes with the gyros' rate" not in drawn and 'axes = ["up"]' in drawn
    assert (
        "need 9 or more" not in drawn and "sign of the accelerometers" not in drawn
    )  # six faces are enough
    drawn = re.sub("gravity = [0-9.]+", f"gravity = {GRAVITY}", drawn)
    (folder / "campaign.toml").write_text(f"{drawn}\n[rig]\nposition_uncertainty = 62\n{rig}")
    return load_campaign(folder)


def judged(folder, names, tables=(), rig=""):
    """Errors over sigmas of both triads, and sigmas, of a campaign that `init` drafts of these files."""
    campaign = drafted(folder, names, tables, rig)
    with jax.enable_x64(True):
        (result,) = calibrate(campaign)
        accel, gyro = result.calibration.accel, result.calibration.gyro
    # A triad's matrix takes what is read to what is felt, and the bias is of what is read.
    for triad, bias, matrix in ((accel, BIAS, SCALE), (gyro, TURN, GYROS)):
        assert triad is not None
        found, sigma = (
            np.asarray(v(20.0))[:12] for v in (triad.parameters, triad.standard_deviations)
        )
        truth = np.r_[bias, (matrix - np.eye(3)).ravel()]
        yield (found - truth) / sigma, sigma


def test_init_reads_a_rate_and_gravity_tells_the_faces(tmp_path):
    logs(tmp_path, np.random.default_rng(2))
    for z, sigma in judged(tmp_path, NAMES):
        assert np.abs(z).max() < 3.5  # of 12 normal numbers in 1 of 180 triads
        assert sigma[[3, 7, 11]].max() < 2e-4 and sigma[:3].max() < 2e-3


def test_a_left_handed_rate_in_other_units_is_about_down(tmp_path):
    logs(tmp_path, np.random.default_rng(4))
    for name in NAMES:
        log = pl.read_csv(tmp_path / f"{name}.csv")
        log.with_columns(pl.col("table_rate") * -np.pi / 180.0).write_csv(tmp_path / f"{name}.csv")
    first, *others = [tmp_path / f"{name}.csv" for name in NAMES]
    drawn = draft_campaign(first, tmp_path, latitude=52.27, others=others).text
    assert 'axes = ["down"]' in drawn
    assert 'table_rates = { names = ["table_rate"], unit = "rad/s" }' in drawn
    assert "or else the accelerometers' sign is wrong" in drawn and "need 9 or more" not in drawn
    (tmp_path / "campaign.toml").write_text(drawn)
    campaign = load_campaign(tmp_path)
    (recording,) = (r for r in campaign.recordings if r.name.startswith("ydn"))
    fast = int(np.argmax(recording.gyro[:, 1]))  # about y, which points down: a turn about down
    assert recording.reference_gyro[fast, 1] == pytest.approx(np.pi, rel=1e-3)
    np.testing.assert_allclose(recording.reference_accel[0], [0.0, -campaign.site.gravity, 0.0])


def own_logs(folder, began):
    """The rate taken out of each log into one of the table's own, which begins earlier, on a clock of its own."""
    made = []
    for k, name in enumerate(NAMES):
        log = pl.read_csv(folder / f"{name}.csv")
        before = pl.DataFrame({"time": [-4.0 - k, -4.0 - k / 2, -0.02], "rate": [0.0, 0.0, 0.0]})
        own = pl.concat([before, log.select(time="t", rate="table_rate")])
        made.append(folder / f"table_{name}.csv")
        own.with_columns(pl.col("time") + began(k)).write_csv(made[-1])
        log.drop("table_rate").write_csv(folder / f"{name}.csv")
    return made


@pytest.mark.slow
@pytest.mark.parametrize("anew", [True, False])
def test_each_mounting_may_have_a_log_of_the_tables_own(tmp_path, anew):
    logs(tmp_path, np.random.default_rng(5))
    hour = 43267.8  # s of the day
    tables = own_logs(tmp_path, lambda k: hour + 211.3 * k * anew)
    for z, sigma in judged(tmp_path, NAMES, tables):
        assert np.abs(z).max() < 3.5
        assert sigma[[3, 7, 11]].max() < 2e-4
    said = tomllib.loads((tmp_path / "campaign.toml").read_text())
    assert said["recordings"]["table_files"] == [f"table_{n}.csv" for n in NAMES]
    late = said["table"]["delay"]
    np.testing.assert_allclose(late, hour + 211.3 * np.arange(6) if anew else hour, atol=0.01)


@pytest.mark.slow
def test_an_angle_beside_the_rate_that_is_read_is_not_asked_for(tmp_path):
    logs(tmp_path, np.random.default_rng(6))
    tables = own_logs(tmp_path, lambda k: 100.0)
    for table in tables:
        own = pl.read_csv(table)
        step = own["time"].diff().fill_null(0.0)
        own.with_columns((own["rate"] * step).cum_sum().alias("Winkel")).write_csv(table)
    first, *others = [tmp_path / f"{name}.csv" for name in NAMES]
    drawn = draft_campaign(first, tmp_path, latitude=52.27, others=others, table=tables)
    assert 'table_rates = { names = ["rate"]' in drawn.text
    assert drawn.unread == ('Not read: "Winkel".',)


@pytest.mark.slow
def test_of_a_commanded_and_a_measured_rate_the_measured_one_is_read(tmp_path):
    """The command leads what the table does by 40 ms: with it the delay would be that much off."""
    logs(tmp_path, np.random.default_rng(9))
    tables = own_logs(tmp_path, lambda k: 100.0)
    for table in tables:
        own = pl.read_csv(table)
        ahead = np.interp(own["time"].to_numpy() + 0.04, own["time"], own["rate"])
        own.with_columns(setpoint=ahead).select("time", "setpoint", "rate").write_csv(table)
    for z, _ in judged(tmp_path, NAMES, tables):
        assert np.abs(z).max() < 3.5
    text = (tmp_path / "campaign.toml").read_text()
    said = tomllib.loads(text)
    assert said["columns"]["table_rates"]["names"] == ["rate"] and "more than setpoint does" in text
    assert said["table"]["delay"] == pytest.approx(100.0, abs=2e-3)
    assert "orthogonality_uncertainty" not in text  # there is no other axis
    assert "# level_uncertainty = 10.0" in text


def leaning(folder, rng):
    """The same logs on a base that leans by 4e-4 rad, in an angle of the table's own at each rest."""
    logs(folder, rng)
    for name in NAMES:
        log = pl.read_csv(folder / f"{name}.csv")
        rest = log["table_rate"].to_numpy() == 0.0
        late = np.arange(len(rest)) > len(rest) // 2
        up = np.eye(3)["xyz".index(name[0])]
        a = rng.uniform(0.0, 2.0 * np.pi, 2)
        level = 4e-4 * (np.outer(np.cos(a), np.roll(up, 1)) + np.outer(np.sin(a), np.roll(up, 2)))
        more = np.where(rest[:, None], level[late.astype(int)], 0.0)
        columns = {f"a{k} [g]": log[f"a{k} [g]"] + more[:, n] for n, k in enumerate("xyz")}
        log.with_columns(**columns).write_csv(folder / f"{name}.csv")


@pytest.mark.slow
def test_a_base_that_leans_by_as_much_as_is_stated_widens_misalignments_alone(tmp_path):
    """Without the statement ± of biases is 1.1e-3 m/s²: what dwells differ by counts on all axes. With it 8e-5 to 5e-4,
    where chance leaves something of that."""
    scores, narrower = [], []
    for seed in range(3):
        leaning(tmp_path, np.random.default_rng(40 + seed))
        ((_, plain), _) = judged(tmp_path, NAMES)
        ((z, sigma), _) = judged(tmp_path, NAMES, rig="level_uncertainty = 58\n")  # 4e-4 / √2
        scores.append(z)
        narrower.append(float(np.mean(sigma[:3] / plain[:3])))
    assert np.mean(narrower) < 0.5
    # 36 numbers: a root mean square is known to 1 / √72 = 12 %; no more than three of them above 1.
    assert np.sqrt(np.mean(np.square(scores))) < 1.36


@pytest.mark.slow
@pytest.mark.parametrize("seat", [SEAT, 0.0], ids=["seats", "none"])
def test_seats_that_nobody_states_are_said_with_their_size(tmp_path, monkeypatch, seat):
    """Misalignments were 12 of their ± off under "usable", with no word of what to state."""
    monkeypatch.setattr("test_one_vertical_axis.SEAT", seat)
    found = []
    for seed in range(4):
        logs(tmp_path, np.random.default_rng(60 + seed))
        others = [tmp_path / f"{name}.csv" for name in NAMES[1:]]
        drawn = draft_campaign(tmp_path / "xup.csv", tmp_path, latitude=52.27, others=others).text
        (tmp_path / "campaign.toml").write_text(drawn)
        with jax.enable_x64(True):
            (result,) = calibrate(load_campaign(tmp_path))
        said = judge(result)
        if seat == 0.0:
            assert "positioning" not in said.answer and said.verdict == "good"
            continue
        assert "write that under [rig] as position_uncertainty" in said.answer
        found.append(float(re.search(r"differs by (\d+) arcsec", said.answer)[1]))
    if found:
        # Of twelve angles the misalignments take six: an estimate of 24 is within 1 / √48 = 14 %, three of them.
        assert np.sqrt(np.mean(np.square(found))) == pytest.approx(61.9, rel=0.43)


def test_another_number_of_table_logs_is_refused(tmp_path):
    logs(tmp_path, np.random.default_rng(5))
    tables = own_logs(tmp_path, lambda k: 100.0)
    first, *others = [tmp_path / f"{name}.csv" for name in NAMES]
    with pytest.raises(ValueError, match="--table names 2 logs of the table for 6 of the device"):
        draft_campaign(first, tmp_path, others=others, table=tables[:2])
    text = draft_campaign(first, tmp_path, others=others, table=tables).text
    (tmp_path / "campaign.toml").write_text(re.sub("delay = .*", "delay = [100.0, 100.0]", text))
    with pytest.raises(ValueError, match=r"\[table\] delay has 2 numbers but \[recordings\] files"):
        load_campaign(tmp_path)


@pytest.mark.slow
def test_errors_of_the_table_are_told_beside_those_of_the_seats(tmp_path):
    """By generalised least squares in NumPy, with two angles of each of six seats. An index error about each axis is
    another word for them: ± 21 arcsec. Told plateau by plateau it was ± 5 to 10, and was named for what seats do."""
    logs(tmp_path, np.random.default_rng(8))
    campaign = drafted(tmp_path, NAMES)
    with jax.enable_x64(True):
        problem = prepare(campaign)
        (gyros,) = (t for t in problem.triads if t.form.triad == "gyro")
        terms = [t for t in gyros.candidates if t.name == "table_axis_error"]
        terms = [t for t in terms if t.variant.label.startswith("index")]
        noise = fit_noise(gyros.system)
        scores = whiten_system(gyros.system, noise, terms).scores
    assert len(scores) == 3
    rate, mounting = gyros.blocks.reference_gyro, problem.log.recording[gyros.blocks.start]
    root = 1.0 / np.sqrt(np.concatenate([chain.white for chain in gyros.system.chains]))
    model = np.kron(np.eye(3), np.column_stack([np.ones(len(rate)), rate]))  # biases and a matrix
    turns = [np.cross(e, rate) * (mounting == m)[:, None] for m in range(6) for e in np.eye(3)]
    stated = SEAT * np.exp(0.5 * noise.coupled[0][RIG])
    seats = stated * np.stack([turn.T.ravel() for turn in turns], axis=1) * root[:, None]
    inner = np.linalg.inv(np.eye(18) + seats.T @ seats)
    for score in scores:
        x = np.column_stack([model, np.concatenate(score.term.columns)]) * root[:, None]
        information = x.T @ x - x.T @ seats @ inner @ seats.T @ x
        sigma = np.sqrt(np.diag(np.linalg.inv(information))[-2:])
        # The dwells' own variance, which the fit finds next to nothing, is not in these.
        np.testing.assert_allclose(np.sqrt(np.diag(score.covariance)), sigma, rtol=0.05)
        assert score.gain < 13.8  # of two normal numbers in 1 of 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "low", "high"),
    [("second_order", 0.70, 0.72), ("drift", 1.2, 2.0)],
    ids=["seats", "time"],
)
def test_rests_of_one_mounting_tell_once_how_it_is_off(tmp_path, name, low, high):
    """By generalised least squares in NumPy: both rests of a mounting err by its two angles. Counted as two mountings
    what seats can do was told better than it is, by the root of two, and what they cannot worse."""
    logs(tmp_path, np.random.default_rng(31))
    campaign = drafted(tmp_path, NAMES)
    with jax.enable_x64(True):
        problem = prepare(campaign)
        (accel,) = (t for t in problem.triads if t.form.triad == "accel")
        terms = [t for t in accel.candidates if t.name == name and t.size == 1]
        terms = [
            next(t for t in terms if t.chains == (c,) and not t.scales_input) for c in range(3)
        ]
        # Slow noise next to none, the rig's as stated
        noise = NoiseFit(
            tuple(np.array([0.0, *4 * [-9.0], 0.0, 0.0]) for _ in range(3)), (0.0,) * 3
        )
        scores = whiten_system(accel.system, noise, terms).scores
    up, rest = accel.blocks.reference_accel, accel.blocks.dwell
    mounting = problem.log.recording[accel.blocks.start]
    model = np.column_stack([np.ones(len(up)), up])
    for c, score in enumerate(scores):
        spread = np.radians(62.0 / 3600.0) * np.sqrt(np.square(up).sum(axis=1) - up[:, c] ** 2)
        x = np.column_stack([model, score.term.columns[0]])
        sigmas = []
        for numbers in (mounting, rest):
            covariance = np.outer(spread, spread) * (numbers[:, None] == numbers)
            covariance += np.diag(accel.system.chains[c].white)
            information = x.T @ np.linalg.solve(covariance, x)
            sigmas.append(np.sqrt(np.linalg.inv(information)[-1, -1]))
        found = float(np.sqrt(score.covariance[0, 0]))
        assert found == pytest.approx(sigmas[0], rel=0.02)  # beside slow noise of e⁻⁹
        assert low < sigmas[1] / sigmas[0] < high


@pytest.mark.slow
def test_few_seats_that_scatter_less_by_chance_do_not_make_the_statement_smaller(
    tmp_path, monkeypatch
):
    """Six mountings without any error. An axis is across four of them, of which its two misalignments leave q = 2
    degrees of freedom: with q ln σ² the likelihood falls, with ν (θ + e^−θ) the statement's price rises, so that
    e^−θ = 1 + q / ν of ν = 4. It was e⁻³, and what seats can do was told to a quarter of what it is."""
    monkeypatch.setattr("test_one_vertical_axis.SEAT", 0.0)
    logs(tmp_path, np.random.default_rng(71))
    campaign = drafted(tmp_path, NAMES)
    with jax.enable_x64(True):
        (accel,) = (t for t in prepare(campaign).triads if t.form.triad == "accel")
        noise = fit_noise(accel.system)
    for theta in noise.theta:
        assert theta[RIG] == pytest.approx(-np.log(1.0 + 2.0 / 4.0), abs=0.1)


def test_gyros_feel_compensated_accelerometers_where_no_force_is_told(tmp_path):
    """While the table turns the reference tells no force. The outputs' own biases, 0.27 m/s², made 1 % of the
    g-sensitivity a bias of the plateaus alone."""
    logs(tmp_path, np.random.default_rng(32))
    campaign = drafted(tmp_path, NAMES)
    with jax.enable_x64(True):
        problem = prepare(campaign)
        accel = calibrated(problem.fitted, "accel")
        force = specific_force(problem.log, cut(problem.log), accel)
    turning = ~problem.log.reference_accel.any(axis=1)
    speed = np.linalg.norm(problem.log.reference_gyro, axis=1)
    assert turning.any() and force is not None
    # |f|² = g² + (0.02 m ω²)², as the log was made, with 3e-3 m/s² of noise and seats that leave |f| as it is.
    expected = np.hypot(GRAVITY, 0.02 * speed**2)[turning]
    found = GRAVITY * np.linalg.norm(force[turning], axis=1)
    np.testing.assert_allclose(found, expected, atol=5 * 3e-3)
    for k in range(6):
        mine = turning & (problem.log.recording == k) & (speed < 1.0)
        name = Path(problem.log.names[k]).stem
        up = np.eye(3)["xyz".index(name[0])] * (1.0 if name[1:] == "up" else -1.0)
        np.testing.assert_allclose(GRAVITY * force[mine].mean(axis=0) @ up, GRAVITY, atol=2e-3)


@pytest.mark.slow
def test_seats_at_temperatures_of_their_own_are_no_misalignment_that_follows_them(tmp_path):
    """Seats alone differ, from mounting to mounting as the room warms by 0.1 °C: no temperature dependence is in the
    logs, and one had a chance of 3e-8 by the noise of single channels."""
    logs(tmp_path, np.random.default_rng(26))
    for k, name in enumerate(NAMES):
        log = pl.read_csv(tmp_path / f"{name}.csv")
        warm = 20.0 + 0.1 * k + 0.15 * np.linspace(0.0, 1.0, len(log))
        log.with_columns(temperature=warm).write_csv(tmp_path / f"{name}.csv")
    campaign = drafted(tmp_path, NAMES)
    with jax.enable_x64(True):
        (gyros,) = (t for t in prepare(campaign).triads if t.form.triad == "gyro")
        listed = [t for t in gyros.candidates if t.effect is not None]
        assert any(t.name == "temperature_dependence" and t.scales_input for t in listed)
        assert remember(gyros.system, fit_noise(gyros.system), listed, []) is None


def test_mountings_in_one_file_are_refused(tmp_path):
    logs(tmp_path, np.random.default_rng(6))
    parts = [pl.read_csv(tmp_path / f"{name}.csv") for name in ("xup", "yup")]
    later = parts[1].with_columns(pl.col("t") + 100.0)
    pl.concat([parts[0], later]).write_csv(tmp_path / "both.csv")
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["both.csv"]\n[columns]\ntime = "t"\n'
        'accel = { names = ["ax [g]", "ay [g]", "az [g]"], unit = "g" }\n'
        'gyro = { names = ["gx [deg/s]", "gy [deg/s]", "gz [deg/s]"], unit = "deg/s" }\n'
        'table_rates = { names = ["table_rate"], unit = "deg/s" }\n[table]\naxes = ["up"]\n'
    )
    with pytest.raises(ValueError, match="Give each mounting a file of its own"):
        load_campaign(tmp_path)


def test_rates_alone_need_the_vertical(tmp_path):
    logs(tmp_path, np.random.default_rng(7))
    text = (
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["zup.csv"]\n[columns]\ntime = "t"\n'
        'accel = { names = ["ax [g]", "ay [g]", "az [g]"], unit = "g" }\n'
        'table_rates = { names = ["table_rate"], unit = "deg/s" }\n'
    )
    (tmp_path / "campaign.toml").write_text(text)
    with pytest.raises(ValueError, match="about the vertical: write"):
        load_campaign(tmp_path)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_norm_of_the_gyros_is_no_table(tmp_path, sign):
    """A logger's own |ω| has one sign."""
    logs(tmp_path, np.random.default_rng(3))
    log = pl.read_csv(tmp_path / "xup.csv").rename({"table_rate": "norm"})
    log.with_columns(pl.col("norm").abs() * sign).write_csv(tmp_path / "one.csv")
    assert "goes with" not in draft_campaign(tmp_path / "one.csv", tmp_path).text
