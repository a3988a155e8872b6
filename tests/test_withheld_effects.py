"""Names that are applied to a calibration, and those that are not; rows of one log, with odds and sizes made up."""

import jax
import numpy as np
import pytest

from diagnose_data import tumble
from inertiax.calibration.fitted_effects import FittedEffect
from inertiax.diagnose.estimates.augmented_calibration import _widened, Beside
from inertiax.diagnose.estimates.withheld_effects import with_likely_applied, withheld_sentence
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.selection.evidence import Candidate
from inertiax.diagnose.selection.score_test import Score
from inertiax.diagnose.selection.verdict import Named


@pytest.fixture(scope="module")
def problem():
    with jax.enable_x64(True):
        return prepare(tumble(seed=4))


def candidate(problem, name, size, chance):
    """A name on accel_y, of that coefficient and chance."""
    (prepared,) = problem.triads
    term = next(t for t in prepared.candidates if t.name == name and t.channels == (1,))
    values = np.full(term.size, size)
    score = Score(term, term.chains, term.columns, np.eye(term.size), values, 100.0)
    return Candidate(term, score, 100.0, float(np.log(chance)))


def beside(problem, lead, rivals):
    (prepared,) = problem.triads
    stored = FittedEffect(
        lead.term.name, "accel", (1,), (), lead.score.coefficients, np.zeros((1, 1)), "m/s^2/g^2"
    )
    return Beside(prepared, (lead.term,), (stored,), (Named(lead, 1e-9, tuple(rivals)),))


@pytest.mark.parametrize(
    ("chance", "size", "applied"),
    [
        (0.42, 1e-2, False),  # 0.1 % of g: the rival moves the calibration elsewhere
        (0.58, 1e-2, True),
        (0.42, 1e-9, True),  # neither moves it
    ],
)
def test_a_name_is_applied_where_less_is_left_to_expect_than_without_any(
    problem, chance, size, applied
):
    lead = candidate(problem, "second_order", size, chance)
    rival = candidate(problem, "third_order", size, 1.0 - chance)
    plain = problem.plain.calibration
    one = beside(problem, lead, [rival])
    found = with_likely_applied(one, plain)
    assert len(found.stored) == len(found.terms) == applied
    assert (found is one) == applied and len(found.withheld) == (not applied)


def test_a_name_whose_rivals_move_the_calibration_the_same_way_is_applied(problem):
    lead = candidate(problem, "second_order", 1e-2, 0.42)
    rival = candidate(problem, "second_order", 0.6e-2, 0.58)
    one = beside(problem, lead, [rival])
    assert with_likely_applied(one, problem.plain.calibration) is one


def test_without_rivals_all_is_applied(problem):
    one = beside(problem, candidate(problem, "second_order", 1e-2, 1.0), [])
    assert with_likely_applied(one, problem.plain.calibration) is one


def test_the_uncertainty_holds_what_every_name_would_move(problem):
    """Two names of one half each that move the calibration by s: their mean square about it is s², as of one by it."""
    names = [candidate(problem, "second_order", 1e-2, 0.4) for _ in range(2)]
    (prepared,), plain = problem.triads, problem.plain.calibration.accel
    alike = Beside(prepared, (), (), withheld=(Named(names[0], 1e-9, (names[1],)),))
    added = np.asarray(_widened(plain, alike).covariance) - np.asarray(plain.covariance)
    # By hand: least squares of the model's own columns on what K2 adds to |f|, weighted by the white noise.
    base, weight = prepared.system.base, 1.0 / np.sqrt(prepared.system.chains[0].white)
    (column,) = names[0].term.columns
    moved, *_ = np.linalg.lstsq(
        base.columns[0] * weight[:, None], 1e-2 * column[:, 0] * weight, rcond=None
    )
    expected = np.zeros(len(added))
    expected[base.index[0]] = moved
    np.testing.assert_allclose(added, np.outer(expected, expected), atol=1e-9 * added.max())
    said = withheld_sentence(alike.withheld[0])
    assert said.startswith(
        "second_order on accel_y is found and not applied in calibration.json: its odds are 50 %"
    )
