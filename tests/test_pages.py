"""Every kind of page in a browser: nothing runs over, nothing is cut, nothing lies on another, no error."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from browser import Browser, FOUND
from fleet_results_data import _names, _truth, _write_results
from inertiax.cli.outputs import folder_names
from inertiax.data.recording import Campaign, Recording
from inertiax.diagnose.plan.limits import Absorbed, AliasSet, Audit, Detectable
from inertiax.effects import CATALOGUE
from inertiax.report.calibration import report_calibration, report_summary
from inertiax.report.diagnosis import report_diagnosis
from inertiax.report.fleet import report_fleet
from inertiax.report.page import Key, Section, Table, Verdict, write_page
from report_data import device_result, diagnosis


pytestmark = pytest.mark.skipif(FOUND is None, reason="no Chromium to lay pages out with")
VERDICTS = ("consistent", "missing-physics", "unexplained")
WIDTHS = (390, 1280)  # a phone's, a desk's
LONG = "an experiment that would part them takes positions every 30 degrees, or three levels"


@pytest.fixture(scope="module")
def browser():
    with Browser() as opened:
        yield opened


def full_audit() -> Audit:
    """Every catalogued effect found detectable, alike to others, or absorbed."""
    channels = tuple(f"{triad}_{axis}" for triad in ("accel", "gyro") for axis in "xyz")
    names = [e.name for e in CATALOGUE]
    scale = tuple(f"accel.matrix[{i},{i}]" for i in range(3))
    return Audit(
        not_testable=tuple((name, "it is absorbed") for name in names),
        detectable=tuple(Detectable(n, (c,), 3e-7, "m/s^2/g^2") for n in names for c in channels),
        aliases=(),
        absorbed=tuple(Absorbed(name, channels[:3], scale) for name in names),
        sets=(AliasSet(tuple(names[:4]), channels, 0.99, (LONG, LONG)),),
    )


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    """One page of each kind, by its name."""
    folder = tmp_path_factory.mktemp("pages")
    rng = np.random.default_rng(1)
    recording = Recording(time=np.arange(500.0), accel=rng.normal(size=(500, 3)), device="A")
    campaign = Campaign((recording,))
    result = device_result(device="A" * 60, scatter=3e-4, chi2_per_dof=9.0, warnings=(LONG,))
    report_calibration(result, folder / "calibration", "inertiax calibrate", campaign=campaign)
    (folder / "summary").mkdir()
    report_summary((result,), folder / "summary", "inertiax calibrate", {"A" * 60: "A"})
    for verdict in VERDICTS:
        found = replace(diagnosis(verdict), audit=full_audit(), noise=(LONG,))
        report_diagnosis(found, folder / verdict, "inertiax", campaign=campaign)
    truth = _truth(80, 1)
    truth[5, 1] += 0.5  # m/s²: a device unlike the others
    _write_results(folder / "earlier", truth, _names(80))
    _write_results(folder / "fleet", 1.1 * truth, _names(80), seed=1, aside=6)
    report_fleet(folder / "fleet", "inertiax fleet", folder_names, earlier=folder / "earlier")
    pages = {p.parent.name: p for p in folder.glob("*/report.html")}
    return pages | {"device": next((folder / "fleet" / "devices").glob("*.html"))}


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", WIDTHS)
def test_every_kind_of_page_fits_and_has_no_error(browser, pages, width, dark):
    assert set(pages) == {"calibration", "summary", *VERDICTS, "fleet", "device"}
    for name, page in pages.items():
        browser.open(page, width=width, dark=dark)
        assert (name, browser.faults(), browser.errors) == (name, [], [])


def test_faults_are_found(browser, tmp_path):
    page = tmp_path / "bad.html"
    page.write_text(
        "<meta name=viewport content='width=device-width'><p style='width:2000px'>wide</p>"
        "<img src=absent.png><script>throw Error('thrown')</script>"
        "<figure><svg width=200 height=100>"
        "<g id=text_1><text x=20 y=50>words on</text></g><g id=text_2><text x=40 y=52>words</text></g>"
        "<g id=text_3><text x=180 y=90>reaches out</text></g></svg></figure>"
    )
    browser.open(page, width=390)
    found = " ".join(browser.faults())
    for fault in ("the page is", "P to 2", "broken image", "text_1 on text_2", "text_3 is cut off"):
        assert fault in found
    assert any("thrown" in e for e in browser.errors)
    assert any("absent.png" in e for e in browser.errors)


def test_long_cells_wrap_and_columns_without_text_are_left_out(browser, tmp_path):
    rows = tuple((f"row {k}", "", "1.0 ± 0.1", LONG, LONG) for k in range(50))
    table = Table(("name", "empty", "value", "why", "what"), rows, numeric=(2,), caption=LONG)
    write_page(
        tmp_path / "page.html",
        title="T",
        under="U",
        verdict=Verdict("good", "V", ("a slope of -3.84e-05 rad/s, see --explain",)),
        sections=(Section("S", tables=(table,)),),
        command="c",
        keys=(Key("reach", "-57.1 … 62.0 °C"),),
    )
    text = (tmp_path / "page.html").read_text("utf-8")
    assert "empty" not in text and '<th class="n">value</th>' in text
    # What a line break would tear apart: an exponent, a unit, an option.
    for kept in ("-3.84e-05", "--explain", "62.0 °C"):
        assert f'<span class="w">{kept}</span>' in text
    browser.open(tmp_path / "page.html", width=1280)
    assert (browser.faults(), browser.errors) == ([], [])
