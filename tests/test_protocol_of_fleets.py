"""The protocol of a fleet's device beside that of the same device calibrated alone, and what the run keeps for it."""

import hashlib
import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate_device, DeviceResult
from inertiax.calibration.calibration import Calibration
from inertiax.data.campaign import load_campaign
from inertiax.fleet import run_fleet
from inertiax.fleet.store import read_manifest, read_parts
from inertiax.fleet.verdicts import count_verdicts, device_grades, device_verdict
from inertiax.protocol.fleet_record import fleet_measurement
from inertiax.protocol.make_record import record_of
from inertiax.protocol.record import Record, StationRecord, TriadRecord
from inertiax.protocol.results import Result, results_at
from inertiax.protocol.sources_at import contributions
from inertiax.reduction.rounded_temperature import hidden_by_steps
from inertiax.report.calibration import report_calibration
from protocol_fleet_cases import DEVICES, RATE, SAMPLES, write_line


ROWS = 2 * 26 * SAMPLES


@pytest.fixture(scope="module")
def home(tmp_path_factory) -> Path:
    """A line on a rate table, and its run."""
    folder = tmp_path_factory.mktemp("fleet")
    write_line(folder / "line")
    run_fleet(folder / "line", folder / "run")
    return folder


@pytest.fixture(scope="module")
def alone(home) -> dict[str, DeviceResult]:
    """Every device as `calibrate` has it."""
    return {d: calibrate_device(load_campaign(home / "line" / d)) for d in DEVICES}


def _stated(calibration: Calibration, record: Record) -> dict[str, Result]:
    return {r.name: r for r in results_at(calibration, record, (20.0,), 2e-4)}


@pytest.mark.slow
def test_every_source_is_that_of_calibrate(home, alone, tmp_path):
    (tmp_path / "calibration.json").write_text("{}")
    for device in DEVICES:
        campaign = load_campaign(home / "line" / device)
        record = record_of(alone[device], campaign, tmp_path, "inertiax calibrate", ())
        one = _stated(alone[device].calibration, record)
        other = _stated(*fleet_measurement(home / "run", device))
        assert set(one) == set(other)
        for name, result in one.items():
            budget, same = dict(result.budget), dict(other[name].budget)
            for source, std in budget.items():
                # A fleet promises a thousandth of a sigma; a part of 1e-3 of the whole is known to a tenth of it.
                assert same.get(source, 0.0) == pytest.approx(std, rel=1e-2, abs=1e-4 * result.std)


@pytest.mark.slow
def test_the_tables_rate_is_whole_in_the_scale_factors(home):
    stated = _stated(*fleet_measurement(home / "run", "U1"))
    for axis in range(3):
        budget = dict(stated[f"gyro.matrix[{axis},{axis}]"].budget)
        # 3e-3 is the scale factor that the gyros were written with.
        assert budget["rig rate"] == pytest.approx(RATE * (1 + 3e-3), rel=1e-4)
        assert stated[f"gyro.matrix[{axis},{axis}]"].expanded > 1.96 * RATE


@pytest.mark.slow
def test_a_fit_that_is_not_taken_apart_has_the_common_rate_on_top(alone):
    calibration = alone["U1"].calibration
    station = StationRecord(9.81, None, None, RATE, None)
    whole = TriadRecord(52, 24, 0.0, 0.0, "rad/s", 144, ())
    found = {
        c.source: c.std
        for c in contributions(calibration.gyro, whole, station, None, np.array([20.0]))
    }
    own = np.sqrt(np.diag(np.asarray(calibration.gyro.covariance)))
    assert np.allclose(found["fit"][0], own, rtol=1e-9)
    diagonal = [
        k
        for k, n in enumerate(calibration.gyro.names)
        if n[-4:-1:2] in ("00", "11", "22") and "matrix" in n
    ]
    assert np.allclose(found["rig rate"][0, diagonal], RATE * (1 + 3e-3), rtol=1e-4)
    assert not found["rig rate"][0, :3].any()


@pytest.mark.slow
def test_the_verdict_is_that_of_calibrate(home, alone):
    manifest = read_manifest(home / "run")
    table = read_parts(home / "run").collect()
    rows = {row["device"]: row for row in table.iter_rows(named=True)}
    verdicts = {d: device_verdict(rows[d], manifest) for d in DEVICES}
    assert verdicts == {d: judge(alone[d]).verdict for d in DEVICES}
    assert verdicts == {"U1": "good", "U2": "usable"}
    assert device_grades(table, manifest).tolist() == [0, 1]
    assert count_verdicts(home / "run", manifest) == {"good": 1, "usable": 1, "doubtful": 0}
    _, record = fleet_measurement(home / "run", "U2")
    assert record.verdict == "usable"
    misfit = next(f.text for f in judge(alone["U2"]).findings if f.topic == "misfit" and not f.fine)
    assert record.findings == (misfit,)


@pytest.mark.slow
def test_recordings_and_inputs_are_those_that_were_read(home):
    _, record = fleet_measurement(home / "run", "U1")
    said = record.conditions
    assert (said.recordings, said.samples, said.experiments) == (2, ROWS, 2)
    assert said.seconds == pytest.approx(2 * (26 * SAMPLES - 1) * 0.1)
    assert [f.file for f in record.inputs] == ["campaign.toml", "log_0.csv", "log_1.csv"]
    for file in record.inputs:
        content = (home / "line" / "U1" / file.file).read_bytes()
        assert (file.sha256, file.bytes) == (hashlib.sha256(content).hexdigest(), len(content))
    assert record.left_out == ()
    assert (record.gyro.dwells, record.gyro.turns) == (52, 24)


@pytest.mark.slow
def test_the_report_of_calibrate_says_what_its_sigmas_do_not_hold(home, alone, tmp_path):
    campaign = load_campaign(home / "line" / "U1")
    report_calibration(alone["U1"], tmp_path, "inertiax calibrate", campaign=campaign)
    text = re.sub(r"<[^>]+>", "", (tmp_path / "report.html").read_text("utf-8"))
    assert "± holds the table&#39;s 100 ppm as an error drawn anew for each rate." in text


@pytest.mark.slow
def test_a_run_of_an_older_version_is_read(home, tmp_path):
    """Without `inputs.json` and without the columns that runs keep for protocols."""
    run = tmp_path / "run"
    (run / "parts").mkdir(parents=True)
    text = (home / "run" / "manifest.json").read_text().replace('"documented":true,', "")
    (run / "manifest.json").write_text(text.replace(',"documented":true', ""))
    kept = ("recordings", "samples", "seconds", "experiments", "warnings")
    for part in (home / "run" / "parts").iterdir():
        table = pl.read_parquet(part).drop(*kept)
        table.select([c for c in table.columns if "source" not in c]).drop(
            [f"{t}_{k}" for t in ("accel", "gyro") for k in ("dwells", "turns", "degrees")]
        ).write_parquet(run / "parts" / part.name)
    calibration, record = fleet_measurement(run, "U2")
    assert record.verdict == "usable"
    assert [f.file for f in record.inputs] == ["campaign.toml", "log_0.csv", "log_1.csv"]
    assert any("taken when the protocol was written" in t for t in record.left_out)
    assert record.conditions.samples is None
    scale = _stated(calibration, record)["gyro.matrix[0,0]"]
    assert {s for s, _ in scale.budget} == {"fit", "rig rate"} and scale.std > RATE


@pytest.mark.slow
def test_what_the_probes_steps_hide_is_that_of_calibrate(tmp_path):
    """A probe in whole degrees: the run keeps what the steps hide, and the budget has its line."""
    line = write_line(tmp_path / "line")
    toml = line / "U1" / "campaign.toml"
    for device in DEVICES:
        for log in (line / device).glob("*.csv"):
            table = pl.read_csv(log)
            ramp = np.linspace(0.0, 12.0, table.height)
            bias = [pl.col("accel_x") + 1e-3 * ramp, pl.Series("temperature", np.round(ramp))]
            table.with_columns(bias).write_csv(log)
        text = toml.read_text().replace("temperature_degree = 0", "temperature_degree = 1")
        (line / device / "campaign.toml").write_text(text)
    run_fleet(line, tmp_path / "run")
    calibration, record = fleet_measurement(tmp_path / "run", "U1")
    own = load_campaign(line / "U1")
    hidden = hidden_by_steps(own.recordings)
    assert hidden > 0.05 and record.accel.hidden_by_steps == pytest.approx(hidden)
    stated = _stated(calibration, record)["accel.bias[0]"]
    # The slope is 1e-3 m/s²/°C, which the fit knows to a percent.
    assert dict(stated.budget)["probe steps"] == pytest.approx(1e-3 * hidden, rel=0.05)
