"""Requirements on a triad whose uncertainties do not hold are not decided; limits in µrad; temperatures outside."""

import json
import shutil

import numpy as np
import polars as pl
import pytest

from inertiax.calibrate.goodness_of_fit import undecidable
from inertiax.cli import main
from inertiax.data.compensated import WRONG_PARAMETERS
from inertiax.live.target import parse_limit
from inertiax.protocol import fallback_fonts
from protocol_cases import write_campaign


LIMITS = '[requirements]\n"accel.bias" = "10 g"\n"accel.misalignment" = "1 urad"\n'


def test_a_misfit_of_ten_times_the_noise_is_the_limit():
    assert undecidable("m/s^2", 1e-3, 9.9) is None
    assert "10.1 times the noise" in (undecidable("m/s^2", 1e-3, 10.1) or "")
    assert undecidable("m/s^2", 1e-3, float("nan")) is None  # the misfit is the noise figure
    assert undecidable("m/s^2", 2.6, float("nan")) is not None


def test_microradians_are_those_of_the_report():
    assert parse_limit("gyro.misalignment", "600 urad", "x") == pytest.approx(6e-4, rel=1e-12)
    assert parse_limit("accel.matrix", "600 µrad", "x") == pytest.approx(6e-4, rel=1e-12)


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([*map(str, arguments), "-q"])
    return int(ended.value.code or 0)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound")
    assert run("calibrate", write_campaign(folder / "c"), "-o", folder / "r") == 0
    return folder / "r"


def protocol(result, folder, *more: object) -> dict:
    folder.mkdir(exist_ok=True)
    (folder / "limits.toml").write_text(LIMITS)
    asked = ("--requirements", folder / "limits.toml", *more)
    assert run("protocol", result, "-o", folder / "p", *asked) == 0
    return json.loads((folder / "p" / "protocol.json").read_text())


def test_a_sound_fit_is_decided(sound, tmp_path):
    bias, _ = protocol(sound, tmp_path)["requirements"]
    assert (bias["decision"], bias["reason"]) == ("pass", "")


@pytest.mark.slow
def test_rests_that_differ_by_fifty_times_their_noise_decide_nothing(tmp_path):
    folder = write_campaign(tmp_path / "c")
    table = pl.read_csv(folder / "0.csv")
    # A dwell's mean is known to 1e-4 / sqrt(20) = 2e-5 m/s²; rests are off by 1e-3.
    off = np.random.default_rng(7).normal(0.0, 1e-3, (42, 3)).repeat(20, axis=0)
    moved = {f"accel_{a}": table[f"accel_{a}"] + off[:, i] for i, a in enumerate("xyz")}
    table.with_columns(**moved).write_csv(folder / "0.csv")
    assert run("calibrate", folder, "-o", tmp_path / "r") == 0
    made = protocol(tmp_path / "r", tmp_path)
    assert [r["decision"] for r in made["requirements"]] == ["undecided", "undecided"]
    assert all("times the noise" in r["reason"] for r in made["requirements"])
    page = (tmp_path / "p" / "protocol.html").read_text()
    assert "not decided, because" in page and "rule of `calibrate`" not in page


def test_a_calibration_not_to_be_used_yet_says_so_wherever_it_goes(sound, tmp_path, capfd):
    shutil.copytree(sound, tmp_path / "r")
    file, record = tmp_path / "r" / "calibration.json", tmp_path / "r" / "record.json"
    export = ("export", file, "--to", "c", "-o", tmp_path / "a.h")
    assert run(*export) == 0
    assert "do not use it" not in capfd.readouterr().err
    doubt = {"verdict": "doubtful", "findings": ["Accelerometers: axis z has the wrong sign."]}
    record.write_text(json.dumps(json.loads(record.read_text()) | doubt))
    line = f"{file}: do not use it yet: Accelerometers: axis z has the wrong sign."
    assert run(*export) == 0
    assert line in capfd.readouterr().err
    assert run("compensate", file, sound.parent / "c" / "0.csv", "-o", tmp_path / "o.csv") == 0
    assert line in capfd.readouterr().err


def test_parameters_of_corrected_outputs_are_said_to_be_wrong(sound, tmp_path, capfd):
    shutil.copytree(sound, tmp_path / "r")
    file, record = tmp_path / "r" / "calibration.json", tmp_path / "r" / "record.json"
    said = f"a.bin IMU[0]: its accel values are after INS_ACCOFFS: {WRONG_PARAMETERS}."
    record.write_text(json.dumps(json.loads(record.read_text()) | {"warnings": ["other", said]}))
    for name, told in (("ardupilot", True), ("px4", True), ("c", False)):
        assert run("export", file, "--to", name, "-o", tmp_path / f"a.{name}") == 0
        assert (said in capfd.readouterr().err) == told


def test_a_name_that_no_font_has_is_told_in_one_line(sound, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(fallback_fonts, "installed_fonts", list)
    station = tmp_path / "station.toml"
    station.write_text('[station]\nname = "北京计量实验室"\n', encoding="utf-8")
    assert run("protocol", sound, "-o", tmp_path / "p", "--station", station, "-q") == 0
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert "protocol.pdf shows □ for 7 characters" in line and "protocol.html is complete" in line
    assert "北京计量实验室" in (tmp_path / "p" / "protocol.html").read_text(encoding="utf-8")


def test_results_go_on_outside_the_range_by_two_percent_and_the_page_says_so(
    sound, tmp_path, capfd
):
    made = protocol(sound, tmp_path, "--at=-0.7,20")  # of 0 to 40 °C
    assert made["results"][0]["at"] == -0.7
    assert (
        "the curves go on beyond the calibrated" in (tmp_path / "p" / "protocol.html").read_text()
    )
    assert run("protocol", sound, "-o", tmp_path / "q", "--at=-0.9,20") == 2
    assert "by more than 0.8 °C" in capfd.readouterr().err
