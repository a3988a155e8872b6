"""No command replaces what it reads, by whatever path or link; and an export replaces exports alone."""

import os
import shutil

import polars as pl
import pytest

from bad_inputs_cases import CSV, good_calibration, TABLE, TOML
from command_runs import place, run
from inertiax.exports.replaced_file import is_of_kind


GOOD = good_calibration(thermal=False)
READ = "is read by this command, and would be replaced; name another place."
RECORDING = "is a recording of a campaign, and would be replaced; name another place."


@pytest.fixture
def here(tmp_path, monkeypatch):
    files = {"c/campaign.toml": TOML, "c/a.csv": CSV, "log.csv": CSV, "r/calibration.json": GOOD}
    place(tmp_path, files)
    TABLE.write_parquet(tmp_path / "log.parquet")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(here, capsys, monkeypatch, said, *arguments):
    """A command is refused in one line, with status 2, and no file is another one afterwards."""
    kept = lambda: {p: p.read_bytes() for p in here.rglob("*") if p.is_file()}
    before = kept()
    status, out, err = run(capsys, monkeypatch, *arguments)
    assert (status, out) == (2, "") and err.count("\n") == 1 and said in err, err
    assert kept() == before


def linked(here, name, kind):
    """Another way to call a file."""
    if kind == "spelling":
        return f"r/../{name}"
    if kind == "absolute":
        return here / name
    other = here / f"other{os.path.splitext(name)[1]}"
    (os.symlink if kind == "symlink" else os.link)(here / name, other)
    return other


LINKS = pytest.mark.parametrize("kind", ["spelling", "absolute", "symlink", "hard link"])


@LINKS
@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_compensate_does_not_replace_its_recording(here, name, kind, capsys, monkeypatch):
    asked = ("compensate", "r/calibration.json", name, "-o", linked(here, name, kind))
    refused(here, capsys, monkeypatch, READ, *asked)


def test_compensate_replaces_no_recording_of_a_campaign_but_its_own_results(
    here, capsys, monkeypatch
):
    made = ("compensate", "r/calibration.json")
    refused(here, capsys, monkeypatch, RECORDING, *made, "log.csv", "-o", "c/a.csv")
    shutil.copy("log.csv", "c/a.other.csv")
    refused(here, capsys, monkeypatch, RECORDING, *made, "c/a.csv", "-o", "c/a.other.csv")
    for _ in range(2):  # a glob of the campaign names it, too, but it is no recording
        status, _, err = run(capsys, monkeypatch, *made, "c/a.csv", "-o", "c/a.done.csv", "-q")
        assert status == 0, err
    assert "extrapolated" in pl.read_csv("c/a.done.csv").columns


@LINKS
def test_export_does_not_replace_its_calibration(here, kind, capsys, monkeypatch):
    where = linked(here, "r/calibration.json", kind)
    asked = ("export", "r/calibration.json", "--to", "c", "-o", where)
    refused(here, capsys, monkeypatch, READ, *asked)


def test_export_replaces_exports_alone(here, capsys, monkeypatch):
    asked = ("export", "r/calibration.json", "--to", "c", "-q", "-o")
    refused(here, capsys, monkeypatch, RECORDING, *asked, "c/a.csv")
    no_export = "is there already, and is no file that --to c writes"
    refused(here, capsys, monkeypatch, no_export, *asked, "log.csv")
    for _ in range(2):
        status, _, err = run(capsys, monkeypatch, *asked, "new.h")
        assert status == 0, err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("learn-noise c -o c/campaign.toml", READ),
        ("learn-noise c -o c/a.csv", READ),
        ("diagnose c --calibration r/calibration.json -o r", READ),
        ("fleet c --earlier r -o r", "is --earlier itself"),
        ("fleet c --prior p -o p", READ),
        ("fleet c --prior p/population.json -o p", READ),
        ("fleet f -o f", READ),
        ("protocol r --requirements p/protocol.json -o p", READ),
        ("design --separate p/separation.json -o p", READ),
        ("live c - --separate p -o p", READ),
        ("live c - -o s", "holds recordings already"),
    ],
)
def test_no_other_command_replaces_what_it_reads(here, arguments, said, capsys, monkeypatch):
    names = ("population.json", "protocol.json", "separation.json", "diagnosis.json")
    place(here, {**{f"p/{name}": "{}" for name in names}, "s/recording-1.csv": CSV})
    place(here, {"f/campaign.toml": TOML.replace("a.*", "*.parquet"), "f/parts/x": ""})
    TABLE.write_parquet(here / "f/quarantine.parquet")
    refused(here, capsys, monkeypatch, said, *arguments.split())


KINDS = {
    "c": b"/* Calibration of device: A. Written by inertiax; change nothing by hand.\n */\n",
    "kalibr": b"# inertiax, parameters at 20 degC\nimu0:\n",
    "ardupilot": b"INS_ACC_ID 1\nINS_ACC2_ID 2\n",
    "px4": b"# Onboard parameters\n1\t1\tCAL_ACC0_ID\t0\t6\n",
    "imu_tk": b"1.0 0.0 0.0\n0.0 1.0 0.0\n",
    "aria": b'{\n  "ImuCalibrations": [\n  ]\n}',
    "azure": b'{"CalibrationInformation": {}}',
    "inertiax": b'{\n "schema": "inertiax.calibration/1",\n "device": "A"\n}',
    "stablehlo": b"ML\xefR\x01\0\0",
}


def test_a_file_is_of_the_kind_of_the_export_that_made_it():
    others = {"log": CSV.encode(), "diagnosis": b'{"schema": "inertiax.diagnosis/1"}', "none": b"x"}
    for name, made in KINDS.items():
        for other, there in {**KINDS, **others}.items():
            assert is_of_kind(there, made) == (name == other), (name, other)
        assert is_of_kind(b"", made) and is_of_kind(b" \n", made)
    longer = b"# another head\n1\t2\tCAL_GYRO0_ID\t7\t6\n"
    assert is_of_kind(longer, KINDS["px4"]) and is_of_kind(KINDS["px4"], longer)
    assert is_of_kind(b'{"a": 1, "CalibrationInformation" : 2}', KINDS["azure"])
