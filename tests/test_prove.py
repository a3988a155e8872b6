"""Prediction of rows left out, against SciPy and against what can be said beforehand."""

from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

from diagnose_data import only, sweep, tumble
from inertiax.diagnose.estimates.cross_validation import (
    folds,
    gain_over_stretches,
    held_out_rms,
    predict_rest,
    reach,
    TOLD_BY_OTHERS,
)
from inertiax.diagnose.estimates.persistence import lowers_rms, predicts
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.wording.explain import gain_of_channels
from inertiax.diagnose.wording.sentences import gain_on_left_out


def rows(seed: int, count: int = 200):
    """Time, a bias and slope as the model, variances, and four fifths of the rows known."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 1.0, count)
    variance = rng.uniform(0.5, 2.0, count)
    return rng, time, np.stack([np.ones(count), time], axis=1), variance, time >= 0.2


def test_the_reach_of_a_prediction_is_its_variance_over_many_draws():
    """Seven rests of nine tell four parameters; what they say of the two others, over 40 000 draws of noise."""
    rng = np.random.default_rng(7)
    columns = np.column_stack([np.ones(9), rng.standard_normal((9, 3))])
    columns[8] *= [1.0, 4.0, 4.0, 4.0]  # far from the others
    known = np.arange(9) < 7
    drawn = rng.standard_normal((9, 40_000))
    fitted = np.linalg.lstsq(columns[known], drawn[known], rcond=None)[0]
    error = (drawn - columns @ fitted)[~known]
    # A variance of 40 000 draws is known to 0.7 % (1 sigma).
    np.testing.assert_allclose(reach(columns, known)[~known], error.var(axis=1), rtol=0.03)
    assert reach(columns, known)[8] > 3.0 * reach(columns, known)[7]


def test_told_effects_are_predicted_as_least_squares_predicts_them():
    rng, time, model, variance, known = rows(1)
    effects = 1e-6 * np.stack([np.sin(9.0 * time), time**2], axis=1)
    observed = rng.standard_normal(len(time))
    columns = np.concatenate([model, 1e6 * effects], axis=1) / np.sqrt(variance)[:, None]
    outside = scipy.optimize.lsq_linear(columns[known], (observed / np.sqrt(variance))[known]).x
    expected = (columns @ outside * np.sqrt(variance))[~known]
    said = predict_rest(model, effects, observed, variance, known)
    np.testing.assert_allclose(said, expected, rtol=1e-8)


def test_an_effect_that_the_known_rows_do_not_tell_predicts_nothing():
    rng, time, model, variance, known = rows(2)
    start = np.exp(-time / 0.01)[:, None]  # 2e-9 of it is left where the known rows begin
    other = np.sin(9.0 * time)[:, None]
    observed = 5.0 * start[:, 0] + other[:, 0] + 0.1 * rng.standard_normal(len(time))
    alone = predict_rest(model, start, observed, variance, known)
    nothing = predict_rest(model, start[:, :0], observed, variance, known)
    np.testing.assert_allclose(alone, nothing, rtol=1e-12)
    # Beside another effect it takes nothing from it but what the 2e-9 weigh.
    both = np.concatenate([1e3 * start, other], axis=1)
    said = predict_rest(model, both, observed, variance, known)
    np.testing.assert_allclose(said, predict_rest(model, other, observed, variance, known), atol=1e-8)  # fmt: skip


@pytest.mark.parametrize(("part", "adds"), [(0.5, 1.0), (0.2, 4.0), (0.09, 0.0)])
def test_a_coefficient_told_in_part_adds_the_square_that_is_promised(part, adds):
    # By hand: a column of ones, p n rows known, errors of variance 1. The mean of the known ones has the variance
    # 1 / (p n), and (1 - p) n rows are predicted with it: (1 - p) / p in all. Below a tenth nothing is predicted.
    assert TOLD_BY_OTHERS == 0.1
    count, known = 200, np.arange(200) < 200 * part
    ones, none = np.ones((count, 1)), np.zeros((count, 0))
    hat = np.stack([predict_rest(none, ones, e, np.ones(count), known) for e in np.eye(count)])
    assert np.sum(hat**2) == pytest.approx(adds, abs=1e-12)


def test_an_effect_that_the_model_holds_already_changes_nothing():
    rng, time, model, variance, known = rows(3)
    observed = rng.standard_normal(len(time))
    same = (3.0 * model[:, :1] - model[:, 1:]) * 1e-4
    said = predict_rest(model, same, observed, variance, known)
    nothing = predict_rest(model, same[:, :0], observed, variance, known)
    np.testing.assert_allclose(said, nothing, rtol=1e-10)


@pytest.mark.slow
def test_stretches_are_shorter_where_one_alone_shows_a_parameter():
    with jax.enable_x64(True):
        (prepared,) = prepare(tumble(seed=5, step=15.0)).triads
    dwell = np.unique(prepared.blocks.dwell, return_inverse=True)[1]
    assert dwell.max() + 1 == 144  # so that one of 40 stretches has 3 or 4 of them
    long = folds(prepared)
    assert set(long[dwell <= 3]) == {0}
    ones = np.ones(len(dwell))
    columns = np.stack([ones, (dwell == 1) | (dwell == 2)], axis=1)
    system = eqx.tree_at(lambda s: s.frames, prepared.system, (np.linalg.qr(columns)[0],))
    short = folds(replace(prepared, system=system))
    assert len(set(short[dwell == 1]) | set(short[dwell == 2])) == 2
    for fold in (long, short):
        assert set(fold) == set(range(5))
        assert all(len(set(fold[dwell == d])) == 1 for d in range(144))


@pytest.mark.slow
def test_a_warm_up_of_one_stretch_does_not_spoil_the_prediction_of_the_campaign():
    with jax.enable_x64(True):
        (prepared,) = prepare(sweep(seed=7)).triads
        warm = [t for t in prepared.candidates if t.name == "warm_up" and t.chains == (0,)]
        term = min(warm, key=lambda t: t.setting)
        seen = np.square(term.columns[0]).sum(axis=1)
        # The campaign is one rest of 40 chunks of 125 s; this start-up transient is over within two of them.
        assert seen[folds(prepared) >= 2].sum() < 1e-3 * seen.sum()
        plain = held_out_rms(prepared, [])
        # Two coefficients at most of a thousand rows: within a percent.
        assert held_out_rms(prepared, [term]) < 1.01 * plain


@pytest.mark.slow
def test_an_effect_seen_everywhere_is_predicted_as_before():
    with jax.enable_x64(True):
        (prepared,) = prepare(
            tumble(seed=4, effect=lambda f, t: only(1, 8e-4 * f[:, 1] ** 2))
        ).triads
        (term,) = [t for t in prepared.candidates if t.name == "second_order" and t.channels == (1,)]  # fmt: skip
        fold, system, square = folds(prepared), prepared.system, 0.0
        y, w = system.base.observed[0], (system.chains[0].white + system.chains[0].rig) ** -0.5
        x = np.concatenate([system.frames[0], term.columns[0]], axis=1)
        for k in range(5):
            known = fold != k
            there = scipy.linalg.lstsq(x[known] * w[known, None], y[known] * w[known])[0]
            square += np.sum((w * (y - x @ there))[~known] ** 2)
        with_it = held_out_rms(prepared, [term])
        assert with_it == pytest.approx(np.sqrt(square / np.sum(w**2)), rel=1e-9)
        assert with_it < 0.7 * held_out_rms(prepared, [])


@pytest.mark.slow
def test_a_gain_is_that_of_the_channels_that_the_effect_touches():
    """1 - rms with / rms without of gyro_x alone by SciPy; y and z, which would dilute it, are not counted."""
    with jax.enable_x64(True):
        (prepared,) = prepare(
            sweep(seed=7, effect=lambda f, t: only(0, 2e-6 * (t > 2000.0)))
        ).triads
        jumps = [t for t in prepared.candidates if t.name == "bias_step" and t.chains == (0,)]
        term = min(jumps, key=lambda t: abs(t.setting - 2000.0))
        fold, system, rms = folds(prepared), prepared.system, []
        y, w = system.base.observed[0], (system.chains[0].white + system.chains[0].rig) ** -0.5
        for extra in ([], [term.columns[0]]):
            x, square = np.concatenate([system.frames[0], *extra], axis=1), 0.0
            for k in range(5):
                known = fold != k
                there = scipy.linalg.lstsq(x[known] * w[known, None], y[known] * w[known])[0]
                square += np.sum((w * (y - x @ there))[~known] ** 2)
            rms.append(np.sqrt(square))
        gain = gain_of_channels(prepared, [term], "bias_step")
        assert gain == pytest.approx(1.0 - rms[1] / rms[0], rel=1e-6) and gain > 0.05
        assert held_out_rms(prepared, [term], [1, 2]) == held_out_rms(prepared, [], [1, 2])
        assert gain > 2.0 * (1.0 - held_out_rms(prepared, [term]) / held_out_rms(prepared, []))


@pytest.mark.slow
@pytest.mark.parametrize(("second", "carried"), [(1.0, True), (0.4, False)])
def test_what_acts_throughout_is_carried_by_more_than_one_dwell(second, carried):
    """By hand: two dwells of sizes 1 and s, each told by the other, fall by 1 and s² and carry (1 + s²)² / (1 + s⁴)
    dwells: 2 for s = 1, 1.3 for s = 0.4."""
    with jax.enable_x64(True):
        (prepared,) = prepare(tumble(seed=4)).triads
        (term,) = [t for t in prepared.candidates if t.name == "second_order" and t.channels == (1,)]  # fmt: skip
        dwell = np.unique(prepared.blocks.dwell, return_inverse=True)[1]
        # Stretches have one or two dwells, so that these are not left out together.
        first, other = dwell == 0, dwell == 3
        column = 1.0 * first + second * other
        term = replace(term, columns=(column[:, None],))
        base = eqx.tree_at(lambda b: b.observed, prepared.system.base, (column,))
        apart = ((~first & ~other)[:, None].astype(float),)  # a model that has no part in the two
        system = eqx.tree_at(lambda s: (s.base, s.frames), prepared.system, (base, apart))
        prepared = replace(prepared, system=system)
        gain = gain_over_stretches(prepared, term, [])
        assert gain.sum() == pytest.approx(first.sum() + second**2 * other.sum(), rel=1e-9)
        assert predicts(prepared, term, []) is carried


@pytest.mark.slow
def test_what_raises_the_rms_of_data_left_out_may_gain_by_its_variance():
    """Two coefficients beside errors that grow with the columns: most dwells gain by their own variance, and the few
    that matter lose."""
    with jax.enable_x64(True):
        (prepared,) = prepare(tumble(seed=4)).triads
        (term,) = [t for t in prepared.candidates if t.name == "second_order" and t.channels == (1,)]  # fmt: skip
        dwell = np.unique(prepared.blocks.dwell, return_inverse=True)[1]
        rng = np.random.default_rng(217)
        size = np.exp(1.5 * rng.standard_normal(72))
        columns = size[:, None] * rng.standard_normal((72, 2))
        observed = columns.sum(axis=1) + 0.7 * size * rng.standard_normal(72)
        term = replace(term, columns=(columns[dwell],))
        base = eqx.tree_at(lambda b: b.observed, prepared.system.base, (observed[dwell],))
        constant = (np.ones((len(dwell), 1)),)
        system = eqx.tree_at(lambda s: (s.base, s.frames), prepared.system, (base, constant))
        prepared = replace(prepared, system=system)
        assert gain_over_stretches(prepared, term, []).sum() > 0.0
        assert held_out_rms(prepared, [term]) > 1.2 * held_out_rms(prepared, [])
        assert not lowers_rms(prepared, term, [])


@pytest.mark.slow
def test_only_a_position_that_comes_again_has_a_level_of_its_own():
    with jax.enable_x64(True):
        levels = [
            [t for t in prepare(tumble(seed=4, sessions=n)).triads[0].candidates if t.name == "~position"]
            for n in (1, 2)
        ]  # fmt: skip
    assert [len(found) for found in levels] == [0, 3]


def test_the_gain_is_said_as_it_is():
    assert gain_on_left_out(0.634, "the rms") == "lowers the rms by 63 %"
    assert gain_on_left_out(-0.02, "the rms") == "raises the rms by 2 %"
    assert gain_on_left_out(0.004, "the rms") == "leaves the rms as it is within half a percent"
