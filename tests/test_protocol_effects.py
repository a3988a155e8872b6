"""Named effects, certificate numbers, and what a page shows of requirements: values beside hand calculations."""

import json
from pathlib import Path
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest

from every_form import every_form
from inertiax.protocol import content, pdf
from inertiax.protocol.dcc import dcc
from inertiax.protocol.identity import identity
from inertiax.protocol.record import EffectRecord
from inertiax.protocol.requirements import Limit
from inertiax.protocol.si_units import in_si
from inertiax.protocol.station import StationTable
from protocol_effect_cases import COEFFICIENT, effect, GRAVITY, protocol, RECORD, SIGMA


DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"


def test_an_effect_is_a_result_in_the_reports_unit():
    section = content.effects(protocol())
    (row,) = section.tables[0].rows
    # 8.871e-4 rad/s is 182.98 °/h; 1.96 · 5.86e-6 rad/s is 2.37 °/h.
    assert row == ("g2_sensitivity", "gyro_y", "f^T A f: yy", "183.0", "2.4", "°/h/g²")
    (entry,) = protocol().document()["effects"]
    assert entry["expanded"] == pytest.approx(1.959964 * SIGMA)
    assert entry["term"] == "f^T A f: yy" and entry["unit"] == "rad/s/g^2"
    assert protocol().left_out == ()
    assert content.effects(protocol(effects=())) is None
    many = effect(
        "size_effect", triad="accel", settings=(), coefficients=np.array([0.03, 0.02, 0.0]),
        covariance=np.eye(3), unit="m",
    )  # fmt: skip
    terms = [e.term.split(": ")[1] for e in protocol(effects=(many,)).effects]
    assert terms == ["r along x", "r along y", "r along z"]
    axes = effect(
        "g_sensitivity",
        settings=(("axes", "xz"),),
        coefficients=np.zeros(2),
        covariance=np.eye(2),
        unit="rad/s/g",
    )
    assert [e.term for e in protocol(effects=(axes,)).effects] == ["D f: x", "D f: z"]


def test_a_setting_has_the_uncertainty_that_the_diagnosis_kept():
    lag = effect(
        "thermal_lag", settings=(("time_constant", 310.0),), coefficients=np.array([1.0]),
        covariance=np.zeros((1, 1)), unit="1",
    )  # fmt: skip
    kept = EffectRecord("thermal_lag", ("gyro_x", "gyro_y"), "time_constant", 310.0, 12.0, "s")
    record = msgspec.structs.replace(RECORD, effects=(kept,))
    first, second = protocol(effects=(lag,), record=record).effects
    assert (first.parameter, first.value, first.std, first.unit) == ("time_constant", 310.0, 12.0, "s")  # fmt: skip
    assert (second.parameter, second.expanded) == ("amplitude", None)
    assert protocol(effects=(lag,)).effects[0].std is None


def test_an_effect_is_a_quantity_of_the_certificate():
    root = ElementTree.fromstring(dcc(protocol()))
    found = [
        q for q in root.iter(f"{DCC}quantity")
        if "g2_sensitivity on gyro_y" in (q.findtext(f"{DCC}name/{DCC}content") or "")
    ]  # fmt: skip
    (real,) = (q.find(f"{SI}real") for q in found)
    # rad/s per g² in rad/s per (m/s²)², g being 9.8 m/s².
    assert float(real.findtext(f"{SI}value")) == pytest.approx(COEFFICIENT / 9.8**2)
    assert real.findtext(f"{SI}unit") == r"\radian\second\tothe{3}\metre\tothe{-2}"
    uncertainty = real.findtext(f"{SI}expandedUnc/{SI}uncertainty")
    assert float(uncertainty) == pytest.approx(1.959964 * SIGMA / 9.8**2)


def test_every_unit_of_the_catalogue_has_a_form_in_si():
    for known, triad, variant, columns in every_form():
        for unit in (
            *(known.unit(triad, variant.settings, k) for k in range(columns)),
            known.nuisance_unit,
        ):
            assert in_si(unit, GRAVITY).factor > 0.0
    assert in_si("m/s^2/(degC/min)", GRAVITY).factor == 60.0


def test_decisions_say_what_they_do_not_contain():
    made = protocol()
    section = content.requirements(made)
    assert "gyro.bias, gyro.scale: decided on the parameters alone" in section.lines[1]
    assert section.lines[1].endswith("stated under Named effects: g2_sensitivity on gyro_y.")
    assert [r["without_effects"] for r in made.document()["requirements"]] == [
        ["g2_sensitivity"]
    ] * 2
    assert len(content.requirements(protocol(effects=())).lines) == 1


def test_requirements_are_shown_in_their_own_unit_with_all_that_is_outside():
    nearest, outside = content.requirements(protocol()).tables
    # 2e-3 rad/s is 0.11459 °/s; 1.98 · 1e-5 rad/s is 0.0011 °/s.
    assert nearest.rows[0][:4] == ("gyro.bias", "0.05 deg/s", "0.1146 ± 0.0011 deg/s", "bias x")
    assert [row[:2] for row in outside.rows] == [
        ("gyro.bias", "bias x"),
        ("gyro.bias", "bias y"),
        ("gyro.scale", "scale factor y"),
        ("gyro.scale", "scale factor z"),
    ]
    assert all(row[4] == "fail" for row in outside.rows)


def test_a_budget_has_the_same_decimals_in_a_unit():
    (section,) = content.budgets(protocol())
    for row in section.tables[0].rows:
        cells = [c for c in row[1:-1] if c != "–"]
        assert len({len(c.partition(".")[2]) for c in cells}) == 1
        assert not any("e" in c for c in cells)


def test_a_stated_source_that_no_result_contains_is_named():
    made = protocol()
    rows = {str(r[0]).strip(): r[2] for r in content.procedure(made).tables[0].rows}
    assert rows["position"] == "within 'fit'"
    assert rows["temperature probe"] == "no" and rows["rate of the table"] == ""
    assert any(t.startswith("probe offset: the station states") for t in made.not_known)


def test_no_two_certificates_have_one_number():
    number = protocol().certificate
    assert number.startswith("2026-11-SN7-")
    assert protocol().certificate == number
    later = msgspec.structs.replace(RECORD, created="2026-02-01T00:00:00Z")
    assert protocol(record=later).certificate == number
    others = [
        protocol("SN8"),
        protocol(effects=()),
        protocol(limits=()),
        protocol(station=StationTable(order="2026-12")),
        protocol(record=msgspec.structs.replace(RECORD, calibration_sha256="1" * 64)),
    ]
    assert len({number, *(p.certificate for p in others)}) == 6
    assert protocol("", StationTable()).certificate.startswith("inertiax-no-serial-")
    assert protocol("A B/1").certificate.startswith("2026-11-A_B_1-")
    stated = protocol(station=StationTable(order="2026-11", certificate="K 17/2026"))
    assert stated.certificate == "K 17/2026"
    root = ElementTree.fromstring(dcc(stated))
    assert root.findtext(f".//{DCC}uniqueIdentifier") == "K 17/2026"
    assert ("certificate", "K 17/2026") in identity(stated).tables[0].rows
    assert json.loads(msgspec.json.encode(stated.document()))["certificate"] == "K 17/2026"


def test_people_sign_below_the_figures(tmp_path, monkeypatch):
    seen = []
    section = pdf._section
    monkeypatch.setattr(
        pdf, "_section", lambda sheet, s, **k: (seen.append(s.title), section(sheet, s, **k))
    )
    monkeypatch.setattr(pdf, "_figure", lambda *_: seen.append("figure") or True)
    figure = pdf.Drawn(None, Path())
    pdf.write_pdf(protocol(), tmp_path, "inertiax protocol", [figure])
    assert seen[-2:] == ["figure", "Signatures"]


@pytest.mark.parametrize(
    ("text", "shown"), [("12mg", "mg"), ("1.2e-2 g", "g"), (" 3 m/s^2 ", "m/s^2"), ("", "SI")]
)
def test_the_unit_of_a_limit_is_that_of_its_text(text, shown):
    factor, unit = Limit("accel.bias", 0.1, text).shown_in
    assert unit == shown
    size = {"mg": 9.80665e-3, "g": 9.80665, "m/s^2": 1.0, "SI": 1.0}[shown]
    assert factor == pytest.approx(1.0 / size)


@pytest.mark.parametrize("arm, said", [((0.03, 0.0, 0.0), True), ((0.03, 0.01, 2e-5), False)])
def test_lever_arms_of_zero_are_told_from_measured_ones(arm, said):
    arms = effect(
        "size_effect", triad="accel", channels=(0,), settings=(), coefficients=np.array(arm),
        covariance=np.diag([1e-4, 0.03, 0.03]) ** 2, unit="m",
    )  # fmt: skip
    section = content.effects(protocol(effects=(arms,)))
    assert any("held at zero" in line for line in section.lines) == said
    assert len(section.tables[0].rows) == 3
