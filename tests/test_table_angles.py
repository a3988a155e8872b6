"""References from a table's angles, against SciPy's rotations."""

import itertools
import json
import re

import msgspec
import numpy as np
import polars as pl
import pytest
import scipy.ndimage
from scipy.spatial.transform import Rotation

import table_of_two_axes
from command_runs import run
from inertiax.campaign_draft import draft_campaign
from inertiax.campaign_draft.table_angles import without_twins
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.table_angles import DIRECTIONS, ideal_readings
from inertiax.data.formats.table_rates import rates_by_axis, rates_of_angles
from inertiax.data.formats.turntable import Turntable
from inertiax.data.recording import Recording
from inertiax.physics.earth import earth_rate
from inertiax.plausibility import check_campaign
from inertiax.reduction.segments import segment


G, LATITUDE = 9.81, np.deg2rad(48.2)
TABLES = {
    "yaw that carries roll": Turntable(axes=("up", "north")),
    "two-axis, device on its side": Turntable(axes=("east", "up"), case=("up", "north", "west")),
    "three axes": Turntable(axes=("up", "east", "north"), azimuth=37.0),
    "an axis of its own direction": Turntable(axes=((0.6, 0.0, 0.8), "north"), azimuth=-120.0),
}


def vector(direction):
    v = np.array(DIRECTIONS[direction] if isinstance(direction, str) else direction)
    return v / np.linalg.norm(v)


def attitudes(table, angles):
    """Case to room: outer axes carry inner ones."""
    case = Rotation.from_matrix(np.stack([vector(d) for d in table.case], axis=1))
    made = case
    for axis, angle in reversed(list(zip(table.axes, angles.T, strict=True))):
        made = Rotation.from_rotvec(angle[:, None] * vector(axis)) * made
    return made


def earth_in_room(table):
    """The room is turned clockwise by its azimuth, seen from above."""
    room = Rotation.from_euler("z", -(table.azimuth or 0.0), degrees=True)
    return room.inv().apply(np.array(earth_rate(LATITUDE)))


@pytest.mark.parametrize("name", TABLES)
def test_force_and_earth_rate_are_those_of_the_rotated_case(name):
    table = TABLES[name]
    angles = np.random.default_rng(1).uniform(-7.0, 7.0, (50, len(table.axes)))
    found = ideal_readings(table, angles, np.zeros_like(angles), G, LATITUDE)
    r = attitudes(table, angles)
    np.testing.assert_allclose(found.force, r.inv().apply([0.0, 0.0, G]), atol=1e-13)
    np.testing.assert_allclose(
        found.rate, r.inv().apply(earth_in_room(table)), rtol=1e-6, atol=1e-12
    )


@pytest.mark.parametrize("name", TABLES)
def test_the_table_s_rates_turn_the_case_as_its_angles_do(name):
    """By the difference of attitudes over 2 ms, whose error is of third order."""
    table, h = TABLES[name], 1e-3
    rng = np.random.default_rng(2)
    angles, rates = (rng.uniform(-2.0, 2.0, (50, len(table.axes))) for _ in range(2))
    found = ideal_readings(table, angles, rates, G, None)
    before, after = (attitudes(table, angles + s * h * rates) for s in (-1.0, 1.0))
    turned = (before.inv() * after).as_rotvec() / (2.0 * h)  # in the case's axes
    np.testing.assert_allclose(found.rate, turned, atol=3e-5)


def test_a_roll_axis_of_ninety_degrees_lays_the_device_on_its_side():
    """About north, right-handed: what was east points down, so that x reads −g; the yaw changes nothing."""
    found = ideal_readings(
        Turntable(axes=("up", "north")), np.deg2rad([[30.0, 90.0]]), None, G, None
    )
    np.testing.assert_allclose(found.force, [[-G, 0.0, 0.0]], atol=1e-12)
    assert found.rate is None


def test_north_by_azimuth():
    """At the equator, on a table whose north points east: the Earth turns about minus its east."""
    table = Turntable(axes=("up",), azimuth=90.0)
    found = ideal_readings(table, np.zeros((1, 1)), np.zeros((1, 1)), G, 0.0)
    np.testing.assert_allclose(found.rate, [[-7.292115e-5, 0.0, 0.0]], atol=1e-17)


def test_one_column_of_rates_is_that_of_the_axis_that_turns():
    """Laps at 60 °/s of the inner axis and −25 °/s of the outer one, angles within a turn with an encoder's noise of
    0.0001°; between them both move to a position by 90° (1 − cos) / 2, for which the column is zero."""
    t = np.arange(0.0, 40.0, 0.01)
    told = np.select([(t > 5.0) & (t < 15.0), t > 25.0], [60.0, -25.0], 0.0)
    lap = lambda begin, end, rate: rate * np.clip(t - begin, 0.0, end - begin)
    u = np.clip((t - 17.0) / 5.0, 0.0, 1.0)
    position = 45.0 * (1.0 - np.cos(np.pi * u))
    moving = np.where((u > 0.0) & (u < 1.0), 45.0 * np.pi / 5.0 * np.sin(np.pi * u), 0.0)  # °/s
    angles = np.stack([position + lap(25.0, 40.0, -25.0), position + lap(5.0, 15.0, 60.0)], axis=1)
    angles = (angles + 1e-4 * np.random.default_rng(3).standard_normal(angles.shape)) % 360.0
    found = np.rad2deg(rates_by_axis(np.deg2rad(angles), np.deg2rad(told[:, None]), t))
    right = np.stack([moving + np.where(t > 25.0, -25.0, 0.0), moving], axis=1)
    right[:, 1] += np.where((t > 5.0) & (t < 15.0), 60.0, 0.0)
    still = (right == 0.0).all(axis=1)
    # Beside a move of 5 s, where a ramp may be within the noise, that is what is left; and a row before it the half of
    # what it does in the first 0.01 s.
    beside = still & (np.abs(t - 19.5) < 2.5 + 0.5)
    assert np.mean(found[still & ~beside] == 0.0) > 0.999  # but for a row beside a plateau
    noise, first = 5.0 * np.sqrt(2.0) * 1e-4, 45.0 * (1.0 - np.cos(np.pi * 0.01 / 5.0))
    np.testing.assert_allclose(found[beside], 0.0, atol=(noise + first) / 0.02)
    np.testing.assert_allclose(found[told != 0.0], right[told != 0.0], atol=1e-9)
    # The change of two angles over 20 ms: 0.0001° · √2 / 0.02 s is 0.007 °/s, five of which are rare in 1000 numbers.
    between = moving > 0.5
    np.testing.assert_allclose(found[between], right[between], atol=0.036)
    with pytest.raises(ValueError, match="not the change of any of table_angles"):
        rates_by_axis(np.deg2rad(angles), np.deg2rad(told[:, None] * 3.0), t)


def ramped(t, begin, rate, ramp, held):
    """Angle and rate, ° and °/s, of an axis that speeds up evenly to `rate`, holds it and slows down again."""
    knots = begin + np.array([0.0, ramp, ramp + held, 2.0 * ramp + held])
    turning = np.interp(t, knots, [0.0, rate, rate, 0.0])
    up, flat, down = (np.clip(t - b, 0.0, e - b) for b, e in zip(knots, knots[1:]))
    angle = 0.5 * rate / ramp * up**2 + rate * flat + rate * down - 0.5 * rate / ramp * down**2
    return angle, turning


@pytest.mark.parametrize("noise", [0.0, 1e-3])  # of an encoder, °; else its digits of 0.0001°
def test_a_programmed_rate_that_is_written_through_the_ramps_is_none_there(noise):
    """±90 °/s at 60 °/s² of the outer axis, as a station writes that commands rates."""
    t = np.arange(0.0, 60.0, 0.01)
    (a, w), (b, v) = ramped(t, 5.0, 90.0, 1.5, 16.0), ramped(t, 32.0, -90.0, 1.5, 16.0)
    told = 90.0 * ((w != 0.0) * 1.0 - (v != 0.0))
    angles = np.stack([a + b, np.full(len(t), 30.0)], axis=1)
    angles += noise * np.random.default_rng(4).standard_normal(angles.shape)
    angles = np.deg2rad(np.round(angles, 4) % 360.0)
    said = np.rad2deg(rates_by_axis(angles, np.deg2rad(told[:, None]), t))
    alone = np.rad2deg(rates_of_angles(angles, t))
    right = w + v
    flat = np.abs(np.abs(right) - 90.0) < 1e-9
    # A row of the ramp, 0.6 °/s, and its digits; beside a plateau five times what noise makes of the change over 10 ms,
    # where a ramp is not told from it, and four times for the row's own.
    near = np.sqrt(2.0) * noise / 0.01
    assert np.abs(said - np.stack([right, 0.0 * right], axis=1)).max() < 0.7 + 9.0 * near
    assert np.mean(np.abs(said[flat] - [[90.0, 0.0]] * np.sign(right[flat, None])) == 0.0) > 0.999
    # The mean rate over 15 s of 1500 angles with noise, or with the digits' 0.00003°.
    inside = flat & np.roll(flat, 30) & np.roll(flat, -30)
    sigma = np.sqrt(12.0) * max(noise, 3e-5) / 15.0 / np.sqrt(1500.0)
    assert np.abs(alone[inside, 0] - right[inside]).max() < 5.0 * sigma
    assert np.ptp(alone[inside & (right > 0.0)], axis=0).max() == 0.0


def test_plateaus_are_whole_where_one_axis_turns_at_a_time():
    """±40 and ±80 °/s of each axis while the other stands, 40 rows a second with stamps to 0.1 ms. The standing axis'
    changes of zero passed for the noise of both, and plateaus fell to pieces that a digit of the stamps parted."""
    t = np.arange(0.0, 120.0, 0.025)
    t = t + 1e-3 * np.random.default_rng(3).uniform(-1.0, 1.0, len(t))
    angles, right = np.zeros((2, len(t), 2))
    for k, begin in enumerate((5.0, 20.0, 35.0, 50.0, 65.0, 80.0, 95.0, 108.0)):
        angle, rate = ramped(t, begin, (-1.0) ** k * (40.0, 80.0)[k % 4 // 2], 1.0, 8.0)
        angles[:, k // 4] += angle
        right[:, k // 4] += rate
    found = np.rad2deg(rates_of_angles(np.deg2rad(np.round(angles, 4)), np.round(t, 4)))
    for axis in range(2):
        for rate in (40.0, -40.0, 80.0, -80.0):
            flat = np.abs(right[:, axis] - rate) < 1e-9
            inside = flat & np.roll(flat, 8) & np.roll(flat, -8)
            assert np.ptp(found[inside, axis]) == 0.0
            # The slope of 320 angles over 8 s, whose stamps are off by 0.1 ms / √12 and digits by 0.0001° / √12.
            sigma = np.sqrt(12.0) * (abs(rate) + 1.0) * 2.9e-5 / 8.0 / np.sqrt(320.0)
            assert np.abs(found[inside, axis] - rate).max() < 5.0 * sigma


def test_a_rate_that_a_reference_holds_through_the_ramps_is_cut_by_the_gyros():
    """Plateaus of 8 s between ramps of 1.5 s; a gyro of 0.05 °/s and 1 % reaches 90 °/s to its noise within 2 ms of
    the ramp's end. Turns by hand, whose reference is the mean rate over ramps and all, stay whole."""
    t = np.arange(0.0, 60.0, 0.01)
    (_, w), (_, v) = ramped(t, 5.0, 90.0, 1.5, 8.0), ramped(t, 32.0, -90.0, 1.5, 8.0)
    right = np.stack([w + v, 0.0 * t, 0.0 * t], axis=1)
    gyro = 1.01 * right + 0.05 * np.random.default_rng(6).standard_normal(right.shape)
    turns = np.sign(right)
    cut = lambda reference: segment(
        Recording(t, gyro=np.deg2rad(gyro), reference_gyro=np.deg2rad(reference))
    )
    found = cut(90.0 * turns)
    plateau = ~found.resting
    assert plateau.sum() == 2
    np.testing.assert_allclose(t[found.start[plateau]], [6.5, 33.5], atol=0.03)
    np.testing.assert_allclose(t[found.stop[plateau] - 1], [14.5, 41.5], atol=0.03)
    assert abs(found.ramps - 6.0) < 0.1
    by_hand = cut(90.0 * 9.5 / 11.0 * turns)  # 8 s and twice half of 1.5 s, over 11 s
    assert by_hand.ramps == 0.0
    assert np.ptp(by_hand.stop[~by_hand.resting] - by_hand.start[~by_hand.resting]) <= 1


@pytest.mark.parametrize("wander, sigma", [(0.0, 3.0), (3e-6, 2.0)])
def test_an_azimuth_that_the_gyros_contradict_is_said_with_the_right_one(tmp_path, wander, sigma):
    """At 48° the horizontal part is 10 °/h, 4.9e-5 rad/s; a rest's mean is known to 1e-5 / √80 = 1.1e-6 rad/s. Biases
    that wander 0.6 °/h in a second, 19 °/h in a rest of a quarter of an hour, leave 72 rests 2° at most."""
    station(tmp_path / "c", msgspec.structs.replace(PITCH, azimuth=-37.0), wander=wander)
    azimuth = lambda file: [
        f for f in check_campaign(load_campaign(file)).findings if f.kind == "azimuth"
    ]
    (said,) = azimuth(tmp_path / "c")
    assert said.severity == "warning" and said.remedy is not None
    numbers = dict(said.evidence)
    assert abs(np.degrees(numbers["angle"]) + 37.0) < 3.0 * np.degrees(numbers["std"])
    assert np.degrees(numbers["std"]) < sigma
    better = float(said.remedy.removeprefix("[table]\nazimuth = "))
    file = tmp_path / "c" / "campaign.toml"
    file.write_text(TOML + f"azimuth = {better}\n")
    assert not azimuth(file)
    log = tmp_path / "c" / "log.csv"
    # Four rests have 12 means for six biases and more drivers than that.
    pl.read_csv(log).filter(pl.col("position") < 4).write_csv(log)
    (said,) = azimuth(file)
    assert said.severity == "note" and "do not tell [table] azimuth" in said.statement


TRUTH = np.array([0.1, -0.2, 0.05])
MATRIX = np.eye(3) + 1e-3 * np.array([[2.0, 0.3, -0.4], [0.5, -1.0, 0.2], [0.1, -0.6, 3.0]])
TOML = """[site]
gravity = 9.81
latitude = 48.2
[recordings]
files = ["log.csv"]
[columns]
table_angles = { names = ["aussen", "innen"] }
table_rates = { names = ["rate aussen", "rate innen"] }
[table]
axes = ["east", "north"]
"""


PITCH = Turntable(axes=("east", "north"))  # carries roll


def station(folder, table=PITCH, ramp=0.0, wander=0.0):
    """Twelve positions of 4 s each, then six turns about the inner axis and six about the outer one; angles empty while
    the table moves from one to the next. Turns begin with a ramp of so many seconds, through which their rate is
    written. Where gyros wander, rad/s in the root of a second, the table goes through its positions six times and once
    rests for a quarter of an hour."""
    rng = np.random.default_rng(5)
    places = np.array([[a, b] for a in (0.0, 120.0, 240.0) for b in (0.0, 90.0, 180.0, 270.0)])
    if wander:
        places = np.tile(places, (6, 1))
    long = [80] * len(places)
    long[len(long) // 3] = 18000 if wander else 80
    rows = [
        (np.tile(p, (n, 1)), np.zeros((n, 2)), np.full(n, k))
        for k, (p, n) in enumerate(zip(places, long, strict=True))
    ]
    step = np.arange(80)[:, None] / 20.0
    share = np.minimum(step / ramp, 1.0) if ramp else np.ones((80, 1))
    turned = np.where(step < ramp, 0.5 * step * share, step - 0.5 * ramp)
    for inner in (
        0.0,
        90.0,
        180.0,
    ):  # about the outer axis on three device axes, and about the inner one
        for rate in ([60.0, 0.0], [-60.0, 0.0], [0.0, 60.0], [0.0, -60.0]):
            turning = np.tile(rate, (80, 1))
            rows.append(([0.0, inner] + turned * turning, turning, np.full(80, -1)))
    angles, rates, label = (np.concatenate(x) for x in zip(*rows, strict=True))
    shares = np.concatenate([np.ones((sum(long), 1)), *[share] * 12])
    ideal = ideal_readings(table, np.deg2rad(angles), np.deg2rad(shares * rates), G, LATITUDE)
    accel = ideal.force @ MATRIX.T + TRUTH + 1e-3 * rng.standard_normal(ideal.force.shape)
    gyro = ideal.rate @ MATRIX.T + 0.01 * TRUTH + 1e-5 * rng.standard_normal(accel.shape)
    if wander:
        gyro += wander * np.cumsum(rng.standard_normal(gyro.shape), axis=0) / np.sqrt(20.0)
    columns = {"time": np.arange(len(label)) / 20.0, "position": label}
    columns |= {f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}
    columns |= {f"gyro_{a}": gyro[:, k] for k, a in enumerate("xyz")}
    told = {"aussen": angles[:, 0], "innen": angles[:, 1]}
    told |= {"rate aussen": rates[:, 0], "rate innen": rates[:, 1]}
    folder.mkdir()
    pl.DataFrame(columns | told).write_csv(folder / "log.csv")
    (folder / "campaign.toml").write_text(TOML)
    return ideal, label


def test_a_campaign_of_angles_is_calibrated_by_reference(tmp_path, capsys, monkeypatch):
    ideal, label = station(tmp_path / "c")
    (recording,) = load_campaign(tmp_path / "c").recordings
    still = label >= 0
    np.testing.assert_allclose(recording.reference_accel[still], ideal.force[still], atol=1e-9)
    assert not recording.reference_accel[~still].any()  # angles of a table that moves are late
    np.testing.assert_allclose(recording.reference_gyro, ideal.rate, atol=1e-12)
    status, out, err = run(
        capsys, monkeypatch, "calibrate", tmp_path / "c", "-o", tmp_path / "out", "--json"
    )
    assert status == 0, err
    (device,) = json.loads(out)["devices"]
    assert (
        device["model"]["accel"]["estimator"] == device["model"]["gyro"]["estimator"] == "reference"
    )
    triads = json.loads((tmp_path / "out" / "calibration.json").read_text())
    for key, bias in (("accel", TRUTH), ("gyro", 0.01 * TRUTH)):
        triad = triads[key]
        truth = np.concatenate([bias, (MATRIX - np.eye(3)).ravel()])
        sigma = np.sqrt(np.diagonal(triad["covariance"]))
        assert np.all(np.abs(triad["coefficients"][0] - truth) < 4.0 * sigma)


@pytest.mark.parametrize("name", ["pitch that carries roll", *list(TABLES)[:2]])
def test_init_finds_the_table_whose_angles_these_are(tmp_path, name):
    """Up to a turn about the vertical, which changes no reading but the Earth's rate; here it is left out."""
    ideal, label = station(tmp_path / "c", TABLES.get(name, PITCH))
    log = tmp_path / "c" / "log.csv"
    columns = pl.read_csv(log).with_columns(
        pl.when(pl.col("position") < 0).then(0).otherwise(pl.col("position") + 1).alias("position")
    )
    columns.select(sorted(columns.columns, reverse=True)).write_csv(log)
    (tmp_path / "c" / "campaign.toml").write_text(draft_campaign(log, tmp_path / "c").text)
    (recording,) = load_campaign(tmp_path / "c").recordings
    still = label >= 0
    np.testing.assert_array_equal(recording.position >= 0, still)
    size = np.linalg.norm(recording.reference_accel[still], axis=1)[:, None]
    np.testing.assert_allclose(
        G * recording.reference_accel[still] / size, ideal.force[still], atol=1e-9
    )
    attitude = attitudes(TABLES.get(name, PITCH), np.zeros((1, 2)))
    earth = attitude.inv().apply(earth_in_room(Turntable()))
    assert np.abs(recording.reference_gyro - ideal.rate).max() < 1.1 * np.linalg.norm(earth)


def test_init_finds_the_table_of_six_faces_whose_inner_axis_stands_at_two_places(tmp_path):
    """A flag, which stands at two as well, is none of its angles."""
    faces = np.array([[0, 0], [180, 0], [90, 0], [270, 0], [270, 90], [90, 90], [0, 0]], float)
    angles = [np.tile(faces[0], (300, 1))]
    for one, other in itertools.pairwise(faces):
        moved = [table_of_two_axes.smooth(a, b, 4.0) for a, b in zip(one, other)]
        angles += [np.stack(moved, axis=1), np.tile(other, (300, 1))]
    turned = np.concatenate(angles)
    force, rate = table_of_two_axes.readings(turned)
    rng = np.random.default_rng(3)
    rows = np.arange(len(turned))
    values = [rows / table_of_two_axes.RATE, force + rng.normal(0.0, 0.01, force.shape)]
    values += [rate + rng.normal(0.0, 1e-3, rate.shape), rows % 1000 < 500, turned]
    names = "time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,heater,aussen,innen".split(",")
    pl.DataFrame(np.column_stack(values), names).write_csv(tmp_path / "log.csv")
    text = draft_campaign(tmp_path / "log.csv", tmp_path).text
    assert 'table_angles = { names = ["aussen", "innen"], unit = "deg" }' in text
    assert 'axes = ["east", "up"]' in text and 'perhaps labels: "heater".' in text


def test_init_finds_a_table_whose_encoders_are_noisy(tmp_path):
    """Half a thousandth of a degree at 0.0001°: no row is as the one before it, at rest neither, where it mostly is."""
    station(tmp_path / "c", wander=1e-12)
    log = tmp_path / "c" / "log.csv"
    rng, table = np.random.default_rng(8), pl.read_csv(log)
    noisy = {
        name: (table[name] + pl.Series(5e-4 * rng.standard_normal(len(table)))).round(4)
        for name in ("aussen", "innen")
    }
    table.with_columns(**noisy).write_csv(log)
    text = draft_campaign(log, tmp_path / "c").text
    assert 'table_angles = { names = ["aussen", "innen"], unit = "deg" }' in text
    assert 'table_rates = { names = ["rate aussen", "rate innen"], unit = "deg/s" }' in text


def test_columns_that_never_stand_still_together_are_no_table(tmp_path):
    """Three columns, each at rest in three rests of five, and no rest in which all three are."""
    station(tmp_path / "c")
    log = tmp_path / "c" / "log.csv"
    table = pl.read_csv(log).drop("rate aussen", "rate innen")
    swing = pl.Series(np.sin(np.arange(len(table))))
    for k in range(3):
        wild = table["position"].is_in([p for p in range(12) if p % 3 == k])
        table = table.with_columns((table["innen"] + swing * wild).alias(f"angle {k}"))
    table.drop("aussen", "innen").write_csv(log)
    assert "table_angles = {" not in draft_campaign(log, tmp_path / "c").text


@pytest.mark.parametrize(
    "ramp, error", [(0.0, 1e-4), (1.0, 0.053)]
)  # a row of the ramp is 3 °/s, 0.05 rad/s
def test_init_finds_one_column_of_rates_for_whichever_axis_turns(tmp_path, ramp, error):
    ideal, _ = station(tmp_path / "c", ramp=ramp)
    log = tmp_path / "c" / "log.csv"
    rate = pl.col("rate aussen") + pl.col("rate innen")
    pl.read_csv(log).with_columns(rate=rate).drop("rate aussen", "rate innen").write_csv(log)
    text = draft_campaign(log, tmp_path / "c").text
    assert 'table_rates = { names = ["rate"], unit = "deg/s" }' in text
    (tmp_path / "c" / "campaign.toml").write_text(text)
    (recording,) = load_campaign(tmp_path / "c").recordings
    assert np.abs(recording.reference_gyro - ideal.rate).max() < error  # the Earth's is left out


def test_init_finds_the_table_of_a_station_that_writes_a_file_for_each_step(tmp_path):
    """No file alone tells the angles; each begins its clock anew, with decimal commas."""
    ideal, label = station(tmp_path / "c")
    folder = tmp_path / "c"
    whole = pl.read_csv(folder / "log.csv").drop("position")
    (folder / "log.csv").unlink()
    for k, rows in enumerate(np.split(np.arange(len(label)), len(label) // 80)):
        step = whole[rows].with_columns(time=np.arange(80) / 20.0)
        step.write_csv(folder / f"step {k + 1}.csv", separator=";", decimal_comma=True)
    logs = sorted(folder.glob("*.csv"), key=lambda p: int(p.stem.split()[1]))
    draft = draft_campaign(logs[0], folder, others=logs[1:])
    assert '"aussen", "innen"' in draft.text and '"rate aussen", "rate innen"' in draft.text
    assert 'files = ["*.csv"]' in draft.text and "need 9 or more" not in draft.text
    (folder / "campaign.toml").write_text(draft.text)
    recordings = load_campaign(folder).recordings
    force = np.concatenate([r.reference_accel for r in recordings])
    rate = np.concatenate([r.reference_gyro for r in recordings])
    np.testing.assert_allclose(
        force / np.linalg.norm(force, axis=1, keepdims=True), ideal.force / G, atol=1e-9
    )
    assert np.abs(rate - ideal.rate).max() < 1e-4  # the Earth's rate is left out


@pytest.mark.parametrize(
    "change, said",
    [
        (('[table]\naxes = ["east", "north"]\n', ""), "table_angles needs [table] axes"),
        (('"east", "north"]', '"up"]'), "[table] axes has 1 directions, but [columns] table_angles names 2"),
        (('"east", "north"]', '"upp", "north"]'), "'upp' is no direction; did you mean 'up'?"),
        (('"north"]\n', '"north"]\ncase = ["east", "up", "north"]\n'), "are left-handed"),
        (('"north"]\n', '"north"]\ncase = ["east", "up", "up"]\n'), "must be at right angles"),
        (('"aussen", "innen"] }', '"aussen", "innen"], unit = "gon" }'), "unit 'gon' is not known"),
        (('["rate aussen", "rate innen"]', '["innen", "aussen", "innen"]'), "name one column for each of table_angles"),
        (('"aussen", "innen"', '"aussen", "inne"'), "column 'inne' is missing; did you mean 'innen'?"),
        (("[table]", 'reference_accel = { names = ["accel_x", "accel_y", "accel_z"] }\n[table]'), "leave one out"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(tmp_path, change, said):
    station(tmp_path / "c")
    (tmp_path / "c" / "campaign.toml").write_text(TOML.replace(*change))
    with pytest.raises(ValueError, match="campaign.toml: ") as caught:
        load_campaign(tmp_path / "c")
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_empty_angles_are_allowed_while_the_table_moves_alone(tmp_path):
    station(tmp_path / "c")
    table = pl.read_csv(tmp_path / "c" / "log.csv")
    empty = pl.when(pl.col("position") >= 0).then(pl.col("innen"))
    table.with_columns(innen=empty).write_csv(tmp_path / "c" / "log.csv")
    rates = 'table_rates = { names = ["rate aussen", "rate innen"] }\n'
    (tmp_path / "c" / "campaign.toml").write_text(TOML.replace(rates, ""))
    (recording,) = load_campaign(tmp_path / "c").recordings
    assert recording.reference_gyro is None
    assert not recording.reference_accel[recording.position < 0].any()
    table.with_columns(innen=pl.lit(None)).write_csv(tmp_path / "c" / "log.csv")
    with pytest.raises(ValueError, match="'innen' has no finite number in"):
        load_campaign(tmp_path / "c")


def two_logs(folder, late, drift=0.0):
    """A device at 50 Hz, and beside it at 10 Hz the table on another computer: sixteen positions by a trapezoid of
    60 °/s, then turns of ±90 °/s about both axes. The table's clock is so many seconds late, and so many ppm fast."""
    folder.mkdir()
    rng = np.random.default_rng(8)
    stops = [[a, b] for b in (0.0, 90.0, 180.0, 270.0) for a in (0.0, 90.0, 180.0, 270.0)]
    stops += [[0.0, 270.0], [0.0, 630.0], [0.0, 270.0], [360.0, 270.0], [0.0, 270.0]]
    knots, places = [0.0, 5.0], [stops[0], stops[0]]
    for a, b in itertools.pairwise(stops):
        spent = np.abs(np.subtract(b, a)).max() / 60.0
        knots += [knots[-1] + spent, knots[-1] + spent + 5.0]
        places += [b, b]
    fine = np.arange(0.0, knots[-1], 0.02)
    course = lambda t: np.stack([np.interp(t, knots, p) for p in np.transpose(places)], axis=1)
    # A mean over 0.6 s is the trapezoid of a table with a finite acceleration.
    angles = scipy.ndimage.uniform_filter1d(course(fine), 31, axis=0, mode="nearest")
    rates = np.gradient(angles, 0.02, axis=0)
    turned = attitudes(PITCH, np.deg2rad(angles)).inv()
    force = turned.apply([0.0, 0.0, G]) + 5e-3 * rng.standard_normal((len(fine), 3))
    ideal = ideal_readings(PITCH, np.deg2rad(angles), np.deg2rad(rates), G, LATITUDE)
    gyro = ideal.rate + 1e-3 * rng.standard_normal(force.shape)
    device = {"time_s": fine}
    device |= {f"ACC_{x}": force[:, k] for k, x in enumerate("ABC")}
    device |= {f"GYR_{x}": np.rad2deg(gyro[:, k]) for k, x in enumerate("ABC")}
    pl.DataFrame(device).write_csv(folder / "device.csv")
    clock = late + fine[::5] * (1.0 + 1e-6 * drift)
    own = {"elapsed_s": np.round(clock, 3), "chamber": np.full(len(fine[::5]), 21.0)}
    own |= {f"pos_{k}": np.round(angles[::5, k] % 360.0, 4) for k in range(2)}
    own |= {f"rate_{k}": np.round(rates[::5, k], 4) for k in range(2)}
    pl.DataFrame(own).write_csv(folder / "table.csv")
    return np.linalg.norm(rates, axis=1), ideal


@pytest.mark.parametrize("late", [0.137, 1.7e9])
def test_a_tables_own_log_is_put_beside_the_devices_by_how_the_gyros_turn(tmp_path, late):
    folder, file = tmp_path / "c", tmp_path / "c" / "campaign.toml"
    speed, ideal = two_logs(folder, late)
    text = draft_campaign(
        folder / "device.csv", folder, latitude=48.2, table=folder / "table.csv"
    ).text
    found = float(re.search(r"\ndelay = (.*)\n", text)[1])
    # 1e-3 rad/s over some 1500 rows in which the speed changes by 1 rad/s² tells 3e-5 s; corners between rows 0.1 s
    # apart are cut, alike on both sides.
    assert abs(found - late) < 1e-3
    file.write_text(text)
    (recording,) = load_campaign(folder).recordings
    still = scipy.ndimage.binary_erosion(speed == 0.0, iterations=10)  # a row of the table is 0.1 s
    direction = (
        recording.reference_accel / np.linalg.norm(recording.reference_accel, axis=1)[:, None]
    )
    assert np.abs(direction - ideal.force / G)[still].max() < 1e-5  # digits of 0.0001°
    assert np.abs(recording.reference_gyro - ideal.rate)[still].max() < 1e-9
    delays = lambda: [
        f for f in check_campaign(load_campaign(folder)).findings if f.kind == "delay"
    ]
    assert not delays()
    file.write_text(text.replace(f"delay = {found!r}", f"delay = {found - 0.12!r}"))
    (said,) = delays()
    assert abs(float(said.remedy.removeprefix("[table]\ndelay = ")) - late) < 1e-3


def test_a_tables_clock_that_runs_faster_is_put_beside_the_devices_all_along(tmp_path):
    """300 ppm are 40 ms over this log, and 3.6° at its end: crystals of 27 ppm do as much in half an hour."""
    folder, file = tmp_path / "c", tmp_path / "c" / "campaign.toml"
    speed, ideal = two_logs(folder, 52.3, 300.0)
    text = draft_campaign(
        folder / "device.csv", folder, latitude=48.2, table=folder / "table.csv"
    ).text
    drift = float(re.search(r"\ndrift = (.*)\n", text)[1])
    # Each half's delay to 2e-4 s, as of the whole log above, and the halves 60 s apart.
    assert drift == pytest.approx(300.0, abs=10.0)
    flat = scipy.ndimage.binary_erosion(np.abs(np.gradient(speed)) < 1e-9, iterations=20)
    turning = flat & (speed > 0.5)

    def off():
        (recording,) = load_campaign(folder).recordings
        force = recording.reference_accel
        told = turning & force.any(axis=1)
        assert told.sum() > 100
        return np.abs(force - ideal.force)[told].max()

    file.write_text(text)
    # A millisecond at 90 °/s is 1.6 mrad of g.
    assert off() < 1e-3 * np.pi / 2.0 * G
    plain = text.replace(f"drift = {drift!r}", "drift = 0.0")
    file.write_text(plain)
    assert off() > 0.1
    # Who writes the file by hand is told both lines.
    (said,) = [f for f in check_campaign(load_campaign(folder)).findings if f.kind == "delay"]
    assert said.statement.startswith("device.csv: the table's angles get 0.0")
    assert "ppm faster than [table] says" in said.statement
    span = np.ptp(load_campaign(folder).recordings[0].time)
    assert dict(said.evidence)["seconds"] == pytest.approx(3e-4 * span, rel=0.04)
    _, late, fast = said.remedy.split("\n")
    assert float(fast.removeprefix("drift = ")) == pytest.approx(300.0, abs=10.0)
    mended = re.sub(r"\ndelay = .*", f"\n{late}", plain).replace("drift = 0.0", fast)
    file.write_text(mended)
    assert off() < 1e-3 * np.pi / 2.0 * G
    assert not [f for f in check_campaign(load_campaign(folder)).findings if f.kind == "delay"]


def test_a_drift_of_columns_beside_the_devices_is_refused(tmp_path):
    station(tmp_path / "c")
    (tmp_path / "c" / "campaign.toml").write_text(TOML.replace("[table]", "[table]\ndrift = 20.0"))
    with pytest.raises(ValueError, match=r"\[table\] drift is of a log of the table's own"):
        load_campaign(tmp_path / "c")


def test_of_a_commanded_and_a_measured_angle_the_measured_one_is_taken_from_rows_that_stand_twice(
    tmp_path,
):
    """The commanded one is 60 ms ahead, by 3.6° at this table's rate: the two were rivals, and rows that stand twice
    were no clock."""
    folder = tmp_path / "c"
    two_logs(folder, 0.137)
    own, rng = pl.read_csv(folder / "table.csv"), np.random.default_rng(4)
    time = own["elapsed_s"].to_numpy()
    turned = {k: np.unwrap(own[f"pos_{k}"].to_numpy(), period=360.0) for k in range(2)}
    told = {
        "Time": [
            f"2026-03-14 {8 + int(t) // 3600:02d}:{int(t) // 60 % 60:02d}:{t % 60:06.3f}"
            for t in time
        ]
    }
    for k, name in enumerate(("Outer", "Inner")):
        told[f"{name}Demand(deg)"] = np.round(np.interp(time + 0.06, time, turned[k]) % 360.0, 4)
        noisy = turned[k] + 2e-4 * rng.standard_normal(len(time))
        told[f"{name}Actual(deg)"] = np.round(noisy % 360.0, 4)
    twice = np.sort(np.r_[np.arange(len(time)), rng.permutation(len(time))[: len(time) // 4]])
    pl.DataFrame(told)[twice].write_csv(folder / "table.csv")
    text = draft_campaign(
        folder / "device.csv", folder, latitude=48.2, table=folder / "table.csv"
    ).text
    assert 'names = ["OuterActual(deg)", "InnerActual(deg)"]' in text
    found = float(re.search(r"\ndelay = (.*)\n", text)[1])
    start = np.datetime64("2026-03-14T08:00:00") - np.datetime64("1970-01-01T00:00:00")
    assert abs(found - 0.137 - start / np.timedelta64(1, "s")) < 2e-3  # a fiftieth of a row


def test_a_tables_own_log_without_a_clock_says_which_log_has_none(tmp_path):
    folder = tmp_path / "c"
    two_logs(folder, 0.0)
    device = folder / "device.csv"
    pl.read_csv(device).drop("time_s").write_csv(device)
    with pytest.raises(ValueError, match="device.csv has none that serve: nothing in the file"):
        draft_campaign(device, folder, latitude=48.2, table=folder / "table.csv")


def test_a_table_s_log_of_another_run_says_where_its_clock_was_put(tmp_path):
    folder = tmp_path / "c"
    two_logs(folder, 0.137)
    own = pl.read_csv(folder / "table.csv")
    turned = [pl.Series(f"pos_{k}", own[f"pos_{k}"].to_numpy()[::-1]) for k in range(2)]
    own.with_columns(turned).drop("rate_0", "rate_1").write_csv(folder / "table.csv")
    with pytest.raises(
        ValueError, match=r"clock was taken to be -?\d+\.\d s late, .* of one run\?"
    ):
        draft_campaign(folder / "device.csv", folder, latitude=48.2, table=folder / "table.csv")


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.05, 0.15])
def test_rows_that_repeat_the_one_before_tell_the_same_delay(tmp_path, share):
    """A logger that now and then asks the table before it has a new angle: the delay was 8 and 30 ms off."""
    folder = tmp_path / "c"
    two_logs(folder, 0.137)
    own = pl.read_csv(folder / "table.csv")
    stale = np.random.default_rng(3).random(len(own)) < share
    kept = np.maximum.accumulate(np.where(stale, 0, np.arange(len(own))))
    repeated = [own[f"pos_{k}"].gather(kept) for k in range(2)]
    own.with_columns(repeated).drop("rate_0", "rate_1").write_csv(folder / "table.csv")
    device = folder / "device.csv"
    text = draft_campaign(device, folder, latitude=48.2, table=folder / "table.csv").text
    found = float(re.search(r"\ndelay = (.*)\n", text)[1])
    assert abs(found - 0.137) < 2e-3  # a fiftieth of a row
    (folder / "campaign.toml").write_text(text)
    findings = check_campaign(load_campaign(folder)).findings
    assert not [f for f in findings if f.kind == "delay"]


@pytest.mark.slow
def test_two_days_with_clocks_that_begin_anew_have_a_delay_each(tmp_path):
    folder, lates = tmp_path / "c", (0.137, 4211.05)
    folder.mkdir()
    for day, late in zip("ab", lates):
        two_logs(tmp_path / day, late)
        for name in ("device", "table"):
            (tmp_path / day / f"{name}.csv").rename(folder / f"{name}_{day}.csv")
    one, other = (folder / f"device_{day}.csv" for day in "ab")
    tables = [folder / f"table_{day}.csv" for day in "ab"]
    text = draft_campaign(one, folder, latitude=48.2, others=[other], table=tables).text
    found = json.loads(re.search(r"\ndelay = (.*)\n", text)[1])
    np.testing.assert_allclose(found, lates, atol=1e-3)
    file = folder / "campaign.toml"
    delays = lambda: [
        f for f in check_campaign(load_campaign(folder)).findings if f.kind == "delay"
    ]
    file.write_text(text)
    assert not delays()
    # Of one log the table is 0.12 s early: the line that mends it leaves the other's delay alone.
    file.write_text(text.replace(f"{found}", f"{[found[0], found[1] - 0.12]}"))
    (said,) = delays()
    assert said.statement.startswith("device_b.csv")
    right = json.loads(said.remedy.removeprefix("[table]\ndelay = "))
    np.testing.assert_allclose(right, lates, atol=1e-3)


def test_axes_that_stand_alike_at_most_rests_are_two_and_a_whole_turn_apart_is_one():
    outer = np.array([0.0, 0.0, 0.0, 0.0, 90.0, 180.0]).repeat(10)
    inner = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 90.0]).repeat(10)
    noise = 1e-4 * np.random.default_rng(2).standard_normal(60)
    columns = {"a set": outer, "b": inner, "a": (outer + noise) % 360.0}
    start = np.arange(6) * 10
    kept, twins = without_twins(list(columns), columns, start, start + 10)
    assert kept == ["b", "a"]
    assert twins == {"a": ["a set"], "b": []}
    # Without a word of it the measured one is the one with an encoder's noise.
    columns = {"pos1": outer, "pos2": columns["a"]}
    assert without_twins(list(columns), columns, start, start + 10)[0] == ["pos2"]
