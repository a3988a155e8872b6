"""`inertiax export`: files, what it says of losses, and how it refuses."""

import json
import re

import numpy as np
import pytest

from command_runs import run
from exports_cases import agree, calibration, HIGH, LOW, NOISE, ours, samples
from inertiax.allan import noise_of
from inertiax.calibration.calibration import read_calibration, write_calibration
from inertiax.data.recording import Recording
from inertiax.exports import by_name, FORMATS
from inertiax.exports.registry import read_calibration_of
from inertiax.physics.temperature import Polynomial
from inertiax.report.noise import noise_document


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "calibration.json"
    write_calibration(calibration(Polynomial(2, LOW, HIGH)), path)
    return path


@pytest.mark.slow
def test_a_lossy_export_says_what_it_loses_and_how_much(capsys, monkeypatch, file):
    status, out, err = run(capsys, monkeypatch, "export", file, "--to", "realsense")
    assert status == 0
    written = file.with_name("calibration.realsense.json")
    assert out.strip() == f"realsense: {written}" and written.is_file()
    assert "loses dependence on temperature: the parameters are those at 15 °C" in err
    assert "loses the gyros' g-sensitivity" in err
    assert "differ from the calibration's by up to" in err and "m/s²" in err


def test_the_result_is_printed_as_json_and_settings_are_taken(capsys, monkeypatch, file, tmp_path):
    to = tmp_path / "out" / "x.json"
    arguments = ["export", file, "--to", "imucal", "-o", to, "--json"]
    status, out, _ = run(capsys, monkeypatch, *arguments, "--set", "temperature=60")
    said = json.loads(out)
    assert status == 0 and said["files"] == [str(to)]
    assert said["error"]["low"] == LOW and said["error"]["force"] > 0
    assert json.loads(to.read_text())["comment"].endswith("60 degC")


def noise_file(folder, logs):
    """What `inertiax noise` writes of logs with the given devices; the y axis is the worst."""
    rng = np.random.default_rng(0)
    size = np.array([1e-3, 4e-3, 1e-3])
    made = [
        noise_of(
            Recording(
                time=np.arange(4096) / 200.0,
                accel=size * rng.normal(size=(4096, 3)),
                gyro=0.1 * size * rng.normal(size=(4096, 3)),
                position=np.zeros(4096, int),
                device=device,
            )
        )
        for device in logs
    ]
    path = folder / "noise.json"
    path.write_text(json.dumps(noise_document(made)))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, density, walks, rate",
    [
        (
            "kalibr",
            "accelerometer_noise_density",
            ("accelerometer_random_walk", "gyroscope_random_walk"),
            "update_rate",
        ),
        ("basalt", "accel_noise_std", ("accel_bias_std", "gyro_bias_std"), "imu_update_rate"),
    ],
)
def test_noise_comes_from_the_noise_commands_document(
    capsys, monkeypatch, file, tmp_path, name, density, walks, rate
):
    noise = noise_file(tmp_path, ["another", "SN 7"])
    to = tmp_path / "out"
    arguments = ["export", file, "--to", name, "-o", to, "--noise", noise]
    # Twenty seconds of white noise determine no random walk: it is not exported, and the user is told.
    status, _, err = run(capsys, monkeypatch, *arguments, "--set", f"{walks[1]}=3e-6")
    assert status == 1 and not to.exists()
    assert f"the log does not determine {walks[0]} (K of accel; at most" in err
    assert walks[1] not in err and err.strip().count("\n") == 0
    given = ["--set", f"{walks[0]}=2e-5", "--set", f"{walks[1]}=3e-6"]
    status, _, err = run(capsys, monkeypatch, *arguments, *given)
    assert status == 0, err
    text = to.read_text()
    numbers = lambda key: [float(x) for x in re.findall(rf'{key}"?:\s*\[?\s*([-\d.e]+)', text)]
    # The worst axis: 4e-3 m/s² at 200 Hz is 2.83e-4 m/s²/√Hz; 4096 samples tell it to 1.1 %, with a filter's
    # attenuation left open to 2.4 %.
    np.testing.assert_allclose(numbers(density), 4e-3 / np.sqrt(200.0), rtol=0.07)
    np.testing.assert_allclose(numbers(rate), 200.0, rtol=1e-6)
    assert numbers(walks[0]) == [2e-5] and numbers(walks[1]) == [3e-6]


@pytest.mark.slow
def test_noise_that_does_not_fit_is_refused_in_one_line(capsys, monkeypatch, file, tmp_path):
    noise = noise_file(tmp_path, ["A", "B"])
    arguments = ["export", file, "--to", "kalibr", "-o", tmp_path / "x", "--noise"]
    status, _, err = run(capsys, monkeypatch, *arguments, noise)
    assert status == 1 and "0 of 2 logs are of device 'SN 7'" in err
    status, _, err = run(capsys, monkeypatch, *arguments, file)
    assert status == 1 and "not a document of `inertiax noise`" in err
    arguments[3] = "imu_tk"
    status, _, err = run(capsys, monkeypatch, *arguments, noise)
    assert status == 2 and "imu_tk: the format holds no noise figures" in err


def test_formats_of_two_files_write_both(capsys, monkeypatch, file, tmp_path):
    arguments = ["export", file, "--to", "imu_tk", "-o", tmp_path / "a.calib", "-q"]
    status, out, _ = run(capsys, monkeypatch, *arguments)
    assert status == 0 and out == ""
    assert (tmp_path / "a_acc.calib").is_file() and (tmp_path / "a_gyro.calib").is_file()


@pytest.mark.slow
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
    assert status == 2 and "reading has no setting 'knd'; known are kind" in err
    status, _, err = run(capsys, monkeypatch, *arguments, "kind=both")
    assert status == 2 and "kind = 'both'" in err


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
            2,
            "no setting 'temprature'; did you mean 'temperature'?",
        ),
        (["--to", "imucal", "--set", "temperature=warm"], 2, "temperature = 'warm'"),
        (["--to", "imucal", "--set", "temperature=200"], 2, "outside the calibrated -40 to 70 °C"),
        (["--to", "kalibr"], 2, "accelerometer_noise_density must be a positive number"),
        (["--to", "c", "--set", "name=1x"], 2, "must be a C identifier"),
        (["--to", "px4", "--set", "instance=4"], 2, "instance = 4 must be within 0 to 3"),
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
