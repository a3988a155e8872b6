"""A jump between rests that were searched: several rests on both sides tell it, or one in whose midst it is."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest

from inertiax.diagnose.estimates import persistence


def told(monkeypatch, lengths, moment, searched=True):
    """Whether a jump at a moment persists, in rests of so many blocks of 1 s, where data left out bear it out."""
    term = SimpleNamespace(
        effect=SimpleNamespace(jump=True), variant=SimpleNamespace(settings={"time": moment})
    )
    prepared = SimpleNamespace(
        blocks=SimpleNamespace(dwell=np.repeat(np.arange(len(lengths)), lengths)),
        coarse=SimpleNamespace(time=np.arange(sum(lengths)) + 0.5),
    )
    monkeypatch.setattr(persistence, "searched", lambda _: searched)
    monkeypatch.setattr(persistence, "held_out_rms", lambda _, terms: 2.0 - len(terms))
    return inspect.unwrap(persistence.persists)(prepared, term, [])


@pytest.mark.parametrize(
    ("lengths", "moment", "found"),
    [
        pytest.param([12, 3], 12.0, False, id="one rest after"),
        pytest.param([12, 8], 13.0, False, id="as the last rest begins"),
        pytest.param([12, 3, 4, 5], 15.0, True, id="two on both sides"),
        pytest.param([40], 20.0, True, id="amid a rest"),
        pytest.param([12, 8], 16.0, True, id="amid the last rest"),
    ],
)
def test_a_jump_in_searched_rests(monkeypatch, lengths, moment, found):
    assert told(monkeypatch, lengths, moment) is found


def test_who_states_the_rests_vouches_for_them(monkeypatch):
    assert told(monkeypatch, [12, 3], 12.0, searched=False)
