"""What a station writes while it moves: its own label, references of zero or none, numbers for rates too."""

import numpy as np
import polars as pl
import pytest

from inertiax.calibrate.pipeline import calibrate
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.diagnose.observations.blocks import cut, join
from inertiax.diagnose.observations.signals import specific_force
from inertiax.plausibility import check_campaign
from inertiax.reduction.segments import segment


RATE, REST, MOVE = 50.0, 200, 60  # Hz, rows
GRAVITY = 9.81
SCALE = np.array([1.002, 0.999, 1.001])


def _station(path, *, moving: int, empty: bool = False, numbered: bool = True, loud=True) -> None:
    """Eighteen positions, then rates of both signs about each axis; zero references while it moves."""
    rng = np.random.default_rng(3)
    grid = np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)], float)
    up = grid[(np.abs(grid).sum(axis=1) > 0) & (np.abs(grid).sum(axis=1) < 3)]
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    plan = [(u, np.zeros(3)) for u in up]
    plan += [
        (np.array([0, 0, 1.0]), s * r * e) for e in np.eye(3) for s in (1, -1) for r in (1.0, 0.5)
    ]
    force, rate, label, told = [], [], [], []
    for number, (u, w) in enumerate(plan, start=5):
        for rows, at_rest in ((MOVE, False), (REST, True)):
            force.append(np.broadcast_to(GRAVITY * u, (rows, 3)))
            rate.append(np.broadcast_to(w if at_rest else 0.1 * w, (rows, 3)))
            turning = bool(w.any()) and not numbered
            label += [number if at_rest and not turning else moving] * rows
            told += [at_rest] * rows
    force, rate, told = np.concatenate(force), np.concatenate(rate), np.array(told)
    shaken = np.where(told, 0.0, 1.0 if loud else 0.0)[:, None] * rng.standard_normal(force.shape)
    columns = {"time": np.arange(len(told)) / RATE, "pose": np.array(label)}
    accel = force * SCALE + 0.01 + 0.003 * rng.standard_normal(force.shape) + shaken
    gyro = rate * SCALE + 1e-3 + 2e-4 * rng.standard_normal(force.shape) + 0.1 * shaken
    nothing = np.nan if empty else 0.0
    references = [np.where(told[:, None], x, nothing) for x in (force, rate)]
    given = dict(
        accel=accel, gyro=gyro, reference_accel=references[0], reference_gyro=references[1]
    )
    for name, values in given.items():
        columns |= {f"{name}_{a}": values[:, k] for k, a in enumerate("xyz")}
    pl.DataFrame(columns).with_columns(pl.selectors.float().fill_nan(None)).write_csv(path)


def _campaign(folder, position: str):
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ["a.csv"]\n[columns]\nposition = {position}\n'
    )
    return load_campaign(folder)


def test_a_label_of_moving_is_told_with_the_line_that_mends_it(tmp_path):
    _station(tmp_path / "a.csv", moving=0)
    seen = check_campaign(_campaign(tmp_path, '"pose"'))
    (first, *_) = seen.of("error")
    assert "position 0" in first.statement and "reference_accel is zero" in first.statement
    assert first.remedy == 'position = { name = "pose", moving = 0 }'
    mended = _campaign(tmp_path, first.remedy.split("= ", 1)[1])
    assert not check_campaign(mended).of("error")
    (result,) = calibrate(mended)
    # 200 samples of 3 mm/s² in 18 positions tell a scale factor to 1e-5; five of that.
    assert result.accel is not None and result.gyro is not None
    for triad in (result.calibration.accel, result.calibration.gyro):
        told = dict(zip(triad.names, np.asarray(triad.curve.coefficients[0]), strict=True))
        name = triad.names[0].split(".")[0]
        off = [told[f"{name}.matrix[{k},{k}]"] - (SCALE[k] - 1.0) for k in range(3)]
        assert np.abs(off).max() < (5e-5 if name == "accel" else 2e-4)


def test_without_references_the_label_is_known_by_its_motion(tmp_path):
    _station(tmp_path / "a.csv", moving=0)
    table = pl.read_csv(tmp_path / "a.csv")
    table.drop([c for c in table.columns if c.startswith("reference_accel")]).write_csv(
        tmp_path / "a.csv"
    )
    errors = check_campaign(_campaign(tmp_path, '"pose"')).of("error")
    assert any("position 0" in e.statement and "the device moves" in e.statement for e in errors)


def test_a_position_that_is_shaken_is_none(tmp_path):
    """Positions at random, three of four dwells of one shaken by 0.1 g: the others follow one another directly."""
    rng = np.random.default_rng(5)
    order = np.concatenate([rng.permutation(6) for _ in range(5)])
    label = np.repeat(order, 200)
    shaken = np.repeat((order == 1) & (np.arange(30) > 6), 200)
    up = np.concatenate([np.eye(3), -np.eye(3)])[label]
    accel = GRAVITY * up + np.where(shaken, 1.0, 3e-3)[:, None] * rng.standard_normal(up.shape)
    columns = {"time": np.arange(len(label)) / RATE, "pose": label}
    columns |= {f"accel_{a}": accel[:, k] for k, a in enumerate("xyz")}
    pl.DataFrame(columns).write_csv(tmp_path / "a.csv")
    seen = check_campaign(_campaign(tmp_path, '"pose"'))
    assert not [f for f in seen.of("error") if "position 1" in f.statement]


def test_a_home_position_between_all_others_is_none(tmp_path):
    _station(tmp_path / "a.csv", moving=0, loud=False)
    table = pl.read_csv(tmp_path / "a.csv")
    table.drop([c for c in table.columns if c.startswith("reference_accel")]).write_csv(
        tmp_path / "a.csv"
    )
    seen = check_campaign(_campaign(tmp_path, '"pose"'))
    assert not [f for f in seen.findings if "position 0" in f.statement]


def test_references_may_be_empty_while_it_moves_and_nowhere_else(tmp_path):
    _station(tmp_path / "a.csv", moving=-1, empty=True)
    empty = _campaign(tmp_path, '"pose"').recordings[0]
    assert not empty.reference_accel[empty.position < 0].any()
    _station(tmp_path / "a.csv", moving=-1)
    zero = _campaign(tmp_path, '"pose"').recordings[0]
    np.testing.assert_array_equal(empty.reference_accel, zero.reference_accel)
    table = pl.read_csv(tmp_path / "a.csv")
    rows = pl.int_range(pl.len()) == MOVE + 5  # the sixth row of the first rest
    table.with_columns(
        reference_gyro_y=pl.when(rows).then(None).otherwise(pl.col("reference_gyro_y"))
    ).write_csv(tmp_path / "a.csv")
    with pytest.raises(ValueError, match=r"'reference_gyro_y' .* in 1 of .* first in row 65"):
        _campaign(tmp_path, '"pose"')


def test_rates_that_are_numbered_like_positions_are_plateaus(tmp_path):
    found = []
    for numbered in (True, False):
        _station(tmp_path / "a.csv", moving=-1, numbered=numbered)
        found.append(segment(_campaign(tmp_path, '"pose"').recordings[0]))
    for name in ("start", "stop", "position"):
        np.testing.assert_array_equal(getattr(found[0], name), getattr(found[1], name))
    assert (found[0].position < 0).sum() == 12 and found[0].resting.sum() == 18


def test_a_dead_channel_of_a_table_ends_in_a_line(tmp_path):
    _station(tmp_path / "a.csv", moving=-1)
    table = pl.read_csv(tmp_path / "a.csv")
    warm = 20.0 + 10.0 * (table["pose"] % 2)
    table.with_columns(gyro_y=0.0, temperature=warm).write_csv(tmp_path / "a.csv")
    (failure,) = calibrate(_campaign(tmp_path, '"pose"'), force=True)
    assert "gyro: a channel has no scatter" in failure.reason and "inertiax check" in failure.reason


def test_references_of_zero_do_not_change_the_size_of_the_force():
    rng = np.random.default_rng(4)
    force = GRAVITY * np.repeat(np.eye(3), 50, axis=0)
    told = rng.random(150) < 0.6
    stated = np.where(told[:, None], force, 0.0)
    position = np.repeat(np.arange(3), 50)
    recording = Recording(
        np.arange(150) / 50.0, 1.01 * force, reference_accel=stated, position=position
    )
    log = join(Campaign((recording,), Site(GRAVITY)))
    made = specific_force(log, cut(log), None)
    assert made is not None
    np.testing.assert_allclose(made[told], force[told] / GRAVITY, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(made[~told], axis=1), 1.0, rtol=1e-12)
