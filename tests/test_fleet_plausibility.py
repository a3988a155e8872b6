"""What `inertiax check` finds wrong with a table of many devices: with all of them, and with one."""

import numpy as np
import polars as pl
import pytest

from inertiax.fleet import run_fleet
from inertiax.fleet.store import read_parts


G = 9.80665
FACES = np.concatenate([np.eye(3), -np.eye(3)])
TURNS = [(axis, rate) for axis in FACES[:3] for rate in (0.5, -0.5, 1.0, -1.0)]


def device(serial, seed, gyro_unit=1.0, mirrored=False):
    """Rests on six faces and between them, and turns about three axes with known rates, at 20 Hz."""
    rng = np.random.default_rng(seed)
    edges = [a + b for a in FACES for b in FACES if a @ b == 0.0]
    poses = [f / np.linalg.norm(f) for f in (*FACES, *edges)]
    pieces = [(k, G * f, np.zeros(3)) for k, f in enumerate(poses)]
    pieces += [(-1, G * axis, rate * axis) for axis, rate in TURNS]
    label, force, rate = (
        np.repeat(np.array([p[i] for p in pieces]), 100, axis=0) for i in range(3)
    )
    accel = force * rng.normal(1.0, 2e-3, 3) + rng.normal(0.0, 0.05, 3)
    gyro = rate * rng.normal(1.0, 2e-3, 3) + rng.normal(0.0, 0.01, 3)
    accel += 5e-3 * rng.standard_normal(accel.shape)
    gyro += 5e-4 * rng.standard_normal(gyro.shape)
    gyro = gyro * gyro_unit * np.where([False, mirrored, False], -1.0, 1.0)
    columns = {"device": [serial] * len(label), "time": np.arange(len(label)) / 20.0}
    for name, values in dict(
        accel=accel, gyro=gyro, reference_accel=force, reference_gyro=rate
    ).items():
        columns |= {f"{name}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
    return pl.DataFrame(columns | {"position": label})


def line(folder, tables):
    folder.mkdir()
    pl.concat(tables).write_parquet(folder / "line.parquet")
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {G}\n[recordings]\nfiles = ["*.parquet"]\n'
    )
    return folder


@pytest.mark.slow
def test_a_unit_that_all_devices_have_wrong_ends_the_run_with_its_cure(tmp_path):
    wrong = line(tmp_path / "line", [device(f"A{k}", k, np.degrees(1.0)) for k in range(4)])
    with pytest.raises(ValueError, match=r'gyro = \{ unit = "deg/s" \}.*in the first 3 devices'):
        run_fleet(wrong, tmp_path / "out")
    assert not list((tmp_path / "out").glob("parts/*"))
    file = wrong / "campaign.toml"
    file.write_text(file.read_text() + '[columns]\ngyro = { unit = "deg/s" }\n')
    assert run_fleet(wrong, tmp_path / "out").calibrated == 4


def test_force_goes_on_and_is_part_of_the_run(tmp_path):
    wrong = line(tmp_path / "line", [device(f"A{k}", k, mirrored=True) for k in range(3)])
    summary = run_fleet(wrong, tmp_path / "out", force=True)
    assert summary.devices == 3
    with pytest.raises(ValueError, match="holds a run with --force"):
        run_fleet(wrong, tmp_path / "out")


@pytest.mark.slow
def test_one_device_that_is_wrong_does_not_end_the_run_and_has_its_cause(tmp_path):
    tables = [device(f"A{k}", k) for k in range(5)]
    tables[1] = device("A1", 1, np.degrees(1.0))
    run_fleet(line(tmp_path / "line", tables), tmp_path / "out")
    reasons = dict(read_parts(tmp_path / "out").select("device", "reason").collect().iter_rows())
    assert [k for k, why in reasons.items() if why] == ["A1"]
    assert "57" in reasons["A1"] and 'gyro = { unit = "deg/s" }' in reasons["A1"]
