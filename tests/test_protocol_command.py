"""`inertiax protocol`: its four documents, what they say, and what is refused in one line."""

import hashlib
import json
import math
import re
from pathlib import Path
from xml.etree import ElementTree

import polars as pl
import pytest

from command_runs import run
from dcc_schema import assert_valid, needs_schema
from inertiax.cli import main
from protocol_cases import GRAVITY, write_campaign


KEYS = {
    "name", "at", "value", "std", "expanded", "coverage_factor", "degrees_of_freedom", "unit", "budget",
}  # fmt: skip
DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"

# Children of the elements that are written, in the order of PTB's schema 3.1.2 (? may be absent, * any number).
ORDER = {
    "coreData": "countryCodeISO3166_1 usedLangCodeISO639_1 mandatoryLangCodeISO639_1 uniqueIdentifier "
    "identifications? receiptDate? beginPerformanceDate endPerformanceDate performanceLocation",
    "item": "name equipmentClass? description? manufacturer model? identifications",
    "identification": "issuer value name?",
    "contact": "name eMail phone? fax? location",
    "customer": "name eMail phone? fax? location",
    "respPerson": "person description? role? mainSigner?",
    "statement": "convention? traceable? norm* reference* declaration? valid? date? conformity?",
    "measurementResult": "name description? usedMethods? usedSoftware? measuringEquipments? influenceConditions? "
    "results",
    "usedMethod": "name description? norm* reference*",
    "influenceCondition": "name description? status? certificate? data",
    "result": "name description? data",
    "quantity": "name? description? real",
    "real": "label? value unit dateTime? expandedUnc?",
    "expandedUnc": "uncertainty coverageFactor coverageProbability distribution?",
}


REQUIREMENTS = (
    '[requirements]\n"accel.bias" = "30 mg"\n"accel.bias[0]" = "5 mg"\n"accel.scale" = "2000 ppm"\n'
)
STATION = (
    '[station]\nname = "Table 2"\noperator = "A. <b>Example</b>"\ncountry = "DE"\ngravity_uncertainty = 2e-5\n'
    'begin = "2026-01-30"\nend = "2026-01-31"\n[device]\nmanufacturer = "Maker & Sons"\nmodel = "M1"\n'
)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A campaign, its calibration, the files that a protocol is given, and the protocol."""
    home = tmp_path_factory.mktemp("protocol")
    write_campaign(home / "campaign")
    (home / "limits.toml").write_text(REQUIREMENTS)
    (home / "station.toml").write_text(STATION)
    commands = [
        ["calibrate", home / "campaign", "-o", home / "results", "-q"],
        ["protocol", home / "results", "-o", home / "out", "-q", "--requirements", home / "limits.toml",
         "--station", home / "station.toml"],
    ]  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAX_COMPILATION_CACHE_DIR", "")
        for command in commands:
            with pytest.raises(SystemExit) as exit:
                main([str(a) for a in command])
            assert not exit.value.code
    return home


@pytest.fixture(scope="module")
def document(made) -> dict:
    return json.loads((made / "out" / "protocol.json").read_text("utf-8"))


# What is said ------------------------------------------------------------------------------------------


def test_the_document_is_that_of_the_contract(made, document):
    assert document["schema"] == "inertiax.protocol/1"
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", document["created"])
    assert document["software"]["inertiax"]
    calibration = json.loads((made / "results" / "calibration.json").read_text("utf-8"))
    assert document["model"] == calibration["model"]
    names = calibration["accel"]["names"]
    assert [(r["name"], r["at"]) for r in document["results"]] == [
        (n, t) for n in names for t in (0.0, 20.0, 40.0)
    ]
    for result in document["results"]:
        assert set(result) == KEYS
        together = math.hypot(*(b["std"] for b in result["budget"]))
        assert result["std"] == pytest.approx(together, rel=1e-12)
        assert result["expanded"] == pytest.approx(
            result["coverage_factor"] * result["std"], rel=1e-12
        )


def test_inputs_are_those_on_the_disk(made, document):
    for entry in document["inputs"]:
        content = (made / "campaign" / entry["file"]).read_bytes()
        assert entry["sha256"] == hashlib.sha256(content).hexdigest()
        assert entry["bytes"] == len(content)
    assert [e["file"] for e in document["inputs"]] == ["campaign.toml", "0.csv"]


def test_values_and_sources(document):
    found = {(r["name"], r["at"]): r for r in document["results"]}
    for k, true in enumerate((0.1, -0.2, 0.05)):
        middle = found[f"accel.bias[{k}]", 20.0]
        assert abs(middle["value"] - true) < middle["expanded"] * 2  # 5 sigma and more
    budget = {b["source"]: b["std"] for b in found["accel.bias[0]", 20.0]["budget"]}
    # 0.2 °C of the probe on 1e-4 m/s² per °C, which the fit knows to a percent.
    assert budget["probe offset"] == pytest.approx(2e-5, rel=0.05)
    scale = {b["source"]: b["std"] for b in found["accel.matrix[0,0]", 20.0]["budget"]}
    assert scale["reference g"] == pytest.approx(2e-5 / GRAVITY, rel=1e-3)  # 1 + γ, γ below 1e-3


def test_decisions(document):
    decided = {r["name"]: r["decision"] for r in document["requirements"]}
    # 30 mg is 0.294 m/s², beyond all biases; 5 mg is 0.049 m/s², below that of x; the matrix is ideal.
    assert decided == {"accel.bias": "pass", "accel.bias[0]": "fail", "accel.scale": "pass"}
    limits = {r["name"]: (r["limit"], r["unit"]) for r in document["requirements"]}
    assert limits["accel.bias"] == (pytest.approx(0.03 * 9.80665), "m/s^2")
    assert limits["accel.scale"] == (pytest.approx(2e-3), "1")


def test_what_is_stated_is_not_called_unknown(document):
    said = " ".join(document["not_known"])
    assert "rotation of the triad" in said and "stability" in said
    assert "probe offset" not in said and "reference g" not in said
    assert "no accreditation" in document["statement"]


def test_the_page_is_whole_and_escapes_what_people_wrote(made):
    text = (made / "out" / "protocol.html").read_text("utf-8")
    assert "A. &lt;b&gt;Example" in text and "<b>Example" not in text
    assert "http://" not in text.replace("http://www.w3.org", "") and "<script" not in text
    assert "Of 3 requirements: 1 not met, 2 met." in text


def test_the_pdf_has_at_most_four_pages(made):
    content = (made / "out" / "protocol.pdf").read_bytes()
    assert content.startswith(b"%PDF-")
    assert 1 <= len(re.findall(rb"/Type /Page\b", content)) <= 4


# The certificate ----------------------------------------------------------------------------------------


def _plain(element: ElementTree.Element) -> str:
    return element.tag.removeprefix(DCC).removeprefix(SI)


def test_children_of_the_certificate_stand_in_the_schemas_order(made):
    root = ElementTree.parse(made / "out" / "dcc.xml").getroot()
    seen = set()
    for element in root.iter():
        order = ORDER.get(_plain(element))
        if order is not None and not (
            _plain(element) == "contact" and element.text is None and not len(element)
        ):
            pattern = "".join(
                rf"(?:{w.rstrip('?*')} ){w[-1] if w[-1] in '?*' else ''}" for w in order.split()
            )
            children = "".join(f"{_plain(c)} " for c in element)
            assert re.fullmatch(pattern, children), (_plain(element), children)
            seen.add(_plain(element))
    assert seen == set(ORDER)


def test_the_certificate_says_what_the_document_says(made, document):
    root = ElementTree.parse(made / "out" / "dcc.xml").getroot()
    values = [
        (float(q.find(f"{SI}value").text), float(q.find(f"{SI}expandedUnc/{SI}uncertainty").text))
        for q in root.iter(f"{SI}real")
        if q.find(f"{SI}expandedUnc") is not None
    ]
    assert sorted(values) == sorted((r["value"], r["expanded"]) for r in document["results"])
    assert [e.text for e in root.iter(f"{DCC}conformity")] == ["pass", "fail", "pass"]
    assert [e.text for e in root.iter(f"{DCC}traceable")] == ["false"]
    assert {e.text for e in root.iter(f"{SI}unit")} == {
        r"\metre\second\tothe{-2}", r"\one", r"\degreecelsius"
    }  # fmt: skip


@needs_schema
def test_the_certificate_validates_against_the_schema(made):
    assert_valid((made / "out" / "dcc.xml").read_bytes())


# What is refused ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('"accel.bais" = "1 mg"', "'accel.bais' is no parameter; did you mean"),
        ('"accel.bias" = "1 ppm"', "unit 'ppm' does not belong to accel.bias"),
        ('"accel.bias" = "-1 mg"', "the limit must be a number above 0"),
        ('"accel.bias" = 0.3', '"accel.bias" = 0.3: a limit is text with a unit'),
        ('"gyro.bias" = "1 deg/h"', 'requirement "gyro.bias": the calibration does not tell it'),
        ("", "[requirements] is empty"),
        ('"accel.bias" = ', "not valid TOML"),
    ],
)
def test_bad_requirements_are_refused_in_one_line(made, tmp_path, capsys, monkeypatch, table, said):
    (tmp_path / "r.toml").write_text(f"[requirements]\n{table}\n")
    status, out, err = run(
        capsys, monkeypatch, "protocol", made / "results", "-o", tmp_path / "out",
        "--requirements", tmp_path / "r.toml",
    )  # fmt: skip
    assert (status, out) == (1, "")
    assert err.startswith("inertiax: ") and err.count("\n") == 1 and said in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('[station]\ncountry = "Germany"', "write two capital letters, such as DE"),
        ('[station]\nbegin = "31.1.2026"', "write a day such as 2026-01-31"),
        ('[station]\nbegin = "2026-02-01"\nend = "2026-01-01"', "begin is 2026-02-01, after end"),
        ("[station]\ngravity_uncertainty = 0.0", "must be above 0 and below 1"),
        ('[station]\noperater = "A"', "[station] unknown key 'operater'; did you mean 'operator'?"),
    ],
)
def test_a_bad_station_is_refused_in_one_line(made, tmp_path, capsys, monkeypatch, table, said):
    (tmp_path / "s.toml").write_text(table)
    status, _, err = run(
        capsys, monkeypatch, "protocol", made / "results", "-o", tmp_path / "out", "--station", tmp_path / "s.toml",
    )  # fmt: skip
    assert status == 1
    assert err.count("\n") == 1 and said in err


def test_what_is_no_result_is_refused_in_one_line(made, tmp_path, capsys, monkeypatch):
    protocol = lambda *a: run(capsys, monkeypatch, "protocol", *a)
    status, _, err = protocol(made / "campaign", "-o", tmp_path / "out")
    assert status == 1 and "holds no calibration.json" in err and err.count("\n") == 1
    status, _, err = protocol(made / "results", "-o", made / "results")
    assert status == 2 and "is RESULT itself" in err and err.count("\n") == 1
    status, _, err = protocol(made / "results", "-o", tmp_path / "out", "--at", "95")
    assert status == 2 and "outside the calibrated range, 0.00 to 40.00 °C" in err
    status, _, err = protocol(made / "results", "-o", tmp_path / "out", "--at", "warm")
    assert status == 2 and "is not a list of temperatures" in err
    status, _, err = protocol(made / "results", "-o", tmp_path / "out", "--device", "X")
    assert status == 2 and "the results are of device '', not 'X'" in err
    assert not (tmp_path / "out").exists()


def test_results_that_do_not_belong_together_are_refused(made, tmp_path, capsys, monkeypatch):
    (tmp_path / "r").mkdir()
    for name in ("calibration.json", "record.json"):
        (tmp_path / "r" / name).write_bytes((made / "results" / name).read_bytes())
    changed = (tmp_path / "r" / "calibration.json").read_text().replace("0.1", "0.2", 1)
    (tmp_path / "r" / "calibration.json").write_text(changed)
    status, _, err = run(capsys, monkeypatch, "protocol", tmp_path / "r", "-o", tmp_path / "out")
    assert status == 1 and "is not the file that record.json belongs to" in err
    (tmp_path / "r" / "record.json").unlink()
    status, _, err = run(capsys, monkeypatch, "protocol", tmp_path / "r", "-o", tmp_path / "out")
    assert status == 1 and "holds no record.json" in err and err.count("\n") == 1


def test_json_is_all_that_standard_output_gets(made, tmp_path, capsys, monkeypatch):
    status, out, err = run(
        capsys, monkeypatch, "protocol", made / "results", "-o", tmp_path / "out", "--json", "--at", "10,30",
        "--operator", "B. Example",
    )  # fmt: skip
    assert (status, err) == (0, "")
    said = json.loads(out)
    assert {r["at"] for r in said["results"]} == {10.0, 30.0}
    assert said["station"] == {"operator": "B. Example"}
    assert said["requirements"] == []
    assert said == json.loads((tmp_path / "out" / "protocol.json").read_text("utf-8"))


# Other results --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_one_of_several_devices_of_calibrate_and_of_a_fleet(tmp_path, capsys, monkeypatch):
    home = write_campaign(tmp_path / "c", ("A", "B", "C"))
    assert run(capsys, monkeypatch, "calibrate", home, "-o", tmp_path / "r", "-q")[0] == 0
    status, _, err = run(capsys, monkeypatch, "protocol", tmp_path / "r", "-o", tmp_path / "p")
    assert status == 2 and "holds the results of A, B, C; name one with --device" in err
    alone = _json_of(capsys, monkeypatch, tmp_path / "r", tmp_path / "p", "B")
    line = tmp_path / "line"
    line.mkdir()
    (line / "campaign.toml").write_text(
        (home / "campaign.toml").read_text().replace("csv", "parquet")
    )
    pl.concat([pl.read_csv(home / f"{k}.csv") for k in range(3)]).write_parquet(
        line / "log.parquet"
    )
    assert run(capsys, monkeypatch, "fleet", line, "-o", tmp_path / "f", "-q")[0] == 0
    status, _, err = run(capsys, monkeypatch, "protocol", tmp_path / "f", "-o", tmp_path / "q")
    assert status == 2 and "holds a fleet; name one device with --device SERIAL" in err
    fleet = _json_of(capsys, monkeypatch, tmp_path / "f", tmp_path / "q", "B")
    assert fleet["device"] == alone["device"] == "B"
    digests = [
        hashlib.sha256((line / f).read_bytes()).hexdigest()
        for f in ("campaign.toml", "log.parquet")
    ]
    assert [i["sha256"] for i in fleet["inputs"]] == digests
    for one, other in zip(alone["results"], fleet["results"], strict=True):
        assert one["name"] == other["name"]
        assert abs(one["value"] - other["value"]) < 0.01 * one["std"]  # as `fleet` promises
        assert one["std"] == pytest.approx(other["std"], rel=0.01)
        assert {b["source"] for b in one["budget"]} == {b["source"] for b in other["budget"]}


@pytest.mark.slow
def test_a_diagnosis_has_a_protocol(tmp_path, capsys, monkeypatch):
    home = write_campaign(tmp_path / "c")
    assert run(capsys, monkeypatch, "diagnose", home, "-o", tmp_path / "r", "-q")[0] == 0
    said = _json_of(capsys, monkeypatch, tmp_path / "r", tmp_path / "p", "")
    verdict = json.loads((tmp_path / "r" / "diagnosis.json").read_text("utf-8"))["verdict"]
    assert verdict == "consistent"
    sources = {b["source"] for r in said["results"] for b in r["budget"]}
    # Scatter and slow noise are there where chance does not exclude them.
    assert {"dwell noise", "probe offset"} <= sources
    assert sources <= {"dwell noise", "probe offset", "re-positioning", "slow noise"}


def _json_of(capsys, monkeypatch, results: Path, output: Path, device: str) -> dict:
    chosen = ["--device", device] if device else []
    status, out, err = run(
        capsys, monkeypatch, "protocol", results, "-o", output, "--json", *chosen
    )
    assert status == 0, err
    assert {p.name for p in output.iterdir()} >= {
        "protocol.html",
        "protocol.pdf",
        "protocol.json",
        "dcc.xml",
    }
    return json.loads(out)


@pytest.mark.slow
def test_a_diagnosis_after_a_known_calibration_has_a_protocol(tmp_path, capsys, monkeypatch):
    home = write_campaign(tmp_path / "c")
    assert run(capsys, monkeypatch, "calibrate", home, "-o", tmp_path / "k", "-q")[0] == 0
    known = tmp_path / "k" / "calibration.json"
    command = ("diagnose", home, "--calibration", known, "-o", tmp_path / "r", "-q")
    assert run(capsys, monkeypatch, *command)[0] == 0
    said = _json_of(capsys, monkeypatch, tmp_path / "r", tmp_path / "p", "")
    written = json.loads((tmp_path / "r" / "calibration.json").read_text("utf-8"))
    assert {r["name"] for r in said["results"]} == set(written["accel"]["names"])
    # The two calibrations compose to a full matrix, which the fit of the second alone does not explain.
    assert {b["source"] for r in said["results"] for b in r["budget"]} == {"fit", "probe offset"}
