"""The noise of a type, learned from several units, and what a diagnosis sees with it."""

import json
import sys
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import polars as pl
import pytest

from command_runs import run
from inertiax.data.recording import Campaign, ModelChoice, Rig
from inertiax.diagnose import diagnose, learn_noise, read_noise, write_noise
from inertiax.diagnose.learn_type_noise import pool
from inertiax.diagnose.noise.observation_series import START
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.noise.state_space import Known, negative_log_likelihood
from inertiax.diagnose.noise.type_noise import LEAST_SCATTER
from inertiax.diagnose.problem import prepare
from type_noise_data import anova, DWELL, FEW, G, ORDER, pooled, unit


@pytest.fixture(scope="module")
def alike():
    return [unit(seed) for seed in range(4)]


@pytest.fixture(scope="module")
def known(alike):
    return pooled(alike)


@pytest.mark.slow
def test_what_is_known_enters_as_a_student_t_distribution():
    with jax.enable_x64(True):
        (prepared,) = prepare(unit(1), ()).triads
        system, theta = prepared.system, START + 0.3
        rows = np.zeros((len(system.longer[0].white), 2))
        inputs = theta, system.scales[0], system.longer[0], rows[:, 0], rows, rows
        center, spread = START + 0.1, np.linspace(0.2, 2.0, len(START))
        precision = np.diag(spread**-2)
        free = negative_log_likelihood(*inputs, Known.nothing())
        held = negative_log_likelihood(*inputs, Known(center, precision))
    # By hand: (4 + 7) / 2 · log(1 + d² / 4) with d² the sum of squares of 0.2 in standard deviations.
    distance = np.sum((0.2 / spread) ** 2)
    assert float(held - free) == pytest.approx(5.5 * np.log1p(distance / 4.0), rel=1e-9)


@pytest.mark.slow
def test_the_noise_of_four_units_is_that_of_the_textbook(alike, known):
    assert [c.label for c in known.chains] == ["accel_x", "accel_y", "accel_z"]
    for c, chain in enumerate(known.chains):
        expected = np.log(np.mean([anova(one, c) for one in alike]))
        k = ORDER.index("dwell")
        own = np.sqrt(chain.covariance[k, k] - 1.25 * chain.scatter[k] ** 2)
        # Four units of 44 degrees of freedom: sqrt(2 / 176) = 0.11, and flicker may take a part of it over.
        assert 0.08 < own < 0.3
        assert abs(chain.mean[k] - expected) < 2.0 * own
        # What no unit shows is bounded from above: a walk's growth over the five minutes of a unit stays below
        # the offsets at 84 %.
        k = ORDER.index("walk")
        walk = np.exp(chain.mean[k] + np.sqrt(chain.covariance[k, k])) * 300.0
        assert walk < DWELL**2


@pytest.mark.slow
def test_units_that_differ_widen_what_is_known(known):
    k = ORDER.index("dwell")
    # Of units alike each score is its own deviation: 0.11 · 2 of scatter at most in most cases, beside the least.
    assert all(LEAST_SCATTER <= c.scatter[k] < 0.5 for c in known.chains)
    factor = np.exp(0.5 * np.array([-1.2, 1.2, -1.2, 1.2]))  # the log variances are ±1.2 off
    wide = pooled([unit(20 + k, dwell=DWELL * f) for k, f in enumerate(factor)])
    # Four units tell their scatter to a factor of sqrt(exp(1)) or so.
    assert all(0.7 < c.scatter[k] < 2.1 for c in wide.chains)


@pytest.mark.slow
def test_a_drift_shows_more_clearly_with_the_noise_of_the_type(known):
    # Twelve dwells of 3e-4 under a ramp of ±9e-4: sqrt(12 / 3) · 3 = 6 standard deviations, 36 in the likelihood ratio
    # under the true noise. Alone, a walk or a larger dwell noise explains a good part of it.
    alone, helped = [], []
    with jax.enable_x64(True):
        for seed in range(31, 37):
            (prepared,) = prepare(unit(seed, dwells=12, added=9e-4), FEW).triads
            mine = [t for t in prepared.candidates if t.name == "drift" and t.channels == (1,)]
            term = next(t for t in mine if t.variant.label == "bias")
            for system, ratios in (
                (prepared.system, alone),
                (known.inform(prepared.system), helped),
            ):
                without, beside = fit_noise(system), fit_noise(system, [term])
                ratios.append(2.0 * (without.value[1] - beside.value[1]))
    assert np.mean(alone) < 20.0 < np.mean(helped) < 36.0


@pytest.mark.slow
def test_a_diagnosis_uses_what_is_known_and_invents_nothing(known):
    found = diagnose(unit(33, dwells=12, added=9e-4), effects=FEW, noise=known)
    assert [e.name for e in found.effects] == ["drift"]
    assert found.effects[0].channels == ("accel_y",)
    nothing = diagnose(unit(33, dwells=12), effects=FEW, noise=known)
    assert nothing.verdict == "consistent"


@pytest.fixture(scope="module")
def units(alike):
    """Two as they should be, one that drifts and one that makes no rows."""
    (recording,) = alike[2].recordings
    moving = eqx.tree_at(lambda r: r.position, recording, np.full_like(recording.position, -1))
    broken = Campaign((moving,), alike[2].site, Rig(), alike[2].model, "tactical")
    lacking = unit(40, added=5e-3)
    return {"one": alike[0], "bad": lacking, "broken": broken, "two": alike[1]}


@pytest.fixture(scope="module")
def diagnosed(units):
    return learn_noise(list(units.items()))


@pytest.mark.slow
def test_a_unit_that_lacks_something_is_left_out_and_named(units, diagnosed):
    assert diagnosed.units == ("one", "two")
    assert [name for name, _ in diagnosed.left_out] == ["bad", "broken"]
    assert "drift" in diagnosed.left_out[0][1] or "warm_up" in diagnosed.left_out[0][1]
    assert "no rest" in diagnosed.left_out[1][1]
    with pytest.raises(ValueError, match=r"1 of 2 units are consistent .* \(bad: "):
        learn_noise([(name, units[name]) for name in ("one", "bad")])


@pytest.mark.slow
def test_units_known_to_be_consistent_are_not_diagnosed_again(units, diagnosed, monkeypatch):
    module = sys.modules[pool.__module__]  # its name is that of a function of the package, too
    monkeypatch.setattr(module, "find_all", lambda *_: pytest.fail("diagnosed again"))
    taken = [(name, units[name]) for name in ("one", "broken", "two")]
    found = learn_noise(taken, consistent=True)
    # One that makes no rows is left out all the same, and of the others the noise is what it is with a diagnosis.
    assert found.units == ("one", "two") and found.left_out == diagnosed.left_out[1:]
    for a, b in zip(found.chains, diagnosed.chains):
        np.testing.assert_array_equal(a.mean, b.mean)
        np.testing.assert_array_equal(a.covariance, b.covariance)


@pytest.mark.slow
def test_campaigns_that_do_not_go_together_are_refused(alike, known):
    with pytest.raises(ValueError, match="1 unit; at least 2 are needed"):
        learn_noise([("one", alike[0])])
    other = eqx.tree_at(lambda c: c.rig, alike[1], Rig(position_uncertainty=1e-5))
    with pytest.raises(ValueError, match=r"\[rig\] of two differs from that of one"):
        learn_noise([("one", alike[0]), ("two", other)])
    with pytest.raises(
        ValueError, match=r"says nothing, but .* position_uncertainty = 2.063 arcsec"
    ):
        diagnose(other, noise=known)
    model = ModelChoice(accel_estimator="invariant", temperature_degree=0)
    magnitude = Campaign(alike[1].recordings, alike[1].site, Rig(), model, "tactical")
    with pytest.raises(ValueError, match=r"accel_x, accel_y, accel_z, but .* are of \|accel\|"):
        diagnose(magnitude, noise=known)


@pytest.mark.slow
def test_the_file_holds_what_was_learned(known, tmp_path):
    path = tmp_path / "type-noise.json"
    write_noise(known, path)
    again = read_noise(path)
    assert (
        again.units == known.units and again.rig == known.rig and again.diagnosed == known.diagnosed
    )
    for a, b in zip(known.chains, again.chains):
        assert a.label == b.label and np.array_equal(a.scatter, b.scatter)
        assert np.array_equal(a.mean, b.mean) and np.array_equal(a.covariance, b.covariance)


def _damaged(content: dict, **changes) -> dict:
    content = json.loads(json.dumps(content))
    for key, value in changes.items():
        target = content["chains"][0] if key in content["chains"][0] else content
        target[key] = value
    return content


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"extra": 1}, "unknown key 'extra'"),
        ({"schema": "inertiax.calibration/1"}, "not the noise of a type: schema is"),
        ({"chains": []}, "'chains' is empty"),
        ({"mean": [0.0]}, "accel_x needs 7 means, 7 scatters and 7 rows of 7"),
        ({"covariance": (-np.eye(7)).tolist()}, "must be positive definite"),
        ({"covariance": np.triu(np.ones((7, 7))).tolist()}, "must be symmetric and finite"),
        ({"unit": "g"}, "accel_x: unit is 'g'; it must be 'm/s\\^2'"),
        ({"label": "accel_y"}, "a label stands twice"),
        ({"log_variances": ["white"]}, "log_variances must be"),
    ],
)
def test_a_damaged_file_is_said_in_one_line(known, tmp_path, change, said):
    path = tmp_path / "type-noise.json"
    write_noise(known, path)
    path.write_text(json.dumps(_damaged(json.loads(path.read_text()), **change)))
    with pytest.raises(ValueError, match=said) as error:
        read_noise(path)
    assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)


def test_a_truncated_file_is_said_in_one_line(known, tmp_path):
    path = Path(tmp_path / "type-noise.json")
    write_noise(known, path)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(ValueError, match="not valid JSON"):
        read_noise(path)


def test_a_file_that_does_not_say_whether_its_units_were_diagnosed_is_read(known, tmp_path):
    path = tmp_path / "type-noise.json"
    write_noise(known, path)
    content = json.loads(path.read_text())
    del content["diagnosed"]
    path.write_text(json.dumps(content))
    assert read_noise(path).origin().endswith("it is not said whether they were diagnosed first.")


def _folder(path, seed):
    """A unit's campaign as files."""
    (recording,) = unit(seed).recordings
    table = {"time": recording.time, "position": recording.position}
    for k, axis in enumerate("xyz"):
        table[f"accel_{axis}"] = recording.accel[:, k]
        table[f"reference_accel_{axis}"] = recording.reference_accel[:, k]
    path.mkdir()
    pl.DataFrame(table).write_csv(path / "log.csv")
    (path / "campaign.toml").write_text(
        f'[site]\ngravity = {G}\n[recordings]\nfiles = ["log.csv"]\n'
        '[model]\naccel_estimator = "reference"\ntemperature_degree = 0\n'
    )
    return path


@pytest.mark.slow
def test_the_commands_learn_and_use_the_noise(tmp_path, capsys, monkeypatch):
    units = [_folder(tmp_path / f"unit-{k}", k) for k in range(2)]
    file = tmp_path / "type-noise.json"
    status, out, err = run(capsys, monkeypatch, "learn-noise", *units, "-o", file)
    assert status == 0, err
    assert "from 2 units: unit-0, unit-1" in out and "accel_z" in out and "m/s²" in out
    assert "taken as consistent" not in out
    assert read_noise(file).units == ("unit-0", "unit-1")
    again = tmp_path / "again.json"
    status, out, err = run(capsys, monkeypatch, "learn-noise", *units, "--consistent", "-o", again)
    assert status == 0, err
    assert "taken as consistent" in out
    learned, taken = json.loads(file.read_text()), json.loads(again.read_text())
    assert (learned.pop("diagnosed"), taken.pop("diagnosed")) == (True, False)
    assert taken == learned
    new = _folder(tmp_path / "unit-7", 7)
    answer = tmp_path / "out"
    status, _, err = run(capsys, monkeypatch, "diagnose", new, "--noise", file, "-o", answer, "-q")
    assert status == 0, err
    diagnosis = json.loads((answer / "diagnosis.json").read_text())
    assert diagnosis["verdict"] == "consistent"
    origin = "2 units of the type (unit-0, unit-1), each found consistent first."
    assert diagnosis["noise"][0].endswith(origin) and origin in (answer / "report.html").read_text()
    toml = (new / "campaign.toml").read_text()
    (new / "campaign.toml").write_text(toml + "[rig]\nposition_uncertainty = 2.0\n")
    other = tmp_path / "other"
    status, _, err = run(capsys, monkeypatch, "diagnose", new, "--noise", file, "-o", other, "-q")
    assert status == 1 and not other.exists()
    assert "learned where [rig] says nothing" in err and len(err.strip().splitlines()) == 1
