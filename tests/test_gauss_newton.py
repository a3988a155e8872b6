"""Gauss-Newton on the host against SciPy, and where plain steps diverge."""

import numpy as np
import pytest
import scipy.optimize
from scipy.optimize import least_squares, rosen

from inertiax.numerics.gauss_newton import solve_on_host
from inertiax.numerics.nonnegative import nonnegative_least_squares, squares_with_one_more
from inertiax.numerics.recent_answers import RecentAnswers


def rosenbrock(x):
    """Rosenbrock's function as squares, with its Jacobian by hand."""
    residual = np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])
    return np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]]), residual


def test_rosenbrocks_valley():
    found = solve_on_host(rosenbrock, np.array([-1.2, 1.0]))
    assert found.converged and rosen(found.unknowns) < 1e-20
    np.testing.assert_allclose(found.unknowns, 1.0, rtol=1e-9)


def test_an_arc_tangent_from_where_newtons_step_overshoots():
    """Plain steps on atan x diverge from |x| > 1.39, a textbook's example."""
    rows = lambda x: (np.array([[1.0 / (1.0 + x[0] ** 2)]]), np.arctan(x))
    found = solve_on_host(rows, np.array([3.0]))
    assert found.converged and abs(found.unknowns[0]) < 1e-7


def six_faces(rng, num=13, off=0.004):
    """Outputs of a triad that was put on six faces, milliradians off: misalignments hardly show."""
    up = np.eye(3)[rng.integers(3, size=num)] * rng.choice([-1.0, 1.0], size=num)[:, None]
    up[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    up += off * rng.normal(size=up.shape)
    force = 9.81 * up / np.linalg.norm(up, axis=1, keepdims=True)
    matrix = np.eye(3) + np.tril(0.02 * rng.normal(size=(3, 3)))
    return force @ matrix.T + 0.4 * rng.normal(size=3) + 2e-3 * rng.normal(size=(num, 3))


def invariant(outputs):
    """Whitened residuals |M (a - b)| - g of nine parameters and their Jacobian."""
    lower = np.tril_indices(3)

    def rows(x):
        matrix = np.eye(3)
        matrix[lower] += x[3:]
        centred = outputs - x[:3]
        force = centred @ matrix.T
        size = np.linalg.norm(force, axis=1)
        up = force / size[:, None]
        design = np.concatenate([-up @ matrix, up[:, lower[0]] * centred[:, lower[1]]], axis=1)
        return design / 2e-3, (size - 9.81) / 2e-3

    return rows


def scipys_cost(rows):
    found = least_squares(
        lambda x: rows(x)[1], np.zeros(9), lambda x: rows(x)[0], method="lm", xtol=1e-12
    )
    return 2 * found.cost


def test_six_faces_end_at_scipys_cost():
    logs = [six_faces(np.random.default_rng(seed)) for seed in range(20)]
    # Nearer to the faces the least cost is in a valley that too strong a damping only creeps along.
    logs.append(six_faces(np.random.default_rng(13), num=12, off=0.0005))
    for rows in map(invariant, logs):
        found = solve_on_host(rows, np.zeros(9))
        assert found.converged
        cost = float(np.sum(rows(found.unknowns)[1] ** 2))
        assert cost <= scipys_cost(rows) * (1 + 1e-6)


def test_undetermined_unknowns_do_not_pass():
    rows = lambda x: (np.array([[1.0, 1.0], [2.0, 2.0]]), np.array([1.0, 3.0]))
    assert not solve_on_host(rows, np.zeros(2)).converged


@pytest.mark.parametrize("unknowns", [1, 4])
def test_nonnegative_shares_are_scipys(unknowns):
    rng = np.random.default_rng(unknowns)
    for _ in range(50):
        design, target = np.abs(rng.normal(size=(9, unknowns))), rng.normal(size=9)
        shares, left = nonnegative_least_squares(design, target)
        expected, length = scipy.optimize.nnls(design, target)
        np.testing.assert_allclose(shares, expected, rtol=0.0, atol=1e-12)  # of order 1
        assert left == pytest.approx(length**2, rel=1e-12)


@pytest.mark.parametrize("chosen", [[], [0], [0, 3], [0, 3, 5]])
def test_one_more_share_leaves_what_scipy_leaves(chosen):
    rng = np.random.default_rng(len(chosen))
    for _ in range(20):
        design, target = np.abs(rng.normal(size=(9, 30))), rng.normal(size=9) + 0.3
        design[:, 7] = (
            2.0 * design[:, 3]
        )  # of one direction with a column that may be among those chosen
        before = (
            scipy.optimize.nnls(design[:, chosen], target)[1] if chosen else np.linalg.norm(target)
        )
        left = squares_with_one_more(design, chosen, target)
        for k in set(range(30)) - set(chosen):
            shares, length = scipy.optimize.nnls(design[:, [*chosen, k]], target)
            least = min(left[k], before**2)  # without it, where it does not help
            assert least == pytest.approx(length**2, rel=1e-12)
            assert shares[-1] < 1e-3 or left[k] == pytest.approx(length**2, rel=1e-12)


def test_an_answer_is_worked_out_once_while_it_is_kept():
    asked, answers = [], RecentAnswers(2)
    for number in (1.0, 1.0, 2.0, 3.0, 2.0, 1.0):  # the first is forgotten with the third
        question = (np.full(3, number), None)
        assert answers(question, lambda n=number: asked.append(n) or n) == number
    assert asked == [1.0, 2.0, 3.0, 1.0]
