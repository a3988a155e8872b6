"""Recordings of every format are compensated; the truth is the inverse of the model, in NumPy."""

import sys

import jax
import numpy as np
import polars as pl
import pytest
import scipy.io

from exports_cases import calibration, GRAVITY
from inertiax.calibration.calibration import write_calibration
from inertiax.cli import main
from inertiax.exports.compensated_recording import compensate_file
from readers_cases import made_up, refusal


h5py = pytest.importorskip("h5py", reason="inertiax[formats] is not installed")
for library in ("pyulog", "rosbags"):
    pytest.importorskip(library, reason="inertiax[formats] is not installed")

from readers_data import bag, dataflash, euroc, matlab_73, RATE, raw_log, session  # noqa: E402


CALIBRATION = calibration()


def hdf5(path, data):
    with h5py.File(path, "w") as file:
        for name, values in data.items():
            file.create_dataset(name, data=values)


def parquet(path, data):
    triads = {f"{t}_{a}": data[t][:, k] for t in ("accel", "gyro") for k, a in enumerate("xyz")}
    pl.DataFrame({"time": data["time"], **triads, "remark": "kept"}).write_parquet(path)


WRITERS = {
    "a.parquet": parquet,
    "a.h5": hdf5,
    "v5.mat": scipy.io.savemat,
    "v73.mat": matlab_73,
    "a.ulg": raw_log,
    "a.bin": dataflash,
    "a.bag": lambda path, data: bag(path, "ros1", data),
    "mcap": lambda path, data: bag(path, "mcap", data),
    "imu0": euroc,
}


def truth(accel, gyro):
    """Specific force and rate by equation (3), row by row."""
    errors = CALIBRATION.accel_errors(0.0), CALIBRATION.gyro_errors(0.0)
    a, g = (jax.tree.map(np.asarray, e) for e in errors)
    force = np.linalg.solve(np.eye(3) + a.matrix, (accel - a.bias).T).T
    by_force = force @ g.g_sensitivity.T / GRAVITY
    return force, np.linalg.solve(np.eye(3) + g.matrix, (gyro - g.bias - by_force).T).T


def agree(table, accel, gyro, *, atol):
    force, rate = truth(accel, gyro)
    for triad, expected in (("accel", force), ("gyro", rate)):
        found = table.select([f"{triad}_{axis}" for axis in "xyz"]).to_numpy()
        np.testing.assert_allclose(found, expected, atol=atol, rtol=0)


@pytest.mark.parametrize("name", WRITERS)
def test_a_recording_of_every_format_is_compensated(tmp_path, name):
    data = made_up()
    WRITERS[name](tmp_path / name, data)
    done = compensate_file(CALIBRATION, tmp_path / name, any_device=True)
    # Flight logs hold floats of 32 bits: 10 m/s² to 6e-7.
    agree(done.table, data["accel"], data["gyro"], atol=1e-6)
    assert not done.table["extrapolated"].any() and len(done.table) == len(data["time"])
    assert ("remark" in done.table.columns) == (name == "a.parquet")


def test_triads_in_files_of_their_own_are_compensated_together(tmp_path, monkeypatch, capsys):
    data = made_up()
    for triad in ("accel", "gyro"):
        np.savetxt(tmp_path / f"{triad}.mat", np.column_stack([data["time"], data[triad]]))
    write_calibration(CALIBRATION, tmp_path / "calibration.json")
    places = [str(tmp_path / n) for n in ("calibration.json", "accel.mat", "gyro.mat", "out.csv")]
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    monkeypatch.setattr(sys, "argv", ["inertiax"])
    with pytest.raises(SystemExit) as exit:
        main(["compensate", places[0], places[1], "--gyro", places[2], "-o", places[3]])
    assert not exit.value.code, capsys.readouterr().err
    agree(pl.read_csv(places[3]), data["accel"], data["gyro"], atol=1e-9)


def test_every_section_of_a_session_is_compensated(tmp_path):
    session(tmp_path)
    (tmp_path / "campaign.toml").write_text(
        f'[recordings]\nfiles = ["a.csv"]\nformat = "imucal"\n[columns]\ntime = {{ rate = {RATE} }}\n'
    )
    done = compensate_file(CALIBRATION, tmp_path / "a.csv", campaign=tmp_path)
    names = done.table["recording"].unique(maintain_order=True).to_list()
    assert len(names) == 9 and names[0] == "a.csv (x_p)" and len(done.table) == 9 * 300
    raw = np.loadtxt(tmp_path / "a.csv", delimiter=",", skiprows=1)
    inside = raw[np.concatenate([20 + 320 * k + np.arange(300) for k in range(9)])]
    agree(done.table, inside[:, 4:7], np.deg2rad(inside[:, 1:4]), atol=1e-9)


def test_what_cannot_be_compensated_is_refused_in_one_line(tmp_path):
    raw_log(tmp_path / "two.ulg", made_up(), instances=(0, 1))
    said = refusal(compensate_file, CALIBRATION, tmp_path / "two.ulg", any_device=True)
    assert "holds 2 devices (imu0, imu1)" in said and "instance" in said
    (tmp_path / "folder").mkdir()
    assert "recording file is needed" in refusal(compensate_file, CALIBRATION, tmp_path / "folder")
