"""Effects common to a line told from those of single devices; data from plain NumPy."""

import json

import jax
import numpy as np
import polars as pl
import pytest

from fleet_data import COLUMNS, directions, GRAVITY, ROWS
from inertiax.estimators import Invariant
from inertiax.fleet import fit_fleet, read_line, score
from inertiax.physics.temperature import Constant
from inertiax.reduction.dwells import Dwells


SIGMA = 2e-4  # m/s², of a dwell mean
DEVICES = 60


def line(seed: int, change=None) -> Dwells:
    """18 positions of each device, in two experiments' time; `change(device, u)` adds to outputs in m/s²."""
    rng = np.random.default_rng(seed)
    u = np.concatenate([directions(), directions()[::-1]])
    outputs = np.empty((DEVICES, len(u), 3))
    for d in range(DEVICES):
        matrix = np.zeros((3, 3))
        matrix[ROWS, COLUMNS] = rng.normal(0, 3e-3, 6)
        outputs[d] = GRAVITY * (u + u @ matrix.T) + rng.normal(0, 0.03, 3)
        if change is not None:
            outputs[d] += change(d, u)
    outputs += rng.normal(0, SIGMA, outputs.shape)
    shape = outputs.shape[:2]
    full = lambda value: np.full(shape, value)
    return Dwells(
        time=np.broadcast_to(np.arange(len(u)) * 30.0, shape),
        duration=full(10.0),
        count=full(1000.0),
        temperature=full(20.0),
        experiment=np.broadcast_to(np.arange(len(u)) // 18, shape),
        position=np.broadcast_to(np.arange(len(u)) % 18, shape),
        valid=full(True),
        accel=outputs,
        accel_covariance=np.broadcast_to(np.eye(3) * SIGMA**2, (*shape, 3, 3)),
    )


def read(dwells: Dwells):
    with jax.enable_x64(True):
        estimator, basis = Invariant(GRAVITY), Constant()
        fit = fit_fleet(estimator, basis, dwells)
        scores = score(estimator, basis, dwells, fit)
    return scores, read_line("accel", [f"SN{d}" for d in range(DEVICES)], scores)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_line_without_effects_is_left_alone(seed):
    scores, found = read(line(seed))
    assert not found.common and not found.single
    z = scores.amplitude / scores.sigma
    seen = np.isfinite(z).all(axis=0)
    # Unit variance where the noise is as stated: 60 devices give the variance to ±18 % (1 sigma), and the greatest
    # departure of ~100 correlated terms is about three of those.
    assert np.all(np.abs(z[:, seen].var(axis=0) - 1.0) < 0.6)


@pytest.mark.slow
def test_amplitudes_are_those_put_in():
    k3 = 2e-3  # m/s² per g³

    def cubic(d, u):
        return np.stack([np.zeros(len(u)), k3 * u[:, 1] ** 3, np.zeros(len(u))], axis=1)

    scores, found = read(line(4, cubic))
    names = [(t.name, t.channel) for t in scores.terms]
    amplitude = scores.amplitude[:, names.index(("third_order", "accel_y"))]
    sigma = scores.sigma[:, names.index(("third_order", "accel_y"))]
    mean, expected = amplitude.mean(), sigma.mean() / np.sqrt(DEVICES)
    assert (
        abs(mean - k3) < 4 * expected + 0.02 * k3
    )  # the step is linear; 3e-3 errors of scale enter
    (first,) = found.common
    assert first.shared_cause
    assert "third_order" in {first.term.name, *(t.name for t in first.rivals)}
    assert first.term.channel == "accel_y"
    assert "the same in all devices" in first.sentence


@pytest.mark.slow
def test_an_effect_of_the_make_spreads_over_devices():
    rng = np.random.default_rng(50)
    sizes = rng.normal(3e-3, 1.5e-3, DEVICES)

    def asymmetry(d, u):
        return np.stack([sizes[d] * np.abs(u[:, 0]), *np.zeros((2, len(u)))], axis=1)

    _, found = read(line(5, asymmetry))
    first = found.common[0]
    assert first.term.channel == "accel_x"
    assert "scale_asymmetry" in {first.term.name, *(t.name for t in first.rivals)}
    assert not first.shared_cause
    assert 0.7 * 1.5e-3 < first.spread < 1.4 * 1.5e-3  # 60 devices: ± 9 % (1 sigma), and noise


@pytest.mark.slow
def test_one_device_with_an_effect_of_its_own():
    def second(d, u):
        return np.stack([*np.zeros((2, len(u))), (d == 17) * 5e-3 * u[:, 2] ** 2], axis=1)

    _, found = read(line(6, second))
    assert not found.common
    assert [s.device for s in found.single] == ["SN17"]
    only = found.single[0]
    assert "second_order" in {only.term.name, *(t.name for t in only.rivals)}
    assert only.term.channel == "accel_z"
    assert only.amplitude == pytest.approx(5e-3, abs=4 * only.sigma)


def test_few_devices_are_refused():
    scores, _ = read(line(7))
    few = type(scores)(scores.terms, scores.amplitude[:5], scores.sigma[:5], scores.overlap)
    with pytest.raises(ValueError, match="5 devices have residuals to compare; at least 8"):
        read_line("accel", ["a"] * 5, few)


@pytest.mark.slow
def test_the_command_names_what_a_line_has_in_common(tmp_path):
    from typer.testing import CliRunner

    import fleet_data
    from inertiax.cli.app import app

    folder = tmp_path / "line"
    fleet_data.write_line(folder, 10, experiments=2, degree=0)
    # The same cubic in every z axis, as of a read-out that the whole line shares.
    for file in folder.glob("*.parquet"):
        table = pl.read_parquet(file)
        cubic = 2e-2 * (pl.col("accel_z") / GRAVITY) ** 3
        table.with_columns(accel_z=pl.col("accel_z") + cubic).write_parquet(file)
    results = tmp_path / "results"
    done = CliRunner().invoke(
        app, ["fleet", str(folder), "-o", str(results), "--explain", "--json"]
    )
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)["line"][0]["common"][0]
    names = {found["term"]["name"], *(t["name"] for t in found["rivals"])}
    assert "third_order" in names and found["term"]["channel"] == "accel_z"
    assert found["shared_cause"]
    page = (results / "report.html").read_text()
    assert "What the model leaves out" in page and "the line has" in page
    # Nothing is done again, and the answer is there.
    again = CliRunner().invoke(app, ["fleet", str(folder), "-o", str(results), "--explain"])
    assert again.exit_code == 0 and "accel: the line has" in again.stdout


def test_a_run_without_scores_is_not_explained_afterwards(tmp_path):
    import fleet_data
    from inertiax.fleet import run_fleet

    fleet_data.write_line(tmp_path / "line", 3, experiments=1, degree=0)
    run_fleet(tmp_path / "line", tmp_path / "results")
    with pytest.raises(ValueError, match="holds a run without --explain"):
        run_fleet(tmp_path / "line", tmp_path / "results", explain=True)
