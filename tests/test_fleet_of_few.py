"""The report of a line of two devices: what it does not know it does not show, and how good the fits are."""

import html
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import numpy as np
import polars as pl
import pytest

from command_runs import run
from fleet_results_data import _names, _truth, _write_results, NAMES, OWN, SPREAD
from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.cli.next_step import after_fleet
from inertiax.cli.outputs import folder_names
from inertiax.data.campaign import load_campaign
from inertiax.data.formats import ColumnMap
from inertiax.data.recording import Campaign
from inertiax.fleet import run_fleet
from inertiax.fleet.magnetometers import in_tables
from inertiax.fleet.overview.view import triad_view
from inertiax.fleet.reduce.tasks import Stretch, Task
from inertiax.fleet.rows import _gaps
from inertiax.fleet.solve.quarantine import _cure
from inertiax.fleet.store import read_manifest, read_parts
from inertiax.fleet.verdicts import count_verdicts, device_findings, device_verdict
from inertiax.physics.temperature import Constant, Polynomial
from inertiax.plots.fleet import distributions
from inertiax.plots.style import drawing
from inertiax.reduction.dwells import Dwells
from inertiax.report.fleet import report_fleet
from inertiax.report.fleet_fits import reserved_lines
from protocol_fleet_cases import write_line


class _Rows(HTMLParser):
    """The text of a page's cells, row by row."""

    def __init__(self):
        super().__init__()
        self.rows: list[list[str]] = []

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_data(self, data):
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data.strip()


def _rows(page: Path) -> dict[str, list[str]]:
    reader = _Rows()
    reader.feed(page.read_text("utf-8"))
    return {row[0]: row[1:] for row in reader.rows if row}


@pytest.fixture
def few(tmp_path) -> Path:
    """Two devices, alike to ten digits; the second's misfit is five times its noise."""
    folder = tmp_path / "run"
    truth = _truth(2, 0)
    truth[1] = truth[0] * (1 + 1e-10)
    _write_results(folder, truth, _names(2))
    (part,) = (folder / "parts").iterdir()
    table = pl.read_parquet(part)
    values = np.stack([truth[0], truth[1]]).tolist()
    changed = table.with_columns(
        accel_parameters=pl.Series(values), accel_chi2_per_dof=pl.Series([1.0, 25.0])
    )
    changed.write_parquet(part)
    return folder


def test_digits_are_those_of_the_devices_own_uncertainty(few):
    report_fleet(few, "command", folder_names)
    unit, mean, spread, own, least, greatest = _rows(few / "report.html")["bias x"]
    assert unit == "m/s²" and spread == "–"
    assert own == f"{OWN * SPREAD[0]:.5f}"  # 6e-4 m/s², two significant digits
    assert len(mean.partition(".")[2]) == len(least.partition(".")[2]) == 5
    assert least == greatest == mean


def test_no_axis_is_finer_than_what_a_device_is_known_to(few):
    view = triad_view(few, "accel", read_manifest(few), None)
    with drawing():
        figure = distributions(view, ((1.0, "SI"),) * len(NAMES))
    for ax, spread in zip(figure.axes, SPREAD, strict=False):
        low, high = ax.get_xlim()
        assert high - low >= 2 * OWN * spread
        assert len(ax.lines) == 1  # the mean; there is no spread to draw


def test_the_verdict_on_the_fit_is_counted(few):
    assert count_verdicts(few, read_manifest(few)) == {"good": 1, "usable": 1, "doubtful": 0}
    rows = read_parts(few).collect().iter_rows(named=True)
    assert [device_verdict(row, read_manifest(few)) for row in rows] == ["good", "usable"]
    report_fleet(few, "command", folder_names)
    text = (few / "report.html").read_text("utf-8")
    assert "Fit by the rule of `calibrate`: 1 good, 1 usable with a reservation (SN00001)." in text


def test_what_calibrate_has_a_reservation_about_a_fleet_has_too(few):
    """Of -30, 20 and 60 °C half of the range is empty, of five temperatures a quarter; 0.3 is the limit."""
    manifest = read_manifest(few)
    temperature = np.array([[20.0, -30.0, 60.0, 60.0, 60.0], [-30.0, -7.0, 15.0, 38.0, 60.0]])
    dwells = Dwells.from_arrays(np.full((2, 5, 3), 5.6), temperature=temperature, sigma=1e-3)
    said = "Accelerometers: -30 to 60 °C, but nothing between -30 and 20 °C."
    moving = msgspec.structs.replace(
        manifest, accel=msgspec.structs.replace(manifest.accel, degree=1)
    )
    assert _gaps(dwells, moving) == [said, None]
    assert _gaps(dwells, manifest) == [None, None]  # constants follow no temperature
    (part,) = (few / "parts").iterdir()
    reserved = pl.Series([said, None], dtype=pl.String)
    pl.read_parquet(part).with_columns(reservation=reserved).write_parquet(part)
    assert count_verdicts(few, manifest) == {"good": 0, "usable": 2, "doubtful": 0}
    first, _ = read_parts(few).collect().iter_rows(named=True)
    assert [f.text for f in device_findings(first, manifest)] == [said]


def test_a_misfit_is_not_hidden_behind_a_lesser_reservation_of_all(few):
    """All have a gap in temperature, and the second five times its noise as well."""
    (part,) = (few / "parts").iterdir()
    gaps = [f"Accelerometers: -30 to {t} °C, but nothing between -30 and 20 °C." for t in (60, 61)]
    pl.read_parquet(part).with_columns(reservation=pl.Series(gaps)).write_parquet(part)
    page = report_fleet(few, "command", folder_names)
    assert page.reserved == ("SN00001", "SN00000")
    misfit, gap = reserved_lines(page.why)
    assert misfit.startswith("1 × Accelerometers: many times the noise is left")
    assert misfit.endswith("(SN00001)")
    assert gap == (
        "2 × Accelerometers: … to … °C, but nothing between … and … °C (SN00001, SN00000)"
    )
    text = re.sub(r"<[^>]+>", "", (few / "report.html").read_text("utf-8"))
    assert gap in text and html.unescape(text).count(misfit) == 1


def test_an_uncertain_device_is_told_which_temperatures_it_lacks():
    """Positions were asked for where two chamber settings left a slope open."""
    settings = np.array([-30.0, -29.0, 21.0, 20.0])
    said = "record temperatures between -29 and 20 °C, of which there are none, or more positions"
    assert _cure(Polynomial(1, -30.0, 21.0), settings) == said
    assert _cure(Polynomial(1, -30.0, 21.0), np.linspace(-30.0, 21.0, 9)) == "record more positions"
    assert _cure(Constant(), settings) == "record more positions"


def test_files_that_are_not_there_are_not_listed(few):
    report_fleet(few, "command", folder_names)
    text = (few / "report.html").read_text("utf-8")
    assert "too few for the spread between devices, and for population.json" in text
    assert "population.json: mean and spread" not in text
    assert not (few / "population.json").exists()


@pytest.mark.slow
def test_explain_says_how_many_devices_it_needs(tmp_path, capsys, monkeypatch):
    write_line(tmp_path / "line")
    asked = ("fleet", tmp_path / "line", "-o", tmp_path / "run", "--explain")
    status, told, err = run(capsys, monkeypatch, *asked)
    assert status == 0, err
    said = "--explain compares devices, and needs 8 that are calibrated; here are 2."
    assert said in told + err
    page = (tmp_path / "run" / "report.html").read_text("utf-8")
    assert said in re.sub(r"<[^>]+>", "", page)
    assert "Fit by the rule of `calibrate`: 1 good, 1 usable with a reservation (U2)." in told + err
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    assert summary["fits"] == {"good": 1, "usable": 1, "doubtful": 0}
    for device in ("U1", "U2"):
        alone = ("fleet", ".", "-o", tmp_path / "run", "--device", device)
        assert run(capsys, monkeypatch, *alone)[0] == 0
    units = {
        device: _rows(tmp_path / "run" / "devices" / f"{device}.html") for device in ("U1", "U2")
    }
    both = _rows(tmp_path / "run" / "report.html")
    # 206 and 1237 °/h: alone the second would be shown in °/s.
    assert both["bias x"][0] == "°/h"
    for name in ("bias x", "misalignment xy"):
        assert units["U1"][name][0] == units["U2"][name][0] == both[name][0]
    text = (tmp_path / "run" / "devices" / "U2.html").read_text("utf-8")
    assert "Calibrated, with a reservation." in text


def test_the_command_to_run_next_diagnoses_a_folder_whose_fit_is_not_good(tmp_path):
    """Devices of a common table have no campaign of their own to diagnose."""
    line = tmp_path / "my line"
    for name in ("A", "B"):
        (line / name).mkdir(parents=True)
        (line / name / "campaign.toml").write_text("")
    assert after_fleet(line, ("B",)) == f"next: inertiax diagnose '{line / 'B'}' -o DIAGNOSIS"
    assert after_fleet(line, ("A/7", "B")).endswith(
        f"{line / 'A'}' -o DIAGNOSIS; likewise of 1 more"
    )
    assert after_fleet(line, ()) == after_fleet(line, ("C",)) == ""
    (line / "campaign.toml").write_text("")
    assert after_fleet(line, ("C", "./D")) == ""


def _write_hand_log(
    folder: Path, up: np.ndarray, *, mag: bool = False, gyro: bool = False
) -> Campaign:
    """A campaign of rests with gravity along the rows of `up`; the triads that it has are its columns."""
    rng = np.random.default_rng(len(up))
    every = lambda x: np.repeat(x, 300, axis=0)
    triads = {"accel": every(9.81 * up * 1.001 + 0.02)} | ({"mag": every(5e-5 * up)} if mag else {})
    triads |= {"gyro": every(np.full(up.shape, 1e-3))} if gyro else {}
    columns = {"time": 0.02 * np.arange(len(every(up))), "position": every(np.arange(len(up)))}
    for name, values in triads.items():
        noisy = values + 1e-3 * np.abs(values).max() * rng.standard_normal(values.shape)
        columns |= {f"{name}_{a}": noisy[:, k] for k, a in enumerate("xyz")}
    folder.mkdir(parents=True)
    pl.DataFrame(columns).write_csv(folder / "log.csv")
    (folder / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n[recordings]\nfiles = ["log.csv"]\n'
    )
    return load_campaign(folder)


FACES = np.concatenate([np.eye(3), -np.eye(3)])


@pytest.mark.parametrize("up, gyro", [(FACES, False), (np.eye(3)[:1], True)])
def test_what_calibrate_says_of_the_positions_of_one_device_the_fleet_says_too(tmp_path, up, gyro):
    campaign = _write_hand_log(tmp_path / "line" / "A", up, gyro=gyro)
    alone = judge(calibrate_device(campaign))
    run_fleet(tmp_path / "line", tmp_path / "run")
    manifest = read_manifest(tmp_path / "run")
    (row,) = read_parts(tmp_path / "run").collect().iter_rows(named=True)
    assert alone.verdict == "usable" == device_verdict(row, manifest)
    (said,) = row["warnings"]
    assert said in [f.text[0].lower() + f.text[1:] for f in alone.findings]


@pytest.mark.slow
def test_magnetometers_that_a_fleet_leaves_out_are_told(tmp_path, capsys, monkeypatch):
    _write_hand_log(tmp_path / "line" / "A", FACES, mag=True)
    status, told, err = run(capsys, monkeypatch, "fleet", tmp_path / "line", "-o", tmp_path / "run")
    said = "Magnetometers are not calibrated by `fleet`"
    assert status == 0 and said in told + err
    assert said in re.sub(r"<[^>]+>", "", (tmp_path / "run" / "report.html").read_text("utf-8"))


def test_magnetometers_alone_are_refused_as_what_they_are(tmp_path):
    home = tmp_path / "line" / "A"
    _write_hand_log(home, FACES, mag=True)
    log = pl.read_csv(home / "log.csv").drop("accel_x", "accel_y", "accel_z", "position")
    log.write_csv(home / "log.csv")
    with pytest.raises(ValueError, match="magnetometers alone.*use 'inertiax calibrate'"):
        run_fleet(tmp_path / "line", tmp_path / "run")


def test_columns_of_magnetometers_in_tables_are_seen(tmp_path):
    file = tmp_path / "a.parquet"
    task = Task(0, (("A", (Stretch(str(file), 0, 1),)),))
    campaign = _write_hand_log(tmp_path / "A", FACES)
    for names in (("mag_x", "mag_y", "mag_z"), ("x", "y", "z")):
        pl.DataFrame({n: [0.0] for n in names}).write_parquet(file)
        assert in_tables(campaign, [task], ColumnMap()) == (names[0] == "mag_x")


def test_a_fleet_of_which_nothing_is_to_be_calibrated_is_refused_as_one_device_is(tmp_path):
    _write_hand_log(tmp_path / "line" / "A", FACES)
    toml = tmp_path / "line" / "A" / "campaign.toml"
    toml.write_text(toml.read_text() + '[model]\naccel_estimator = "none"\n')
    told = 'accel_estimator = "none": nothing is left to calibrate'
    with pytest.raises(ValueError, match=told):
        calibrate_device(load_campaign(tmp_path / "line" / "A"))
    with pytest.raises(ValueError, match=told):
        run_fleet(tmp_path / "line", tmp_path / "run")
    assert not (tmp_path / "run").exists()
