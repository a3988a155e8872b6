"""The blind proof's generator and scorer (benchmarks/blind), which share no code with the package."""

import ast
import importlib
import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest


BLIND = Path(__file__).parent.parent / "benchmarks" / "blind"
sys.path.insert(0, str(BLIND))

_NAMES = (
    "draw", "generate", "linear", "marks", "menu", "page", "plans", "rig", "score", "truth", "world",
)  # fmt: skip
draw, generate, linear, marks, menu, page, plans, rig, score, truth, world = map(
    importlib.import_module, _NAMES
)

KINDS = ["null", "single", "aliased"]


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cases")
    return folder, generate.generate(3, 19, folder, kinds=KINDS)


@pytest.mark.slow
def test_same_seed_gives_the_same_cases_and_hash(suite, tmp_path):
    folder, answers = suite
    again = generate.generate(1, 19, tmp_path, kinds=KINDS[:1])
    assert again["cases"] == answers["cases"][:1]
    for file in sorted((folder / "case-001").iterdir()):
        assert file.read_bytes() == (tmp_path / "case-001" / file.name).read_bytes()
    other = generate.seal({**answers, "seed": 20})[1]
    assert generate.seal(answers)[1] == generate.seal(json.loads(json.dumps(answers)))[1] != other


@pytest.mark.slow
def test_cases_are_campaigns_of_the_contract(suite):
    folder, _ = suite
    allowed = {"time", "temperature", "experiment", "position"}
    for prefix in ("accel", "gyro", "reference_accel", "reference_gyro"):
        allowed |= {f"{prefix}_{a}" for a in "xyz"}
    for case in sorted(folder.glob("case-*")):
        settings = tomllib.loads((case / "campaign.toml").read_text())
        assert 9.7 < settings["site"]["gravity"] < 9.9
        assert settings["device"]["grade"] in ("navigation", "tactical", "consumer")
        triads = [k for k in ("accel", "gyro") if f"{k}_estimator" in settings["model"]]
        last = -np.inf
        for file in sorted(case.glob("*.parquet")):
            log = pl.read_parquet(file)
            assert set(log.columns) <= allowed
            assert {f"{k}_{a}" for k in triads for a in "xyz"} <= set(log.columns)
            assert np.isfinite(log.to_numpy()).all()
            time = log["time"].to_numpy()
            assert time[0] > last and (np.diff(time) > 0).all()
            assert {-1, 0} <= set(log["position"].to_list())
            last = time[-1]


def test_specific_force_and_rates_agree_with_each_other():
    """d(up)/dt = -rate × up in case axes, for moves and spins alike (100 Hz, second-order error)."""
    table = plans.Table(100.0)
    target, _ = plans.attitude(np.array([0.3, -0.5, 0.8]), 0.7)
    table.move(target)
    table.spin(np.array([1.0, 2.0, -1.0]), 1.5, 2.0)
    plan = table.plan("t", lambda t: 0 * t, model={}, block_seconds=1.0)
    turned = np.diff(plan.up, axis=0) * 100.0
    middle = lambda x: 0.5 * (x[1:] + x[:-1])
    assert np.abs(turned + np.cross(middle(plan.rate), middle(plan.up))).max() < 2e-3


@pytest.mark.slow
def test_size_estimates_scatter_as_the_true_covariance_says():
    """48 runs: the normalised estimate has standard deviation 1 ± 0.1, χ² per degree 1 ± 0.01."""
    rng = np.random.default_rng([5, 2])
    case = draw.stage("x", plans.tumble, dict(model="reference", count=12, sessions=2), rng)
    effect = truth.second_order(case.scenes["accel"], rng)
    problem = case.problems["accel"]
    seen = problem.visible(effect.signal(1.0))
    seen /= np.linalg.norm(seen)
    scores, chi2 = [], []
    for _ in range(48):
        draw.record(case, rng)
        y = problem.visible(case.disturbance["accel"])
        scores.append(seen @ y)
        chi2.append(y @ y / (len(y) - problem.base.shape[1]))
    assert 0.7 < np.std(scores) < 1.3 and abs(np.mean(scores)) < 0.5
    assert abs(np.mean(chi2) - 1.0) < 0.05


def test_effect_that_calibration_absorbs_leaves_nothing():
    rng = np.random.default_rng(3)
    case = draw.stage("x", plans.tumble, dict(model="reference", count=12, sessions=1), rng)
    problem, scene = case.problems["accel"], case.scenes["accel"]
    whole = np.linalg.norm(problem.whiten(problem.reduce(scene.ideal)))
    assert np.linalg.norm(problem.visible(scene.ideal)) < 1e-8 * whole
    turned = np.cross([1e-3, 2e-3, -1e-3], scene.ideal)
    assert np.linalg.norm(problem.visible(turned)) < 1e-8 * whole


def test_relaxation_process_has_the_covariance_of_its_blocks():
    """Variance of a block mean of a unit process, against 4000 simulated blocks (5 % s.e. 2 %)."""
    time = np.arange(160_000) * 0.5
    x = world.ornstein_uhlenbeck(time, 20.0, 1.0, np.random.default_rng(1)).reshape(4000, 40)
    one = np.ones(1)
    blocks = linear.Blocks(one, one, one, 20.0 * one, one, one)
    expected = linear._relaxation_covariance(blocks, 20.0)[0, 0]
    assert abs(x.mean(axis=1).var() / expected - 1) < 0.1


def test_generator_and_marks_import_nothing_of_the_package():
    # What runs the diagnosis, and what compares it afterwards with a fit that is given the answer.
    users = {"together.py", "given.py", "learned.py", "informed.py", "kept.py"}
    for file in (f for f in BLIND.glob("*.py") if f.name not in users):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not {n.split(".")[0] for n in names} & {"inertiax", "jax", "equinox"}, file


@pytest.mark.slow
def test_siblings_share_plan_and_station_and_nothing_else():
    case = draw.case("single", np.random.default_rng([5, 1]))
    one, other = (draw.sibling(case, np.random.default_rng([5, 1, k])) for k in (1, 2))
    assert one.plan is case.plan and one.grade_name == case.grade_name and not one.drawn
    assert one.level["rig"] == case.level["rig"]
    ratios = [one.level[k] / case.level[k] for k in ("flicker", "walk", "dwell", "session")]
    # Logarithms scatter by 0.15; five of that.
    assert all(abs(np.log(r)) < 0.75 and r != 1.0 for r in ratios)
    triad = case.plan.triads[0]
    assert one.reference.get(triad, case.reference[triad]) == pytest.approx(case.reference[triad])
    bias = [c.scenes[triad].sensor.bias for c in (case, one, other)]
    assert not np.allclose(bias[0], bias[1]) and not np.allclose(bias[1], bias[2])


def test_a_pier_tilt_comes_with_the_rates_that_tell_how_each_position_was_turned():
    rows = [row for row in menu.MENU if rig.pier_tilt in row[3]]
    assert rows and all(settings["turns_logged"] for _, settings, _, _ in rows)
    case = draw.stage("single", plans.tumble, rows[0][1], np.random.default_rng([5, 2]))
    draw.record(case, np.random.default_rng([5, 3]))
    assert set(case.plan.references) == {"accel", "gyro"}
    rest = case.plan.resting
    earth = np.linalg.norm(case.reference["gyro"][rest], axis=1)
    assert np.allclose(earth, 7.292115e-5, rtol=1e-4)  # rad/s; at rest nothing else is there
    assert np.abs(case.reference["gyro"][~rest]).max() > 0.1


@pytest.mark.slow
def test_sizes_asked_for_are_the_sizes_of_single_effects(tmp_path):
    answers = generate.generate(1, 23, tmp_path, kinds=["single"], sizes=(6.0,))
    assert answers["sizes"] == [6.0]
    free = [e for c in answers["cases"] for e in c["effects"] if e["name"] != "earth_rate"]
    assert free and all(e["z"] == pytest.approx(6.0, abs=0.01) for e in free)


def test_wilson_interval_and_span_overlap_have_their_hand_values():
    assert np.allclose(score.wilson(8, 10), [0.4902, 0.9433], atol=1e-4)  # Newcombe 1998's form
    assert marks.overlap([(0, 10)], [[5, 15]]) == pytest.approx(5 / 15)
    assert marks.overlap([(0, 4), (2, 6)], [(0, 6)]) == pytest.approx(1.0)


@pytest.mark.slow
def test_scorer_refuses_other_answers_than_the_sealed_ones(suite, tmp_path):
    folder, answers = suite
    text, digest = generate.seal(answers)
    (folder / "answers.sha256").write_text(digest + "\n")
    good, bad = tmp_path / "good.json", tmp_path / "bad.json"
    good.write_bytes(text)
    bad.write_bytes(text.replace(b"consistent", b"unexplained"))
    assert score.open_answers(folder, good) == json.loads(text)
    with pytest.raises(SystemExit, match="was sealed"):
        score.open_answers(folder, bad)


def test_a_perfect_diagnosis_gets_full_marks_and_a_wrong_one_none(suite):
    answer = suite[1]["cases"][1]
    truth_ = answer["effects"][0]
    effect = {"name": truth_["name"], "channels": truth_["channels"], "alternatives": []}
    right = marks.mark(answer, {"verdict": "missing-physics", "effects": [effect]}, 1.0)
    assert right.right_verdict and right.first_in_class and right.true_in_set and right.channel
    wrong = {"name": "supply", "channels": ["accel_q"], "alternatives": []}
    other = marks.mark(answer, {"verdict": "missing-physics", "effects": [wrong]}, 1.0)
    assert not (other.first_in_class or other.true_in_set or other.channel)
    assert marks.mark(answer, None, None).detected is False


def test_page_has_the_figures_that_were_measured_and_no_others(suite):
    answer = suite[1]["cases"][1]
    truth_ = answer["effects"][0]
    effect = {"name": truth_["name"], "channels": truth_["channels"], "alternatives": []}
    mark = marks.mark(answer, {"verdict": "missing-physics", "effects": [effect]}, 1.0)
    strong = {**vars(mark), "z": 30.0}
    one = score.summary([marks.Mark(**strong)])
    table = page._overall({"one": {"summary": one}})
    # One of one, by Wilson: 1 / (1 + 1.96²) = 0.21 to 1.
    assert "| Detected, z ≥ 10 | 100 % (21–100; n 1) |" in table
    assert "False alarms" not in table and "z = 6" not in table and "Both of two" not in table
    assert "| Runs that failed | 0 |" in table and "| Seconds a case, median | 1.00 |" in table
