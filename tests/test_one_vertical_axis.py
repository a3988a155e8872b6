"""A device on face after face of a fixture, on a table that turns about the vertical alone: what `init` says, and that
the page's script leads to the right calibration. Logs in NumPy."""

import re
from pathlib import Path

import jax
import numpy as np
import polars as pl
import pytest

from inertiax.calibrate.pipeline import calibrate
from inertiax.campaign_draft.pipeline import draft_campaign
from inertiax.data.campaign import load_campaign


PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "turntable.md"
GRAVITY, EARTH = 9.81246, 7.292115e-5 * np.sin(np.radians(52.27))
NAMES = ("xup", "xdn", "yup", "ydn", "zup", "zdn")
HERTZ, SEAT = 50, 3e-4  # Hz; rad, of each mounting
BIAS, TURN = np.array([0.2, -0.15, 0.1]), np.array([0.01, -0.02, 0.015])
SCALE = np.array([[1.003, 0.002, -0.001], [0.0, 0.996, 0.003], [0.002, -0.001, 1.005]])
GYROS = np.array([[0.995, -0.002, 0.003], [0.001, 1.004, -0.001], [-0.003, 0.002, 1.002]])


def logs(folder, rng):
    """Six logs with rests and both signs of three rates, g and °/s, a device 2 cm beside the axis."""
    held = np.array([0.0, 30.0, -30.0, 90.0, -90.0, 180.0, -180.0, 0.0])
    for name in NAMES:
        up = np.zeros(3)
        up["xyz".index(name[0])] = 1.0 if name[1:] == "up" else -1.0
        up += np.cross(SEAT * rng.standard_normal(3), up)
        rate = np.repeat(np.radians(held), 8 * HERTZ)
        out = np.roll(up, 1) - up * (np.roll(up, 1) @ up)
        force = GRAVITY * up - 0.02 * np.square(rate)[:, None] * out
        accel = force @ SCALE.T + BIAS + 3e-3 * rng.standard_normal(force.shape)
        gyro = np.outer(rate + EARTH, up) @ GYROS.T + TURN + 1e-3 * rng.standard_normal(force.shape)
        columns = {"t": np.arange(len(rate)) / HERTZ}
        columns |= {f"a{k} [g]": v for k, v in zip("xyz", accel.T / 9.80665)}
        columns |= {f"g{k} [deg/s]": v for k, v in zip("xyz", np.degrees(gyro).T)}
        pl.DataFrame(columns | {"table_rate": np.degrees(rate)}).write_csv(folder / f"{name}.csv")


def test_a_rate_without_angles_is_pointed_to_the_page_whose_script_calibrates(
    tmp_path, monkeypatch
):
    logs(tmp_path, np.random.default_rng(2))
    monkeypatch.chdir(tmp_path)
    first, *others = [tmp_path / f"{name}.csv" for name in NAMES]
    said = draft_campaign(first, tmp_path, others=others).text
    assert '"table_rate" goes with the gyros\' rate' in said and "'One vertical axis'" in said

    (script,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    exec(script, {})
    first, *others = [tmp_path / f"ref_{name}.csv" for name in NAMES]
    drawn = draft_campaign(first, tmp_path, latitude=52.27, others=others).text
    assert "goes with the gyros' rate" not in drawn
    (tmp_path / "campaign.toml").write_text(f"{drawn}\n[rig]\nposition_uncertainty = 62\n")
    with jax.enable_x64(True):
        (result,) = calibrate(load_campaign(tmp_path))
        accel, gyro = result.calibration.accel, result.calibration.gyro
    # A triad's matrix takes what is read to what is felt, and the bias is of what is read.
    for triad, bias, matrix in ((accel, BIAS, SCALE), (gyro, TURN, GYROS)):
        assert triad is not None
        found, sigma = (
            np.asarray(v(20.0))[:12] for v in (triad.parameters, triad.standard_deviations)
        )
        truth = np.r_[bias, (matrix - np.eye(3)).ravel()]
        assert (
            np.abs((found - truth) / sigma).max() < 3.5
        )  # of 12 normal numbers in 1 of 180 triads
        assert sigma[[3, 7, 11]].max() < 2e-4 and sigma[:3].max() < 2e-3


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_norm_of_the_gyros_is_no_table(tmp_path, sign):
    """A logger's own |ω| has one sign."""
    logs(tmp_path, np.random.default_rng(3))
    log = pl.read_csv(tmp_path / "xup.csv").rename({"table_rate": "norm"})
    log.with_columns(pl.col("norm").abs() * sign).write_csv(tmp_path / "one.csv")
    assert "goes with" not in draft_campaign(tmp_path / "one.csv", tmp_path).text
