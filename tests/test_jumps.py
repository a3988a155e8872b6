"""Jumps of a bias: moments between rests are tried, and fast turns do not hide what the rests show."""

from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
import pytest
import scipy.linalg

from diagnose_data import only, tumble
from inertiax.diagnose.estimates.cross_validation import folds, held_out_rms
from inertiax.diagnose.estimates.persistence import persists
from inertiax.diagnose.problem import prepare, retuned
from inertiax.effects import CATALOGUE, Signal


JUMP = next(e for e in CATALOGUE if e.name == "bias_step")


def stays(number: int, seconds: float = 8.0, pause: float = 3.0) -> Signal:
    """A triad at rest `number` times, once a second, with a pause between two rests that has no rows."""
    time = np.concatenate([k * (seconds + pause) + np.arange(seconds) for k in range(number)])
    since = np.tile(np.arange(seconds), number)
    nothing = np.zeros((len(time), 3))
    return Signal("accel", time, nothing, nothing, time, time, since, nothing, np.ones(len(time)))


def test_each_gap_between_few_rests_has_a_moment():
    signal = stays(15)
    tried = np.array([v.settings["time"] for v in JUMP.variants(signal)])
    begins = 11.0 * np.arange(
        1, 14
    )  # of all rests but the first, and the last, which is near the end
    for begin in begins:
        assert np.any((tried > begin - 4.0) & (tried <= begin)), begin
    inside = (tried % 11.0 > 0) & (tried % 11.0 < 8.0)
    assert inside.sum() >= 20  # and moments within rests


def test_many_rests_do_not_make_many_moments():
    assert len(JUMP.variants(stays(300))) <= 72


@pytest.mark.slow
def test_a_jump_between_two_of_a_dozen_rests_is_seen_as_a_regression_sees_it():
    """The drop of the sum of squares by the best moment is SciPy's at the true one."""
    moment = 12 * 5 + 10.0  # s, between the sixth rest and the seventh
    with jax.enable_x64(True):
        campaign = tumble(seed=3, sessions=1, effect=lambda f, t: only(1, 0.02 * (t > moment)))
        (prepared,) = prepare(campaign).triads
        mine = [t for t in prepared.candidates if t.name == "bias_step" and t.channels == (1,)]
        y, frame = prepared.system.base.observed[0], prepared.system.frames[0]
        w = prepared.system.chains[0].white ** -0.5

        def drop(column):
            both = np.column_stack([frame, column])
            left = [
                y * w - (x * w[:, None]) @ scipy.linalg.lstsq(x * w[:, None], y * w)[0]
                for x in (frame, both)
            ]
            return left[0] @ left[0] - left[1] @ left[1]

        (true,) = retuned(prepared, mine[0], [moment])
        best = max(drop(t.columns[0]) for t in mine)
        assert best > 0.98 * drop(true.columns[0])


@pytest.mark.slow
def test_rests_show_a_jump_beside_turns_whose_rows_err_much_more():
    with jax.enable_x64(True):
        moment = 400.0
        campaign = tumble(seed=4, effect=lambda f, t: only(1, 3e-4 * (t > moment)))
        (prepared,) = prepare(campaign).triads
        (jump,) = retuned(
            prepared,
            next(t for t in prepared.candidates if t.name == "bias_step" and t.channels == (1,)),
            [moment],
        )
        # Every third position errs by a tenth of m/s² more, as its rig states.
        dwell, rng = prepared.blocks.dwell, np.random.default_rng(0)
        loud = dwell % 3 == 0
        errors = 0.1 * rng.standard_normal(dwell.max() + 1)[dwell] * loud
        base, (chain,) = prepared.system.base, prepared.system.chains
        quiet = prepared.system
        seen = eqx.tree_at(lambda s: s.base.observed, quiet, (base.observed[0] + errors,))
        loud_rig = (eqx.tree_at(lambda c: c.rig, chain, 0.01 * loud),)
        louder = replace(prepared, system=eqx.tree_at(lambda s: s.chains, seen, loud_rig))
        assert persists(louder, jump, [])
        # The rms is SciPy's, each row by one over its variance.
        fold, y, x = folds(louder), louder.system.base.observed[0], louder.system.frames[0]
        w, square = (chain.white + 0.01 * loud) ** -0.5, 0.0
        for k in range(5):
            known = fold != k
            there = scipy.linalg.lstsq(x[known] * w[known, None], y[known] * w[known])[0]
            square += np.sum((w * (y - x @ there))[~known] ** 2)
        assert held_out_rms(louder, []) == pytest.approx(np.sqrt(square / np.sum(w**2)), rel=1e-6)
        # Were all rows alike, the loud positions would decide, and the jump would not be seen.
        alike = replace(prepared, system=seen)
        gain = held_out_rms(alike, []) - held_out_rms(alike, [jump])
        assert gain < 1e-3 * held_out_rms(alike, [])
