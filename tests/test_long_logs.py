"""A long log in parts on the disk gives what the whole one gives."""

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from inertiax.allan import deviations, logs_of, noise_of
from inertiax.allan.logs import _channel
from inertiax.allan.stored_channel import is_constant, StoredChannel
from inertiax.calibrate.pipeline import calibrate
from inertiax.data.campaign import load_campaign
from inertiax.data.formats import read_recordings
from inertiax.data.formats.columns import AngleColumns, ColumnMap, Layout, RateColumns
from inertiax.data.formats.long_logs import read_long
from inertiax.data.formats.turntable import Turntable
from inertiax.data.stored_recording import ColumnStore, log_numbers, StoredRecording
from inertiax.plausibility import check_campaign
from inertiax.reduction.device_segments import segment_all
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.rotations_between_rests import with_motions
from inertiax.reduction.segments import segment


RATE = 50.0  # Hz
GRAVITY = 9.81
PART = 2600  # rows
REST, TURN = 500, 100  # rows
POSES = 20


def log(*, labelled: bool = False, still: bool = False) -> pl.DataFrame:
    """Rests joined by turns of about 80 degrees, both triads, white noise."""
    rng = np.random.default_rng(11)
    axes = rng.normal(size=(POSES, 3))
    force, rate, position = [], [], []
    up = np.array([0.0, 0.0, 1.0])
    for pose, axis in enumerate(axes / np.linalg.norm(axes, axis=1, keepdims=True)):
        force.append(np.broadcast_to(up, (REST, 3)))
        rate.append(np.zeros((REST, 3)))
        position += [pose] * REST + [-1] * TURN
        angle = 0.0 if still else 1.4
        share = np.arange(1, TURN + 1) / TURN
        swept = angle * (share - np.sin(2 * np.pi * share) / (2 * np.pi))[:, None]
        across = np.cross(axis, up)
        along = axis * (axis @ up)
        turned = along + (up - along) * np.cos(swept) - across * np.sin(swept)
        force.append(turned)
        speed = angle * (1.0 - np.cos(2 * np.pi * share)) * RATE / TURN
        rate.append(axis * speed[:, None])
        up = turned[-1]
    accel = GRAVITY * np.concatenate(force)
    accel = accel + 0.05 + 0.01 * rng.standard_normal(accel.shape)
    gyro = np.concatenate(rate)
    gyro = gyro + 0.002 + 1e-3 * rng.standard_normal(gyro.shape)
    columns = {"time": np.arange(len(accel)) / RATE}
    columns |= {f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}
    columns |= {f"gyro_{a}": gyro[:, k] for k, a in enumerate("xyz")}
    columns["temperature"] = np.full(len(accel), 25.0) + 0.01 * rng.standard_normal(len(accel))
    block = np.arange(len(accel)) // (REST + TURN)
    turning = np.maximum(np.arange(len(accel)) % (REST + TURN) - REST + 1, 0)
    columns["outer"] = (
        5.0 * block + 0.05 * turning
    )  # a table's axis, deg; what it carries does not matter here
    columns["outer_rate"] = np.where(turning > 0, 0.05 * RATE, 0.0)
    return pl.DataFrame(columns | ({"position": position} if labelled else {}))


def in_parts(path, *columns_and_layout, **how):
    return read_long(path, *columns_and_layout, part=PART, rows=700, size=40_000, **how)


@pytest.fixture(params=["a.parquet", "a.csv"])
def file(tmp_path, request):
    path = tmp_path / request.param
    (pl.DataFrame.write_csv if path.suffix == ".csv" else pl.DataFrame.write_parquet)(log(), path)
    return path


TABLE = Layout(gravity=GRAVITY, latitude=0.8, turntable=Turntable(axes=("east",), azimuth=0.0))
ANGLES = ColumnMap(
    table_angles=AngleColumns(names=("outer",)), table_rates=RateColumns(names=("outer_rate",))
)


def test_parts_are_the_whole_cut_at_rests(file):
    (whole,) = read_recordings(file, ANGLES, TABLE)
    parts = in_parts(file, columns=ANGLES, layout=TABLE)
    assert len(parts) == 5 and all(isinstance(p, StoredRecording) for p in parts)
    assert parts[1].name == f"{file.name} (part 2 of 5)"
    for column in (
        "time", "accel", "gyro", "temperature", "reference_accel", "reference_gyro",
    ):  # fmt: skip
        joined = np.concatenate([getattr(p, column) for p in parts])
        np.testing.assert_array_equal(joined, getattr(whole, column))
    assert parts[0].position is None and sum(p.num_samples for p in parts) == whole.num_samples
    row = np.cumsum([p.num_samples for p in parts])[:-1]
    assert np.all(row % (REST + TURN) < REST)  # no turn is torn


@pytest.mark.parametrize("labelled", [False, True])
def test_dwells_and_motions_of_parts_are_those_of_the_whole(tmp_path, labelled):
    log(labelled=labelled).write_parquet(tmp_path / "a.parquet")
    found = [read_recordings(tmp_path / "a.parquet"), in_parts(tmp_path / "a.parquet")]
    whole, parts = (reduce_to_dwells(r) for r in found)
    # Each of the four cuts makes two dwells of one rest; all are of one run.
    assert whole.num_dwells == POSES and parts.num_dwells == POSES + 4
    assert set(parts.experiment) == {0}
    first = np.cumsum([r.num_samples for r in found[1]]) - [r.num_samples for r in found[1]]
    start = first[parts.rows[:, 0]] + parts.rows[:, 1]
    owner = np.searchsorted(np.asarray(whole.rows)[:, 1], start + REST // 4, side="right") - 1
    for triad in ("accel", "gyro"):
        sigma = np.sqrt(np.diagonal(getattr(parts, f"{triad}_covariance"), axis1=1, axis2=2))
        off = (getattr(parts, triad) - getattr(whole, triad)[owner]) / sigma
        # A dwell that was cut shares half of its samples with the whole: it differs by a sigma or two.
        assert np.abs(off).max() < 4.0 and np.median(np.abs(off)) < 0.3
    turns = [with_motions(r, d) for r, d in zip(found, (whole, parts), strict=True)]
    assert [t.num_motions for t in turns] == [POSES - 1] * 2


def test_a_part_without_any_rest_has_none(tmp_path):
    """By itself it would be taken for one rest: nothing in it is quieter than the rest of it."""
    rows = 7 * PART
    rng = np.random.default_rng(2)
    shaken = (np.arange(rows) > 2 * PART) & (np.arange(rows) < 5 * PART)
    noise = np.where(shaken, 30.0, 1.0)[:, None] * rng.standard_normal((rows, 6))
    columns = {"time": np.arange(rows) / RATE}
    columns |= {f"accel_{a}": 0.01 * noise[:, k] + 5.66 for k, a in enumerate("xyz")}
    columns |= {f"gyro_{a}": 1e-3 * noise[:, 3 + k] for k, a in enumerate("xyz")}
    pl.DataFrame(columns).write_parquet(tmp_path / "a.parquet")
    parts = in_parts(tmp_path / "a.parquet")
    rows_of = lambda p: RATE * p.time[[0, -1]]
    inside = [p for p in parts if rows_of(p)[0] > 2 * PART and rows_of(p)[1] < 5 * PART]
    assert inside
    for part in inside:
        assert not segment(part).used.any()
        assert segment(part[:]).used.mean() > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("on_the_disk", [False, True])
def test_noise_of_parts_is_that_of_the_whole(tmp_path, monkeypatch, on_the_disk):
    monkeypatch.setattr("inertiax.allan.rest_channels.LONG", 100 if on_the_disk else 1 << 30)
    log(still=True).write_parquet(tmp_path / "a.parquet")
    (whole,) = read_recordings(tmp_path / "a.parquet")
    parts = in_parts(tmp_path / "a.parquet")
    assert logs_of(parts) == [parts]
    one, other = noise_of(whole), noise_of(parts)
    assert one.duration == other.duration and one.recording == other.recording == "a.parquet"
    assert one.notes == other.notes
    for a, b in zip(one.channels, other.channels, strict=True):
        np.testing.assert_array_equal(a.curve.deviation, b.curve.deviation)
        assert a.model.terms == b.model.terms and a.model.statement == b.model.statement


def test_a_stored_channel_slices_as_an_array_and_tells_the_same_noise():
    """Of more than 2¹⁹ samples, from which on spectra and deviations are found piece by piece."""
    rng = np.random.default_rng(5)
    samples = 600_011
    log = rng.standard_normal(samples) + 0.01 * np.cumsum(rng.standard_normal(samples))
    stored = StoredChannel(np.array_split(log, 7))
    for rows in (slice(None), slice(5), slice(10, 20), slice(samples - 3, samples + 9)):
        np.testing.assert_array_equal(stored[rows], log[rows])
    one, other = (_channel("gyro_x", "gyro", channel, 100.0) for channel in (log, stored))
    assert one.model.terms == other.model.terms
    np.testing.assert_array_equal(one.curve.deviation, other.curve.deviation)
    whole = deviations(log, rate=100.0, factors=one.curve.factor[one.curve.factor < 256])
    # The same sums in another order: a part in 10¹⁶ for each of 10⁵ rows at the most.
    np.testing.assert_allclose(one.curve.deviation[: len(whole.tau)], whole.deviation, rtol=1e-11)
    assert not is_constant(stored) and is_constant(StoredChannel([np.ones(9)]))


def test_what_is_odd_in_many_parts_is_told_once(tmp_path):
    table = log().with_columns(temperature=pl.lit(25.0))
    table.write_parquet(tmp_path / "a.parquet")
    (tmp_path / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["a.parquet"]\n'
    )
    campaign = load_campaign(tmp_path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("inertiax.data.campaign.read_long", in_parts)
        cut = load_campaign(tmp_path, in_parts=True)
    assert len(cut.recordings) == 5
    assert list(log_numbers(cut.recordings)) == [0] * 5
    said = [f for f in check_campaign(cut).findings if f.what == "temperature"]
    assert [f.kind for f in said] == [
        f.kind for f in check_campaign(campaign).findings if f.what == "temperature"
    ]
    assert said[0].statement.endswith("(Alike in 4 further parts.)")


@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.with_columns(
            time=pl.when(pl.int_range(pl.len()) >= 7000).then(0.1).otherwise("time")
        ),
        lambda t: t.with_columns(
            gyro_x=pl.when(pl.int_range(pl.len()) == 7000).then(None).otherwise("gyro_x")
        ),
        lambda t: t.drop("gyro_z"),
    ],
)
def test_bad_input_is_told_as_for_the_whole(tmp_path, change):
    change(log()).write_parquet(tmp_path / "a.parquet")
    with pytest.raises(ValueError) as whole:
        read_recordings(tmp_path / "a.parquet")
    with pytest.raises(ValueError) as parts:
        in_parts(tmp_path / "a.parquet")
    assert str(parts.value) == str(whole.value)


def test_rows_that_are_counted_go_on_from_part_to_part(tmp_path):
    log().drop("time").write_parquet(tmp_path / "a.parquet")
    from inertiax.data.formats import ColumnMap
    from inertiax.data.formats.columns import TimeColumn

    parts = in_parts(tmp_path / "a.parquet", columns=ColumnMap(time=TimeColumn(rate=RATE)))
    time = np.concatenate([p.time for p in parts])
    np.testing.assert_array_equal(time, np.arange(POSES * (REST + TURN)) / RATE)


def test_a_part_keeps_no_column(file):
    first = in_parts(file)[0]
    held = first.store.read("accel", first.first, first.stop)
    assert first.accel is held  # as the store has it, until that lets it go
    assert not any(isinstance(v, np.ndarray) and v.size > 1 for v in vars(first).values())


def test_a_store_holds_so_many_bytes_and_refuses_other_columns(monkeypatch):
    monkeypatch.setattr("inertiax.data.stored_recording._HELD", 20_000)
    (whole,) = _recordings(300)
    store = ColumnStore()
    for a in (0, 100, 200):
        store.append(whole[a : a + 100])
    for first in range(20):
        np.testing.assert_array_equal(store.read("accel", first, 300), whole.accel[first:])
    # 300, 299 and 298 rows of 24 bytes are more than that.
    assert [first for _, first, _ in store._held] == [0, 1]
    assert store.read("accel", 0, 300) is store.read("accel", 0, 300)
    assert store.read("accel", 9, 300) is not store.read("accel", 9, 300)
    assert store.read("supply", 0, 10) is None and store.columns == ("time", "accel")
    with pytest.raises(ValueError, match="different columns"):
        store.append(_recordings(300, gyro=True)[0])


def _recordings(rows: int, gyro: bool = False):
    from inertiax.data.recording import Recording

    values = np.random.default_rng(0).standard_normal((rows, 3))
    return (Recording(np.arange(rows) / RATE, accel=values, gyro=values if gyro else None),)


@pytest.mark.slow
@pytest.mark.parametrize("in_parts_of", [None, 90_000])
def test_turns_that_are_a_thousandth_of_a_long_log_part_its_rests(tmp_path, in_parts_of):
    # Twelve rests of a quarter of an hour, and turns of half a second between them.
    rate, rest, turn, poses = 20.0, 18_000, 10, 12
    rng = np.random.default_rng(12)
    up = rng.normal(size=(poses, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    pose = np.repeat(np.arange(poses), rest)
    accel = GRAVITY * up[pose] + 0.01 * rng.standard_normal((len(pose), 3))
    turning = (np.arange(len(pose)) % rest < turn) & (pose > 0)
    accel[turning] += 2.0 * rng.standard_normal((turning.sum(), 3))
    gyro = 0.002 + 1e-3 * rng.standard_normal(accel.shape)
    gyro[turning] += 1.0
    assert turning.mean() < 1e-3
    columns = {"time": np.arange(len(accel)) / rate}
    columns |= {f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}
    columns |= {f"gyro_{a}": gyro[:, k] for k, a in enumerate("xyz")}
    pl.DataFrame(columns).write_parquet(path := tmp_path / "a.parquet")
    parts = read_long(path) if in_parts_of is None else read_long(path, part=in_parts_of)
    assert len(parts) == (1 if in_parts_of is None else 3)
    found = reduce_to_dwells(parts, segments=segment_all(parts))
    # Standard error of a mean of 18 000 samples is 7.5e-5 m/s²; rests cut at a part's end are two dwells.
    off = np.abs(np.asarray(found.accel)[:, None] - GRAVITY * up).max(axis=2).min(axis=1)
    assert len(off) in range(poses, poses + len(parts)) and off.max() < 1e-3


MATRIX = np.eye(3) + [[1e-3, -5e-4, 8e-4], [4e-4, -7e-4, 2e-4], [-3e-4, 6e-4, 5e-4]]


def turned_on_a_table(folder):
    """Both logs of a table whose clock is 0.12 s ahead, rows of 0.1 s: 16 attitudes, then whole turns both ways; a
    device some cm from the axes."""
    fs, ahead, arm = 50.0, 0.12, np.array([0.03, -0.02, 0.05])
    steps: list[tuple[int, float, float]] = []  # axis, deg, s; the table speeds up at 60 deg/s^2
    steps += [*[(0, 90.0, 2.5)] * 4, (1, 90.0, 2.5)] * 4
    for axis in (0, 1):
        for turns in (1.0, -1.0, 2.0, -2.0):
            steps.append((axis, 360.0 * turns, 2.5))
    pieces, at = [np.zeros((120, 2))], np.zeros(2)
    for axis, turn, rest in steps:
        most = min(abs(turn) / 3.0, 110.0) if abs(turn) > 100 else 45.0
        ramp = most / 60.0
        lasts = abs(turn) / most + ramp
        t = np.arange(1, int(np.ceil(lasts * fs)) + 1) / fs
        rate = np.clip(np.minimum(60.0 * t, 60.0 * (lasts - t)), 0.0, most)
        share = np.cumsum(rate) / np.sum(rate)
        moved = at + turn * share[:, None] * np.eye(2)[axis]
        at = moved[-1]
        pieces += [moved, np.tile(at, (int(rest * fs), 1))]
    angles = np.radians(np.concatenate(pieces))
    time = 7.0 + np.arange(len(angles)) / fs
    turn = Rotation.from_euler("X", angles[:, :1]) * Rotation.from_euler("z", angles[:, 1:])
    # Places and axes in the room, differentiated numerically: no formula of the package's.
    place = turn.apply(arm)
    acceleration = np.gradient(np.gradient(place, 1 / fs, axis=0), 1 / fs, axis=0)
    force = turn.inv().apply(acceleration + [0.0, 0.0, GRAVITY])
    rate = np.gradient(angles, 1 / fs, axis=0)
    omega = turn.inv().apply(rate[:, :1] * [1.0, 0.0, 0.0]) + rate[:, 1:] * [0.0, 0.0, 1.0]
    rng = np.random.default_rng(8)
    accel = force @ MATRIX.T + [0.05, -0.03, 0.02] + 5e-3 * rng.standard_normal(force.shape)
    gyro = omega @ MATRIX.T + [1e-3, -2e-3, 5e-4] + 3e-4 * rng.standard_normal(force.shape)
    columns = {"time": time} | {f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}
    columns |= {f"gyro_{a}": gyro[:, k] for k, a in enumerate("xyz")}
    pl.DataFrame(columns).write_parquet(folder / "device.parquet")
    own = slice(None, None, 5)
    table = {"time": time[own] + ahead, "outer": np.degrees(angles[own, 0]) % 360.0}
    table |= {"inner": np.degrees(angles[own, 1]) % 360.0}
    table |= {f"rate_{k}": np.degrees(rate[own, k]) for k in range(2)}
    pl.DataFrame(table).write_csv(folder / "table.csv")
    (folder / "campaign.toml").write_text(
        f"""[site]
gravity = {GRAVITY}
[recordings]
files = ["device.parquet"]
table_files = ["table.csv"]
[columns]
table_angles = {{ names = ["outer", "inner"], unit = "deg" }}
table_rates = {{ names = ["rate_0", "rate_1"], unit = "deg/s" }}
[table]
axes = ["east", "up"]
delay = {ahead}
[model]
lever_arms = true
temperature_degree = 0
"""
    )
    return arm


@pytest.mark.slow
def test_parts_of_a_table_s_log_with_a_clock_of_its_own_give_what_the_whole_gives(tmp_path):
    """The first row of a move is no knock at the end of a rest, in the whole as in its parts."""
    arm = turned_on_a_table(tmp_path)
    whole = load_campaign(tmp_path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("inertiax.data.campaign.read_long", in_parts)
        parts = load_campaign(tmp_path, in_parts=True)
    assert [len(c.recordings) for c in (whole, parts)] == [1, 4]
    found = [segment_all(c.recordings) for c in (whole, parts)]
    assert not any(s.disturbances for segments in found for s in segments)
    used = [np.concatenate([s.used for s in segments]) for segments in found]
    np.testing.assert_array_equal(*used)
    fits = [calibrate(c)[0] for c in (whole, parts)]
    one, other = (f.calibration for f in fits)
    sigma = np.sqrt(np.diagonal(one.covariance))
    # Each of three cuts makes two dwells of one.
    assert np.abs((other.coefficients - one.coefficients) / sigma).max() < 0.5
    for made in (one, other):
        for effect in made.effects:
            (k,) = effect.channels
            # Plateaus about two axes show each arm along its own axis; the truth in four sigma.
            assert abs(effect.coefficients[k] - arm[k]) < 4.0 * np.sqrt(effect.covariance[k, k])
