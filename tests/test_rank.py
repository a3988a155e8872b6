"""`succeeded` implies full rank: one rule for the audit of a plan and for the outcome of a solve."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibrate.observability import judge_normal
from inertiax.estimators import Invariant
from inertiax.physics.temperature import Constant
from inertiax.procedure.rank import determines_all, has_full_rank
from inertiax.procedure.single_device import joint_fit_one, Problem
from inertiax.procedure.thermal_iterations import joint_fit
from inertiax.reduction.dwells import Dwells


G = 9.81
TRIAD = Invariant(gravity=G)


def _plan(tilt: float) -> Dwells:
    """Faces, edges without those in the xy plane, and +x once more, turned about z by `tilt` rad.

    The element [1,0] enters |a| by x y alone, which is about `tilt` in one rest: 8 of 9 unknowns for tilt = 0.
    """
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    signs = [(s, t) for s in (1, -1) for t in (1, -1)]
    edges = [[s, 0, t] for s, t in signs] + [[0, s, t] for s, t in signs]
    turned = [[np.cos(tilt), np.sin(tilt), 0]]
    force = G * np.concatenate([faces, np.array(edges) / np.sqrt(2.0), turned])
    matrix = np.array([[1.01, 0, 0], [0.004, 0.99, 0], [-0.003, 0.006, 1.008]])
    output = force @ matrix.T + [0.05, -0.02, 0.1]
    output += 1e-4 * np.random.default_rng(0).normal(size=output.shape)
    n = len(output)
    zero = np.zeros(n)
    return Dwells(
        zero, zero + 5.0, zero + 500.0, zero, np.zeros(n, int), np.arange(n), np.ones(n, bool),
        accel=output, accel_covariance=np.tile(1e-8 * np.eye(3), (n, 1, 1)),
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("tilt, rank", [(0.0, 8), (3e-5, 8), (3e-3, 9)])
def test_succeeded_implies_full_rank(tilt, rank):
    dwells = _plan(tilt)
    problem = Problem(TRIAD, Constant(), dwells)
    design, _ = problem.rows(np.zeros((1, 9)))
    # Outside check of the plan's rank at the ideal triad: biases share one scale, matrix elements another.
    norms = np.linalg.norm(design, axis=0)
    kinds = np.r_[np.full(3, norms[:3].max()), np.full(6, norms[3:].max())]
    singular = np.linalg.svd(design / kinds, compute_uv=False)
    assert int(np.sum(singular > 1e-4 * singular[0])) == rank
    assert judge_normal(design.T @ design, TRIAD.names, 1).rank == rank
    on_host = joint_fit_one(TRIAD, Constant(), dwells)
    compiled = joint_fit(TRIAD, Constant(), jax.tree.map(jnp.asarray, dwells))
    for solution in (on_host, compiled):
        assert bool(solution.succeeded) == (rank == 9)
        assert np.all(np.isfinite(solution.covariance)) == (rank == 9)


@pytest.mark.parametrize("size", [1, 5])
def test_both_forms_of_the_rule_agree_to_the_bound_of_the_largest_eigenvalue(size):
    rng = np.random.default_rng(2)
    names = ("accel.bias[0]", "accel.bias[1]", "accel.matrix[0,0]")
    count = size * len(names)
    turn = np.linalg.qr(rng.normal(size=(count, count)))[0]
    check = jax.jit(lambda n: determines_all(n, names, size))
    for smallest, full in ((0.9e-4, False), (1.3e-4, True)):
        values = np.r_[np.ones(count - 1), smallest]
        normal = (turn * values**2) @ turn.T
        # Of unit columns but for the last direction's share; scaling by kind is a matter of some per cent here.
        scale = np.sqrt(np.diagonal(normal))
        normal = normal / np.outer(scale, scale)
        spread = np.sqrt(np.linalg.eigvalsh(normal)[[0, -1]])
        assert (spread[0] > 1e-4 * spread[1]) == has_full_rank(normal, names, size)
        if full and spread[0] > 1.1e-4 * spread[1]:
            assert bool(check(jnp.asarray(normal)))
        if not has_full_rank(normal, names, size):
            assert not bool(check(jnp.asarray(normal)))
    unknown = np.full((count, count), np.nan)
    assert not has_full_rank(unknown, names, size) and not bool(check(jnp.asarray(unknown)))
