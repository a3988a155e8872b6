"""Checks that a twin of the process makes while it estimates."""

import os
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest

from inertiax.calibrate import pipeline
from inertiax.calibrate.results import DeviceFailure
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import aside, require_plausible
from inertiax.plausibility.aside import Asked, spare_processor


pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork"),
    # JAX warns where other tests have loaded it; the twins here do not use it.
    pytest.mark.filterwarnings("ignore:os.fork.. was called:RuntimeWarning"),
]


def _campaign(scale: float) -> Campaign:
    """Twelve rests of 3 s in poses drawn at random, in m/s² times a scale."""
    rng = np.random.default_rng(0)
    up = rng.normal(size=(12, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    rows = np.repeat(9.81 * up, 300, axis=0) + 0.02 * rng.normal(size=(3600, 3))
    temperature = np.r_[np.full(1800, 20.0), np.full(1800, 21.0)][:, None]
    recording = Recording(time=0.01 * np.arange(3600), accel=scale * rows, temperature=temperature)
    return Campaign((recording,), Site(gravity=9.81))


@pytest.fixture
def twins(monkeypatch) -> list[int]:
    """Twins are to be had as in a process without JAX; numbers of those that checked."""
    seen: list[int] = []
    monkeypatch.setattr(aside, "can_fork", lambda: True)

    class Told(aside.ForkedWork):
        def result(self, say: Callable[[str], None]):
            seen.append(self._child)
            return super().result(say)

    monkeypatch.setattr(aside, "ForkedWork", Told)
    return seen


def test_a_twin_finds_what_this_process_does(twins):
    campaign = _campaign(1.0)
    with spare_processor():
        asked = Asked(campaign, force=False, as_recorded=None)
    assert asked.findings() == require_plausible(campaign)
    assert asked.findings() == asked.findings()
    assert len(twins) == 1 and twins[0] != os.getpid()
    asked.end()


def test_an_error_is_raised_as_without_a_twin(twins):
    campaign = _campaign(9.81)  # g taken for m/s²
    with pytest.raises(ValueError) as plain:
        require_plausible(campaign)
    with spare_processor():
        asked = Asked(campaign, force=False, as_recorded=None)
    for _ in range(2):  # whenever it is asked
        with pytest.raises(ValueError) as said:
            asked.findings()
        assert str(said.value) == str(plain.value) and "unit" in str(said.value)
    with spare_processor():
        forced = Asked(campaign, force=True, as_recorded=None).findings()
    assert forced == require_plausible(campaign, force=True)
    assert len(twins) == 2


@pytest.mark.parametrize("fails", [False, True])
def test_a_device_whose_data_are_wrong_fails_with_the_reason(twins, monkeypatch, fails):
    """Whether the estimation comes to an end meanwhile or not."""
    if fails:
        broken = lambda *_, **__: np.linalg.inv(np.zeros((3, 3)))
        monkeypatch.setattr(pipeline, "reduce_to_dwells", broken)
    campaign = _campaign(9.81)
    with pytest.raises(ValueError) as plain:
        require_plausible(campaign)
    with spare_processor():
        (failure,) = pipeline.calibrate(campaign)
    assert isinstance(failure, DeviceFailure) and failure.reason == str(plain.value)
    assert len(twins) == 1


@pytest.mark.slow
def test_the_command_says_what_is_wrong_and_writes_nothing(tmp_path):
    """In a process of its own, which has a twin where there are two processors."""
    (recording,) = _campaign(1.0 / 9.81).recordings
    assert recording.accel is not None
    rows = np.column_stack([recording.time, recording.accel])
    names = "time,accel_x,accel_y,accel_z"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=names, comments="")
    settings = '[site]\ngravity = 9.81\n[recordings]\nfiles = ["log.csv"]\n'
    (tmp_path / "campaign.toml").write_text(settings)
    command = [sys.executable, "-m", "inertiax", "calibrate", tmp_path, "-o", tmp_path / "out"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 1 and ended.stderr.splitlines()[-1].startswith("inertiax: ")
    assert 'accel = { unit = "g" }' in ended.stderr and "descriptor" not in ended.stderr
    assert not (tmp_path / "out").exists()


def test_a_worker_among_others_has_no_twin(twins):
    asked = Asked(_campaign(1.0), force=False, as_recorded=None)
    assert asked.findings() == require_plausible(_campaign(1.0)) and not twins
