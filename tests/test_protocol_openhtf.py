"""The phase for OpenHTF: run by OpenHTF itself, or refused where it is not installed."""

import importlib.util
import json
from pathlib import Path

import pytest

from inertiax.cli import main
from inertiax.protocol.openhtf_phase import protocol_phase
from protocol_cases import write_campaign


LIMITS = '[requirements]\n"accel.bias" = "30 mg"\n"accel.bias[0]" = "5 mg"\n'


@pytest.mark.skipif(importlib.util.find_spec("openhtf") is not None, reason="OpenHTF is installed")
def test_without_openhtf_it_says_how_to_get_it(tmp_path):
    (tmp_path / "limits.toml").write_text(LIMITS)
    with pytest.raises(ValueError, match=r"pip install 'inertiax\[openhtf\]'"):
        protocol_phase(tmp_path, tmp_path / "out", requirements=tmp_path / "limits.toml")


@pytest.mark.slow
def test_a_test_measures_the_requirements_and_attaches_the_documents(tmp_path, monkeypatch):
    openhtf = pytest.importorskip("openhtf")
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    write_campaign(tmp_path / "c")
    with pytest.raises(SystemExit) as exit:
        main(["calibrate", str(tmp_path / "c"), "-o", str(tmp_path / "r"), "-q"])
    assert not exit.value.code
    (tmp_path / "limits.toml").write_text(LIMITS)
    phase = protocol_phase(tmp_path / "r", tmp_path / "out", requirements=tmp_path / "limits.toml")
    test, records = openhtf.Test(phase), []
    test.add_output_callbacks(records.append)
    assert not test.execute(test_start=lambda: "SN-0042")  # x has 0.1 m/s² of bias, twice 5 mg
    (record,) = (p for p in records[0].phases if p.name == "protocol")
    found = {n: (m.measured_value.value, m.outcome.name) for n, m in record.measurements.items()}
    assert found["accel.bias"] == ("pass", "PASS")
    assert found["accel.bias[0]"] == ("fail", "FAIL")
    assert found["accel.bias[0].value"][0] == pytest.approx(0.1, abs=0.01)
    attached = record.attachments["protocol.json"].data
    assert json.loads(attached) == json.loads(Path(tmp_path / "out" / "protocol.json").read_text())
    assert set(record.attachments) == {"protocol.pdf", "protocol.html", "protocol.json", "dcc.xml"}
