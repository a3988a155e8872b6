"""The moment of a jump: a staircase of likelihood over the times between blocks, and one moment for one event."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import uniform

from inertiax.diagnose.candidates.signatures import Term
from inertiax.diagnose.estimates import moments
from inertiax.diagnose.estimates.moments import Moments, tuned_moments
from inertiax.effects import Variant


EDGES = np.array([0.0, 1.0, 2.0, 9.0, 10.0, 11.0, 30.0, 31.0])  # two gaps, of 7 s and of 19 s
BETWEEN = np.diff(EDGES) > 2.0


def profile(gain, name="term"):
    gain = np.asarray(gain, float)
    none = Variant("", {})
    members = [Term(f"{name} {k}", "accel", (0,), none, (), ()) for k in range(len(gain))]
    return Moments(EDGES[:-1], EDGES[1:], gain, BETWEEN, (members,))


def test_a_jump_in_one_gap_is_known_to_its_width_over_the_root_of_twelve():
    found = profile([0, 0, 50, 0, 0, 0, 0])
    assert found.spread() == pytest.approx(uniform(2.0, 7.0).std(), rel=1e-3)


def test_gaps_that_fit_as_well_add_their_distance():
    """Against the integral of the density over both gaps, about the middle of the better one."""
    found = profile([0, 0, 50, 0, 0, 48, 0])
    density = lambda t: np.exp(25.0) if 2.0 < t < 9.0 else np.exp(24.0) if 11.0 < t < 30.0 else 1.0
    over = lambda f: quad(f, 0.0, 31.0, points=list(EDGES[1:-1]), limit=200)[0]
    square = over(lambda t: density(t) * (t - 5.5) ** 2) / over(density)
    assert found.spread() == pytest.approx(np.sqrt(square), rel=1e-6)
    assert found.spread() > 10.0


def tuned(monkeypatch, profiles, *, searched):
    given = iter(profiles)
    monkeypatch.setattr(moments, "_profile", lambda *_: next(given))
    monkeypatch.setattr(moments, "searched", lambda _: searched)
    system = SimpleNamespace(num_rows=1000, chains=(0,))  # ln n = 6.9
    judged = inspect.unwrap(tuned_moments)  # without the check of types: a stand-in has no rows
    terms = [p.members[0][0] for p in profiles]
    made = judged(SimpleNamespace(system=system), None, terms, [])
    return [(term.name, std) for term, std in made]


@pytest.mark.parametrize(("second", "shared"), [(20.0, True), (40.0, False)])
def test_channels_share_a_moment_unless_their_own_are_worth_a_parameter(
    monkeypatch, second, shared
):
    x = profile([0, 0, 50, 0, 0, 38, 0], "x")
    y = profile([0, 0, 16, 0, 0, second, 0], "y")  # alone better by 4, or by 24, in the other gap
    (a, first), (b, other) = tuned(monkeypatch, [x, y], searched=False)
    assert (a, b) == (("x 2", "y 2") if shared else ("x 2", "y 5"))
    assert (first == other) == shared


@pytest.mark.parametrize(
    ("searched", "inside", "place"), [(True, 58.0, 2), (True, 80.0, 3), (False, 58.0, 3)]
)
def test_a_moment_within_a_rest_that_was_found_must_stand_out(monkeypatch, searched, inside, place):
    """χ² of one degree of freedom passes 10.2 with a chance of 0.01/7 (tables): 8 is chance, 30 is none."""
    ((term, _),) = tuned(monkeypatch, [profile([0, 0, 50, inside, 0, 0, 0])], searched=searched)
    assert term == f"term {place}"
