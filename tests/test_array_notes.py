"""What MATLAB and HDF5 files say beside their arrays: `Fs`, `UNITS.gyro`.

As the public logs of tags for animals hold them: `Fs = 50`, a struct UNITS of texts, and no column of times.
"""

import numpy as np
import pytest
import scipy.io

from hand_log_data import DEGREE, draft, G
from inertiax.data.campaign import load_campaign
from inertiax.data.formats import matlab
from inertiax.data.formats.array_notes import array_notes, words_of
from readers_data import matlab_73


ROWS = 1500
RNG = np.random.default_rng(2)
ACCEL = np.array([0.0, 0.0, G]) + 0.02 * RNG.standard_normal((ROWS, 3))
GYRO = np.array([0.01, -0.02, 0.0]) + 0.001 * RNG.standard_normal((ROWS, 3))  # rad/s


def saved(path, **content):
    scipy.io.savemat(path, {"accel": ACCEL.T, "gyro": GYRO.T, **content})
    return path


def test_a_scalar_fs_is_the_rate(tmp_path):
    found = draft(saved(tmp_path / "x_down.mat", Fs=np.uint8(50)))
    assert found["columns"]["time"] == {"rate": 50.0}
    text = (tmp_path / "campaign.toml").read_text()
    assert "# time: Fs in the file states the rate" in text
    (recording,) = load_campaign(tmp_path).recordings
    assert recording.time[-1] == pytest.approx((ROWS - 1) / 50.0)


def test_a_scalar_that_may_be_another_rate_is_to_be_checked(tmp_path):
    found = draft(saved(tmp_path / "x_down.mat", rate=30.0))
    assert found["columns"]["time"] == {"rate": 30.0}
    assert "# CHECK time: rate in the file may be" in (tmp_path / "campaign.toml").read_text()


def test_stamps_come_before_the_rate(tmp_path):
    time = np.arange(ROWS) / 100.0
    found = draft(saved(tmp_path / "x_down.mat", time=time, Fs=50.0))
    assert found["columns"]["time"]["name"] == "time"


@pytest.mark.parametrize("unit, size", [("rad/s", 1.0), ("deg/s", DEGREE), ("°/s", DEGREE)])
@pytest.mark.parametrize("packed", [False, True])
def test_texts_tell_units(tmp_path, unit, size, packed):
    """Of a device at rest nothing else tells them; the draft guessed, and marked it CHECK."""
    units = {"accel": "m/s^2", "gyro": unit, "Fs": "Hz"}
    content = {"accel": ACCEL, "gyro": GYRO, "Fs": 50.0, "UNITS": units}
    scipy.io.savemat(tmp_path / "x_down.mat", content, do_compression=packed)
    found = draft(tmp_path / "x_down.mat")["columns"]
    assert found["gyro"]["unit"] == {1.0: "rad/s", DEGREE: "deg/s"}[size]
    text = (tmp_path / "campaign.toml").read_text()
    assert "CHECK gyro" not in text and "# gyro: as the file says" in text
    (recording,) = load_campaign(tmp_path).recordings
    assert np.allclose(recording.gyro, size * GYRO)


def test_v73_states_its_rate(tmp_path):
    pytest.importorskip("h5py")
    matlab_73(tmp_path / "x_down.mat", {"accel": ACCEL, "gyro": GYRO, "Fs": np.array([[50.0]])})
    assert draft(tmp_path / "x_down.mat")["columns"]["time"] == {"rate": 50.0}


def test_texts_are_no_columns(tmp_path):
    """Nor is one of several lines, or a cell, of any."""
    lines = np.array(["one  ", "other"])
    path = saved(tmp_path / "a.mat", SN="0100019894", lines=lines, cell=np.array(["a"], object))
    assert matlab.decode(path).columns == [f"{k}_{x}" for k in ("accel", "gyro") for x in "xyz"]


@pytest.mark.parametrize(
    "scalars, rate, sure",
    [
        ({"Fs": 50}, 50.0, True),
        ({"log/sample_rate": 200, "rate": 30}, 200.0, True),
        ({"a/fs": 100, "b/fs": 50}, None, False),
        ({"a/fs": 100, "b/fs": 100}, 100.0, True),
        ({"freq": 0.1}, None, False),
        ({"offs": 50, "first": 2, "temperature_rate": 5}, None, False),
    ],
)
def test_which_scalars_are_a_rate(scalars, rate, sure):
    found = array_notes({k: np.array([[v]]) for k, v in scalars.items()}, {})
    assert (found.rate, found.sure) == (rate, sure)


@pytest.mark.parametrize(
    "name, columns, told",
    [
        ("UNITS/gyro", ("gyro_x", "gyroscope_x"), {"gyro_x": "rad/s"}),
        ("gyro/units", ("gyro/data_x", "accel/data_x"), {"gyro/data_x": "rad/s"}),
        ("gyro_unit", ("gyro_x",), {"gyro_x": "rad/s"}),
        ("units", ("w_x", "w_y", "w_z"), dict.fromkeys(("w_x", "w_y", "w_z"), "rad/s")),
        ("units", ("w_x", "w_y", "w_z", "a_x"), {}),
        ("community", ("w_x",), {}),
    ],
)
def test_whose_unit_a_text_is(name, columns, told):
    assert words_of(array_notes({}, {name: "rad/s"}), columns) == told
