"""One model from calibrate to diagnose, audit and fleet: the same block, estimates and standard deviations."""

import json
from functools import cache

import jax
import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from inertiax.calibrate.pipeline import calibrate, DeviceResult
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import audit, diagnose_campaign
from inertiax.diagnose.problem import prepare
from inertiax.effects import CATALOGUE
from inertiax.fleet import run_fleet
from inertiax.fleet.results import fleet_calibration


G = 9.81
MATRIX = np.array([[1.01, 0.0, 0.0], [0.004, 0.99, 0.0], [-0.003, 0.002, 1.005]])
GYRO = np.array([[1.004, 0.002, -0.003], [0.001, 0.996, 0.002], [0.003, -0.001, 1.002]])
FEW = tuple(e for e in CATALOGUE if e.name in ("drift", "second_order"))


def outputs(force, rate, temperature, seed, slope=2e-3):
    """What an imperfect device reads: its biases grow by `slope` (m/s²) and a hundredth of it (rad/s) per °C."""
    rng = np.random.default_rng(seed)
    warm = np.asarray(temperature)[:, None] - 25.0
    accel = force @ MATRIX.T + [0.1, -0.05, 0.08] + slope * warm
    gyro = rate @ GYRO.T + [0.01, -0.004, 0.006] + 0.01 * slope * warm
    return (
        accel + 2e-3 * rng.standard_normal(accel.shape),
        gyro + 2e-4 * rng.standard_normal(gyro.shape),
    )


@cache
def _by_hand(seed):
    """Specific force and rate of 24 rests of 3 s with tilts of 1 s between them, at 50 Hz, as a hand makes them."""
    rng = np.random.default_rng(seed)
    attitude, force, rate = Rotation.identity(), [], []
    for _ in range(24):
        force.append(np.tile(attitude.inv().apply([0.0, 0.0, G]), (150, 1)))
        rate.append(np.zeros((150, 3)))
        axis = rng.standard_normal(3)
        turn = axis / np.linalg.norm(axis) * rng.uniform(0.7, 1.5)
        steps = (1.0 - np.cos(2.0 * np.pi * (np.arange(50) + 0.5) / 50))[:, None] * turn / 50
        turned = attitude * Rotation.from_rotvec(np.cumsum(steps, axis=0))
        attitude = turned[-1]
        force.append(turned.inv().apply([0.0, 0.0, G]))
        rate.append(steps * 50)
    return np.concatenate(force), np.concatenate(rate)


def hand(temperature=None, seed=1, model=None, device=""):
    force, rate = _by_hand(seed)
    time = 0.02 * np.arange(len(force))
    probe = np.full(len(time), 25.0)
    if temperature:
        probe = 25.0 + temperature * time / time[-1]
    accel, gyro = outputs(force, rate, probe, seed + 10)
    column = probe[:, None] if temperature else None
    recording = Recording(time, accel=accel, gyro=gyro, temperature=column, device=device)
    return Campaign((recording,), Site(G), Rig(), model or ModelChoice())


def table(model=None, rig=None, temperature=(25.0,), triads=("accel", "gyro"), arms=None):
    """Rests in 18 directions and plateaus of ±1 rad/s about six axes at each temperature, 10 Hz, with references."""
    axes = np.array([[3, 1, 0], [0, 3, 1], [1, 0, 3], [1, 1, 1], [1, -1, 1], [-1, 1, 1]], float)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    grid = np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)], float)
    poses = grid[(np.abs(grid).sum(axis=1) > 0) & (np.abs(grid).sum(axis=1) < 3)]
    poses = G * poses / np.linalg.norm(poses, axis=1, keepdims=True)
    turns = [(G * a, s * a) for a in axes for s in (1.0, -1.0)]
    pieces = [(p, np.zeros(3)) for p in poses] + turns
    force = np.concatenate([np.tile(f, (40, 1)) for f, _ in pieces] * len(temperature))
    rate = np.concatenate([np.tile(w, (40, 1)) for _, w in pieces] * len(temperature))
    label = np.where(np.arange(len(pieces)) < len(poses), np.arange(len(pieces)), -1)
    position = np.tile(np.repeat(label, 40), len(temperature))
    probe = np.repeat(np.array(temperature, float), 40 * len(pieces))
    felt = force
    if arms is not None:
        turned = np.cross(rate[:, None, :], np.cross(rate[:, None, :], arms[None]))
        felt = force + np.einsum("tii->ti", turned)
    accel, gyro = outputs(felt, rate, probe, 5)
    columns = {"accel": accel, "reference_accel": force, "gyro": gyro, "reference_gyro": rate}
    kept = {k: v for k, v in columns.items() if k.removeprefix("reference_") in triads}
    recording = Recording(
        0.1 * np.arange(len(force)), position=position,
        temperature=probe[:, None] if len(temperature) > 1 else None,
        experiment=np.repeat(np.arange(len(temperature)), 40 * len(pieces)), **kept,
    )  # fmt: skip
    return Campaign((recording,), Site(G), rig or Rig(), model or ModelChoice())


def faces(seed=3):
    """Six faces twice, 4 s each, no reference."""
    poses = np.tile(np.concatenate([np.eye(3), -np.eye(3)]), (2, 1)) * G
    force = np.repeat(poses, 40, axis=0)
    accel, _ = outputs(force, 0.0 * force, np.full(480, 25.0), seed)
    position = np.repeat(np.arange(12), 40)
    recording = Recording(0.1 * np.arange(480), accel=accel, position=position)
    return Campaign((recording,), Site(G))


def one_pose(seed=4):
    """One pose while the temperature goes up and down by 40 °C; both triads."""
    time = 2.0 * np.arange(1200)
    probe = 25.0 + 20.0 * np.sin(2.0 * np.pi * time / 2400.0)
    force = np.tile([0.3, -0.2, G], (1200, 1))
    accel, gyro = outputs(force, 0.0 * force, probe, seed)
    recording = Recording(
        time, accel=accel, gyro=gyro, temperature=probe[:, None], position=np.zeros(1200, int)
    )
    return Campaign((recording,), Site(G))


def ferraris():
    """Six faces at rest and a full turn by hand about each axis, whose mean rate is the reference, at 50 Hz."""
    force, rate, stated, label = [], [], [], []
    for k, axis in enumerate(np.concatenate([np.eye(3), -np.eye(3)])):
        force += [np.tile(G * axis, (150, 1))]
        rate += [np.zeros((150, 3))]
        stated += [np.zeros((150, 3))]
        label += [np.full(150, k)]
        if k < 3:
            share = 1.0 - np.cos(2.0 * np.pi * (np.arange(200) + 0.5) / 200)
            force += [np.tile(G * axis, (200, 1))]
            rate += [share[:, None] * axis * np.pi / 2.0]
            stated += [np.tile(axis * np.pi / 2.0, (200, 1))]
            label += [np.full(200, -1)]
    recordings, start = [], 0.0
    for part, (f, w) in enumerate(
        zip(force, rate, strict=True)
    ):  # a recording each: turned over in between
        accel, gyro = outputs(f, w, np.full(len(f), 25.0), 60 + part)
        recording = Recording(
            start + 0.02 * np.arange(len(f)), accel=accel, gyro=gyro, position=label[part],
            reference_accel=f, reference_gyro=stated[part],
        )  # fmt: skip
        recordings.append(recording)
        start += 100.0
    return Campaign(tuple(recordings), Site(G))


def without(campaign, **columns):
    (recording,) = campaign.recordings
    kept = {k: getattr(recording, k) for k in recording.__dataclass_fields__}
    return Campaign((Recording(**kept | columns),), campaign.site, campaign.rig, campaign.model)


CAMPAIGNS = {
    "hand": hand,
    "hand with temperature": lambda: hand(12.0),
    "hand, together": lambda: hand(model=ModelChoice(together=True)),
    "hand, gyros left alone": lambda: hand(model=ModelChoice(gyro_estimator="none")),
    "table": table,
    "table with temperature": lambda: table(temperature=(0.0, 20.0, 40.0, 60.0)),
    "table, rig stated": lambda: table(rig=Rig(position_uncertainty=5e-5, rate_uncertainty=1e-4)),
    "table, g-sensitivity": lambda: table(ModelChoice(g_sensitivity=True)),
    "rate table alone": lambda: table(triads=("gyro",)),
    "together": lambda: table(ModelChoice(together=True)),
    "lever arms": lambda: table(
        ModelChoice(lever_arms=True),
        arms=np.array([[0.03, 0, 0.01], [0, 0.02, 0], [0.01, 0, 0.04]]),
    ),
    "no misalignment of the triads": lambda: table(ModelChoice(misalignment=False)),
    "table, accelerometers": lambda: table(triads=("accel",)),
    "the same with temperature": lambda: table(
        triads=("accel",), temperature=(0.0, 20.0, 40.0, 60.0)
    ),
    "the same, rig stated": lambda: table(triads=("accel",), rig=Rig(position_uncertainty=5e-5)),
    "paper plan": lambda: without(
        table(triads=("accel",), temperature=(-40.0, -20.0, 0.0, 20.0, 40.0, 60.0)),
        reference_accel=None,
    ),
    "Ferraris": ferraris,
    "faces only": faces,
    "one pose": one_pose,
    "three attitudes and gyros": lambda: without(
        hand(), **{k: v[:600] for k, v in vars(hand().recordings[0]).items() if _is_column(v)}
    ),
}


def _is_column(value):
    return isinstance(value, np.ndarray)


def calibrated(campaign):
    with jax.enable_x64(True):
        (result,) = calibrate(campaign)
    assert isinstance(result, DeviceResult), result.reason
    return result


@cache
def calibrated_by_name(name):
    return calibrated(CAMPAIGNS[name]())


def same(one, other):
    """Parameters within a thousandth of a standard deviation over the temperatures, those within 5 %."""
    low, high = one.temperature_range or (25.0, 25.0)
    grid = np.linspace(low, high, 7)
    for triad in ("accel", "gyro"):
        a, b = getattr(one, triad), getattr(other, triad)
        assert (a is None) == (b is None)
        if a is None:
            continue
        assert a.names == b.names
        (values, sigmas), (others, again) = a.over(grid), b.over(grid)
        assert np.all(np.abs(values - others) <= 1e-3 * sigmas + 1e-12)
        np.testing.assert_allclose(again, sigmas, rtol=0.05)
    arms, others = ([e for e in c.effects if e.name == "size_effect"] for c in (one, other))
    for arm, again in zip(arms, others, strict=True):
        sigmas, theirs = (np.sqrt(np.diagonal(e.covariance)) for e in (arm, again))
        assert arm.channels == again.channels
        assert np.all(np.abs(arm.coefficients - again.coefficients) <= 1e-3 * sigmas + 1e-12)
        np.testing.assert_allclose(theirs, sigmas, rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMPAIGNS)
def test_a_diagnosis_judges_the_model_that_was_calibrated(name, monkeypatch):
    campaign, plain = CAMPAIGNS[name](), calibrated_by_name(name)
    problems = []  # an audit judges what a diagnosis does, which is made once

    def kept(campaign, catalogue):
        problems.append(prepare(campaign, catalogue))
        return problems[-1]

    monkeypatch.setattr("inertiax.diagnose.plan.detectability.prepare", kept)
    assert audit(campaign, effects=FEW).as_dict()["model"] == plain.model.document()
    (problem,) = problems
    assert problem.plain.model == plain.model == problem.plain.calibration.model
    same(plain.calibration, problem.plain.calibration)
    for prepared in problem.triads:
        spec = getattr(plain.model, prepared.form.triad)
        named = [n for n in prepared.form.names if "lever_arm" not in n]
        assert (prepared.form.estimator, prepared.form.degree) == (
            spec.estimator,
            spec.temperature_degree,
        )
        assert tuple(named) == spec.parameters


@pytest.mark.slow
def test_every_kind_of_model_is_among_them():
    models = [calibrated_by_name(name).model for name in CAMPAIGNS]
    used = {m.accel.estimator for m in models if m.accel} | {
        m.gyro.estimator for m in models if m.gyro
    }
    assert used == {"invariant", "reference", "static", "gravity"}
    assert {m.together for m in models} == {m.lever_arms for m in models} == {True, False}


@pytest.mark.slow
@pytest.mark.parametrize("name", ("hand with temperature", "table", "lever arms", "faces only"))
def test_nothing_is_missing_where_the_model_is_right_and_the_calibration_stays(name):
    campaign, plain = CAMPAIGNS[name](), calibrated_by_name(name)
    found, after = diagnose_campaign(campaign)
    assert found.verdict == "consistent", found.summary
    assert json.loads(found.to_json())["model"] == plain.model.document()
    same(plain.calibration, after)
    assert after.effects == () or plain.model.lever_arms


FLEETS = (
    "table",
    "table with temperature",
    "table, rig stated",
    "table, g-sensitivity",
    "rate table alone",
    "table, accelerometers",
    "the same with temperature",
    "the same, rig stated",
    "paper plan",
    "hand, gyros left alone",
    "hand",
    "hand with temperature",
    "hand, together",
    "three attitudes and gyros",
    "Ferraris",
    "faces only",
    "one pose",
    "together",
    "lever arms",
)


def written(campaign, folder, devices):
    """A campaign of like devices as a Parquet file with its `campaign.toml`; a log without positions in a folder of its
    own, as a fleet of them stands."""
    tables = [rows(made, name) for name, made in devices.items()]
    place = folder if "position" in tables[0].columns else folder / "line" / "A-1"
    place.mkdir(parents=True, exist_ok=True)
    pl.concat(tables).write_parquet(place / "log.parquet")
    rig, asked = campaign.rig, campaign.model
    text = f"[site]\ngravity = {G}\n[recordings]\nfiles = ['log.parquet']\n"
    if rig.position_uncertainty:
        arcsec = np.rad2deg(rig.position_uncertainty) * 3600.0
        text += f"[rig]\nposition_uncertainty = {arcsec}\nrate_uncertainty = {1e6 * (rig.rate_uncertainty or 0.0)}\n"
    text += "[model]\n"
    text += "g_sensitivity = true\n" if asked.g_sensitivity else ""
    text += "together = true\n" if asked.together else ""
    text += "lever_arms = true\n" if asked.lever_arms else ""
    text += f"gyro_estimator = '{asked.gyro_estimator}'\n" if asked.gyro_estimator else ""
    (place / "campaign.toml").write_text(text)
    return folder if place == folder else folder / "line"


def rows(campaign, device):
    """A campaign's recordings as one table of one device."""
    tables = []
    for recording in campaign.recordings:
        columns = {"time": recording.time}
        for label in ("position", "experiment"):
            if getattr(recording, label) is not None:
                columns[label] = getattr(recording, label)
        for triad in ("accel", "gyro", "reference_accel", "reference_gyro"):
            if getattr(recording, triad) is not None:
                columns |= {
                    f"{triad}_{a}": getattr(recording, triad)[:, k] for k, a in enumerate("xyz")
                }
        if recording.temperature is not None:
            columns |= {"temperature": recording.temperature[:, 0]}
        tables.append(pl.DataFrame(columns))
    return pl.concat(tables).with_columns(device=pl.lit(device))


@pytest.mark.slow
@pytest.mark.parametrize("name", FLEETS)
def test_a_fleet_says_the_same(name, tmp_path):
    campaign, alone = CAMPAIGNS[name](), calibrated_by_name(name)
    line = written(campaign, tmp_path, {"A-1": campaign})
    summary = run_fleet(line, tmp_path / "out")
    assert summary.as_dict()["model"] == alone.model.document()
    same(alone.calibration, fleet_calibration(tmp_path / "out", "A-1"))


@pytest.mark.slow
def test_a_line_of_hand_logs_has_the_model_of_most_and_one_bad_device_stops_nothing(tmp_path):
    """Two good logs, one that was never turned, and one that is no table."""
    summary = _line_of_logs(tmp_path, {"A-1": hand(), "A-2": _alike(), "A-3": _begun(120)})
    assert summary.as_dict()["model"] == calibrated_by_name("hand").model.document()
    assert (summary.devices, summary.calibrated) == (4, 2)
    same(fleet_calibration(tmp_path / "out", "A-1"), fleet_calibration(tmp_path / "out", "A-2"))
    for name in ("A-3", "A-4"):
        with pytest.raises(ValueError, match="was set aside: "):
            fleet_calibration(tmp_path / "out", name)


@pytest.mark.slow
def test_what_a_probe_s_steps_hide_is_in_the_sigmas_of_a_fleet_too(tmp_path):
    """In whole degrees over 12 °C of a bias that follows them by 0.02 (m/s²)/°C."""
    log = hand(12.0)
    (recording,) = log.recordings
    probe = recording.temperature
    follows = recording.accel + 0.02 * (probe - 25.0)
    made = without(log, temperature=np.round(probe), accel=follows, gyro=None)
    line = written(made, tmp_path, {"A-1": made})
    run_fleet(line, tmp_path / "out")
    (alone,) = calibrate(made)
    found = fleet_calibration(tmp_path / "out", "A-1")
    assert found.accel.curve.basis.size > 1
    same(alone.calibration, found)


@pytest.mark.slow
def test_logs_too_poor_to_be_used_do_not_choose_the_model_of_the_others(tmp_path):
    """Of seven rests each biases and scale factors only, beyond use; of six no accelerometers; the last log is good."""
    poor = {f"A-{k}": _begun(1600 + 40 * k) for k in (1, 2)}
    few = {f"B-{k}": _begun(960 + 20 * k) for k in (1, 2)}
    summary = _line_of_logs(tmp_path, {**poor, **few, "C-1": hand()})
    assert summary.as_dict()["model"] == calibrated_by_name("hand").model.document()
    same(calibrated_by_name("hand").calibration, fleet_calibration(tmp_path / "out", "C-1"))
    for name in poor:
        with pytest.raises(ValueError, match="was set aside: "):
            fleet_calibration(tmp_path / "out", name)


def _begun(rows):
    """The hand log, broken off after so many rows."""
    (recording,) = hand().recordings
    return without(hand(), **{k: v[:rows] for k, v in vars(recording).items() if _is_column(v)})


def _alike():
    # A copy to the last digit would be set aside, with its original.
    return without(hand(), accel=hand().recordings[0].accel * (1.0 + 1e-12))


def _line_of_logs(tmp_path, logs):
    """The summary of a fleet of logs with a folder each, and of one whose file is no table."""
    for name, made in {**logs, "A-4": None}.items():
        folder = tmp_path / "line" / name
        folder.mkdir(parents=True)
        (folder / "campaign.toml").write_text(
            f"[site]\ngravity = {G}\n[recordings]\nfiles = ['log.parquet']\n"
        )
        if made is None:
            (folder / "log.parquet").write_text("no table")
        else:
            rows(made, name).write_parquet(folder / "log.parquet")
    return run_fleet(tmp_path / "line", tmp_path / "out")


@pytest.mark.slow
def test_a_fleet_of_two_devices_says_the_same_of_each(tmp_path):
    first = table()
    (recording,) = first.recordings
    second = without(first, accel=2.0 * recording.reference_accel - recording.accel)
    written(first, tmp_path, {"A-1": first, "A-2": second})
    with jax.enable_x64(True):
        results = calibrate(load_campaign(tmp_path / "campaign.toml"))
    summary = run_fleet(tmp_path / "campaign.toml", tmp_path / "out")
    assert [r.calibration.device for r in results] == ["A-1", "A-2"]
    for alone in results:
        assert alone.model.document() == summary.as_dict()["model"]
        same(alone.calibration, fleet_calibration(tmp_path / "out", alone.calibration.device))


@pytest.mark.slow
@pytest.mark.parametrize("shown", [True, False])
def test_devices_in_common_files_know_the_latitude(tmp_path, shown):
    """Rests tell the vertical part of the Earth's rate with it, and gravity's turns between them the rest; of gyros
    that show none of it none is taken."""
    moving = np.arange(24 * 200) % 200 >= 150
    (recording,) = hand().recordings
    vertical = shown * 7.292115e-5 * np.sin(np.deg2rad(52.5)) * recording.accel / G
    log = without(
        hand(), gyro=recording.gyro + vertical,
        position=np.where(moving, -1, np.arange(24 * 200) // 200),
    )  # fmt: skip
    line = written(log, tmp_path, {"A-1": log})
    file = line / "campaign.toml"
    biases = {}
    for latitude in ("", "latitude = 52.5\n"):
        file.write_text(file.read_text().replace("[recordings]", f"{latitude}[recordings]"))
        out = tmp_path / f"out{len(latitude)}"
        run_fleet(line, out)
        (alone,) = calibrate(load_campaign(line))
        found = fleet_calibration(out, "A-1")
        assert found.gyro.estimator == "gravity"
        same(alone.calibration, found)
        biases[latitude] = np.asarray(found.gyro.curve(25.0))[:3]
    first, second = biases.values()
    # 15.04 °/h × sin 52.5°, by the mean of the rests' verticals
    assert (1e-7 if shown else -1.0) < np.abs(first - second).max() < (5.8e-5 if shown else 1e-12)
