"""Where a fleet's recordings may lie: a folder of campaigns in any format, and addresses."""

import os

import fsspec
import numpy as np
import polars as pl
import pytest

from fleet_data import device_table, GRAVITY, parameters, write_line
from inertiax.calibrate.pipeline import calibrate, DeviceResult
from inertiax.data.campaign import load_campaign
from inertiax.fleet import fleet_calibration, read_parts, run_fleet
from inertiax.fleet.reduce.campaign_folders import find_campaigns
from inertiax.fleet.reduce.tasks import Stretch, Task, wherever_read


TOML = '[site]\ngravity = {}\n[recordings]\nfiles = ["*.csv", "*.parquet"]\n[model]\ntemperature_degree = {}\n'


def _campaign(folder, tables, *, gravity=GRAVITY, degree=1):
    folder.mkdir(parents=True)
    text = TOML.format(gravity, degree)
    for name, table in tables.items():
        table.write_parquet(folder / name) if name.endswith("parquet") else table.write_csv(
            folder / name
        )
    used = '"*.parquet"' if any(n.endswith("parquet") for n in tables) else '"*.csv"'
    (folder / "campaign.toml").write_text(text.replace('"*.csv", "*.parquet"', used))


def _tables(count: int) -> list[pl.DataFrame]:
    rng = np.random.default_rng(4)
    return [device_table(rng, f"S{k}", parameters(rng, 1), 3) for k in range(count)]


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Unit 1 as CSV, unit 2 as Parquet, unit 3 a campaign of two devices, unit 10 without accelerometers,
    unit 11 with a broken campaign.toml."""
    folder = tmp_path_factory.mktemp("bench") / "bench"
    tables = _tables(4)
    _campaign(folder / "unit1", {"log.csv": tables[0].drop("device")})
    _campaign(folder / "unit2", {"log.parquet": tables[1]})
    _campaign(folder / "unit3", {"log.parquet": pl.concat(tables[2:])})
    gyro = tables[0].drop("device").rename({f"accel_{c}": f"gyro_{c}" for c in "xyz"})
    gyro = gyro.with_columns(pl.col("^gyro_.$") * 1e-4)
    _campaign(folder / "unit10", {"log.csv": gyro})
    (folder / "unit11").mkdir()
    (folder / "unit11" / "campaign.toml").write_text("[site]\ngravty = 9.8\n")
    return folder


def test_campaigns_are_found_in_natural_order(bench):
    names = [f.parent.name for f in find_campaigns(bench)]
    assert names == ["unit1", "unit2", "unit3", "unit10", "unit11"]


@pytest.mark.slow
def test_every_campaign_is_there_once_and_bad_ones_are_set_aside(bench, tmp_path):
    summary = run_fleet(bench, tmp_path / "out")
    assert (summary.devices, summary.calibrated) == (6, 4)
    table = read_parts(tmp_path / "out").collect()
    names = ["unit1", "unit2", "unit3/S2", "unit3/S3", "unit10", "unit11"]
    assert table["device"].to_list() == names
    reasons = dict(zip(table["device"], table["reason"], strict=True))
    assert reasons["unit10"] == "accel: no column accel_x, which the fleet's model needs"
    assert "unknown key 'gravty'; did you mean 'gravity'?" in reasons["unit11"]
    again = run_fleet(bench, tmp_path / "out")
    assert again.tasks_before == 1 and again.devices == 6


@pytest.mark.slow
def test_a_campaign_in_a_fleet_is_calibrated_as_alone(bench, tmp_path):
    run_fleet(bench, tmp_path / "out")
    for unit in ("unit1", "unit2"):
        (alone,) = calibrate(load_campaign(bench / unit))
        assert isinstance(alone, DeviceResult)
        in_fleet = fleet_calibration(tmp_path / "out", unit).accel
        for temperature in (-20.0, 40.0):
            sigma = np.asarray(alone.calibration.accel.standard_deviations(temperature))
            one, other = (
                np.asarray(c.curve(temperature)) for c in (alone.calibration.accel, in_fleet)
            )
            # The same dwells; the batch takes its weights along the force once, alone they follow every step, which
            # moves the minimum by 4e-4 sigma. A thousandth is what is promised.
            assert np.abs((one - other) / sigma).max() < 1e-3


def test_campaigns_that_do_not_fit_together_are_refused(tmp_path):
    tables = _tables(2)
    _campaign(tmp_path / "a" / "1", {"log.csv": tables[0]})
    _campaign(tmp_path / "a" / "2", {"log.csv": tables[1]}, gravity=9.81)
    with pytest.raises(
        ValueError, match=r"2/campaign.toml: \[site\] gravity = 9.81, but .* has 9.815"
    ):
        run_fleet(tmp_path / "a", tmp_path / "out")
    _campaign(tmp_path / "b" / "1", {"log.csv": tables[0]})
    _campaign(tmp_path / "b" / "2", {"log.csv": tables[1]}, degree=0)
    with pytest.raises(ValueError, match=r"2/campaign.toml: \[model\] is not that of"):
        run_fleet(tmp_path / "b", tmp_path / "out")
    _campaign(tmp_path / "d" / "1", {"log.csv": tables[0]})
    file = tmp_path / "d" / "1" / "campaign.toml"
    file.write_text(file.read_text().replace("[model]", "[model]\nlever_arms = true"))
    with pytest.raises(ValueError, match="no device can be calibrated.*lever_arms = true needs"):
        run_fleet(tmp_path / "d", tmp_path / "out")
    (tmp_path / "c").mkdir()
    with pytest.raises(ValueError, match="no campaign.toml in this folder"):
        run_fleet(tmp_path / "c", tmp_path / "out")


@pytest.mark.slow
def test_an_address_gives_the_table_that_a_path_gives(tmp_path):
    """`file` is a path, `memory` is read through fsspec."""
    write_line(tmp_path / "line", 3, files=2, experiments=2)
    files = sorted((tmp_path / "line").glob("*.parquet"))
    for file in files:
        fsspec.filesystem("memory").pipe_file(f"/line/{file.name}", file.read_bytes())
    run_fleet(tmp_path / "line", tmp_path / "here")
    here = read_parts(tmp_path / "here").collect().sort("device")
    assert here.height == 3
    text = (tmp_path / "line" / "campaign.toml").read_text()
    named = '", "'.join(f"file://{f}" for f in files)  # a glob there would leave the folder
    for protocol, address in (("memory", "memory://line/*.parquet"), ("file", named)):
        far, there = tmp_path / f"far-{protocol}", tmp_path / f"there-{protocol}"
        far.mkdir()
        (far / "campaign.toml").write_text(text.replace("*.parquet", address))
        run_fleet(far, there)
        assert here.equals(read_parts(there).collect().sort("device")), protocol


@pytest.mark.parametrize(
    "pattern", ["file://{}/*.parquet", "FILE://localhost{}/%2A.parquet", "simplecache::file://{}/*"]
)
def test_a_glob_of_an_address_on_this_machine_stays_in_the_folder_as_any_other(pattern, tmp_path):
    write_line(tmp_path / "line", 3, files=1, experiments=2)
    text = (tmp_path / "line" / "campaign.toml").read_text()
    (tmp_path / "far").mkdir()
    outside = pattern.format(tmp_path / "line")
    (tmp_path / "far" / "campaign.toml").write_text(text.replace("*.parquet", outside))
    with pytest.raises(ValueError, match="leaves the campaign's folder"):
        run_fleet(tmp_path / "far", tmp_path / "out")


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("nosuch://a/*.parquet", "'nosuch://a/\\*.parquet' cannot be listed: Protocol not known"),
        ("memory://empty/*.parquet", "'memory://empty/\\*.parquet' matches nothing"),
        ("memory://odd/a.parquet", "/odd/a.parquet: not a readable Parquet file"),
    ],
)
def test_an_address_that_cannot_be_read_is_said(address, message, tmp_path):
    fsspec.filesystem("memory").pipe_file("/odd/a.parquet", b"not Parquet")
    (tmp_path / "campaign.toml").write_text(
        f'[site]\ngravity = 9.8\n[recordings]\nfiles = ["{address}"]\n'
    )
    with pytest.raises(ValueError, match=message) as caught:
        run_fleet(tmp_path, tmp_path / "out")
    assert "\n" not in str(caught.value)


def test_a_run_goes_on_from_another_folder(tmp_path, monkeypatch):
    """Paths that were given relative to one folder are read from another, as by workers of Dask's."""
    write_line(tmp_path / "line", 2, files=1, experiments=1, degree=0)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    run_fleet("line", "out", workers=1)
    found = read_parts("out").collect()
    for part in (tmp_path / "out").rglob("*.parquet"):
        part.unlink()
    monkeypatch.chdir(tmp_path / "elsewhere")
    run_fleet("../line", "../out", workers=1)
    assert read_parts("../out").collect().equals(found)


def test_addresses_of_other_places_stay():
    task = Task(0, (("A", (Stretch("s3://bucket/a.parquet", 0, 1), Stretch("a.parquet", 0, 1))),))
    (made,) = wherever_read([task])
    assert [s.file for s in made.devices[0][1]] == [
        "s3://bucket/a.parquet",
        os.path.abspath("a.parquet"),
    ]
