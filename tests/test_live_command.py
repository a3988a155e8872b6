"""`inertiax live`: the contract's events, what is recorded, and what a log in the making does to it."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from command_runs import run as run_command
from inertiax.calibrate.pipeline import calibrate
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Recording
from inertiax.live.follow import events, plan
from inertiax.live.recorder import Recorder
from inertiax.live.session import Session
from inertiax.plausibility.finding import Finding, Plausibility
from inertiax.reduction.device_segments import segment_all
from inertiax.reduction.rests import find_rests


GRAVITY = 9.81
BIAS = np.array([0.08, -0.12, 0.2])
MATRIX = np.eye(3) + np.array([[0.01, 0, 0], [0.004, -0.008, 0], [-0.003, 0.005, 0.012]])
HEADER = "time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z"
CAMPAIGN = '[site]\ngravity = 9.81\n\n[recordings]\nfiles = ["log.csv"]\n'


def turn_to(before, after):
    """Rotation vector that takes one direction of gravity in the case to another (the case turns against it)."""
    axis = np.cross(after, before)
    size = np.linalg.norm(axis)
    axis = np.cross(before, [0.3, 0.5, 0.8]) if size < 1e-9 else axis
    return axis / np.linalg.norm(axis) * np.arctan2(size, before @ after)


class Person:
    """Someone who lays a device down and turns it, by NumPy alone: 100 rows a second."""

    def __init__(self, seed, noise=0.01):
        self.rng, self.noise = np.random.default_rng(seed), noise
        self.up, self.time = np.array([0.0, 0.0, 1.0]), 0.0

    def _rows(self, up, rate):
        count = len(up)
        accel = GRAVITY * up @ MATRIX.T + BIAS + self.noise * self.rng.standard_normal((count, 3))
        gyro = rate + [0.01, -0.02, 0.005] + 1e-3 * self.rng.standard_normal((count, 3))
        stamps = self.time + 0.01 * np.arange(count)
        self.time += 0.01 * count
        return np.column_stack([stamps, accel, gyro])

    def rest(self, seconds, tap=None):
        rows = self._rows(np.tile(self.up, (round(seconds * 100), 1)), np.zeros(3))
        if tap is not None:
            k = round(tap * 100)
            ring = np.exp(-np.arange(30) / 4.0) * np.cos(np.arange(30))
            rows[k : k + 30, 1:4] += 0.15 * ring[:, None]
            rows[k : k + 30, 4:7] += 0.015 * ring[:, None]
        return rows

    def turn(self, up, seconds=1.5):
        up = np.asarray(up, float) / np.linalg.norm(up)
        vector, count = turn_to(self.up, up), round(seconds * 100)
        share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count + 1) / count)
        axis, angle = vector / np.linalg.norm(vector), np.linalg.norm(vector)
        a = (-angle * share)[:, None]  # the direction turns against the case
        u = self.up
        ups = u * np.cos(a) + np.cross(axis, u) * np.sin(a) + axis * (axis @ u) * (1 - np.cos(a))
        rate = np.gradient(angle * share, 0.01)[:, None] * axis
        self.up = up
        return self._rows(ups, rate)


def text(rows):
    return "".join(",".join(f"{x:.6f}" for x in row) + "\n" for row in rows)


POSES = [
    (0, 0, -1),
    (0, 1, 0),
    (0, -1, 0),
    (1, 0, 0),
    (-1, 0, 0),
    (1, 1, 0),
    (1, 0, 1),
    (0, 1, 1),
    (-1, 1, 0),
    (-1, 0, 1),
    (0, -1, 1),
]


def session_rows(seed, poses=POSES, noise=0.01, taps=()):
    person = Person(seed, noise)
    rows = [person.rest(5.0)]
    for k, up in enumerate(poses):
        rows += [person.turn(up), person.rest(5.0, tap=2.5 if k in taps else None)]
    return np.concatenate(rows)


def campaign(tmp_path, body=CAMPAIGN):
    folder = tmp_path / "campaign"
    folder.mkdir(exist_ok=True)
    (folder / "campaign.toml").write_text(body)
    return folder


def followed(tmp_path, content, *, target="accel.bias=1 ug", body=CAMPAIGN):
    """Events of a log that is there already, and the folder of what was recorded."""
    folder = campaign(tmp_path, body)
    (folder / "log.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    made = plan(folder, None, piped=False, target=target)
    recorder = Recorder(tmp_path / "out", made.campaign.path)
    found = list(events(made, recorder, idle=0.1))
    recorder.close()
    return found, tmp_path / "out"


def of(found, kind):
    return [e for e in found if e["event"] == kind]


def accepted(found):
    last = {e["number"]: e["accepted"] for e in of(found, "rest")}
    return sum(last.values())


@pytest.mark.slow
def test_events_are_those_of_the_contract(tmp_path):
    found, folder = followed(tmp_path, f"{HEADER}\n" + text(session_rows(1)))
    assert found[0]["event"] == "start" and found[-1]["event"] == "done"
    rests = of(found, "rest")
    assert [e["number"] for e in rests] == list(range(1, 13))
    for rest, up in zip(rests, [(0, 0, 1), *POSES]):
        assert rest["accepted"] and rest["why"] is None
        assert 3.0 < rest["end"] - rest["start"] < 5.2
        expected = GRAVITY * MATRIX @ np.array(up) / np.linalg.norm(up) + BIAS
        np.testing.assert_allclose(rest["mean_accel"], expected, atol=0.01 / 17 * 5)
    for event in of(found, "next"):
        np.testing.assert_allclose(np.linalg.norm(event["up"]), 1.0, atol=1e-5)
        assert event["statement"].startswith("turn the device so that ")
        assert 0.0 <= event["gain"] <= 1.0 and event["temperature"] is None is event["rate"]
    last = of(found, "progress")[-1]
    assert last["ratio"] > 1.0 and last["worst"].startswith("accel.bias")
    assert set(last["parameters"]["accel.bias[0]"]) >= {"value", "std", "unit", "limit"}
    assert (
        last["parameters"]["accel.matrix[2,0]"]["label"] == "misalignment zx of the accelerometers"
    )
    for axis in range(3):
        one = last["parameters"][f"accel.bias[{axis}]"]
        assert abs(one["value"] - BIAS[axis]) < 4 * one["std"] and one["unit"] == "m/s^2"
    assert found[-1]["reason"] == "input ended" and found[-1]["rests"] == 12
    (batch,) = segment_all(load_campaign(folder).recordings)
    assert batch.num_segments == 12


def in_pieces(folder, rows, size):
    """Events of a session that is fed `size` rows at a time."""
    made = plan(folder, None, piped=True, target="accel.bias=1 ug")
    session = Session(made.campaign, made.target)
    lines = [HEADER.encode(), *text(rows).encode().split()]
    for k in range(0, len(lines), size):
        chunk = made.rows.read(lines[k : k + size], last=k + size >= len(lines))
        made.rows.take_header()
        if chunk is not None:
            yield from session.feed(chunk.rows, chunk.time)
    yield from session.end()


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [5.0, 20.0])
def test_a_device_that_moves_in_the_first_rows_has_the_rests_of_the_batch(tmp_path, seconds):
    person = Person(5)
    rows = [person.turn((0, 0, -1), 2.0), person.rest(seconds)]
    for up in POSES[1:4]:
        rows += [person.turn(up), person.rest(seconds)]
    rows = np.concatenate(rows)
    folder = campaign(tmp_path)
    one, other = (of(in_pieces(folder, rows, size), "rest") for size in (30, 500))
    assert one == other  # how fast rows come changes nothing
    batch = find_rests(Recording(rows[:, 0], accel=rows[:, 1:4], gyro=rows[:, 4:]), window=1.0)
    assert len(one) == len(batch.start) == 4 and all(e["accepted"] for e in one)
    for event, first, last in zip(one, batch.start, batch.stop):
        assert abs(event["start"] - rows[first, 0]) < 0.3  # a rest was said before later ones came
        assert abs(event["end"] - rows[last - 1, 0]) < 0.3
        assert event["end"] - event["start"] > seconds - 1.3


@pytest.mark.slow
def test_a_target_that_is_reached_ends_the_session_with_what_it_says_true(tmp_path):
    poses = [p for k in range(4) for p in POSES + [(0, 0, 1)]]
    rows = session_rows(2, poses, noise=0.003)
    found, folder = followed(
        tmp_path, f"{HEADER}\n" + text(rows), target="accel.bias=1 mg, accel.scale=500 ppm"
    )
    assert found[-1]["reason"] == "target reached" and found[-1]["rests"] < 30
    last = of(found, "progress")[-1]
    assert last["ratio"] <= 1.0
    for axis in range(3):
        one = last["parameters"][f"accel.bias[{axis}]"]
        assert abs(one["value"] - BIAS[axis]) < 1e-3 * 9.80665
        scale = last["parameters"][f"accel.matrix[{axis},{axis}]"]
        assert abs(scale["value"] - (MATRIX[axis, axis] - 1)) < 5e-4
    recorded = load_campaign(folder).recordings[0]
    assert recorded.num_samples < len(rows)


@pytest.mark.slow
def test_turns_tell_the_scale_factors_of_the_gyros(tmp_path):
    poses = [p for k in range(3) for p in POSES + [(0, 0, 1)]]
    rows = session_rows(21, poses, noise=0.003)
    scale = np.array([1.02, 0.985, 1.01])
    rows[:, 4:7] = (rows[:, 4:7] - [0.01, -0.02, 0.005]) * scale + [0.01, -0.02, 0.005]
    found, _ = followed(tmp_path, f"{HEADER}\n" + text(rows), target="gyro.scale=3000 ppm")
    assert found[-1]["reason"] == "target reached" and found[-1]["rests"] < len(poses)
    last = of(found, "progress")[-1]["parameters"]
    for axis in range(3):
        one = last[f"gyro.matrix[{axis},{axis}]"]
        assert abs(one["value"] - (scale[axis] - 1.0)) < 3e-3 and 0.0 < one["std"] < 1.5e-3


def test_a_target_that_the_columns_cannot_tell_is_one_line(tmp_path):
    rows = session_rows(22, POSES[:2])
    with pytest.raises(ValueError, match=r"target accel.matrix\[0,1\]: `live` does not tell it"):
        followed(tmp_path, f"{HEADER}\n" + text(rows), target="accel.matrix[0,1]=1 mrad")


def held_rows(seed, held=(4,), tapped=None):
    """Rests of 6 s, of which a hand holds some: four short turns by half a degree, as the gyros see them."""
    person = Person(seed)
    rows = [person.rest(5.0)]
    for k, up in enumerate(POSES):
        rows += [person.turn(up), person.rest(6.0, tap=2.5 if k == tapped else None)]
        for begin in (0.0, 1.7, 3.4, 5.0) if k in held else ():
            share = (np.arange(len(rows[-1])) * 0.01 - begin) / 0.5
            inside = (share > 0) & (share < 1)
            turn = np.where(inside, 0.03 * np.sin(np.pi * share) ** 2, 0.0)
            rows[-1][:, 4:7] += turn[:, None] * np.array([0.6, -0.5, 0.4])
    return np.concatenate(rows)


@pytest.mark.slow
def test_a_tap_is_left_out_and_a_rest_that_was_held_counts_for_the_force(tmp_path):
    found, _ = followed(tmp_path, f"{HEADER}\n" + text(held_rows(3, tapped=7)))
    rests = {e["number"]: e for e in of(found, "rest")}
    assert [e["number"] for e in rests.values() if e["held"]] == [6]
    assert all(e["accepted"] for e in rests.values())
    tapped = [e for e in rests.values() for d in e["left_out"] if d["kind"] == "knock"]
    assert [e["number"] for e in tapped] == [9] and tapped[0]["accepted"]


def test_a_held_rest_counts_for_no_gyro(tmp_path):
    columns = [0, 4, 5, 6]
    names = ",".join(HEADER.split(",")[k] for k in columns)
    rows = held_rows(3, tapped=7)[:, columns]
    found, _ = followed(tmp_path, f"{names}\n" + text(rows), target="gyro.bias=1 deg/h")
    assert not any(e["held"] for e in of(found, "rest"))


def swaying_rows(seed):
    """Rests that all sway by a degree or two: a hand turns gravity across itself, and leaves its length."""
    person, rng = Person(seed), np.random.default_rng(seed + 1)
    rows = []
    for up in [(0, 0.1, 1), *POSES, (1, 1, 1), (-1, 1, -1), (1, -1, -1)]:
        rows.append(person.turn(up))
        up, count = person.up, 500
        tilt = np.zeros((count, 3))
        for k in range(1, count):
            tilt[k] = 0.98 * tilt[k - 1] + 0.003 * rng.standard_normal(3)
        ups = up + np.cross(tilt, up)
        ups /= np.linalg.norm(ups, axis=1, keepdims=True)
        rows.append(person._rows(ups, -np.gradient(tilt, 0.01, axis=0)))
    return np.concatenate(rows)


@pytest.mark.slow
@pytest.mark.parametrize("made", [lambda: held_rows(3, (2, 4)), lambda: swaying_rows(2)])
def test_rests_in_a_hand_tell_as_much_as_calibrate_finds_in_them(tmp_path, made):
    found, folder = followed(tmp_path, f"{HEADER}\n" + text(made()))
    (batch,) = calibrate(load_campaign(folder))
    mine = of(found, "progress")[-1]["parameters"]
    calibration = batch.calibration
    stds = np.sqrt(np.diag(calibration.covariance))
    names = [n for n in calibration.coefficient_names if n.startswith("accel")]
    assert len(names) == 9
    for k, name in enumerate(calibration.coefficient_names):
        if name in names:
            here = mine[name]
            # The same rests, of which batch means take blocks: a third of a sigma, and a spread within a factor of 2.5.
            assert abs(here["value"] - calibration.coefficients[k]) < 0.34 * stds[k], name
            assert 0.4 < here["std"] / stds[k] < 2.5, name


@pytest.mark.slow
def test_a_wrong_unit_is_a_problem_before_any_rest_is_trusted(tmp_path):
    rows = session_rows(4, POSES[:4])
    rows[:, 1:4] /= 9.80665  # g
    found, _ = followed(tmp_path, f"{HEADER}\n" + text(rows))
    problems = of(found, "problem")
    assert problems[0]["kind"] == "accel_unit" and problems[0]["severity"] == "error"
    assert "accel" in problems[0]["remedy"]
    first_rest = next(k for k, e in enumerate(found) if e["event"] == "rest")
    assert found.index(problems[0]) <= first_rest + 3


@pytest.mark.slow
@pytest.mark.parametrize("looks", [1, 2], ids=["at the end", "before"])
def test_an_error_that_a_later_look_does_not_find_is_withdrawn(tmp_path, monkeypatch, looks):
    """The plausibility finds an error at its first `looks` looks only; the last look is that at the end."""
    wrong = Finding("accel_unit", "error", "accel", "recording-1: 1 g reads 0.4")
    left = [1] * looks

    def check(campaign):
        found = (wrong,) if left else ()
        left[:1] = []
        return Plausibility(found)

    monkeypatch.setattr("inertiax.live.session.check_campaign", check)
    found, _ = followed(tmp_path, f"{HEADER}\n" + text(session_rows(4, POSES[:2])))
    told, back = of(found, "problem")
    assert told["severity"] == "error" and told["statement"] == wrong.statement
    assert back["severity"] == "note" and back["withdraws"] == wrong.statement
    assert found[-1]["event"] == "done" and not left


def test_half_a_line_and_lines_that_are_no_rows_stop_nothing_and_are_kept(tmp_path):
    lines = text(session_rows(5, POSES[:3])).splitlines(keepends=True)
    lines[500] = "#### serial line reset ####\n"
    lines[900] = lines[900][:20] + "\n"
    lines[1000] = "1,2,nonsense,4,5,6,7\n"
    found, folder = followed(tmp_path, f"{HEADER}\n" + "".join(lines) + lines[-1][:25])
    assert [e["kind"] for e in of(found, "problem")].count("garbled") == 1
    assert found[-1]["rests"] == 4
    aside = (folder / "left-out.txt").read_text().splitlines()
    assert aside == [lines[k].rstrip("\n") for k in (500, 900, 1000)] + [lines[-1][:25]]
    recorded = (folder / "recording-1.csv").read_text()
    assert recorded == f"{HEADER}\n" + "".join(
        x for k, x in enumerate(lines) if k not in (500, 900, 1000)
    )


@pytest.mark.slow
def test_a_clock_that_jumps_is_told_and_survived(tmp_path):
    rows = session_rows(6)
    half = len(rows) // 2
    rows[half:, 0] -= 3600.0
    rows[half + 50, 0] = rows[half + 49, 0]  # and a stamp that stands twice
    found, folder = followed(tmp_path, f"{HEADER}\n" + text(rows))
    clock = [e for e in of(found, "problem") if e["kind"] == "clock"]
    assert "went back" in clock[0]["statement"] and any("twice" in e["statement"] for e in clock)
    recordings = load_campaign(folder).recordings
    assert [r.num_samples for r in recordings] == [half, len(rows) - half - 1]
    batch = sum(s.num_segments for s in segment_all(recordings))
    assert abs(accepted(found) - batch) <= 1
    assert found[-1]["seconds"] < 0.01 * len(rows) + 1


def test_a_counter_that_was_full_costs_neither_a_rest_nor_a_motion(tmp_path):
    rows = session_rows(5, POSES[:3])
    rows[:, 0] = np.mod(rows[:, 0] + 65.536 - rows[len(rows) // 2, 0], 65.536)  # 16 bits of ms
    found, folder = followed(tmp_path, f"{HEADER}\n" + text(rows))
    assert accepted(found) == 4 and not of(found, "problem")
    assert found[-1]["seconds"] == pytest.approx(0.01 * (len(rows) - 1))
    assert (folder / "recording-1.csv").read_text() == f"{HEADER}\n" + text(rows)
    (recorded,) = load_campaign(folder).recordings
    assert recorded.num_samples == len(rows) and np.ptp(np.diff(recorded.time)) < 2e-6


@pytest.mark.parametrize("apart", [3, 50])
def test_two_rows_that_came_late_are_put_aside_and_nothing_else_changes(tmp_path, apart):
    lines = text(session_rows(5, POSES[:3])).splitlines(keepends=True)
    late = []
    for k in (1000, 1000 + apart):
        lines[k], lines[k + 1] = lines[k + 1], lines[k]
        late.append(lines[k + 1])
    found, folder = followed(tmp_path, f"{HEADER}\n" + "".join(lines))
    assert found[-1]["event"] == "done" and accepted(found) == 4
    assert [e["kind"] for e in of(found, "problem")] == ["clock"]
    assert (folder / "left-out.txt").read_text() == "".join(late)
    (recorded,) = load_campaign(folder).recordings
    assert recorded.num_samples == len(lines) - 2


@pytest.mark.parametrize("rows", [6, 30])
def test_a_board_that_is_reset_twice_in_quick_succession_goes_on(tmp_path, rows):
    parts = (
        session_rows(5, POSES[:2]),
        session_rows(6, POSES[:2])[:rows],
        session_rows(7, POSES[:3]),
    )
    found, folder = followed(tmp_path, f"{HEADER}\n" + "".join(map(text, parts)))
    assert found[-1]["event"] == "done" and accepted(found) == 3 + 4
    clock = [e["statement"] for e in of(found, "problem") if e["kind"] == "clock"]
    assert len(clock) == 2 and all("went back" in said for said in clock)
    assert not (folder / "left-out.txt").exists()
    for number, part in enumerate(parts, start=1):
        assert (folder / f"recording-{number}.csv").read_text() == f"{HEADER}\n" + text(part)
    first, _, last = segment_all(load_campaign(folder).recordings)
    assert (first.num_segments, last.num_segments) == (3, 4)  # what is at rest at a reset counts


def test_rows_that_wait_for_what_follows_are_recorded_at_the_end(tmp_path):
    rows = session_rows(5, POSES[:1])
    rows[-2:, 0] += 1.0  # after a gap
    _, folder = followed(tmp_path, f"{HEADER}\n" + text(rows))
    assert (folder / "recording-1.csv").read_text() == f"{HEADER}\n" + text(rows)


@pytest.mark.slow
def test_a_log_that_is_replaced_begins_another_recording(tmp_path):
    folder = campaign(tmp_path)
    log = folder / "log.csv"
    first, second = session_rows(7, POSES[:2]), session_rows(8, POSES[:3])
    log.write_text(f"{HEADER}\n" + text(first))
    made = plan(folder, None, piped=False, target=None)
    recorder = Recorder(tmp_path / "out", made.campaign.path)
    found, replaced = [], False
    for event in events(made, recorder, idle=0.4):
        found.append(event)
        if not replaced and event["event"] == "rest":
            other = folder / "other"
            other.write_text(f"{HEADER}\n" + text(second))
            os.replace(other, log)
            replaced = True
    recorder.close()
    assert [r.num_samples for r in load_campaign(tmp_path / "out").recordings][-1] == len(second)


@pytest.mark.slow
def test_names_units_and_rates_of_the_campaign_hold(tmp_path):
    rows = session_rows(9, POSES[:6])
    rows[:, 1:4] /= 9.80665
    rows[:, 4:7] = np.degrees(rows[:, 4:7])
    body = (
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["log.csv"]\n'
        'names = ["n", "ax", "ay", "az", "wx", "wy", "wz"]\nstart_row = 3\n'
        '[columns]\ntime = { rate = 100.0 }\naccel = { names = ["ax", "ay", "az"], unit = "g" }\n'
        'gyro = { names = ["wx", "wy", "wz"], unit = "deg/s" }\n'
    )
    found, folder = followed(tmp_path, text(rows), body=body)
    assert found[-1]["rests"] == 7 and not of(found, "problem")
    recording = load_campaign(folder).recordings[0]
    assert recording.num_samples == len(rows) - 3
    np.testing.assert_allclose(recording.accel, rows[3:, 1:4] * 9.80665, atol=1e-5)


@pytest.mark.parametrize("target", ["accel.bias=1 ug", "gyro.bias=0.001 deg/h"])
def test_after_every_rest_it_is_said_where_to_turn(tmp_path, target):
    rows = session_rows(31, POSES[:4])
    found, _ = followed(tmp_path, f"{HEADER}\n" + text(rows), target=target)
    kinds = [e["event"] for e in found]
    rests = [k for k, kind in enumerate(kinds) if kind == "rest"]
    assert len(rests) == 5
    for begin, end in zip(rests[:-1], rests[1:]):
        assert [e["provisional"] for e in of(found[begin:end], "next")][0] is False
    assert kinds.count("done") == 1
    known = of(found, "progress")[-1]["parameters"]
    shown = {n: (p["label"], round(p["factor"], 4), p["shown_unit"]) for n, p in known.items()}
    assert shown["accel.matrix[2,0]"] == ("misalignment zx of the accelerometers", 1e6, "µrad")
    # A bias of 0.02 rad/s is beyond 1000 °/h, so that all are in °/s.
    assert shown["gyro.bias[2]"] == ("bias z of the gyros", 57.2958, "°/s")


def test_columns_that_are_not_there_are_one_line(tmp_path):
    with pytest.raises(ValueError, match="neither accel_x/y/z nor gyro_x/y/z") as caught:
        followed(tmp_path, "time,a,b,c\n" + "1,2,3,4\n" * 60)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_rows_a_thousand_times_a_second_are_thinned_to_the_same_rests(tmp_path):
    slow = session_rows(10, POSES[:5])
    stamps = np.arange(0.0, slow[-1, 0], 0.001)
    fast = np.column_stack([stamps, *(np.interp(stamps, slow[:, 0], c) for c in slow[:, 1:].T)])
    fast[:, 1:4] += 0.03 * np.random.default_rng(1).standard_normal((len(fast), 3))
    found, folder = followed(tmp_path, f"{HEADER}\n" + text(fast))
    (batch,) = segment_all(load_campaign(folder).recordings)
    assert accepted(found) == batch.num_segments == 6


ENVIRONMENT = {**os.environ, "INERTIAX_TRACEBACK": "1"}


def started(*arguments, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "inertiax", "live", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=ENVIRONMENT,
        **options,
    )


@pytest.mark.slow
def test_the_command_ends_with_what_the_batch_command_says_and_writes(
    tmp_path, capsys, monkeypatch
):
    folder, out = campaign(tmp_path), tmp_path / "out"
    process = started(folder, "-", "-o", out, stdin=subprocess.PIPE)
    said, errors = process.communicate((f"{HEADER}\n" + text(session_rows(12))).encode(), 240)
    assert process.returncode == 0, errors.decode()
    lines = said.decode().splitlines()
    done = next(k for k, line in enumerate(lines) if line.startswith("done: "))
    assert lines[done + 1].startswith(f"recorded: {out / 'recording-1.csv'} (its ± below")
    _, told, _ = run_command(capsys, monkeypatch, "calibrate", out, "-o", tmp_path / "batch")
    batch = told.splitlines()
    assert any(line.startswith("is it good? ") for line in batch)
    assert (
        lines[done + 2 : -1] == batch[:-2]
        and batch[-1].startswith("next: ")
        and str(out / "report.html") in lines[-1]
    )
    assert (out / "report.html").is_file()
    ours, theirs = (
        json.loads((home / "calibration.json").read_text()) for home in (out, tmp_path / "batch")
    )
    assert ours["accel"] == theirs["accel"] and ours["gyro"] == theirs["gyro"]


@pytest.mark.slow
def test_a_killed_run_loses_nothing_that_came(tmp_path):
    folder, out = campaign(tmp_path), tmp_path / "out"
    rows = session_rows(13, POSES[:3])
    process = started(folder, "-", "--json", "-o", out, stdin=subprocess.PIPE)
    sent = f"{HEADER}\n" + text(rows)
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(sent.encode())
    process.stdin.flush()
    for line in process.stdout:  # it has read as far as the third rest
        if json.loads(line).get("number") == 3:
            break
    deadline, recorded = time.monotonic() + 30, ""
    while time.monotonic() < deadline and recorded != sent:
        time.sleep(0.1)
        recorded = (out / "recording-1.csv").read_text()
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    assert (out / "recording-1.csv").read_text() == sent
    assert load_campaign(out).recordings[0].num_samples == len(rows)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--target", "accel.bias=3"], "no number with a unit"),
        (["--target", "accel.bais=3 mg"], "did you mean 'accel.bias'?"),
        (["--target", "accel.bias=-3 mg"], "must be a number above 0"),
        (["--target", "accel.bias=3 kg"], "does not belong to accel.bias"),
        (["--target", "mag.bias=3 uT"], "accelerometers and gyros alone"),
        (["--plan", "--target", "accel.bias=3 kg"], "does not belong to accel.bias"),
        (["x"], "is not -"),
        (["-", "--follow", "log.csv"], "not both"),
        (["--noise", "1 mg"], "give --plan, too"),
        (["--plan", "--noise", "1 deg"], "does not belong to accel.bias"),
        (["--plan", "--target", "gyro.bias=1 deg/h"], "asks nothing of the accelerometers"),
    ],
)
def test_wrong_usage_is_one_line(tmp_path, arguments, said, capsys):
    from inertiax.cli.app import run

    with pytest.raises(SystemExit) as caught:
        run(["live", str(campaign(tmp_path)), "-o", str(tmp_path / "out"), *arguments])
    assert caught.value.code == 2
    shown = capsys.readouterr().err
    assert said in shown and shown.count("\n") == 1


def test_a_plan_says_the_rests_for_each_noise_and_follows_nothing(tmp_path, capsys):
    from inertiax.cli.app import run

    asked = [
        str(campaign(tmp_path)),
        "--plan",
        "--target",
        "accel.bias=0.5 mg, accel.scale=600 ppm",
    ]
    with pytest.raises(SystemExit, match="^$"):
        run(["live", *asked, "--json"])
    said = json.loads(capsys.readouterr().out)["plan"]
    assert [round(row["noise"] / 9.80665e-3, 3) for row in said] == [0.05, 0.125, 0.25, 0.5, 1.0]
    rests = [row["rests"] for row in said]
    assert rests[0] == 14 and rests == sorted(rests) and rests[-1] > 3 * rests[-2] - 30
    assert said[0]["seconds"] == 14 * 10.0  # 4 s of hold, 2 s besides, 4 s of turning
    with pytest.raises(SystemExit, match="^$"):
        run(["live", *asked, "--noise", "0.5 mg"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].split() == ["0.5", "mg", str(rests[3]), f"{rests[3] / 6:.1f}"]
    assert not list(tmp_path.glob("**/live-*"))
