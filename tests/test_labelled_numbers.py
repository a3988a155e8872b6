"""Rows printed for people or a plotter: refused, with a command that is run here."""

import shutil
import subprocess

import numpy as np
import pytest

from hand_log_data import draft, hand_log
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()
STATUS = "Calibration status: sys 3, gyro 3, accel 0, mag 3\n"
FORMS = {
    "a status between the rows": (
        STATUS
        + "Accel X = {1:.5f}, Y = {2:.5f}, Z = {3:.5f}, gx = {4:.6f}, gy = {5:.6f}, gz = {6:.6f}\n",
        ["Accel X", "Accel Y", "Accel Z"],
    ),
    "a clock without a label": (
        "{0:.2f},ACC: X={1:.5f},Y={2:.5f},Z={3:.5f},GYRO: X={4:.6f},Y={5:.6f},Z={6:.6f}\n",
        ["ACC: X", "ACC: Y", "ACC: Z"],
    ),
    "a plotter": (
        "t:{0:.2f}\tax:{1:.5f}\tay:{2:.5f}\taz:{3:.5f}\tgx:{4:.6f}\tgy:{5:.6f}\tgz:{6:.6f}\n",
        ["ax", "ay", "az"],
    ),
    "stamps, words and units beside": (
        "2025-10-04 16:35:{0:06.3f},EULER(deg): R=1.70,P=9.24,Y=9.59,GYRO: X={4:.6f},Y={5:.6f},Z={6:.6f},"
        "ACCEL: X={1:.5f},Y={2:.5f},Z={3:.5f},MAG: X=57.468,Y=-27.401,Z=53.271,BARO_ALT: 165.81m,GPS: 3D_FIX,SAT=4,"
        "iTOW=558330000ms\n",
        ["ACCEL: X", "ACCEL: Y", "ACCEL: Z"],
    ),
}


@pytest.mark.skipif(shutil.which("sed") is None, reason="no sed")
@pytest.mark.parametrize(("form", "names"), FORMS.values(), ids=FORMS)
def test_the_command_makes_columns_under_the_labels_names(tmp_path, form, names):
    """Of a public log of a BNO055 the command left the lines of its status, at which `init` failed again."""
    path = tmp_path / "log.txt"
    rows = [form.format(t, *a, *w) for t, a, w in zip(TIME, ACCEL, GYRO, strict=True)]
    last = (
        "" if "iTOW" in form else "Shutting down...\n"
    )  # words that are data leave no telling what is none
    path.write_text("".join(rows) + last)
    with pytest.raises(ValueError, match="numbers stand behind labels") as refused:
        draft(path)
    command = str(refused.value).split("take those out: ")[1]
    subprocess.run(command, shell=True, check=True, cwd=tmp_path)
    assert draft(tmp_path / "numbers_log.csv")["columns"]["accel"]["names"] == names
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.accel, ACCEL, atol=1e-5)
    np.testing.assert_allclose(recording.gyro, GYRO, atol=1e-6)


@pytest.mark.skipif(shutil.which("sed") is None, reason="no sed")
@pytest.mark.parametrize("between", [" ", ", ", "\t"])
def test_numbers_in_brackets_become_columns(tmp_path, between):
    path = tmp_path / "log.txt"
    three = lambda v: f"({v[0]:.5f}, {v[1]:.5f}, {v[2]:.5f})"
    rows = [
        f"RAW 0x68: accel={three(a)}{between}gyro={three(w)}{between}temp=25.1\n"
        for a, w in zip(ACCEL, GYRO, strict=True)
    ]
    path.write_text("MPU6050 found (0x68)\n" + "".join(rows))
    with pytest.raises(ValueError, match="numbers stand in brackets") as refused:
        draft(path)
    command = str(refused.value).split("make columns of them: ")[1]
    subprocess.run(command, shell=True, check=True, cwd=tmp_path)
    found = np.genfromtxt(tmp_path / "numbers_log.csv", delimiter=",", names=True)
    names = tuple(f"{t}_{a}" for t in ("accel", "gyro") for a in "xyz")
    assert found.dtype.names == names
    columns = np.stack([found[name] for name in names], axis=1)
    np.testing.assert_allclose(columns, np.hstack([ACCEL, GYRO]), atol=1e-5)


def test_labels_that_change_name_no_columns(tmp_path):
    path = tmp_path / "log.txt"
    rows = [f"a{k % 2}: {a[0]},b: {a[1]},c: {a[2]}\n" for k, a in enumerate(ACCEL)]
    path.write_text("".join(rows))
    with pytest.raises(ValueError, match="take those out: sed -E"):
        draft(path)


@pytest.mark.skipif(shutil.which("sed") is None, reason="no sed")
@pytest.mark.parametrize(
    "stamp",
    [
        "[12:30:{0:06.3f}]",
        "[2025-10-04 16:35:{0:06.3f}]",
        "[2025-10-04T16:35:{0:06.3f}]",
        "[{0:.3f}]",
    ],
)
@pytest.mark.parametrize("between", [" ", ", "])
def test_stamps_in_brackets_stay_as_the_time(tmp_path, stamp, between):
    """The command for the labels took the first word with its stamp out, or named it "[12"."""
    path, labels = tmp_path / "log.txt", ("ax", "ay", "az", "gx", "gy", "gz")
    form = between.join(f"{n}={{{k}:.6f}}" for k, n in enumerate(labels, 1))
    kept = TIME < 59.0  # of one minute
    rows = [
        f"{stamp} {form}\n".format(t, *a, *w)
        for t, a, w in zip(TIME[kept], ACCEL[kept], GYRO[kept], strict=True)
    ]
    path.write_text("Sensor ready\n" + "".join(rows))
    with pytest.raises(ValueError, match="labels and a stamp") as refused:
        draft(path)
    command = str(refused.value).split("make columns of them: ")[1]
    subprocess.run(command, shell=True, check=True, cwd=tmp_path)
    tables = draft(tmp_path / "numbers_log.csv")
    assert tables["columns"]["time"]["name"] == "time"
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.time - recording.time[0], TIME[kept] - TIME[0], atol=6e-4)
    np.testing.assert_allclose(recording.accel, ACCEL[kept], atol=1e-5)
