"""`inertiax export`: files, what it says of losses, and how it refuses."""

import json
import sys

import numpy as np
import pytest

from exports_cases import agree, calibration, HIGH, LOW, NOISE, ours, samples
from inertiax.calibration import read_calibration, write_calibration
from inertiax.cli import main
from inertiax.exports import by_name, FORMATS
from inertiax.exports.registry import read_calibration_of
from inertiax.temperature import Polynomial


def run(capsys, monkeypatch, *arguments):
    """Status, standard output and standard error of one command."""
    # With this set the command leaves JAX's cache alone, which the other tests share.
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    arguments = [str(a) for a in arguments]
    monkeypatch.setattr(sys, "argv", ["inertiax", *arguments])
    with pytest.raises(SystemExit) as exit:
        main(arguments)
    said = capsys.readouterr()
    return int(exit.value.code or 0), said.out, said.err


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "calibration.json"
    write_calibration(calibration(Polynomial(2, LOW, HIGH)), path)
    return path


def test_a_lossy_export_says_what_it_loses_and_how_much(capsys, monkeypatch, file):
    status, out, err = run(capsys, monkeypatch, "export", file, "--to", "realsense")
    assert status == 0
    written = file.with_name("calibration.realsense.json")
    assert out.strip() == f"realsense: {written}" and written.is_file()
    assert "loses dependence on temperature: the parameters are those at 15 °C" in err
    assert "loses the gyros' g-sensitivity" in err
    assert "differs from the calibration's by up to" in err and "m/s²" in err


def test_the_result_is_printed_as_json_and_settings_are_taken(capsys, monkeypatch, file, tmp_path):
    to = tmp_path / "out" / "x.json"
    arguments = ["export", file, "--to", "imucal", "-o", to, "--json"]
    status, out, _ = run(capsys, monkeypatch, *arguments, "--set", "temperature=60")
    said = json.loads(out)
    assert status == 0 and said["files"] == [str(to)]
    assert said["error"]["low"] == LOW and said["error"]["force"] > 0
    assert json.loads(to.read_text())["comment"].endswith("60 degC")


def test_formats_of_two_files_write_both(capsys, monkeypatch, file, tmp_path):
    arguments = ["export", file, "--to", "imu_tk", "-o", tmp_path / "a.calib", "-q"]
    status, out, _ = run(capsys, monkeypatch, *arguments)
    assert status == 0 and out == ""
    assert (tmp_path / "a_acc.calib").is_file() and (tmp_path / "a_gyro.calib").is_file()


def test_another_tools_file_is_brought_in(capsys, monkeypatch, tmp_path):
    from inertiax.exports import export

    cal = calibration(d=False)
    source = tmp_path / "theirs.json"
    source.write_bytes(export(cal, "basalt", **NOISE["basalt"]).content)
    to = tmp_path / "ours.json"
    arguments = ["export", source, "--from", "basalt", "--to", "inertiax", "-o", to]
    assert run(capsys, monkeypatch, *arguments)[0] == 0
    accel, gyro, temperature = samples(20)
    frame = export(cal, "basalt", **NOISE["basalt"]).frame
    expected = [x @ frame.T for x in ours(cal, accel, gyro, temperature)]
    agree(ours(read_calibration(to), accel, gyro, temperature), expected, tolerance=1e-12)


def test_a_gyro_file_is_read_as_such(capsys, monkeypatch, file, tmp_path):
    arguments = ["export", file, "--to", "imu_tk", "-o", tmp_path / "a.calib", "-q"]
    assert run(capsys, monkeypatch, *arguments)[0] == 0
    to = tmp_path / "b.json"
    arguments = ["export", tmp_path / "a_gyro.calib", "--from", "imu_tk", "--to", "inertiax"]
    arguments += ["-o", to, "-q", "--read"]
    assert run(capsys, monkeypatch, *arguments, "kind=gyro")[0] == 0
    assert read_calibration(to).accel is None and read_calibration(to).gyro is not None
    status, _, err = run(capsys, monkeypatch, *arguments, "knd=gyro")
    assert status == 1 and "reading has no setting 'knd'; known are kind" in err
    status, _, err = run(capsys, monkeypatch, *arguments, "kind=both")
    assert status == 1 and "kind = 'both'" in err


def test_the_list_names_every_format_with_what_it_keeps_and_loses(capsys, monkeypatch):
    status, out, _ = run(capsys, monkeypatch, "export", "--list")
    assert status == 0
    for module in FORMATS:
        assert f"{module.NAME}: {module.TITLE}" in out
        assert module.KEEPS in out and module.LOSES in out
    status, out, _ = run(capsys, monkeypatch, "export", "--list", "--json")
    rows = {r["format"]: r for r in json.loads(out)["formats"]}
    assert rows["c"]["settings"] == ["name", "dtype"] and rows["imucal"]["imports"]
    assert not rows["kalibr"]["imports"]


@pytest.mark.parametrize(
    "arguments, status, said",
    [
        (["--to", "kalib"], 2, "did you mean 'kalibr'?"),
        ([], 2, "--to FORMAT"),
        (["--to", "imucal", "--set", "temperature"], 2, "must be KEY=VALUE"),
        (
            ["--to", "imucal", "--set", "temprature=3"],
            1,
            "no setting 'temprature'; did you mean 'temperature'?",
        ),
        (["--to", "imucal", "--set", "temperature=warm"], 1, "temperature = 'warm'"),
        (["--to", "imucal", "--set", "temperature=200"], 1, "outside the calibrated -40 to 70 °C"),
        (["--to", "kalibr"], 1, "accelerometer_noise_density must be a positive number"),
        (["--to", "c", "--set", "name=1x"], 1, "must be a C identifier"),
        (["--to", "px4", "--set", "instance=4"], 1, "instance = 4 must be within 0 to 3"),
        (["--to", "c", "--from", "imucal"], 1, "imucal: units"),
        (["--to", "inertiax"], 2, "is the calibration itself"),
    ],
)
def test_wrong_usage_and_wrong_settings_are_one_line(
    capsys, monkeypatch, file, arguments, status, said
):
    found, _, err = run(capsys, monkeypatch, "export", file, *arguments)
    assert found == status and said in " ".join(err.replace("│", " ").split())
    assert sorted(p.name for p in file.parent.iterdir()) == ["calibration.json"]


def test_files_that_are_no_such_thing_are_refused_in_one_line():
    for name, content, said in (
        ("imucal", b"{}", "imucal: units"),
        ("imu_tk", b"1 2 3", "a .calib holds 21 numbers"),
        ("basalt", b'{"value0": {}}', "calib_accel_bias must be 9 numbers"),
        ("azure", b"{}", "no InertialSensors entry"),
        ("aria", b"{}", "0 IMUs for label"),
        ("realsense", b"{}", "'imus' must list one IMU"),
        ("px4", b"", "no TC_* or CAL_* parameters"),
        ("ardupilot", b"", "no INS_TCAL1_*"),
    ):
        with pytest.raises(ValueError, match=None) as caught:
            by_name(name).read(content)
        assert said in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="imucal: not valid JSON"):
        read_calibration_of(b"{", "imucal")
    with pytest.raises(ValueError, match="kalibr: files cannot be read back"):
        read_calibration_of(b"", "kalibr")
    scale = np.diag([0.0024] * 3)
    text = "\n".join(" ".join(map(str, r)) for r in [*np.eye(3), *scale]) + "\n33000\n33000\n32000"
    with pytest.raises(ValueError, match="convert raw counts"):
        by_name("imu_tk").read(text.encode())
