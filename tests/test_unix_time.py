"""Stamps in seconds since 1970: days of a protocol, and moments in a diagnosis' words."""

import dataclasses
import json
from datetime import datetime, UTC
from xml.etree import ElementTree

import numpy as np
import polars as pl
import pytest

from command_runs import run
from diagnose_data import only, sweep
from inertiax.calibration.effect_units import Shown, shown_parameter
from inertiax.data.recorded import recorded
from inertiax.data.recording import Recording
from inertiax.diagnose import diagnose
from inertiax.report.diagnosis import _place_section
from protocol_cases import write_campaign


START = datetime(2026, 1, 31, 23, 59, 30, tzinfo=UTC).timestamp()


def log(begin: float, step: float = 0.01, rows: int = 100) -> Recording:
    return Recording(time=begin + step * np.arange(rows), accel=np.full((rows, 3), 5.0))


def test_days_and_rate_of_what_was_recorded():
    found = recorded([log(START), log(START + 86400.0)])
    assert (found.begin, found.end) == (START, START + 86400.0 + 0.99)
    assert found.sample_rate == pytest.approx(100.0)


@pytest.mark.parametrize("begin", [0.0, 12361.5, 3.2e9])
def test_another_clock_tells_no_day(begin):
    assert recorded([log(begin), log(START)]).begin is None


def test_recordings_of_two_rates_have_no_usual_one():
    assert recorded([log(0.0), log(0.0, 0.005)]).sample_rate is None


@pytest.mark.slow
def test_a_protocol_has_the_days_of_its_recordings(tmp_path, capsys, monkeypatch):
    """Half a minute before midnight (UTC) to the next day."""
    folder = write_campaign(tmp_path / "campaign")
    table = pl.read_csv(folder / "0.csv")
    table.with_columns(pl.col("time") + START).write_csv(folder / "0.csv")
    made, out = tmp_path / "made", tmp_path / "out"
    assert run(capsys, monkeypatch, "calibrate", folder, "-o", made)[0] == 0
    assert run(capsys, monkeypatch, "protocol", made, "-o", out)[0] == 0
    conditions = json.loads((out / "protocol.json").read_text())["conditions"]
    assert conditions["begin"] == "2026-01-31T23:59:30Z"
    assert conditions["end"] == "2026-02-01T00:01:34Z"  # 124.9 s later
    assert "2026-01-31 to 2026-02-01, by the recordings" in (out / "protocol.html").read_text()
    root = ElementTree.parse(out / "dcc.xml").getroot()
    day = "{https://ptb.de/dcc}%sPerformanceDate"
    assert root.findtext(f".//{day % 'begin'}") == "2026-01-31"
    assert root.findtext(f".//{day % 'end'}") == "2026-02-01"


def test_a_moment_is_shown_from_the_first_row_on():
    at = Shown(START + 2699.5, 1.2, "s")
    assert shown_parameter("bias_step", "time", at, START) == (
        "2699.5",
        "1.2",
        "s after the first row",
    )
    assert shown_parameter("bias_step", "time (accel_x)", at, START)[0] == "2699.5"
    # A time constant is no moment, and a log's own clock is quoted as it is.
    assert shown_parameter("warm_up", "time_constant", Shown(310.0, 12.0, "s"), START)[2] == "s"
    assert shown_parameter("bias_step", "time", Shown(2699.5, 1.2, "s"), 0.0)[2] == "s"


@pytest.mark.slow
def test_a_diagnosis_speaks_of_the_first_row(tmp_path):
    campaign = sweep(seed=8, effect=lambda probe, t: only(1, 8e-6 * (t > 2700.0)))
    (first,) = campaign.recordings
    later = dataclasses.replace(first, time=first.time + START)
    found = diagnose(dataclasses.replace(campaign, recordings=(later,)))
    assert "time 2699." in found.summary and "s after the first row" in found.summary
    assert f"{START + 2699:.0f}" not in found.summary + found.effects[0].statement
    time = dict(found.effects[0].parameters)["time"]  # the file keeps the recordings' clock
    assert abs(time.value - START - 2700.0) < 20.0
    (table,) = _place_section(found, tmp_path, None)[0].tables
    assert table.head[2] == "start, s after the first row" and float(table.rows[0][2]) < 5000.0
