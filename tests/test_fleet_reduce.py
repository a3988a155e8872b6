"""Raw rows of many devices to dwell means at once: as polars groups them, and as each device alone."""

import jax
import numpy as np
import polars as pl
import pytest

from fleet_data import device_table, parameters
from inertiax.data.formats import ColumnMap
from inertiax.data.formats.columns import PositionColumn
from inertiax.data.recording import Recording
from inertiax.fleet.reduce.blocks import BLOCKS
from inertiax.fleet.reduce.many_dwells import Reduced, Reduction
from inertiax.fleet.reduce.raw_rows import reduce_table
from inertiax.reduction.dwell_means import reduce_to_dwells


def _spoil(k: int, table: pl.DataFrame, rng: np.random.Generator) -> pl.DataFrame:
    """Gaps, turning, saturation, few rows, wrong order, … by the device's number."""
    row, x = pl.int_range(pl.len()), pl.col("accel_x")
    changes = {
        1: pl.when(row == 100).then(float("nan")).otherwise(x).alias("accel_x"),
        2: pl.when(row < 200).then(float("inf")).otherwise(-x).alias("accel_y"),
        3: x.clip(upper_bound=5.0).alias("accel_x"),
        4: pl.col("time").reverse(),
        5: pl.lit(-1, pl.Int32).alias("position"),
        6: pl.when(row % 64 < 9).then(-1).otherwise(pl.col("position")).alias("position"),
        7: pl.when(row == 70).then(None).otherwise(pl.col("position")).alias("position"),
        8: pl.when(row == 3).then(None).otherwise(pl.col("temperature")).alias("temperature"),
    }
    table = table.with_columns(changes[k]) if k in changes else table
    if k == 9:
        return table.filter(pl.int_range(pl.len()) % 64 < 3)  # dwells of one block
    if k in (10, 11):
        return table.filter(pl.Series(rng.random(len(table)) > 0.4))
    return table


@pytest.fixture(scope="module")
def tables() -> list[pl.DataFrame]:
    rng = np.random.default_rng(6)
    made = [
        _spoil(k, device_table(rng, f"D{k}", parameters(rng, 1), 1 + k % 3), rng) for k in range(14)
    ]
    return [t.drop("device").cast({"position": pl.Int64}) for t in made]


def _reduced(tables: list[pl.DataFrame], first: int = 0) -> list[Reduced]:
    names = tuple(f"D{first + k}" for k in range(len(tables)))
    rows = np.array([len(t) for t in tables])
    return list(reduce_table(pl.concat(tables), rows, names, ColumnMap()))


def test_a_device_among_others_is_reduced_as_alone(tables):
    together = _reduced(tables)
    for k, found in enumerate(together):
        (alone,) = _reduced([tables[k]], first=k)
        assert (found.device, found.reason) == (alone.device, alone.reason)
        assert (found.dwells is None) == (alone.dwells is None)
        for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(alone), strict=True):
            np.testing.assert_array_equal(one, other)


def test_reasons_name_the_column_and_the_place(tables):
    reasons = {k: r.reason for k, r in enumerate(_reduced(tables)) if r.reason}
    assert sorted(reasons) == [1, 2, 3, 4, 5, 8]
    assert "'accel_x' has no finite number in 1 of" in reasons[1]
    assert "first in position 1 of experiment 0" in reasons[1]
    assert (
        "'accel_y' has no finite number in 50 of" in reasons[2]
    )  # 3 dwells and 8 rows: 3 · 16 + 2
    assert "'accel_x' stays at 5, its extreme value, through" in reasons[3]
    assert reasons[4].startswith("time does not increase")
    assert reasons[5].startswith("no rest")
    assert "'temperature' has no finite number in 1 of" in reasons[8]


def test_means_are_those_of_polars(tables):
    for table, found in zip(tables, _reduced(tables), strict=True):
        if found.dwells is None or table["position"].null_count() or (table["position"] < 0).any():
            continue  # there a position is split, and counts as several dwells
        grouped = table.group_by("experiment", "position", maintain_order=True).agg(
            pl.col("time", "temperature", "accel_x", "accel_y", "accel_z").mean(), pl.len()
        )
        np.testing.assert_array_equal(found.dwells.count, grouped["len"])
        np.testing.assert_array_equal(found.dwells.position, grouped["position"])
        for name in ("time", "temperature"):
            np.testing.assert_allclose(getattr(found.dwells, name), grouped[name], rtol=1e-12)
        means = grouped.select("accel_x", "accel_y", "accel_z").to_numpy()
        np.testing.assert_allclose(found.dwells.accel, means, rtol=1e-12, atol=1e-12)


def test_the_covariance_is_by_successive_differences_of_block_means(tables):
    """The Allan variance written as a loop over dwells, on a device of whole blocks."""
    (found,) = _reduced([tables[0]])
    assert found.dwells is not None
    samples = tables[0]["accel_z"].to_numpy().reshape(-1, BLOCKS, 64 // BLOCKS)
    squares = [np.diff(dwell.mean(axis=1)) ** 2 for dwell in samples]
    variance = np.concatenate(squares).mean() / 2 / BLOCKS
    np.testing.assert_allclose(found.dwells.accel_covariance[:, 2, 2], variance, rtol=1e-12)
    off = found.dwells.accel_covariance[:, [0, 0, 1], [1, 2, 2]]
    np.testing.assert_array_equal(off, 0.0)


def test_dwells_of_single_blocks_have_no_covariance(tables):
    (found,) = _reduced([tables[9]])
    assert found.dwells is not None
    np.testing.assert_array_equal(found.dwells.accel_covariance, 0.0)


def test_stacks_give_back_what_was_put_in(tables):
    reduced = _reduced(tables)
    again = list(Reduction.of(reduced))
    for one, other in zip(reduced, again, strict=True):
        assert (one.device, one.reason) == (other.device, other.reason)
        for x, y in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(x, y)


def _rate_table(rng: np.random.Generator, rests: int = 3) -> pl.DataFrame:
    """Rests of 64 samples at 10 Hz, then ramps of 20 rows and plateaus of 40 at ±1 rad/s about three axes."""
    rates, position = [np.zeros((64 * rests, 3))], [np.repeat(np.arange(rests), 64)]
    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        ramp = np.linspace(0.0, 1.0, 20)[:, None] * axis
        rates += [ramp, np.tile(axis, (40, 1)), ramp[::-1]]
        position.append(np.full(80, -1))
    rate, where = np.concatenate(rates), np.concatenate(position)
    force = np.tile([0.0, 0.0, 9.81], (len(rate), 1))
    gyro = 1.01 * rate + 0.02 + 1e-3 * rng.standard_normal(rate.shape)
    accel = force + 2e-3 * rng.standard_normal(rate.shape)
    columns = {"time": 0.1 * np.arange(len(rate)), "position": where.astype(np.int64)}
    named = {"accel": accel, "gyro": gyro, "reference_gyro": rate}
    return pl.DataFrame(
        columns | {f"{k}_{a}": v[:, i] for k, v in named.items() for i, a in enumerate("xyz")}
    )


def _as_recording(table: pl.DataFrame) -> Recording:
    triads = {
        name: table.select(f"{name}_{a}" for a in "xyz").to_numpy()
        for name in ("accel", "gyro", "reference_gyro")
        if f"{name}_x" in table.columns
    }
    probe = table["temperature"].to_numpy()[:, None] if "temperature" in table.columns else None
    experiment = table["experiment"].to_numpy() if "experiment" in table.columns else None
    return Recording(
        table["time"].to_numpy(), temperature=probe, experiment=experiment,
        position=table["position"].to_numpy(), **triads,
    )  # fmt: skip


def _same_dwells(one, other):
    for name in one.__dataclass_fields__:
        if name != "rows":
            first, second = getattr(one, name), getattr(other, name)
            assert (first is None) == (second is None), name
            if first is not None:
                np.testing.assert_allclose(first, second, rtol=1e-13, atol=1e-15, err_msg=name)


@pytest.mark.parametrize("rests", [3, 0])
@pytest.mark.parametrize("exact", [False, True])
def test_plateaus_of_constant_rate_count(rests, exact):
    """Also where the device never rests, and beside devices that are reduced by sums."""
    rng = np.random.default_rng(8)
    turning, other = _rate_table(rng, rests), _rate_table(rng)
    resting = other.filter(pl.col("position") >= 0)
    table, rows = pl.concat([turning, resting]), np.array([len(turning), len(resting)])
    found, beside = reduce_table(table, rows, ("turns", "rests"), ColumnMap(), exact=exact)
    assert (found.device, found.reason, beside.device, beside.reason) == ("turns", "", "rests", "")
    assert found.dwells is not None and beside.dwells is not None
    np.testing.assert_array_equal(found.dwells.position, [*range(rests), *[-1] * 6])
    np.testing.assert_allclose(
        found.dwells.reference_gyro[rests:], np.concatenate([np.eye(3), -np.eye(3)]), atol=1e-12
    )
    _same_dwells(found.dwells, reduce_to_dwells([_as_recording(turning)]))
    np.testing.assert_array_equal(beside.dwells.position, [0, 1, 2])


@pytest.mark.parametrize("numbered", [False, True])
def test_a_station_s_own_label_for_moving_is_minus_one(numbered):
    """And rates that are numbered as positions are plateaus."""
    table = _rate_table(np.random.default_rng(9))
    own = pl.when(pl.col("position") < 0).then(7).otherwise(pl.col("position"))
    if numbered:
        still = pl.max_horizontal(pl.col("^reference_gyro_.*$").abs()) > 0.999
        own = pl.when(still).then(20 + pl.int_range(pl.len()) // 80).otherwise(own)
    columns = ColumnMap(position=PositionColumn(name="position", moving=7))
    rows = np.array([len(table)])
    (found,) = reduce_table(table.with_columns(position=own), rows, ("one",), columns)
    (plain,) = reduce_table(table, rows, ("one",), ColumnMap())
    assert found.reason == plain.reason == ""
    _same_dwells(found.dwells, plain.dwells)


def test_exact_dwells_are_those_of_one_device_alone(tables):
    rows, names = np.array([len(t) for t in tables]), tuple(f"D{k}" for k in range(len(tables)))
    quick = _reduced(tables)
    exact = list(reduce_table(pl.concat(tables), rows, names, ColumnMap(), exact=True))
    for table, one, other in zip(tables, quick, exact, strict=True):
        assert (one.device, one.reason) == (other.device, other.reason)
        if other.dwells is not None and not table["position"].null_count():
            _same_dwells(other.dwells, reduce_to_dwells([_as_recording(table)]))
