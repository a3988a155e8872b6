"""HDF5 and MATLAB files, written by h5py and SciPy, become the same recording."""

import numpy as np
import pytest
import scipy.io

from inertiax.data.formats import ColumnMap, Layout, matlab, read_recordings
from inertiax.data.formats.columns import LabelColumn, TimeColumn, TriadColumns
from readers_cases import campaign, check, made_up, refusal
from readers_data import matlab_73


h5py = pytest.importorskip("h5py", reason="h5py is not installed (inertiax[hdf5])")


def columns_of(data):
    plain = {"time": data["time"], "temperature": data["temperature"]}
    for key in ("accel", "gyro"):
        plain |= {f"{key}_{a}": data[key][:, k] for k, a in enumerate("xyz")}
    return plain


@pytest.mark.parametrize("layout", ["columns", "matrices", "table", "group", "nested group"])
def test_hdf5_layouts_are_read_from_a_campaign(tmp_path, layout):
    data = made_up()
    group = {"group": "imu", "nested group": "run/imu", "table": "log"}.get(layout)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        if layout == "table":
            plain = columns_of(data)
            rows = np.zeros(len(data["time"]), [(k, float) for k in plain])
            for k, v in plain.items():
                rows[k] = v
            file["log"] = rows
        else:
            place = file.require_group(group) if group else file
            for k, v in (columns_of(data) if layout == "columns" else data).items():
                place[k] = v
            file["unrelated"] = np.zeros((7, 5, 3))
            file.attrs["note"] = "made up"
    extra = f'group = "{group}"' if group else ""
    (recording,) = campaign(tmp_path, ["a.h5"], extra)
    check(recording, data)


def test_hdf5_columns_may_be_mapped_with_units_and_devices(tmp_path):
    data = made_up()
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        file["stamp"] = (1e6 * data["time"]).round().astype(np.uint64)
        file["acc"] = (data["accel"] / 9.80665).astype(np.float32)
        file["serial"] = [b"A", b"B"] * 200
    mapped = ColumnMap(
        time=TimeColumn(name="stamp", unit="us"),
        accel=TriadColumns(names=("acc_x", "acc_y", "acc_z"), unit="g"),
        device=LabelColumn("serial"),
    )
    first, second = read_recordings(tmp_path / "a.hdf5", mapped)
    assert (first.device, second.device) == ("A", "B")
    np.testing.assert_allclose(second.accel, data["accel"][1::2], rtol=1e-6)
    np.testing.assert_allclose(second.time, data["time"][1::2], rtol=1e-15)


def test_hdf5_text_of_any_length_names_devices(tmp_path):
    data = made_up()
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for k, v in data.items():
            file[k] = v
        file["device"] = np.array(["SN-1"] * len(data["time"]), dtype=h5py.string_dtype())
    (recording,) = read_recordings(tmp_path / "a.h5")
    assert recording.device == "SN-1"


def test_hdf5_links_to_other_files_are_not_followed(tmp_path):
    data = made_up()
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["gyro"] = data["gyro"]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["accel"] = data["time"], data["accel"]
        file["gyro"] = h5py.ExternalLink("other.h5", "/gyro")
    (recording,) = read_recordings(tmp_path / "a.h5")
    assert recording.gyro is None


def test_bad_hdf5_is_refused_in_one_line(tmp_path):
    data = made_up()
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for k, v in data.items():
            file[f"imu/{k}"] = v
    whole = path.read_bytes()

    message = refusal(read_recordings, path, layout=Layout(group="imo"))
    assert message == "a.h5: group 'imo' is missing; did you mean 'imu'? the file has ['imu']."
    assert "column 'time' is missing" in refusal(read_recordings, path)
    assert "topic is for ulog, ros" in refusal(read_recordings, path, layout=Layout(topic="imu"))

    path.write_bytes(whole[: len(whole) // 2])
    message = refusal(read_recordings, path, layout=Layout(group="imu"))
    assert message.startswith("a.h5: the HDF5 file is damaged or cut off")

    path.write_bytes(b"no HDF5 at all")
    assert "damaged" in refusal(read_recordings, path)

    for change, said in (
        ({"accel": data["accel"][:-1]}, "'accel_x' has 399 values but time has 400"),
        ({"time": data["time"][::-1]}, "time must increase strictly"),
        ({"gyro": np.where(np.arange(400)[:, None] == 7, np.nan, data["gyro"])}, "row 7"),
    ):
        with h5py.File(path, "w") as file:
            for k, v in (data | change).items():
                file[k] = v
        assert said in refusal(read_recordings, path)


def test_missing_library_names_the_extra(tmp_path, monkeypatch):
    import sys

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"] = [0.0]
    monkeypatch.setitem(sys.modules, "h5py", None)
    message = refusal(read_recordings, tmp_path / "a.h5")
    assert message == "a.h5: reading it needs the library h5py: pip install 'inertiax[hdf5]'."


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("struct", [None, "imu"])
def test_matlab_v5_files_are_read_from_a_campaign(tmp_path, struct, compress):
    data = made_up()
    content = {struct: data} if struct else columns_of(data)
    content |= {"note": "made up", "cells": np.array([1, "a"], dtype=object)}
    scipy.io.savemat(tmp_path / "a.mat", content, do_compression=compress, oned_as="column")
    (recording,) = campaign(tmp_path, ["a.mat"], f'group = "{struct}"' if struct else "")
    check(recording, data)


@pytest.mark.parametrize("struct", [None, "imu"])
def test_matlab_v73_files_are_read_from_a_campaign(tmp_path, struct):
    data = made_up()
    matlab_73(tmp_path / "a.mat", data, struct)
    (recording,) = campaign(tmp_path, ["a.mat"], f'group = "{struct}"' if struct else "")
    check(recording, data)


def test_three_samples_of_three_axes_are_not_transposed_twice(tmp_path):
    data = made_up(count=3)
    matlab_73(tmp_path / "a.mat", data)
    (recording,) = read_recordings(tmp_path / "a.mat")
    check(recording, data)
    scipy.io.savemat(tmp_path / "b.mat", data)
    (recording,) = read_recordings(tmp_path / "b.mat")
    check(recording, data)


def test_bad_matlab_files_are_refused_in_one_line(tmp_path):
    data = made_up()
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"imu": data})
    whole = path.read_bytes()
    assert refusal(read_recordings, path, layout=Layout(group="imus")) == (
        "a.mat: group 'imus' is missing; did you mean 'imu'? the file has ['imu']."
    )
    for part in (whole[:200], whole[: len(whole) // 2]):
        path.write_bytes(part)
        message = refusal(read_recordings, path, layout=Layout(group="imu"))
        assert message.startswith("a.mat: the MATLAB file is damaged or cut off")
    matlab_73(path, data)
    path.write_bytes(path.read_bytes()[:2000])
    assert "damaged or cut off" in refusal(read_recordings, path)
    scipy.io.savemat(path, {"text": "only"})
    assert refusal(read_recordings, path) == "a.mat: no numeric arrays in it."
    path.rename(tmp_path / "a.csv")
    assert refusal(read_recordings, tmp_path / "a.csv") == (
        "a.csv: the content is a MATLAB file but the suffix is '.csv'; rename it to .mat or write "
        '[recordings] format = "matlab".'
    )


@pytest.mark.parametrize("lying", [False, True])
def test_rows_of_zeros_at_the_end_of_an_array_made_in_advance_are_left_out(tmp_path, lying):
    """Stamps first, as a script fills it; an array whose first column does not rise is left as it is."""
    rng = np.random.default_rng(2)
    values = np.zeros((500, 4))
    values[:400, 0] = 0.01 * np.arange(1, 401)
    values[:400, 1:] = rng.standard_normal((400, 3))
    scipy.io.savemat(tmp_path / "a.mat", {"buffer": values.T if lying else values})
    table = matlab.decode(tmp_path / "a.mat")
    np.testing.assert_array_equal(table.to_numpy(), values[:400])
    values[:400, 0] = rng.standard_normal(400)
    scipy.io.savemat(tmp_path / "b.mat", {"buffer": values})
    assert matlab.decode(tmp_path / "b.mat").height == 500
