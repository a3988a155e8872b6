"""Scores from products of whitened columns against those from the columns themselves."""

import jax
import numpy as np
import pytest
import scipy.linalg

from diagnose_data import sweep
from inertiax.diagnose.noise.observation_series import NoiseFit, START
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.selection.column_products import ColumnProducts
from inertiax.diagnose.selection.evidence import bank, count_forms, judge
from inertiax.diagnose.selection.score_test import whiten_columns, whiten_system
from inertiax.effects import CATALOGUE


NAMES = ("drift", "bias_step", "warm_up", "temperature_rate", "thermal_lag", "cross_axis_rate")


@pytest.fixture(scope="module")
def triad():
    """Rows of three chains, with terms of one and of several columns, on one channel and on all."""
    with jax.enable_x64(True):
        (made,) = prepare(sweep(1), [e for e in CATALOGUE if e.name in NAMES]).triads
    sizes = {t.size for t in made.candidates}
    assert len(made.system.chains) == 3 and 1 in sizes and max(sizes) > 1
    assert any(len(t.chains) == 3 for t in made.candidates)
    return made


def noises(system):
    """The start of a search, and two that differ from it on one chain each."""
    first = tuple(START.copy() for _ in system.chains)
    made = [first]
    for c, shift in ((0, 1.5), (2, -2.0)):
        theta = [t.copy() for t in first]
        theta[c][1] += shift
        made.append(tuple(theta))
    return [NoiseFit(t, (0.0, 0.0, 0.0)) for t in made]


def test_gains_and_coefficients_are_those_of_the_whitened_columns(triad):
    system, chosen = triad.system, [next(t for t in triad.candidates if t.name == "drift")]
    with jax.enable_x64(True):
        products = ColumnProducts(system, triad.candidates, chosen)
        assert not products.together
        for noise in noises(system):
            expected = {
                id(s.term): s for s in whiten_system(system, noise, triad.candidates, chosen).scores
            }
            sums = products.sums(noise)
            gains = products.gains(sums)
            shown = [k for k, g in enumerate(gains.drop) if np.isfinite(g)]
            assert {id(products.terms[k]) for k in shown} == set(expected)
            for k in shown:
                theirs, own = expected[id(products.terms[k])], products.score(k, sums, gains)
                # A direction that hardly differs from another is known to 1e-7 of the larger one.
                np.testing.assert_allclose(gains.drop[k], theirs.gain, rtol=1e-6, atol=1e-9)
                np.testing.assert_allclose(own.gain, theirs.gain, rtol=1e-6, atol=1e-9)
                if own.size == 1 == products.terms[k].size:
                    np.testing.assert_allclose(own.coefficients, theirs.coefficients, rtol=1e-9)
                    np.testing.assert_allclose(own.covariance, theirs.covariance, rtol=1e-9)


def test_the_gain_of_one_column_is_the_drop_of_a_least_squares(triad):
    system, (noise, *_) = triad.system, noises(triad.system)
    term = next(t for t in triad.candidates if t.name == "drift" and t.size == 1)
    (c,) = term.chains
    with jax.enable_x64(True):
        columns = [system.base.observed[c][:, None], system.frames[c], term.columns[0]]
        white = whiten_columns(system, noise, c, np.concatenate(columns, axis=1))
        products = ColumnProducts(system, [term], [])
        (gain,) = products.gains(products.sums(noise)).drop
    left = [np.sum((white[:, 0] - white[:, 1:n] @ scipy.linalg.lstsq(white[:, 1:n], white[:, 0])[0]) ** 2)
            for n in (white.shape[1] - 1, white.shape[1])]  # fmt: skip
    assert gain == pytest.approx(left[0] - left[1], rel=1e-6)


def test_candidates_of_a_bank_are_judged_as_noise_by_noise(triad):
    system, fits = triad.system, noises(triad.system)
    forms = count_forms(triad.candidates)
    with jax.enable_x64(True):
        start = bank(system, fits, [])
        by_products = judge(system, start, triad.candidates, [], forms, None)
        by_columns = judge(system, start, triad.candidates, [], forms, None, columns=True)
    theirs = {id(c.term): c for c in by_columns}
    assert {id(c.term) for c in by_products} == set(theirs)
    for mine in by_products:
        other = theirs[id(mine.term)]
        assert mine.ratio == pytest.approx(other.ratio, rel=1e-6, abs=1e-8)
        assert not mine.score.white and len(other.score.white) == len(mine.term.chains)


def test_what_was_found_under_one_chains_variances_is_kept(triad, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "inertiax.diagnose.selection.column_products.whiten_columns",
        lambda system, noise, c, columns: (
            asked.append(c) or whiten_columns(system, noise, c, columns)
        ),
    )
    with jax.enable_x64(True):
        products = ColumnProducts(triad.system, triad.candidates, [])
        for noise in noises(triad.system):
            products.sums(noise)
    # Each chain once, and chains 0 and 2 once more under their own other variances.
    assert len(asked) % 5 == 0 and asked.count(0) == asked.count(2) == 2 * asked.count(1)
