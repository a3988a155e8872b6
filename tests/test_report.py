"""Reports: judged rightly, safe against hostile names, complete and self-contained."""

import html.parser
import json
import re
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibrate.fit_quality import judge, weakest
from inertiax.calibrate.pipeline import DeviceFailure
from inertiax.calibration.calibration import TriadCalibration
from inertiax.calibration.quantities import label, quantities, with_sigma
from inertiax.data.recording import Campaign, Recording
from inertiax.physics.temperature import Curve, Polynomial
from inertiax.reduction.device_segments import segment_all
from inertiax.report.calibration import FIGURES, report_calibration, report_summary
from inertiax.report.diagnosis import report_diagnosis
from inertiax.report.document import calibration_document
from report_data import device_result, diagnosis, EVIL


class _Page(html.parser.HTMLParser):
    """Tags, ids, addresses and text of a page; checks that tags nest."""

    def __init__(self, text: str):
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("href", "src", "xlink:href", "action", "data"):
                self.addresses.append(value)
            assert not name.startswith("on"), f"event handler {name}"
        if tag not in ("meta", "link", "br"):
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        self._open.pop()

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if not self._open or self._open[-1] != "style":
            self.text += data


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> tuple[_Page, Path]:
    folder = tmp_path_factory.mktemp("report")
    result = device_result(device=EVIL, scatter=3e-4, chi2_per_dof=9.0, warnings=(EVIL,))
    recording = Recording(
        time=np.arange(500.0), accel=np.random.default_rng(1).normal(size=(500, 3)), name=EVIL
    )
    campaign = Campaign((recording,))
    result = replace(result, segments=segment_all(campaign.recordings))
    report_calibration(result, folder, f"inertiax calibrate {EVIL}", campaign=campaign)
    return _Page((folder / "report.html").read_text("utf-8")), folder


@pytest.mark.slow
def test_the_page_loads_nothing_from_elsewhere(page):
    parsed, folder = page
    assert {"script", "link", "img", "iframe", "object"}.isdisjoint(parsed.tags)
    assert all(a.startswith("#") for a in parsed.addresses)
    assert (folder / "report.html").stat().st_size < 1_000_000
    text = (folder / "report.html").read_text("utf-8")
    assert not re.findall(r"@import|url\((?!#)", text)


@pytest.mark.slow
def test_hostile_names_are_shown_as_text(page):
    parsed, _ = page
    assert "script" not in parsed.tags
    assert parsed.text.count("<script>alert(1)</script>") >= 3  # title, warning, command


def test_ids_in_the_page_are_unique(page):
    parsed, _ = page
    assert len(parsed.ids) == len(set(parsed.ids))
    assert {a[1:] for a in parsed.addresses} <= set(parsed.ids)


def test_the_page_says_verdict_key_figures_and_how_to_reproduce(page):
    parsed, folder = page
    assert "Calibrated, with a reservation." in parsed.text
    assert "3.0 times the noise" in parsed.text
    assert "inertiax calibrate" in parsed.text and "jaxlib" in parsed.text
    assert parsed.text.index("with a reservation") < parsed.text.index("Accelerometers: parameters")
    # Middle of the range: x = 0, so bias z is its first coefficient, 2e-3 m/s², ± 1e-4.
    assert re.search(r"bias z\s*0\.00200\s*0\.00010\s*m/s²", parsed.text)


def test_every_figure_of_the_page_is_also_on_disk(page):
    _, folder = page
    found = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.suffix in (".png", ".svg")}
    assert found <= set(FIGURES)
    assert "figures/rests.png" in found and "figures/misfit-accel.svg" in found


def test_misfit_is_judged_against_the_noise():
    good = device_result()
    bad = device_result(scatter=3e-4, chi2_per_dof=9.0)
    unknown = device_result(chi2_per_dof=float("nan"))
    found = {f.topic: f for f in judge(good).findings}["misfit"]
    assert found.fine and "as noise and stated uncertainties predict" in found.text
    found = {f.topic: f for f in judge(bad).findings}["misfit"]
    assert not found.fine and "3.0 times the noise" in found.text
    found = {f.topic: f for f in judge(unknown).findings}["misfit"]
    assert found.fine and "not known" in found.text


@pytest.mark.slow
@pytest.mark.parametrize("chi2", [1.0, 4.0, 9.0, 1e8])
def test_page_json_and_summary_say_one_thing(tmp_path, chi2):
    result = device_result(device="A", scatter=0.0 if chi2 == 1.0 else 1e-4, chi2_per_dof=chi2)
    quality = judge(result)
    report_calibration(result, tmp_path, "inertiax")
    text = _Page((tmp_path / "report.html").read_text("utf-8")).text
    (device,) = calibration_document((result,), {"A": "a"}, tmp_path)["devices"]
    assert device["quality"]["verdict"] == quality.verdict
    (sentence,) = device["quality"]["triads"]
    # The page says a reason once: where the answer gives it, the triad's own line does not.
    assert sentence["text"].partition("; ")[2] in text and quality.answer in text
    called_good = quality.verdict == "good"
    assert ("the fit is good" in text) == called_good == ("Good" in quality.answer)


def test_the_weakest_parameter_is_the_one_that_moves_the_output_most():
    # 5e-5 of scale factor z moves the output by 5e-5 · 9.81 = 4.9e-4 m/s², more than 3e-4 of bias y.
    sigmas = np.array([1e-5, 3e-4, 1e-5, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 5e-5])
    result = device_result(sigmas=sigmas)
    assert result.accel is not None and result.calibration.accel is not None
    found = weakest(result.calibration.accel, result.accel, (-40.0, 60.0))
    assert found.label == "scale factor z"
    # At the ends of the range x = ±1: √(1 + 1) of a coefficient's sigma.
    assert found.sigma == "71 ppm"
    np.testing.assert_allclose(found.effect, 2**0.5 * 5e-5 * 9.81, rtol=1e-6)


def test_summary_links_to_devices_and_gives_reasons(tmp_path):
    results = (device_result(device="A/1"), DeviceFailure(EVIL, "too few positions"))
    report_summary(results, tmp_path, "inertiax", {"A/1": "A_1", EVIL: "x"})
    parsed = _Page((tmp_path / "report.html").read_text("utf-8"))
    assert parsed.addresses == ["A_1/report.html"]
    assert "1 of 2 devices failed" in parsed.text and "too few positions" in parsed.text
    assert "script" not in parsed.tags


def test_the_document_is_json_in_si():
    results = (device_result(device="A"), DeviceFailure("B", "why"))
    document = calibration_document(results, {"A": "A", "B": "B"}, Path("out"))
    again = json.loads(json.dumps(document, allow_nan=False))
    assert again["num_failed"] == 1
    assert again["devices"][1] == {"device": "B", "status": "failed", "reason": "why"}
    parameter = again["devices"][0]["accel"]["parameters"][8]
    assert parameter["name"] == "accel.matrix[2,2]" and parameter["unit"] == "1"
    np.testing.assert_allclose([parameter["value"], parameter["std"]], [8e-3, 1e-4])
    nan = calibration_document((device_result(chi2_per_dof=float("nan")),), {"": ""}, Path("o"))
    json.dumps(nan, allow_nan=False)


@pytest.mark.parametrize("verdict", ["consistent", "missing-physics", "unexplained"])
def test_a_diagnosis_is_told_and_drawn(tmp_path, verdict):
    recording = Recording(time=np.arange(500.0), accel=np.ones((500, 3)), device=EVIL)
    found = diagnosis(verdict)
    report_diagnosis(found, tmp_path, "inertiax diagnose", campaign=Campaign((recording,)))
    parsed = _Page((tmp_path / "report.html").read_text("utf-8"))
    assert "script" not in parsed.tags and "img" not in parsed.tags
    assert len(parsed.ids) == len(set(parsed.ids))
    assert "third_order" in parsed.text and "second_order" in parsed.text
    # (1.5 − 1.0) / 0.1; a parameter without a standard deviation has no shift.
    assert "+5.0" in parsed.text and "accel.bias[2]" not in parsed.text
    if verdict == "missing-physics":
        assert "thermal_lag or temperature_rate" in parsed.text
        assert re.search(r"time_constant\s*310\s*12\s*s", parsed.text)
        assert "not determined" in parsed.text
        assert "p < 1e-300" in parsed.text and "p = 0.0e+00" not in parsed.text
        assert "-75 %" in parsed.text  # held-out rms from 4e-4 to 1e-4
    if verdict == "unexplained":
        assert "a formula" in parsed.text


def test_a_headline_does_not_call_consistent_what_rests_on_doubtful_noise(tmp_path):
    found = replace(diagnosis("consistent"), noise_doubted=("gyro_y",))
    report_diagnosis(found, tmp_path, "inertiax diagnose")
    text = _Page((tmp_path / "report.html").read_text("utf-8")).text
    assert "the noise of gyro_y is not known" in text and "Consistent: nothing" not in text


def test_a_headline_parts_what_has_a_name_from_what_has_none(tmp_path):
    named = diagnosis("missing-physics").effects
    found = replace(diagnosis("unexplained"), effects=named)
    report_diagnosis(found, tmp_path, "inertiax diagnose")
    text = _Page((tmp_path / "report.html").read_text("utf-8")).text
    assert "Beside what has a name" in text and "named are thermal_lag" in text


@pytest.mark.parametrize(
    "value, sigma, expected",
    [
        (0.0312345, 0.00012, ("0.03123", "0.00012")),
        (-1.0, 0.0996, ("-1.00", "0.10")),
        (123456.0, 3421.0, ("123500", "3400")),
        (-1e-9, 0.01, ("0.000", "0.010")),
        (5.0, 0.0, ("5", "0")),
        (5.0, float("nan"), ("5", "nan")),
    ],
)
def test_values_are_rounded_to_their_uncertainty(value, sigma, expected):
    assert with_sigma(value, sigma) == expected


def test_units_are_customary_ones():
    names = ("gyro.bias[0]", "gyro.matrix[0,1]", "gyro.g_sensitivity[2,0]")
    curve = Curve(Polynomial(0, 0.0, 1.0), jnp.asarray([[4.84813681e-6, 1e-3, 4.84813681e-6]]))
    triad = TriadCalibration(curve, jnp.eye(3) * 1e-14, names, "reference")
    shown = [(label(q.name), round(q.value, 6), q.unit) for q in quantities(triad, 0.5)]
    # 1 °/h is 4.848e-6 rad/s.
    assert shown == [
        ("bias x", 1.0, "°/h"),
        ("misalignment xy", 1000.0, "µrad"),
        ("g-sensitivity zx", 1.0, "°/h/g"),
    ]
