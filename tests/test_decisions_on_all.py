"""Requirements decided for every device at once: the same decisions as in each device's protocol."""

import csv
import json

import pytest

from command_runs import run
from inertiax.protocol.all_devices import counted, decide_on_all, write_decisions
from inertiax.protocol.requirements import Limit
from inertiax.protocol.station import DeviceTable, Station
from protocol_cases import write_campaign
from protocol_effect_cases import measured


# Biases of 2e-3, −1e-3 and 5e-4 rad/s with 1e-5 at 1 sigma; 2e-3 rad/s is 0.1146 °/s.
LIMITS = {
    "pass": Limit("gyro.bias", 3e-3, "0.17189 deg/s"),
    "fail": Limit("gyro.bias[1]", 5e-4, "0.028648 deg/s"),
    "undecided": Limit("gyro.bias[0]", 2e-3, "0.11459 deg/s"),
}


@pytest.mark.parametrize(
    ("asked", "decision"),
    [(("pass",), "pass"), (("pass", "undecided"), "undecided"), (("undecided", "fail"), "fail")],
)
def test_a_device_is_as_good_as_its_worst_requirement(asked, decision):
    limits = tuple(LIMITS[a] for a in asked)
    (one,) = decide_on_all([("A", measured("A"))], Station(), limits)
    assert (one.device, one.fit, one.decision) == ("A", "good", decision)
    assert [r.decision for r in one.requirements] == list(asked)


def test_devices_that_were_set_aside_are_there_with_the_reason(tmp_path):
    limits = (LIMITS["pass"], LIMITS["fail"])
    found = [("A", measured("A")), ("B, <b>", "gyro: too few positions"), ("C", measured("C"))]
    devices = decide_on_all(found, Station(), limits)
    assert counted(devices) == "Of 3 devices: 2 fail, 1 set aside."
    write_decisions(devices, limits, tmp_path, "inertiax protocol")
    lines = (tmp_path / "decisions.csv").read_text("utf-8").splitlines()
    first, second, third = csv.DictReader(lines)
    assert (first["gyro.bias"], first["gyro.bias nearest [deg/s]"]) == ("pass", "0.114592")
    assert float(first["gyro.bias expanded [deg/s]"]) == pytest.approx(1.98 * 5.73e-4, rel=0.05)
    assert (second["decision"], second["reason"]) == ("set aside", "gyro: too few positions")
    assert second["gyro.bias"] == "" and third["gyro.bias[1]"] == "fail"
    page = (tmp_path / "decisions.html").read_text("utf-8")
    assert "B, &lt;b&gt;" in page and "Of 3 devices: 2 fail, 1 set aside." in page
    document = json.loads((tmp_path / "decisions.json").read_text("utf-8"))
    assert document["devices"][0]["requirements"][1]["value"] == pytest.approx(-1e-3)


def test_a_station_that_names_one_device_is_refused():
    station = Station(device=DeviceTable(serial="A"))
    with pytest.raises(ValueError, match="names one device, but all are decided on"):
        decide_on_all([("A", measured("A"))], station, (LIMITS["pass"],))


def test_wrong_usage_is_said_in_one_line(tmp_path, capsys, monkeypatch):
    ask = lambda *a: run(
        capsys, monkeypatch, "protocol", tmp_path, "-o", tmp_path / "out", "--all", *a
    )
    assert ask()[0] == 2 and "give --requirements FILE" in ask()[2]
    (tmp_path / "r.toml").write_text('[requirements]\n"accel.bias" = "1 mg"\n')
    asked = ("--requirements", tmp_path / "r.toml")
    status, _, err = ask(*asked, "--device", "A")
    assert status == 2 and "does not go with --device" in err
    status, _, err = ask(*asked)
    assert status == 1 and "holds no calibration.json" in err and err.count("\n") == 1


@pytest.mark.slow
def test_the_decisions_are_those_of_each_protocol(tmp_path, capsys, monkeypatch):
    home = write_campaign(tmp_path / "c", ("A", "B"))
    assert run(capsys, monkeypatch, "calibrate", home, "-o", tmp_path / "r", "-q")[0] == 0
    (tmp_path / "q.toml").write_text(
        '[requirements]\n"accel.bias" = "30 mg"\n"accel.bias[0]" = "5 mg"\n'
    )
    asked = ("--requirements", tmp_path / "q.toml", "--json")
    status, out, err = run(
        capsys, monkeypatch, "protocol", tmp_path / "r", "-o", tmp_path / "d", "--all", *asked
    )
    assert status == 0, err
    together = {d["device"]: d for d in json.loads(out)["devices"]}
    assert set(together) == {"A", "B"}
    for device, decided in together.items():
        chosen = ("--device", device, "-o", tmp_path / device)
        alone = json.loads(run(capsys, monkeypatch, "protocol", tmp_path / "r", *chosen, *asked)[1])
        for one, other in zip(alone["requirements"], decided["requirements"], strict=True):
            assert (one["name"], one["decision"]) == (other["name"], other["decision"])
            assert one["worst"]["value"] == other["value"]
        assert decided["decision"] == "fail"
