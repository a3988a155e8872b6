"""The diagnosis of simulated campaigns with a key, from a generator that is none of this project's."""

import json
import os
from pathlib import Path

import pytest

from inertiax.diagnose import run_diagnosis


PRACTICE = os.environ.get("INERTIAX_PRACTICE")


def _keys():
    if PRACTICE is None:
        return []
    return json.loads((Path(PRACTICE) / "answers.json").read_text("utf-8"))["cases"]


@pytest.mark.skipif(PRACTICE is None, reason="INERTIAX_PRACTICE names no folder of campaigns")
def test_there_are_campaigns():
    assert len(_keys()) >= 6


@pytest.mark.slow
@pytest.mark.parametrize("key", _keys(), ids=[key["case"] for key in _keys()])
def test_a_campaign_gets_the_answer_of_its_key(key, tmp_path):
    run_diagnosis(Path(PRACTICE) / key["case"], tmp_path)
    said = json.loads((tmp_path / "diagnosis.json").read_text("utf-8"))
    assert said["schema"] == "inertiax.diagnosis/1"
    assert said["verdict"] in key["verdict"]
    if "missing-physics" not in key["verdict"]:
        return
    assert said["effects"][0]["name"] in [n for e in key["effects"] for n in e["accepted"]]
    for effect in key["effects"]:
        mine = [e for e in said["effects"] if e["name"] in effect["accepted"]]
        assert any(set(e["channels"]) & set(effect["channels"]) for e in mine), effect["name"]
