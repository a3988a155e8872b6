"""What a search between the points of a grid costs."""

from itertools import combinations

import jax
import numpy as np
import pytest

from diagnose_cases import score
from diagnose_data import still
from inertiax.diagnose.problem import between_all, finer, prepare
from inertiax.diagnose.selection.trials_factor import searched_tests
from inertiax.effects import CATALOGUE


GRID = np.arange(5.0)
BETWEEN = np.concatenate([k + np.linspace(0.1, 0.9, 6) for k in GRID[:-1]])


def orthogonal(count):
    return np.linalg.qr(np.random.default_rng(1).standard_normal((200, count)))[0].T


def test_forms_between_count_each_where_they_are_independent():
    rows = orthogonal(len(GRID) + len(BETWEEN))
    grid = [(v, score(r, "step", 0)) for v, r in zip(GRID, rows)]
    fine = [(v, score(r, "step", 0)) for v, r in zip(BETWEEN, rows[len(GRID) :])]
    # By hand: two points of the grid lead by chance, and what lies beside them is looked at as well.
    looked = [
        5 + sum(any(abs(v - GRID[p]) < 1.0 for p in pair) for v in BETWEEN)
        for pair in combinations(range(5), 2)
    ]
    wanted = 1.0 / np.mean(
        1.0 / np.array(looked)
    )  # -log(1 - p) of the smallest of M is 1 / M in the mean
    assert 5 < wanted < 29
    # N is known to 1 / sqrt(draws / 2), 2.2 %: two of them.
    assert searched_tests(grid, fine, [200], draws=4000).number == pytest.approx(wanted, rel=0.05)


def test_forms_between_cost_nothing_where_they_are_the_same_test():
    rows = orthogonal(len(GRID))
    grid = [(v, score(r, "step", 0)) for v, r in zip(GRID, rows)]
    fine = [(v, score(rows[int(v)], "step", 0)) for v in BETWEEN]
    assert searched_tests(grid, fine, [200], draws=4000).number == pytest.approx(5.0, rel=0.05)


def test_every_form_that_a_nearer_look_can_reach_is_counted():
    effect = next(e for e in CATALOGUE if e.name == "bias_step")
    with jax.enable_x64(True):
        (prepared,) = prepare(still(2000.0), (effect,)).triads
        mine = [t for t in prepared.candidates if t.name == "bias_step" and t.channels == (0,)]
        every = {t.setting for t in mine} | {t.setting for t in between_all(prepared, mine[0])}
        reached = {t.setting for start in mine[::9] for t in finer(prepared, start)}
    assert len(reached) > len(mine)
    assert reached <= every
