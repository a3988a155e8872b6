"""A line of devices beside the axes of a two-axis table, made by NumPy alone: lever arms as `calibrate` finds them."""

import json

import jax
import numpy as np
import polars as pl
import pytest
import scipy.stats

from command_runs import run
from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate, DeviceResult
from inertiax.calibration.calibration import read_calibration
from inertiax.data.campaign import load_campaign
from inertiax.fleet import fleet_calibration, read_parts, run_fleet
from inertiax.fleet.store import read_manifest
from inertiax.fleet.verdicts import device_findings, device_verdict
from inertiax.protocol.effect_results import effect_results
from inertiax.protocol.fleet_record import fleet_measurement


G, ROWS_A_SECOND = 9.8127, 25.0
OUTER, INNER = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
EARTH = np.array([4.44e-5, 0.0, 5.79e-5])  # rad/s, north and up
GOOD, BAD, BARE = ("D-1", "D-2"), "D-4", "D-5"
TOML = f"""[site]
gravity = {G}
latitude = 52.5
[recordings]
files = ["log.parquet"]
[model]
lever_arms = true
"""


def about(axis, angle):
    """Matrices that turn about a unit vector, by Rodrigues' formula."""
    k = np.cross(np.eye(3), axis)  # k v = axis × v
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * k + (1.0 - c) * (k @ k)


def table():
    """Clock, force and rate in the case, position and temperature: rests in 24 attitudes and whole turns, at three
    temperatures."""
    plan = []
    for warm in (0.0, 20.0, 40.0):
        plan += [(a, b, 0.0, 0.0, 6.0, warm) for b in (0, 120, 240) for a in range(0, 360, 45)]
        for rate in (1.5, -1.5, 3.0, -3.0):
            length = round(2.0 * abs(rate)) * np.pi / abs(rate)
            turns = [(0, 0, 0.0, rate), (60, 0, 0.0, rate), (0, 0, rate, 0.0), (0, 90, rate, 0.0)]
            for k, turn in enumerate(turns):  # with a rest before each
                plan += [(30, 10 * k, 0.0, 0.0, 6.0, warm), (*turn, length, warm)]
    case = about(np.array([0.6, 0.8, 0.0]), np.array([0.9]))[
        0
    ]  # how the device stands on the table
    parts, start, number, before = [], 0.0, 0, 0.0
    for outer, inner, fast, slow, length, warm in plan:
        clock = np.arange(round(length * ROWS_A_SECOND)) / ROWS_A_SECOND
        start, before = start + 1800.0 * (warm != before), warm
        first = about(OUTER, np.deg2rad(outer) + fast * clock)
        second = about(INNER, np.deg2rad(inner) + slow * clock)
        of_room = np.swapaxes(first @ second @ case, 1, 2)
        turn = (np.swapaxes(second, 1, 2) @ OUTER * fast + INNER * slow) @ case
        moving = fast != 0.0 or slow != 0.0
        label = np.full(len(clock), -1 if moving else number)
        force, rate = of_room @ np.array([0.0, 0.0, G]), turn + of_room @ EARTH
        parts.append((start + clock, force, rate, label, np.full(len(clock), warm)))
        start, number = start + length + 2.0, number + (not moving)
    return [np.concatenate(column) for column in zip(*parts, strict=True)]


def device(seed, ideal):
    """A device's log, and its lever arms, m: 30 to 60 mm and some millimetres between them."""
    clock, force, rate, label, warm = ideal
    rng = np.random.default_rng(seed)
    place = rng.standard_normal(3)
    place *= rng.uniform(0.03, 0.06) / np.linalg.norm(place)
    arms = place + 3e-3 * rng.standard_normal((3, 3))
    felt = force[:, None] + np.cross(rate[:, None], np.cross(rate[:, None], arms[None]))
    accel = np.eye(3) + 1e-4 * rng.standard_normal((3, 3))
    gyro = np.eye(3) + 1e-3 * rng.standard_normal((3, 3))
    warmer = (warm - 20.0)[:, None]
    # Each accelerometer has its own place: row i of its matrix times the force there.
    force = np.einsum("ij,tij->ti", accel, felt) + 0.05 * rng.standard_normal(3) + 1e-3 * warmer
    turned = rate @ gyro.T + 0.01 * rng.standard_normal(3) + 1e-5 * warmer
    triads = {
        "accel": force + 2e-3 * rng.standard_normal(force.shape),
        "gyro": turned + 2e-4 * rng.standard_normal(turned.shape),
        "reference_accel": ideal[1],
        "reference_gyro": rate,
    }
    columns = {"time": clock, "position": label, "temperature": warm}
    for name, values in triads.items():
        columns |= {f"{name}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
    return pl.DataFrame(columns), arms


@pytest.fixture(scope="module")
def line(tmp_path_factory):
    """A folder for each device and one table of all of them, results of both, and the arms; one device has no numbers
    while the table turns, and one in a folder no references."""
    place, ideal, arms, logs = tmp_path_factory.mktemp("line"), table(), {}, {}
    for seed, name in enumerate((*GOOD, BAD), start=11):
        logs[name], arms[name] = device(seed, ideal)
    gone = pl.when(pl.col("position") >= 0).then(pl.col("accel_y")).otherwise(None)
    logs[BAD] = logs[BAD].with_columns(accel_y=gone)
    bare = logs[GOOD[0]].drop([f"reference_{t}_{a}" for t in ("accel", "gyro") for a in "xyz"])
    for name, log in {**logs, BARE: bare}.items():
        folder = place / "folders" / name
        folder.mkdir(parents=True)
        log.write_parquet(folder / "log.parquet")
        (folder / "campaign.toml").write_text(TOML)
    (place / "table").mkdir()
    (place / "table" / "campaign.toml").write_text(TOML)
    pl.concat([log.with_columns(device=pl.lit(name)) for name, log in logs.items()]).write_parquet(
        place / "table" / "log.parquet"
    )
    told = []
    run_fleet(place / "folders", place / "of folders", progress=lambda *done: told.append(done))
    run_fleet(place / "table", place / "of table")
    return place, arms, told


@pytest.fixture(scope="module")
def alone(line):
    place, _, _ = line
    with jax.enable_x64(True):
        found = {name: calibrate(load_campaign(place / "folders" / name)) for name in GOOD}
    assert all(isinstance(result, DeviceResult) for (result,) in found.values())
    return {name: result for name, (result,) in found.items()}


@pytest.mark.slow
def test_a_library_call_in_32_bits_gives_the_same(line, alone):
    """Both triads with nine arms over temperature are solved in 64 bits, whatever JAX is set to."""
    place, _, _ = line
    with jax.enable_x64(False):
        (found,) = calibrate(load_campaign(place / "folders" / GOOD[0]))
        assert isinstance(found, DeviceResult), found.reason
        kinds = {type(x) for x in jax.tree.leaves(found.calibration) if hasattr(x, "dtype")}
    assert kinds <= {np.ndarray, np.float64}
    own = alone[GOOD[0]].calibration
    sigmas = np.sqrt(np.diagonal(own.covariance))
    assert np.abs((found.calibration.coefficients - own.coefficients) / sigmas).max() < 1e-6
    for arm, other in zip(own.effects, found.calibration.effects, strict=True):
        np.testing.assert_allclose(other.coefficients, arm.coefficients, atol=1e-9)  # m


@pytest.mark.slow
@pytest.mark.parametrize("results", ["of folders", "of table"])
def test_a_device_in_a_fleet_is_calibrated_as_alone(results, line, alone):
    place, _, _ = line
    manifest = read_manifest(place / results)
    rows = {r["device"]: r for r in read_parts(place / results).collect().iter_rows(named=True)}
    for name, result in alone.items():
        own, found = result.calibration, fleet_calibration(place / results, name)
        assert found.model == own.model and found.model.lever_arms
        for triad in ("accel", "gyro"):
            (values, sigmas), (others, again) = (
                getattr(c, triad).over(np.linspace(0.0, 40.0, 5)) for c in (own, found)
            )
            assert np.abs((values - others) / sigmas).max() < 1e-3
            np.testing.assert_allclose(again, sigmas, rtol=0.05)
        for arm, other in zip(own.effects, found.effects, strict=True):
            assert (arm.name, arm.channels, arm.unit) == (other.name, other.channels, other.unit)
            sigmas = np.sqrt(np.diagonal(arm.covariance))
            assert np.abs((arm.coefficients - other.coefficients) / sigmas).max() < 1e-3
            assert (
                np.abs((arm.covariance - other.covariance) / np.outer(sigmas, sigmas)).max() < 0.1
            )
            assert arm.greatest_input == pytest.approx(other.greatest_input)
        # Verdict, reservations, and what is said beside the numbers.
        quality = judge(result)
        assert device_verdict(rows[name], manifest) == quality.verdict == "usable"
        asking = [f.text for f in quality.findings if not f.fine]
        assert [f.text for f in device_findings(rows[name], manifest)] == asking
        assert set(own.notes) <= set(found.notes)
        assert sum(note.startswith("accelerometer x: lever arm") for note in found.notes) == 1


@pytest.mark.slow
def test_arms_are_recovered_within_their_uncertainties(line):
    place, arms, _ = line
    rows = read_parts(place / "of folders").filter(reason="").collect()
    squares = []
    for name, found, sigmas in rows.select(
        "device", "accel_lever_arms", "accel_lever_arms_sigma"
    ).iter_rows():
        off = np.reshape(found, (3, 3)) - arms[name]
        np.testing.assert_allclose(off, 0.0, atol=1e-3)  # m; they are 30 to 60 mm
        assert max(sigmas) < 1e-3
        effects = fleet_calibration(place / "of folders", name).effects
        for k, effect in enumerate(effects):
            squares.append(off[k] @ np.linalg.solve(effect.covariance, off[k]))
            own = np.sqrt(np.diagonal(effect.covariance))
            np.testing.assert_allclose(sigmas[3 * k : 3 * k + 3], own, rtol=1e-12)
    assert len(squares) == 3 * len(GOOD)
    # Forces that turn in the case are noise to the means of plateaus, so that the uncertainties are rather too large.
    assert sum(squares) < scipy.stats.chi2(3 * len(squares)).ppf(0.999)


@pytest.mark.slow
def test_a_bad_device_stops_nothing_and_each_device_is_told(line):
    place, _, told = line
    for results in ("of folders", "of table"):
        with pytest.raises(ValueError, match=f"device '{BAD}' was set aside: .*accel"):
            fleet_calibration(place / results, BAD)
        assert read_parts(place / results).filter(reason="").collect().height == len(GOOD)
    with pytest.raises(
        ValueError, match=f"'{BARE}' was set aside: accel: no column reference_accel_x"
    ):
        fleet_calibration(place / "of folders", BARE)
    assert told == [(k, 4) for k in range(5)]


@pytest.mark.slow
def test_a_devices_file_and_protocol_hold_its_arms(line, alone, capsys, monkeypatch):
    place, _, _ = line
    results, name = place / "of folders", GOOD[1]
    asked = ("fleet", place / "folders", "-o", results, "--device", name)
    assert run(capsys, monkeypatch, *asked)[0] == 0
    file = results / f"calibration-{name}.json"
    stored = read_calibration(file).effects
    own = alone[name].calibration.effects
    assert [e.channels for e in stored] == [(0,), (1,), (2,)]
    for one, other in zip(stored, own, strict=True):
        np.testing.assert_allclose(one.coefficients, other.coefficients, rtol=1e-6)
    assert json.loads(file.read_text())["effects"][0]["unit"] == "m"
    page = (results / "devices" / f"{name}.html").read_text()
    assert "Lever arms" in page and f"{1e3 * float(own[0].coefficients[0]):.0f}" in page
    calibration, record = fleet_measurement(results, name)
    said = effect_results(calibration, record)
    assert [r.value for r in said] == pytest.approx(np.concatenate([e.coefficients for e in own]))
    assert all(r.std is not None and r.std > 0.0 for r in said)
    assert record.station.latitude == pytest.approx(np.deg2rad(52.5))


@pytest.mark.slow
def test_lever_arms_go_with_no_prior_and_no_scores(line):
    place, _, _ = line
    with pytest.raises(ValueError, match="lever_arms .* go with no prior, no --explain"):
        run_fleet(place / "folders", place / "scored", explain=True)
