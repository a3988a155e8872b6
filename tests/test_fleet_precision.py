"""A fleet's run in single precision: what it loses, and where it is refused."""

import json

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from fleet_data import GRAVITY, write_line
from inertiax.cli.app import app
from inertiax.fleet import read_parts, run_fleet


@pytest.fixture(scope="module")
def line(tmp_path_factory):
    folder = tmp_path_factory.mktemp("line")
    write_line(folder, 4)
    return folder


@pytest.fixture(scope="module")
def whole(line, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    run_fleet(line, folder)
    return folder


def _array(folder, column) -> np.ndarray:
    table = read_parts(folder).collect().sort("device")
    return np.array(table.get_column(column).to_list())


@pytest.mark.slow
def test_the_command_calibrates_in_single_precision_within_the_loss_it_states(
    line, whole, tmp_path
):
    command = ["fleet", str(line), "-o", str(tmp_path), "--precision", "float32", "--json"]
    run = CliRunner().invoke(app, command)
    assert run.exit_code == 0, run.output
    assert json.loads(run.stdout)["calibrated"] == 4
    assert json.loads((tmp_path / "manifest.json").read_bytes())["precision"] == "float32"
    found, expected = (_array(f, "accel_parameters") for f in (tmp_path, whole))
    units = np.tile([GRAVITY] * 3 + [1.0] * 6, found.shape[1] // 9)
    # 0.3 µg and 0.3 ppm: roundings of 2⁻²⁴ = 6e-8 in outputs and residuals. No loss would be double precision.
    assert 1e-9 < np.abs((found - expected) / units).max() < 3e-7
    sigma, same = (_array(f, "accel_sigma") for f in (tmp_path, whole))
    np.testing.assert_allclose(sigma, same, rtol=1e-3)


@pytest.mark.slow
def test_a_run_goes_on_only_in_its_own_precision(line, whole):
    with pytest.raises(ValueError, match="holds a run in float64; choose another output folder"):
        run_fleet(line, whole, precision="float32")


def test_single_precision_is_refused_to_a_line_without_the_problem(line, tmp_path):
    other = tmp_path / "line"
    other.mkdir()
    table = pl.read_parquet(sorted(line.glob("*.parquet"))).with_columns(
        **{f"reference_accel_{c}": pl.col(f"accel_{c}") for c in "xyz"}
    )
    table.write_parquet(other / "line.parquet")
    text = (line / "campaign.toml").read_text()
    (other / "campaign.toml").write_text(text.replace('"invariant"', '"reference"'))
    with pytest.raises(ValueError, match="calibrated by 'invariant'; here .* by 'reference'"):
        run_fleet(other, tmp_path / "out", precision="float32")
    assert not (tmp_path / "out" / "manifest.json").exists()
