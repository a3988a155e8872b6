"""The criterion for further columns is the ratio of marginal likelihoods, and BIC where rows are many."""

import math

import jax
import numpy as np
import pytest
from scipy.integrate import quad

from inertiax.calibrate.one_triad import require_observable
from inertiax.estimators import Invariant, ReferenceAccel
from inertiax.model_selection.temperature_degree import choose_degree
from inertiax.numerics.further_columns import log_odds
from inertiax.numerics.left_out import log_left_out
from inertiax.physics.temperature import Constant
from inertiax.reduction.dwells import Dwells


@pytest.mark.parametrize("rows, kept, further", [(31, 9, 18), (20, 2, 3), (60, 9, 9)])
def test_it_is_the_ratio_of_the_integrals_over_sigma(rows, kept, further):
    """After the kept columns are projected out, rows are N(0, σ²) or, with the further ones, N(0, σ² (1 + n P))."""
    rng = np.random.default_rng(rows)
    freedom = rows - kept
    part = np.linalg.qr(rng.standard_normal((freedom, further)))[0]
    y = rng.standard_normal(freedom)
    inside = float(np.sum((part.T @ y) ** 2))
    whole = float(y @ y)

    def marginal(square: float, log_det: float) -> float:
        # ∫ σ^(−ν) exp(−square / 2σ²) dσ/σ, with the determinant's root in front; over ln σ.
        density = lambda s: math.exp(-freedom * s - 0.5 * square * math.exp(-2.0 * s))
        middle = 0.5 * math.log(square / freedom)
        return math.exp(-0.5 * log_det) * quad(density, middle - 4.0, middle + 6.0)[0]

    plain = marginal(whole, 0.0)
    wider = marginal(whole - inside * rows / (1.0 + rows), further * math.log1p(rows))
    left = 1.0 - inside / whole
    assert log_odds(rows, kept, further, left) == pytest.approx(math.log(wider / plain), abs=1e-6)


def test_with_many_rows_it_is_half_the_difference_of_bic():
    rows, kept, further, left = 20_000, 9, 9, 0.99
    bic = rows * math.log(left) + further * math.log(rows)
    assert log_odds(rows, kept, further, left) == pytest.approx(-0.5 * bic, rel=0.02)


def test_errors_of_groups_left_out_are_those_of_fits_without_them():
    rng = np.random.default_rng(5)
    design, right = rng.standard_normal((30, 7)), rng.standard_normal(30)
    logs = []
    for group in np.arange(30).reshape(10, 3):
        others = np.setdiff1d(np.arange(30), group)
        solution = np.linalg.lstsq(design[others], right[others], rcond=None)[0]
        logs.append(np.log(np.linalg.norm(right[group] - design[group] @ solution)))
    assert log_left_out(design, right, 3) == pytest.approx(np.mean(logs), rel=1e-9)


def hand_rests(seed: int, *, slope: float, shaken: float = 0.0) -> Dwells:
    """Means of 31 rests that a device warms up over, its biases by `slope` (m/s² over the whole); every fifth one is
    off by `shaken` times a number of Student's t with two degrees of freedom."""
    rng = np.random.default_rng(seed)
    up = rng.standard_normal((31, 3))
    heat = np.linspace(0.0, 1.0, 31)
    force = 9.81 * up / np.linalg.norm(up, axis=1, keepdims=True) + slope * heat[:, None]
    force[::5] += shaken * np.random.default_rng(100 + seed).standard_t(2.0, (7, 3))
    return Dwells(
        time=5.0 * np.arange(31),
        duration=np.full(31, 4.0),
        count=np.full(31, 400.0),
        temperature=20.0 + 15.0 * heat,
        experiment=np.zeros(31, int),
        position=np.arange(31),
        valid=np.ones(31, bool),
        accel=force + 1e-3 * rng.standard_normal((31, 3)),
        accel_covariance=np.tile(1e-6 * np.eye(3), (31, 1, 1)),
    )


def test_few_rests_of_a_device_that_warms_up_do_not_feign_a_dependence_on_temperature():
    """Nine parameters at degree 2 are 27 unknowns for 31 rows, which fit noise to next to nothing."""
    degree = lambda seed, slope: choose_degree(
        Invariant(gravity=9.81), hand_rests(seed, slope=slope)
    )[0]
    assert [degree(seed, 0.0) for seed in range(20)].count(0) >= 19  # a chance of 1 % each at most
    held = [
        choose_degree(Invariant(gravity=9.81), hand_rests(k, slope=0.0, shaken=0.005))[0]
        for k in range(20)
    ]
    assert held.count(0) >= 19  # what a hand does to single rests predicts no other one
    assert [degree(seed, 0.05) for seed in range(20)].count(1) >= 18


def test_a_degree_is_told_by_temperatures_at_which_all_parameters_are():
    """Four soaks of 24 attitudes each whose temperature creeps by 0.8 °C, ramps in one pose between them, and a bias
    that follows one more power of temperature: all is told at four temperatures only. With a fifth soak it is told."""
    rng = np.random.default_rng(7)

    def degree(soaks) -> int:
        up = rng.standard_normal((24, 3))
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        heat, force = [], []
        for low, high in zip(soaks, [*soaks[1:], None]):
            heat.append(low - 0.8 * np.exp(-np.arange(24) / 8.0))
            force.append(9.81 * up)
            if high is not None:
                heat.append(np.linspace(low, high, 12)[1:-1])
                force.append(np.tile([0.0, 0.0, 9.81], (10, 1)))
        t, f = np.concatenate(heat), np.concatenate(force)
        n, x = len(t), (t - 15.0) / 45.0
        accel = f + 0.01 * np.stack([x**4, x**3, x], axis=1) + 1e-4 * rng.standard_normal(f.shape)
        dwells = Dwells(
            time=20.0 * np.arange(n),
            duration=np.full(n, 15.0),
            count=np.full(n, 300.0),
            temperature=t,
            experiment=np.zeros(n, int),
            position=np.arange(n),
            valid=np.ones(n, bool),
            accel=accel,
            accel_covariance=np.tile(1e-8 * np.eye(3), (n, 1, 1)),
            reference_accel=f,
        )
        return choose_degree(ReferenceAccel(), dwells)[0]

    assert degree([-30.0, 0.0, 25.0, 60.0]) == 3
    assert degree([-30.0, -10.0, 15.0, 40.0, 60.0]) == 4


def chamber_rests(seed: int, *, cubic: float = 0.0, warm: float = 0.0, poses: int = 12) -> Dwells:
    """Means of rests in `poses` attitudes at each of nine temperatures of two days. Biases follow the third power by
    `cubic` of their noise, and by `warm` of it the decay of a warm-up at the beginning of either day."""
    rng = np.random.default_rng(seed)
    up = np.eye(3)[[0, 1, 2, 0, 1, 2]] * np.repeat([1.0, -1.0], 3)[:, None]
    up = np.concatenate([up, rng.standard_normal((6, 3))])[:poses]
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    x = np.repeat([-1.0, -0.5, 0.0, 0.5, 1.0, -0.4, 0.1, 0.6, 0.9], poses)
    since = np.r_[: 5 * poses, : 4 * poses]
    n, force = len(x), np.tile(9.81 * up, (9, 1))
    bias = 1e-3 * (cubic * (4.0 * x**3 - 3.0 * x) + warm * np.exp(-since / poses))
    return Dwells(
        time=20.0 * np.arange(n),
        duration=np.full(n, 15.0),
        count=np.full(n, 300.0),
        temperature=15.0 + 45.0 * x,
        experiment=np.repeat(np.arange(9), poses),
        position=np.tile(np.arange(poses), 9),
        valid=np.ones(n, bool),
        accel=force * (1.0 + 0.002 * x[:, None])
        + bias[:, None]
        + 1e-3 * rng.standard_normal((n, 3)),
        accel_covariance=np.tile(1e-6 * np.eye(3), (n, 1, 1)),
        reference_accel=force,
    )


def test_curvature_of_the_biases_alone_is_a_degree_and_a_lag_is_none():
    """Half the noise in 108 rests is worth three columns and not twelve: 0.5 · 3 · 27 · 0.5² = 20 of log likelihood,
    against 0.5 ln 325 = 2.9 for each."""
    said = [choose_degree(ReferenceAccel(), chamber_rests(k, cubic=0.5)) for k in range(10)]
    assert sum(d == 3 and "of the biases alone" in words for d, words in said) >= 8
    for other in ({}, {"warm": 2.0}):
        degrees = [choose_degree(ReferenceAccel(), chamber_rests(k, **other))[0] for k in range(10)]
        assert degrees.count(1) >= 9, other


def creeping_runs(seed: int, *, one_file: bool = False) -> Dwells:
    """Means of 58 rests at each of three temperatures, which a chamber nears by 8 of 75 °C meanwhile. Biases follow the
    second power of temperature and, in each run, a first-order process of 200 s that is three times their noise."""
    rng = np.random.default_rng(seed)
    up = rng.standard_normal((58, 3))
    force = np.tile(9.81 * up / np.linalg.norm(up, axis=1, keepdims=True), (3, 1))
    run, since = np.repeat(np.arange(3), 58), np.tile(9.0 * np.arange(58), 3)
    heat = np.array([-17.0, 23.0, 63.0])[run]
    heat = heat + np.array([14.0, -14.0, -14.0])[run] * np.exp(-since / 600.0)
    slow, decay = rng.standard_normal((3, 58, 3)), np.exp(-9.0 / 200.0)
    for k in range(1, 58):
        slow[:, k] = decay * slow[:, k - 1] + np.sqrt(1.0 - decay**2) * slow[:, k]
    x = ((heat - 23.0) / 36.0)[:, None]
    white = 1e-4 * rng.standard_normal((174, 3))
    return Dwells(
        time=since + 1e4 * run,
        duration=np.full(174, 5.0),
        count=np.full(174, 500.0),
        temperature=heat,
        experiment=0 * run if one_file else run,
        position=np.tile(np.arange(58), 3),
        valid=np.ones(174, bool),
        accel=force * (1.0 + 0.002 * x)
        + (0.02 * x + 0.005 * x**2)
        + 3e-4 * slow.reshape(-1, 3)
        + white,
        accel_covariance=np.tile(1e-8 * np.eye(3), (174, 1, 1)),
        reference_accel=force,
    )


def test_what_a_chamber_creeps_by_within_a_run_is_no_further_temperature():
    """Three temperatures tell a second degree, and what slow noise makes of the slopes within the runs is no third: it
    would bend the curves between the temperatures, where nothing was measured."""
    for one_file in (False, True):
        runs = [creeping_runs(k, one_file=one_file) for k in range(12)]
        assert [choose_degree(ReferenceAccel(), dwells)[0] for dwells in runs] == [2] * 12


def test_references_of_one_pose_tell_biases_and_the_refusal_says_how():
    dwells = chamber_rests(0, poses=1)
    degree, words = choose_degree(ReferenceAccel(), dwells)
    assert degree == 0 and "determine no dependence" in words
    with pytest.raises(ValueError, match='accel_estimator = "static" under'):
        require_observable(ReferenceAccel(), Constant(), dwells)


def test_no_degree_is_taken_whose_unknowns_the_dwells_do_not_determine():
    """The same log twice has 62 rows, and 31 poses: 36 unknowns of degree 3 fit them without a misfit."""
    once = hand_rests(0, slope=0.0)
    twice = jax.tree.map(lambda x: np.concatenate([x, x]), once)
    assert choose_degree(Invariant(gravity=9.81), twice)[0] < 3
