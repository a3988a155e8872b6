"""The page over a fleet: yield, reasons, devices unlike the others, drift; safe against hostile names."""

import html.parser
import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from command_runs import draw_nothing
from fleet_data import write_line
from fleet_results_data import _names, _truth, _write_results, NAMES, OWN, SPREAD
from inertiax.cli.app import app
from inertiax.cli.outputs import folder_names
from inertiax.fleet.overview.recalibration import common_rate_variance, drift_between
from inertiax.fleet.overview.view import unlike_devices
from inertiax.fleet.solve.triad_model import curve_covariance, curves, TriadModel
from inertiax.physics.temperature import Curve, Polynomial
from inertiax.report.fleet import fleet_page, report_fleet


EVIL = '"><script>alert(1)</script>'


class _Links(html.parser.HTMLParser):
    """Tags and links of a page."""

    def __init__(self):
        super().__init__()
        self.tags: set[str] = set()
        self.links: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.links += [v for k, v in attrs if tag == "a" and k == "href"]


def _read(file: Path) -> tuple[str, _Links]:
    text, links = file.read_text(encoding="utf-8"), _Links()
    links.feed(text)
    return text, links


@pytest.fixture
def without_figures(monkeypatch):
    """Pages whose figures nobody looks at: other tests here have them drawn."""
    draw_nothing(monkeypatch)


@pytest.fixture(scope="module")
def line(tmp_path_factory):
    """80 devices over temperature: one with a bias 9 sigma out, one with a hostile name, six set aside."""
    folder = tmp_path_factory.mktemp("fleet") / "results"
    truth, names = _truth(80, 1), _names(80)
    truth[5, 1] += 9 * SPREAD[1]
    names[5] = EVIL
    names[79] = f"../../{EVIL}"
    _write_results(folder, truth, names, aside=6)
    report_fleet(folder, f"inertiax fleet {EVIL}", folder_names)
    return folder, truth, names


@pytest.mark.slow
def test_page_tells_yield_and_reasons(line):
    folder, _, _ = line
    text, _ = _read(folder / "report.html")
    assert "74 of 80 devices calibrated: a yield of 92.50 %." in text
    # Reasons that differ in their numbers only are one reason.
    assert re.search(
        r'<td class="n">6</td><td class="l">accel: no convergence after … steps</td>', text
    )


def test_yield_of_almost_all_is_not_all(tmp_path):
    _write_results(tmp_path, _truth(20, 0), _names(20), aside=1)
    states = fleet_page(tmp_path)
    assert states.aside.height == 1
    from inertiax.report.fleet import _percent

    assert (_percent(39999, 40000), _percent(40000, 40000), _percent(19, 20)) == (
        "99.99 %",
        "100 %",
        "95.00 %",
    )


@pytest.mark.slow
def test_a_device_unlike_the_others_is_named_with_its_parameter(line):
    folder, _, names = line
    page = fleet_page(folder)
    found = unlike_devices(page.views["accel"])
    assert [u.device for u in found] == [names[5]] and found[0].parameter == "accel.bias[1]"
    # 9 sigma added to a device of the line; slopes make the spread at the ends wider by √1.09.
    assert 5.5 < found[0].sigmas < 12.5
    text, links = _read(folder / "devices" / f"{folder_names(page.paged)[names[5]]}.html")
    assert "Calibrated, but unlike its line." in text and "bias y" in text


@pytest.mark.slow
def test_names_are_escaped_and_links_lead_to_pages_inside(line):
    folder, _, _ = line
    for file in (folder / "report.html", *(folder / "devices").glob("*.html")):
        text, links = _read(file)
        assert "script" not in links.tags and "<script" not in text
        for link in links.links:
            target = (file.parent / link).resolve()
            assert target.is_file() and target.is_relative_to(folder.resolve())
    assert len(list((folder / "devices").glob("*.html"))) == 7  # one unlike, six set aside
    assert (
        EVIL.replace('"', "&#34;").replace("<", "&lt;").replace(">", "&gt;")
        in _read(folder / "report.html")[0]
    )


def test_curves_are_those_of_the_temperature_basis():
    """The NumPy curves and variances of many devices against the library's `Curve` and φ C φᵀ."""
    rng = np.random.default_rng(2)
    model, basis = TriadModel("invariant", NAMES, 2, -30.0, 60.0), Polynomial(2, -30.0, 60.0)
    values = rng.standard_normal((4, 27))
    factor = rng.standard_normal((4, 27, 27))
    covariance = factor @ factor.transpose(0, 2, 1)
    grid = np.array([-30.0, 7.0, 80.0])
    shown, variance = curves(model, values, grid), curve_covariance(model, covariance, grid)
    for d in range(4):
        for t, temperature in enumerate(grid):
            phi = np.kron(np.asarray(basis(temperature)), np.eye(9))  # (9, 27)
            expected = np.asarray(Curve(basis, values[d].reshape(3, 9))(temperature))
            np.testing.assert_allclose(shown[d, t], expected, rtol=1e-12, atol=1e-12)
            row = phi.reshape(9, 27)
            np.testing.assert_allclose(
                variance[d, t], np.diag(row @ covariance[d] @ row.T), rtol=1e-10
            )


def test_a_change_of_the_table_s_rate_alone_is_no_change_of_a_gyro():
    """By hand: 20 ppm in each run are √2 · 20 ppm of a difference, on scale factors of gyros by reference alone."""
    names = ("gyro.bias[0]", "gyro.matrix[0,0]", "gyro.matrix[0,1]", "gyro.matrix[2,2]")
    found = common_rate_variance(names, "reference", [20e-6, 20e-6])
    np.testing.assert_allclose(
        np.sqrt(found), [0.0, np.sqrt(2.0) * 20e-6, 0.0, np.sqrt(2.0) * 20e-6]
    )
    assert not common_rate_variance(names, "gravity", [20e-6, 20e-6]).any()
    assert not common_rate_variance(("accel.matrix[0,0]",), "reference", [20e-6]).any()


@pytest.mark.slow
def test_drift_is_the_difference_in_its_own_sigmas(line, tmp_path, without_figures):
    folder, truth, names = line
    moved = truth[10:60].copy()
    moved[3, 2] += (
        8 * np.sqrt(2) * OWN * SPREAD[2]
    )  # device 13's constant bias z: 8 sigma of a difference
    _write_results(tmp_path / "later", moved, names[10:60], seed=1)
    drift = drift_between(tmp_path / "later", folder, "accel", temperatures=[15.0])
    assert drift.devices == tuple(names[10:60])
    # In the middle of the range the slope's term is zero: σ of a difference is √2 of the constant's own.
    np.testing.assert_allclose(drift.sigma[:, 0], np.sqrt(2) * OWN * np.tile(SPREAD, (50, 1)))
    sigmas = drift.sigmas[:, 0]
    assert abs(sigmas[3, 2] - 8.0) < 4.0
    others = np.delete(sigmas.reshape(-1), 3 * 9 + 2)
    # 449 standard normal numbers: their rms is 1 ± 0.033.
    assert abs(np.sqrt(np.square(others).mean()) - 1.0) < 0.14
    report_fleet(tmp_path / "later", "again", folder_names, earlier=folder, temperatures=[15.0])
    text, _ = _read(tmp_path / "later" / "report.html")
    assert "50 devices were calibrated before" in text
    assert re.search(r"<td>SN00013</td><td>bias z</td><td>15 °C</td>", text)


@pytest.mark.slow
def test_many_changes_ask_for_attention_and_chance_does_not(line, tmp_path, without_figures):
    folder, truth, names = line
    good = slice(10, 60)
    tones = []
    for number, shift in enumerate((0.0, 6.0 * OWN)):
        later = tmp_path / str(number)
        moved = truth[good] + shift * np.concatenate([SPREAD, np.zeros(9)])
        _write_results(later, moved, names[good], seed=2)
        report_fleet(later, "again", folder_names, earlier=folder)
        tones.append(re.search(r'class="verdict (\w+)"', _read(later / "report.html")[0])[1])
    assert tones == ["good", "attention"]


def test_drift_without_a_common_device_or_temperature_is_said(line, tmp_path):
    folder, truth, _ = line
    _write_results(tmp_path / "other", truth[:10], [f"X{k}" for k in range(10)])
    with pytest.raises(ValueError, match="have no calibrated device in common"):
        fleet_page(tmp_path / "other", earlier=folder)
    with pytest.raises(ValueError, match="no manifest.json"):
        fleet_page(folder, earlier=tmp_path)


@pytest.mark.slow
def test_few_devices_and_none_have_a_page(tmp_path):
    _write_results(tmp_path / "few", _truth(3, 0), _names(3))
    report_fleet(tmp_path / "few", "command", folder_names)
    assert "too few for the spread" in _read(tmp_path / "few" / "report.html")[0]
    _write_results(tmp_path / "none", _truth(3, 0), _names(3), aside=3)
    report_fleet(tmp_path / "none", "command", folder_names)
    assert "No device could be calibrated." in _read(tmp_path / "none" / "report.html")[0]


@pytest.mark.slow
def test_page_of_twenty_thousand_devices_stays_small(tmp_path):
    truth = _truth(20_000, 0)
    truth[::100] *= 30.0  # 200 unlike the others, more than are listed
    _write_results(tmp_path, truth, _names(20_000), aside=1000)
    report_fleet(tmp_path, "command", folder_names)
    assert (tmp_path / "report.html").stat().st_size < 2e6
    assert len(list((tmp_path / "devices").glob("*.html"))) == 40
    assert "more are in population.json" in _read(tmp_path / "report.html")[0]


@pytest.mark.slow
def test_command_writes_one_devices_page_beside_its_calibration(line):
    folder, _, names = line
    run = CliRunner().invoke(app, ["fleet", ".", "-o", str(folder), "--device", names[8]])
    assert run.exit_code == 0, run.output
    text, _ = _read(folder / "devices" / "SN00008.html")
    assert "Calibrated, and like its line." in text
    assert json.loads((folder / "calibration-SN00008.json").read_text())["device"] == "SN00008"


@pytest.mark.slow
def test_command_ends_with_the_page(tmp_path):
    write_line(tmp_path / "line", 6, files=1, experiments=2)
    command = ["fleet", str(tmp_path / "line"), "-o", str(tmp_path / "out"), "--json", "-q"]
    run = CliRunner().invoke(app, command)
    assert run.exit_code == 0, run.output
    told = json.loads(run.stdout)
    assert (told["devices"], told["calibrated"], told["unlike"]) == (6, 6, [])
    assert (
        "6 of 6 devices calibrated: a yield of 100 %." in _read(tmp_path / "out" / "report.html")[0]
    )
    assert (tmp_path / "out" / "population.json").is_file()


def test_command_tells_wrong_temperatures(line, tmp_path):
    folder, _, _ = line
    for asked in ("cold", "20,nan"):
        run = CliRunner().invoke(app, ["fleet", ".", "-o", str(tmp_path), "--at", asked])
        assert run.exit_code == 2 and "not a list of temperatures" in run.output
