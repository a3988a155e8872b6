"""The run that parts what a diagnosis left together: what can be run, what it is expected to say, what is written."""

import json
from dataclasses import replace

import numpy as np
import pytest

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose.observations.blocks import join
from inertiax.diagnose.plan.run_menu import LONGEST, menu, Run, Station, station_of
from inertiax.diagnose.plan.separate import (
    AFTER,
    ENOUGH,
    Expected,
    NameSet,
    separate,
    Separation,
    together,
)
from inertiax.diagnose.wording.separation import (
    document,
    lines,
    MOST_ODDS,
    odds,
    read_sets,
    write_separations,
)
from inertiax.live.itinerary import Itinerary, Step
from inertiax.live.rest_ledger import Rest
from inertiax.live.separation import itinerary
from inertiax.live.session import Session
from inertiax.live.target import Target
from inertiax.simulate.campaign import write_campaign
from inertiax.simulate.programme import programme_from_angles
from inertiax.simulate.scenario import load_scenario, plan_of, PlanTable, Scenario, scenario_toml
from inertiax.simulate.triad import Noise


G = 9.81
WHITE = 2e-4  # m/s², one sample
BENCH = Station(turned=True, temperature=25.0, span=12.0, rate=80.0)


# --- what can be run -------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_runs_last_as_long_as_the_simulator_says_and_no_longer_than_an_hour(axis):
    runs = menu(BENCH, axis)
    assert len({run.name for run in runs}) == len(runs) == 12
    for run in runs:
        plan = plan_of(Scenario(plan=run.plan))
        pauses = (plan.num_experiments - 1) * plan.soak_time
        assert run.seconds == pytest.approx(plan.num_experiments * plan.experiment_time + pauses)
        assert run.seconds <= LONGEST and len(run.checklist()) > 0


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_device_that_stays_in_one_position_feels_gravity_on_the_axis(axis):
    alone = [run for run in menu(BENCH, axis) if len(run.plan.positions) == 1]
    assert {run.name for run in alone} == {"a long rest", "power cycles at one temperature"}
    for run in alone:
        (up,) = programme_from_angles("one", np.array(run.plan.positions)).directions()
        np.testing.assert_allclose(up, np.eye(3)[axis], atol=1e-12)


def test_a_station_is_asked_for_what_it_has_only():
    hand = menu(replace(BENCH, span=0.0, rate=0.0), 0)
    assert all(run.plan.change == 0.0 and not run.plan.turn_rate for run in hand)
    fixed = menu(replace(BENCH, turned=False, rate=0.0), 0)
    assert all(run.plan.positions == ((0.0, 0.0),) for run in fixed)
    assert any(run.plan.change != 0.0 for run in fixed)


def test_a_chamber_goes_on_from_where_it_is_and_stays_in_its_span():
    heated = [run for run in menu(BENCH, 0) if isinstance(run.plan.change, tuple)]
    assert len(heated) == 4
    for run in heated:
        start, change = np.array(run.plan.temperatures), np.array(run.plan.change)
        # Written to a thousandth of a degree.
        np.testing.assert_allclose(start[1:], (start + change)[:-1], atol=2e-3)
        assert start.min() >= 25.0 - 6.0 - 2e-3 and (start + change).max() <= 25.0 + 6.0 + 2e-3
        assert run.plan.soak_time == 0.0  # a pause would be a power cycle
        chamber = plan_of(Scenario(plan=run.plan)).chamber
        ends = [float(chamber.temperature(k, 1.0)) for k in range(len(start))]
        np.testing.assert_allclose(ends, start + change, atol=1e-5)


def test_rates_go_down_by_halves_and_both_ways():
    (run,) = [run for run in menu(BENCH, 0) if run.plan.turn_rate]
    assert run.plan.turn_rate[:3] == (80.0, 40.0, 20.0)
    turns = plan_of(Scenario(plan=run.plan)).turns
    signed = {round(float(np.degrees(t.rate)), 6) for t in turns}
    assert {80.0, -80.0, 40.0, -40.0} <= signed


def test_a_scenario_is_read_as_it_was_written(tmp_path):
    for run in menu(BENCH, 1):
        file = tmp_path / "scenario.toml"
        file.write_text(scenario_toml(Scenario(plan=run.plan)))
        assert load_scenario(file) == Scenario(plan=run.plan)


def test_a_change_for_each_experiment_needs_as_many(tmp_path):
    file = tmp_path / "scenario.toml"
    file.write_text("[plan]\ntemperatures = [20.0, 30.0]\nchange = [1.0, 2.0, 3.0]\n")
    with pytest.raises(ValueError, match=r"change has 3 values for 2 temperatures"):
        load_scenario(file)


# --- what it is expected to say ---------------------------------------------------------------------


def rest_once(size, seed=5):
    """One session over 18 positions, 4 Hz, white noise; the x axis drifts by `size` m/s² from end to end."""
    rng = np.random.default_rng(seed)
    plan = plan_of(Scenario(plan=PlanTable(temperatures=(20.0,), dwell_time=30.0)))
    force = G * np.repeat(plan.programme.directions(), 4 * 40, axis=0)
    time = np.arange(len(force)) / 4.0
    position = np.where(np.arange(len(force)) % 160 < 120, np.arange(len(force)) // 160, -1)
    accel = force @ np.array([[1.001, 0, 0], [2e-3, 0.998, 0], [-1e-3, 1e-3, 1.003]]).T
    accel = accel + [0.02, -0.03, 0.01] + np.outer(time / time[-1] - 0.5, [size, 0.0, 0.0])
    accel = accel + WHITE * rng.standard_normal(accel.shape)
    recording = Recording(time=time, accel=accel, position=position)
    model = ModelChoice(accel_estimator="invariant", temperature_degree=0)
    return Campaign((recording,), Site(G), Rig(), model, "tactical")


DRIFTS = NameSet(("drift", "warm_up"), ("accel_x",))


# Three of the menu: each costs seconds of compilation.
SOME = [run for run in menu(replace(BENCH, span=0.0, rate=0.0), 0) if "corners" not in run.name][:3]


@pytest.fixture(scope="module")
def parted():
    return separate(rest_once(2e-4), DRIFTS, runs=SOME)


@pytest.mark.slow
def test_the_best_run_parts_all_pairs_in_the_least_time(parted):
    assert parted.names == DRIFTS
    pairs = [(i, j) for i, j, _ in parted.best.pairs]
    assert pairs == [("drift", "warm_up"), ("warm_up", "drift")]
    most = max(run.parted for run in parted.runs)
    assert parted.best.parted >= most - 0.1
    for other in parted.runs:
        assert other.parted < most - 0.1 or other.run.seconds >= parted.best.run.seconds
    # An hour later a drift has gone on and a warm-up has not: the plainest of runs tells.
    assert parted.best.worst > 1.0


@pytest.mark.slow
def test_the_odds_grow_with_the_square_of_the_size(parted):
    larger = separate(rest_once(4e-4), DRIFTS, runs=SOME)
    name = "six faces twice"
    small, large = (
        next(e for e in found.runs if e.run.name == name).worst for found in (parted, larger)
    )
    # Four times for a doubled effect. The size and form that the noise lets the first run tell scatter by a tenth
    # or so each, and the noise fitted beside is not the same.
    assert 2.0 < large / small < 8.0


@pytest.mark.slow
def test_names_that_the_campaign_does_not_show_are_refused():
    with pytest.raises(ValueError, match="shows 1 of drift, magnetic"):
        separate(rest_once(2e-4), NameSet(("drift", "magnetic"), ("accel_x",)))
    with pytest.raises(ValueError, match="gyro is not calibrated"):
        separate(rest_once(2e-4), NameSet(("drift", "warm_up"), ("gyro_x",)))


def test_the_station_is_that_of_the_campaign():
    assert station_of(join(rest_once(0.0))) == Station(True, 20.0, 0.0, 0.0)


# --- what is written ---------------------------------------------------------------------------------


def separation(*values):
    """Three runs of the menu with made-up expectations."""
    runs = menu(replace(BENCH, span=0.0, rate=0.0), 0)
    expected = tuple(
        Expected(run, (("drift", "warm_up", a), ("warm_up", "drift", b)))
        for run, (a, b) in zip(runs, values)
    )
    return Separation(DRIFTS, expected, 4.0, Noise(1e-4, 0.0), rest_once(0.0))


def test_odds_are_of_the_bayes_factor_and_bounded():
    assert odds(np.log(20.0)) == pytest.approx(20.0) and odds(0.0) == 1.0
    assert odds(1e4) == MOST_ODDS


def test_lines_say_the_steps_and_the_odds():
    found = separation((12.0, 30.0), (1.0, 1.0))
    said = "\n".join(lines(found))
    assert "drift, warm_up on accel_x: a long rest, 50 min" in said
    assert "expected if it is drift: 1.63e+05 to 1 against warm_up" in said
    assert "expected if it is warm_up: more than 1e+06 to 1 against drift" in said
    assert "no run here parts" not in said and "may leave a set" not in said
    assert found.best.enough and found.best.worst == 12.0 > ENOUGH


def test_what_no_run_parts_is_said_with_what_would():
    found = separation((0.5, 0.1), (0.2, 1.0))
    assert found.hopeless == ("drift", "warm_up")
    said = "\n".join(lines(found))
    assert "may leave a set" in said and "a power cycle at constant temperature" in said
    half = separation((12.0, 0.1), (0.2, 9.0))  # one run for each direction
    assert half.hopeless == ()


def test_files_are_a_scenario_a_checklist_and_json(tmp_path):
    found = separation((12.0, 30.0))
    write_separations([found, found], tmp_path)
    names = {p.name for p in tmp_path.iterdir()}
    assert names == {
        "separation.json",
        "scenario.toml",
        "scenario-2.toml",
        "checklist.md",
        "checklist-2.md",
    }
    scenario = load_scenario(tmp_path / "scenario.toml")
    assert scenario.plan == found.best.run.plan and scenario.device.grade == "tactical"
    assert scenario.recording.accel_noise == 1e-4 and scenario.site.gravity == G
    content = json.loads((tmp_path / "separation.json").read_text())
    assert content["schema"] == "inertiax.separation/1"
    assert content["sets"][0] == json.loads(json.dumps(document(found)))
    checklist = (tmp_path / "checklist.md").read_text()
    assert (
        "- [ ] leave the device alone for 50 min with " in checklist and "to 1 against" in checklist
    )


@pytest.mark.slow
def test_the_scenario_is_one_that_the_simulator_runs(tmp_path):
    found = separation((12.0, 30.0))
    write_separations([found], tmp_path)
    write_campaign(load_scenario(tmp_path / "scenario.toml"), tmp_path / "campaign")
    assert (tmp_path / "campaign" / "campaign.toml").is_file()


def diagnosis(tmp_path, **changes):
    entry = {"name": "drift", "channels": ["accel_x"], "alternatives": ["warm_up"]}
    content = {"schema": "inertiax.diagnosis/1", "effects": [entry | changes.pop("entry", {})]}
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps(content | changes))
    return file


def test_sets_are_read_from_the_file_or_its_folder(tmp_path):
    file = diagnosis(tmp_path, campaign="../campaign", device="SN1")
    for path in (file, tmp_path):
        said = read_sets(path)
        assert said.sets == (DRIFTS,) and said.device == "SN1"
        assert said.campaign == tmp_path.parent / "campaign"
        assert said.beside(said.sets[0]) == ()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": "inertiax.calibration/1"}, "not a diagnosis"),
        ({"effects": 3}, "not a diagnosis"),
        ({"effects": []}, "nothing to separate"),
        ({"entry": {"alternatives": []}}, "nothing to separate"),
        ({"entry": {"alternatives": ["gremlins"]}}, "'gremlins' is no effect"),
        ({"entry": {"channels": ["accel_q"]}}, "are not of accel_x"),
    ],
)
def test_what_is_no_set_is_one_line(tmp_path, changes, message):
    file = diagnosis(tmp_path, **changes)
    with pytest.raises(ValueError, match=message) as caught:
        read_sets(file)
    assert "\n" not in str(caught.value) and str(file) in str(caught.value)


def test_a_file_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(ValueError, match="cannot be read"):
        read_sets(tmp_path / "nothing.json")


def run(arguments, capsys):
    from inertiax.cli.app import run as run_command

    with pytest.raises(SystemExit) as caught:
        run_command(["design", *map(str, arguments)])
    shown = capsys.readouterr().err
    return caught.value.code, shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--audit"], "means nothing with --separate"),
        (["--positions", "12"], "means nothing with --separate"),
        ([], "is not at 'None'; name it"),
        (["nowhere"], "is not at 'nowhere'; name it"),
    ],
)
def test_wrong_usage_is_one_line(tmp_path, capsys, arguments, message):
    code, shown = run(["--separate", diagnosis(tmp_path), *arguments], capsys)
    assert code == 2 and shown.count("\n") == 1 and message in shown
    code, shown = run(["--optimise", "-o", tmp_path / "out"], capsys)
    assert code == 2 and "means nothing with --optimise" in shown


# --- followed live -------------------------------------------------------------------------------------


def test_further_recordings_come_an_hour_later_as_further_experiments():
    first = rest_once(0.0)
    one = first.recordings[0]
    further = [
        replace(one, time=one.time + k * 1e4, experiment=np.full(one.num_samples, k))
        for k in (0, 1)
    ]
    both = together(first, further)
    starts = [float(r.time[0]) for r in both.recordings]
    assert starts[1] == pytest.approx(float(one.time[-1]) + AFTER) and starts[2] - starts[1] == 1e4
    assert [int(r.experiment[0]) for r in both.recordings[1:]] == [1, 2]


def rests(*taken):
    """Accepted rests: axis that is up, seconds, recording."""
    made, begin = [], 0.0
    for number, (axis, seconds, part) in enumerate(taken, start=1):
        one = Rest(number, part, 0, 1, (begin, begin + seconds))
        one.accel = G * np.eye(3)[axis] + [0.1, 0.2, -0.1]
        made.append(one)
        begin += seconds + 5.0
    return made


def faces(axes, seconds=50.0, afresh=()):
    steps = [
        Step(tuple(float(x) for x in np.eye(3)[k]), f"{k} up", seconds, afresh=n in afresh)
        for n, k in enumerate(axes)
    ]
    return Itinerary(tuple(steps))


def test_steps_are_done_in_order_by_rests_long_enough_in_their_direction():
    plan = faces([2, 1, 0])
    assert plan.done([]) == 0
    assert plan.done(rests((2, 48.0, 1), (0, 48.0, 1))) == 1  # the second is another one
    assert plan.done(rests((2, 20.0, 1), (2, 48.0, 1), (1, 48.0, 1))) == 2
    done = rests((2, 48.0, 1), (1, 48.0, 1), (0, 48.0, 1))
    assert plan.finished(done) and not plan.finished(done[:2])
    said = plan.next_position(done[:1])
    assert said.up == (0.0, 1.0, 0.0) and said.statement == "step 2 of 3: 1 up"
    assert said.gain == pytest.approx(1 / 3) and plan.next_position(done) is None


def test_a_long_rest_does_several_steps_but_none_that_begins_afresh():
    assert faces([2, 2, 2]).done(rests((2, 148.0, 1))) == 3
    assert faces([2, 2, 2]).done(rests((2, 95.0, 1))) == 2
    cycles = faces([2, 2, 2], afresh=(1, 2))
    assert cycles.done(rests((2, 148.0, 1))) == 1
    assert cycles.done(rests((2, 48.0, 1), (2, 48.0, 1))) == 1
    assert cycles.done(rests((2, 48.0, 1), (2, 48.0, 2), (2, 48.0, 3))) == 3


def test_turns_come_last_and_end_with_the_input():
    (run_,) = [r for r in menu(replace(BENCH, span=0.0), 0) if r.plan.turn_rate]
    plan = itinerary(run_)
    assert len(plan.steps) == 6 and plan.then[0][1] == pytest.approx(np.radians(80.0))
    done = [replace(r) for r in rests(*((0, 50.0, 1),) * 6)]
    for rest, step in zip(done, plan.steps):
        rest.accel = G * np.array(step.up)
    said = plan.next_position(done)
    assert "at 80 deg/s" in said.statement and said.rate == pytest.approx(np.radians(80.0))
    assert not plan.finished(done)


def test_steps_of_a_chamber_and_of_power_cycles_are_said_with_them():
    named = {r.name: itinerary(r) for r in menu(BENCH, 2)}
    heated = named["there and back: the first temperature again"]
    assert len(heated.steps) == 30 and heated.steps[0].temperature == pytest.approx(19.0)
    assert heated.steps[6].statement.startswith(
        "heat from 19 to 31 °C in 6 min (2.1 °C/min); turn the device"
    )
    assert heated.steps[6].temperature == pytest.approx(31.0)
    cycles = named["power cycles at one temperature"]
    assert [s.afresh for s in cycles.steps] == [False, True, True, True]
    off = "power off, wait 5 min, power on and record at once"
    assert cycles.steps[1].statement.startswith(f"{off}; turn the device")
    (run_,) = [r for r in menu(BENCH, 2) if r.name == "power cycles at one temperature"]
    alone = "leave the device alone for 8 min with +z up"
    assert run_.checklist() == (alone, off, alone, off, alone, off, alone)
    assert run_.minutes == pytest.approx(4 * 8 + 3 * 5, abs=0.1)  # the title's is that of the steps


def test_a_rest_that_does_no_step_says_why():
    plan = faces([2, 1, 1], afresh=(2,))
    assert plan.missed(rests((2, 48.0, 1))) is None
    assert plan.missed(rests((0, 48.0, 1))).startswith("does not count for step 1: 9")  # 91°
    assert plan.missed(rests((2, 48.0, 1), (1, 30.0, 1))) == (
        "does not count for step 2: shorter than 40 s"
    )
    before = rests((2, 48.0, 1), (1, 48.0, 1), (1, 48.0, 1))
    assert "no time without power" in plan.missed(before)
    assert plan.missed(rests((2, 48.0, 1), (1, 48.0, 1), (1, 48.0, 2))) is None


def test_a_session_follows_its_steps_to_the_end():
    positions = ((0.0, 0.0), (90.0, 0.0), (90.0, 90.0))
    short = Run(
        "three", PlanTable(positions=positions, temperatures=(20.0,), change=0.0, dwell_time=6.0)
    )
    plan = itinerary(short)
    campaign = rest_once(0.0)
    session = Session(campaign, Target("", ()), 6.0, plan)
    (first,) = session.first_step()
    assert first["statement"].startswith("step 1 of 3: turn the device so that it rests with +z up")
    rng, told, begin = np.random.default_rng(3), [], 0.0
    ups = [np.array(s.up) for s in plan.steps]
    for k, up in enumerate(ups):
        way = np.linspace(ups[k - 1], up, 75) if k else np.zeros((0, 3))
        way = way / np.linalg.norm(way, axis=1, keepdims=True)
        force = G * np.concatenate([way, np.tile(up, (450, 1))])
        force = force + 0.01 * rng.standard_normal(force.shape)
        time = begin + 0.02 * np.arange(len(force))
        begin = time[-1] + 0.02
        told += list(session.feed(Recording(time, accel=force), time))
    assert session.finished and told[-1]["reason"] == "run completed" and told[-1]["rests"] == 3
    steps = [e["statement"].split(":")[0] for e in told if e["event"] == "next"]
    assert list(dict.fromkeys(steps)) == ["step 2 of 3", "step 3 of 3"]


def test_a_target_beside_a_separation_is_one_line(tmp_path, capsys):
    from inertiax.cli.app import run as run_command

    with pytest.raises(SystemExit) as caught:
        run_command(["live", str(tmp_path), "--separate", "x.json", "--target", "accel.bias=1 mg"])
    shown = capsys.readouterr().err
    assert caught.value.code == 2 and "means nothing with --separate" in shown
