"""Names that rests left out do not exclude, by hand: rows in which the terms differ in as many dwells as one likes."""

from dataclasses import replace
from types import SimpleNamespace

import equinox as eqx
import jax
import numpy as np
import pytest
import scipy.stats

from diagnose_data import tumble
from inertiax.diagnose import findings
from inertiax.diagnose.estimates.predicted_rivals import named_instead, with_predicted_rivals
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.selection.evidence import Candidate
from inertiax.diagnose.selection.score_test import Score
from inertiax.diagnose.selection.verdict import Named


@pytest.fixture(scope="module")
def rows():
    """Rows of an invariant triad whose model has no part in the first two dwells of every six."""
    with jax.enable_x64(True):
        (prepared,) = prepare(tumble(seed=4)).triads
    dwell = np.unique(prepared.blocks.dwell, return_inverse=True)[1]
    apart = (dwell % 6 > 1)[:, None].astype(float)
    return eqx.tree_at(lambda s: s.frames, prepared.system, (apart,)), prepared, dwell


def seen(rows, observed):
    system, prepared, _ = rows
    base = eqx.tree_at(lambda b: b.observed, system.base, (observed,))
    return replace(prepared, system=eqx.tree_at(lambda s: s.base, system, base))


def candidate(rows, name, column, evidence):
    """A name whose column is made up; what its score says is not asked."""
    _, prepared, _ = rows
    like = next(t for t in prepared.candidates if t.name == name and t.channels == (1,))
    term = replace(like, columns=(column[:, None],))
    score = Score(term, (0,), (column[:, None],), np.eye(1), np.ones(1), 100.0)
    return Candidate(term, score, 100.0, evidence)


@pytest.mark.slow
@pytest.mark.parametrize(("dwells", "kept"), [(3, True), (12, False)])
def test_a_rival_that_predicts_nothing_is_kept_where_few_rests_tell(rows, dwells, kept):
    """n dwells of one size, all but one of which tell each: the rival is behind by √n standard errors."""
    dwell = rows[2]
    mine = np.isin(dwell, 6 * np.arange(dwells)).astype(float)
    other = np.isin(dwell, 6 * np.arange(12) + 1).astype(float)
    lead = candidate(rows, "second_order", mine, 50.0)
    rival = candidate(rows, "third_order", other, 30.0)
    found = with_predicted_rivals(seen(rows, mine), Named(lead, 1e-9, (), (rival,)), [])
    assert [r.term.name for r in found.rivals] == (["third_order"] if kept else [])
    if kept:
        t = np.sqrt(dwells)
        odds = scipy.stats.norm.sf(t) / scipy.stats.norm.cdf(t)
        assert np.exp(found.rivals[0].evidence - 50.0) == pytest.approx(odds, rel=1e-6)


def test_a_rival_that_predicts_the_same_is_as_likely(rows):
    mine = np.isin(rows[2], 6 * np.arange(12)).astype(float)
    lead = candidate(rows, "second_order", mine, 50.0)
    rival = candidate(rows, "third_order", -2.0 * mine, 30.0)
    found = with_predicted_rivals(seen(rows, mine), Named(lead, 1e-9, (), (rival,)), [])
    assert [r.evidence for r in found.rivals] == [pytest.approx(50.0, abs=1e-9)]
    assert found.near == () and found.odds == pytest.approx([0.5, 0.5])


def test_names_that_hardly_act_do_not_take_the_place_of_one_that_fits_as_well(rows):
    """Four names of next to no likelihood predict alike, being next to nothing; a jump has it, and many moments."""
    dwell = rows[2]
    mine = np.isin(dwell, 6 * np.arange(3)).astype(float)
    other = np.isin(dwell, 6 * np.arange(12) + 1).astype(float)
    lead = candidate(rows, "odd_quadratic", mine, 50.0)
    idle = [
        replace(candidate(rows, name, other, 46.0 - k), ratio=2.0)
        for k, name in enumerate(("second_order", "third_order", "scale_asymmetry", "drift"))
    ]
    jump = replace(candidate(rows, "bias_step", other, 40.0), ratio=lead.ratio - 1.0)
    found = with_predicted_rivals(seen(rows, mine), Named(lead, 1e-9, (), (*idle, jump)), [])
    assert [r.term.name for r in found.rivals] == ["bias_step", *(c.term.name for c in idle[:3])]
    far = replace(jump, ratio=lead.ratio - 7.0)  # beyond the bound of the set
    found = with_predicted_rivals(seen(rows, mine), Named(lead, 1e-9, (), (*idle, far)), [])
    assert "bias_step" not in [r.term.name for r in found.rivals]


def test_a_name_that_is_left_out_takes_its_part_of_the_odds(rows):
    """35 to 1 against one rival: beyond the set's 20 to 1, and the name is no certainty: 35 / 36."""
    lead = candidate(rows, "second_order", np.ones(len(rows[2])), np.log(35.0))
    left_out = candidate(rows, "third_order", np.ones(len(rows[2])), 0.0)
    assert Named(lead, 1e-9, (), (left_out,)).odds == pytest.approx([35.0 / 36.0])


@pytest.mark.parametrize(("chance", "told"), [(1e-6, True), (0.2, False)])
def test_a_rival_that_lowers_the_rms_takes_the_place_of_a_name_that_raises_it(
    rows, monkeypatch, chance, told
):
    """Two dwells differ: the name has one of them and one that does not, the rival has both."""
    within = lambda *dwells: np.isin(rows[2], dwells).astype(float)
    lead = candidate(rows, "scale_asymmetry", within(0, 12), 50.0)
    rival = candidate(rows, "second_order", within(0, 6), 49.0)
    made = object.__new__(findings.Finding)  # what the search found beside these is not asked
    answer = SimpleNamespace(
        verdict="missing-physics",
        named=(Named(lead, 1e-9, (rival,)),),
        tests=SimpleNamespace(p_value=lambda _: chance),
    )
    vars(made).update(prepared=seen(rows, within(0, 6)), answer=answer, scores=())
    found = []
    monkeypatch.setattr(findings, "_with_names", lambda made, kept: found.extend(kept) or made)
    findings._as_stated(made)
    if not told:
        assert found == []
        return
    (named,) = found
    assert named.candidate is rival and named.p_value == chance
    assert [(r.term.name, r.evidence) for r in named.rivals] == [("scale_asymmetry", 49.0)]


def test_a_name_that_predicts_as_well_stands_in_place_of_an_unlisted_dependence(rows):
    mine = np.isin(rows[2], 6 * np.arange(12)).astype(float)
    other = np.isin(rows[2], 6 * np.arange(12) + 1).astype(float)
    unlisted = candidate(rows, "second_order", mine, 50.0)
    good = Named(candidate(rows, "third_order", mine, 20.0), 1e-6, ())
    useless = Named(candidate(rows, "odd_quadratic", other, 40.0), 1e-6, ())
    data = seen(rows, mine)
    found = named_instead(data, unlisted, [useless, good], [])
    assert found is not None and found.candidate.term.name == "third_order"
    assert named_instead(data, unlisted, [useless], []) is None
