"""Checks that a twin of the process makes while it estimates."""

import os
from collections.abc import Callable

import numpy as np
import pytest

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
    with pytest.raises(ValueError) as said:
        asked.findings()
    assert str(said.value) == str(plain.value) and "unit" in str(said.value)
    with spare_processor():
        forced = Asked(campaign, force=True, as_recorded=None).findings()
    assert forced == require_plausible(campaign, force=True)
    assert len(twins) == 2


def test_a_worker_among_others_has_no_twin(twins):
    asked = Asked(_campaign(1.0), force=False, as_recorded=None)
    assert asked.findings() == require_plausible(_campaign(1.0)) and not twins
