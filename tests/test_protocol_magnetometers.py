"""A protocol states the magnetometers as it states the other triads."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import polars as pl
import pytest

from dcc_schema import assert_valid, needs_schema
from inertiax.cli import main
from inertiax.live.target import parse_target
from magnetometer_cases import FIELD, field_of, HARD, rotations, SOFT


DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
SAMPLES = 20  # of a rest
NOISE = 5e-8  # T


@pytest.fixture(scope="module")
def protocol(tmp_path_factory) -> Path:
    """Forty rests of ideal accelerometers beside magnetometers with hard and soft iron."""
    folder, rng = tmp_path_factory.mktemp("protocol"), np.random.default_rng(8)
    turns = rotations(40, rng)
    still = lambda x, sigma: (
        np.repeat(x, SAMPLES, axis=0) + rng.normal(0.0, sigma, (40 * SAMPLES, 3))
    )
    accel = still(9.81 * turns[:, :, 2], 1e-3)
    mag = still(field_of(turns) @ (np.eye(3) + SOFT).T + HARD, NOISE)
    number = np.repeat(np.arange(40), SAMPLES)
    columns = {"time": 0.1 * np.arange(len(number)) + number, "position": number}
    for name, values in (("accel", accel), ("mag", mag)):
        columns |= {f"{name}_{a}": values[:, k] for k, a in enumerate("xyz")}
    pl.DataFrame(columns).write_csv(folder / "log.csv")
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = 9.81\nmagnetic_field = {FIELD}\n[recordings]\nfiles = ["log.csv"]\n'
    )
    (folder / "limits.toml").write_text(
        '[requirements]\n"mag.bias" = "50 uT"\n"mag.bias[1]" = "0.1 gauss"\n"mag.scale" = "10 %"\n'
    )
    for words in (
        f"calibrate {folder} -o {folder / 'results'} -q",
        f"protocol {folder / 'results'} -o {folder / 'out'} -q --requirements {folder / 'limits.toml'}",
    ):
        with pytest.raises(SystemExit) as end:
            main(words.split())
        assert not end.value.code
    return folder / "out"


@pytest.mark.slow
def test_values_hold_the_truth_within_their_expanded(protocol):
    results = {
        r["name"]: r for r in json.loads((protocol / "protocol.json").read_text("utf-8"))["results"]
    }
    truth = {f"mag.bias[{k}]": v for k, v in enumerate(HARD)}
    truth |= {f"mag.matrix[{i},{j}]": SOFT[i, j] for i in range(3) for j in range(3)}
    assert {n for n in results if n.startswith("mag.")} == set(truth)
    # Twice an interval of 95 % is left by a normal error once in ten thousand.
    off = [abs(results[n]["value"] - v) / results[n]["expanded"] for n, v in truth.items()]
    assert max(off) < 2.0
    assert results["mag.bias[0]"]["unit"] == "T" and results["mag.matrix[0,0]"]["unit"] == "1"
    # Forty means of twenty samples tell an offset to their noise over √800, but for what the matrix takes.
    assert 1.0 < results["mag.bias[0]"]["expanded"] / (1.96 * NOISE / 800**0.5) < 6.0


def test_requirements_may_limit_them(protocol):
    said = json.loads((protocol / "protocol.json").read_text("utf-8"))["requirements"]
    # The hard iron is 20, −35 and 12 µT; 0.1 gauss are 10 µT. Soft iron on the diagonal is 5 % at most.
    assert [r["decision"] for r in said] == ["pass", "fail", "pass"]
    assert said[1]["limit"] == pytest.approx(1e-5) and said[1]["unit"] == "T"
    with pytest.raises(ValueError, match="follows accelerometers and gyros alone"):
        parse_target("accel.bias=1 mg, mag.bias=1 uT")


def test_the_certificate_has_them_in_tesla(protocol):
    root = ElementTree.parse(protocol / "dcc.xml").getroot()
    parts = root.findall(f"{DCC}measurementResults/{DCC}measurementResult")
    names = [p.find(f"{DCC}name/{DCC}content").text for p in parts]
    assert names == ["Accelerometers", "Magnetometers"]
    units = {u.text for u in parts[1].iter(f"{SI}unit")}
    assert {r"\tesla", r"\one"} <= units
    said = (protocol / "protocol.html").read_text("utf-8")
    assert (
        "Magnetometers: results" in said and "hard iron x" in said and "field of the place" in said
    )


@needs_schema
def test_the_certificate_validates_against_the_schema(protocol):
    assert_valid((protocol / "dcc.xml").read_bytes())
