"""Errors of the rig that the channels of a triad share: their covariance, and what is seen beyond them."""

import re
from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
import pytest
import scipy.linalg

from diagnose_data import ANGLE, oblique, RATE
from inertiax.diagnose import diagnose
from inertiax.diagnose.noise.common_mode import MOST, signatures
from inertiax.diagnose.noise.common_mode_fit import coupled_theta, JointLikelihood, RIG
from inertiax.diagnose.noise.observation_series import NoiseFit, START, variances
from inertiax.diagnose.noise.reml import fit_noise
from inertiax.diagnose.noise.state_space import stated_price
from inertiax.diagnose.problem import prepare
from inertiax.diagnose.selection.evidence import bank, judge
from inertiax.diagnose.selection.score_test import residual_together, whiten_columns, whiten_system
from inertiax.effects import CATALOGUE
from inertiax.numerics.common_errors import inverse_root


def test_the_signatures_have_the_covariance_of_a_rotation_and_a_rate_error():
    reading = np.array([[1.0, 2.0, -2.0], [1.0, 2.0, -2.0], [3.0, 0.0, 0.0]])
    made, own = signatures(
        reading, np.array([4, 4, 7]), np.full((3, 3), 1e-12), np.full(3, ANGLE), RATE
    )
    assert not own[:2].any() and np.isnan(own[2]).all()  # along an axis nothing is shared
    # By hand: cov(x × ε) = σ² (|x|² I − x xᵀ), with |x| = 3; and σ_ρ² x xᵀ.
    both = np.outer(reading[0], reading[0])
    expected = ANGLE**2 * (9.0 * np.eye(3) - both) + RATE**2 * both
    for a in range(2):
        for b in range(2):  # the same error in both blocks of the dwell
            assert np.allclose(made[a] @ made[b].T, expected, rtol=1e-12, atol=1e-24)
    assert not made[2].any()


def test_rows_with_shared_errors_become_white():
    u = np.random.default_rng(1).standard_normal((9, 4))
    u[:, 3] = 0.0  # an error that shows nowhere
    f = u @ inverse_root(u.T @ u)
    s = np.eye(9) - f @ f.T
    assert np.allclose(s @ (np.eye(9) + u @ u.T) @ s.T, np.eye(9), atol=1e-12)


@pytest.mark.slow
def test_the_joint_likelihood_is_that_of_the_dense_covariance():
    with jax.enable_x64(True):
        (prepared,) = prepare(oblique(5), ()).triads
        system = prepared.system
        num = len(system.base.observed[0])
        errors = np.concatenate(system.shared.columns)
        y = np.concatenate(system.base.observed)
        x = scipy.linalg.block_diag(*system.frames)

        def dense(theta):
            noise = NoiseFit(theta, (0.0,) * 3, theta)
            inverse = [whiten_columns(system, noise, c, np.eye(num), apart=True) for c in range(3)]
            own = scipy.linalg.block_diag(*(np.linalg.inv(w.T @ w) for w in inverse))
            v = own + np.exp(theta[0][RIG]) * errors @ errors.T
            root = np.linalg.cholesky(v)
            a, b = (scipy.linalg.solve_triangular(root, m, lower=True) for m in (x, y))
            q, r = np.linalg.qr(a)
            left = b - q @ (q.T @ b)
            logs = np.log(np.diag(root)).sum() + np.log(np.abs(np.diag(r))).sum()
            return logs + 0.5 * left @ left + 0.5 * stated_price(theta[0][RIG])

        one = tuple(START + 0.0 for _ in range(3))
        other = tuple(
            START + np.array([0.1, -0.5, -1.0, 0.4 * c, 0.0, 0.0, -0.3]) for c in range(3)
        )
        value = JointLikelihood(system, ())
        found = value(one) - value(other)
        expected = dense(one) - dense(other)
    # Sums of 900 terms around a hundred, with rows near 1e-5 rad/s.
    assert found == pytest.approx(expected, rel=1e-5, abs=1e-4)


@pytest.mark.slow
def test_rows_of_all_chains_and_of_one_are_whitened_by_the_dense_covariance():
    """Residuals of all together, and a chain by itself with its own part of errors that last."""
    with jax.enable_x64(True):
        (prepared,) = prepare(oblique(5), ()).triads
        system = prepared.system
        num = len(system.base.observed[0])
        theta = tuple(
            START + np.array([0.1, -0.5, -1.0, 0.4 * c, 0.0, 0.0, -0.3]) for c in range(3)
        )
        noise = NoiseFit(theta, (0.0,) * 3, theta)
        own = []
        for c in range(3):
            white = whiten_columns(system, noise, c, np.eye(num), apart=True)
            own.append(np.linalg.inv(white.T @ white))
        errors = np.exp(0.5 * theta[0][RIG]) * np.concatenate(system.shared.columns)
        v = scipy.linalg.block_diag(*own) + errors @ errors.T
        root = np.linalg.cholesky(v)
        y, x = np.concatenate(system.base.observed), scipy.linalg.block_diag(*system.frames)
        a, b = (scipy.linalg.solve_triangular(root, m, lower=True) for m in (x, y))
        q = np.linalg.qr(a)[0]
        found = np.concatenate(residual_together(system, noise, ()))
        assert found @ found == pytest.approx(b @ b - np.sum((q.T @ b) ** 2), rel=1e-6)
        lasting = replace(system, shared=replace(system.shared, lasting=True, known={}))
        for c in range(3):
            white = whiten_columns(lasting, noise, c, np.eye(num))
            mine = errors[c * num : (c + 1) * num]
            expected = own[c] + mine @ mine.T
            # Of covariances with a condition of 1e4 from inverses of such.
            np.testing.assert_allclose(white @ expected @ white.T, np.eye(num), atol=1e-6)


@pytest.mark.slow
def test_the_rows_tell_the_rigs_errors_from_each_channels_own():
    with jax.enable_x64(True):
        (prepared,) = prepare(oblique(2, promised=0.7, flat=48), ()).triads
        system = prepared.system
        assert system.shared is not None and 0 < system.shared.num <= MOST
        noise = fit_noise(system)
        theta = coupled_theta(noise)
        rig = [np.exp(t[6] / 2.0) for t in theta]
        dwell = [np.sqrt(v.dwell) for v in variances(system, noise.__class__(theta, noise.value))]
    # 54 oblique dwells with three errors each: one sigma of the rig's part is 1 / sqrt(2 · 162) = 6 %; of a chain's
    # own dwell error 1 / sqrt(2 · 72) = 8 %, and what the rig leaves of it takes more. Four of them.
    assert rig == pytest.approx([rig[0]] * 3) and rig[0] == pytest.approx(0.7, rel=0.25)
    assert dwell == pytest.approx([2e-5] * 3, rel=0.5)


@pytest.mark.slow
def test_what_one_channel_says_alone_is_seen_beyond_the_rigs_errors():
    few = [e for e in CATALOGUE if e.name in ("cross_axis_rate", "rate_nonlinearity")]
    # Alone, gyro x has errors of 3e-4 · 1.2 rad/s in half of its oblique dwells at 100 deg/s, ten times its own.
    campaign = oblique(3, product=8e-5)
    # Behind the rig's errors a product of rates on x looks much like the square of one on y: the name is asked here.
    found = diagnose(campaign, effects=few)
    assert [e.name for e in found.effects] == ["cross_axis_rate"]
    with jax.enable_x64(True):
        (prepared,) = prepare(campaign, few).triads
        term = next(
            t for t in prepared.candidates
            if t.name == "cross_axis_rate" and t.channels == (0,) and t.variant.label == "ip"
        )  # fmt: skip
        noise = fit_noise(prepared.system, [term])
        (together,) = whiten_system(prepared.system, noise, [term]).scores
        alone = eqx.tree_at(lambda s: s.shared, prepared.system, None)
        (apart,) = whiten_system(alone, fit_noise(alone, [term]), [term]).scores
    spread = np.sqrt(together.covariance[0, 0])
    assert abs(together.coefficients[0] - 8e-5) < 3.0 * spread
    assert spread < 0.5 * np.sqrt(apart.covariance[0, 0])
    assert diagnose(oblique(4), effects=few).verdict == "consistent"


def test_rivals_that_depend_on_the_input_are_judged_beyond_the_rigs_errors_as_well():
    with jax.enable_x64(True):
        (prepared,) = prepare(oblique(6), ()).triads
    rate = re.compile(
        r"\bw(?![a-z])|\bw_"
    )  # the rate in a formula, such as w^2 sqrt(t) or |w - 0.1 rad/s|
    unlisted = {(t.name, t.variant.label): t for t in prepared.candidates}
    of_input = {k for k, t in unlisted.items() if t.follows_input and "position" not in t.name}
    assert of_input == {k for k in unlisted if rate.search(k[1])}
    assert any(" times " in name for name, _ in of_input)
    assert len(of_input) < len(unlisted)  # a bump in time is none


def test_what_is_scored_on_all_channels_is_judged_by_their_likelihood_together():
    scale = [e for e in CATALOGUE if e.name == "drift"]
    with jax.enable_x64(True):
        (prepared,) = prepare(oblique(7), scale).triads
        system = prepared.system
        term = next(
            t for t in prepared.candidates if t.channels == (1,) and t.variant.label == "scale"
        )
        num = len(system.base.observed[0])
        errors, y = np.concatenate(system.shared.columns), np.concatenate(system.base.observed)
        plain = scipy.linalg.block_diag(*system.frames)
        more = np.zeros((3 * num, 1))
        more[num : 2 * num] = term.columns[0]

        def square_and_logs(fit, x):
            """Generalised least squares by the dense covariance."""
            whole = NoiseFit(fit.theta, (0.0,) * 3, fit.coupled)
            inverse = [whiten_columns(system, whole, c, np.eye(num), apart=True) for c in range(3)]
            own = scipy.linalg.block_diag(*(np.linalg.inv(w.T @ w) for w in inverse))
            factor = np.linalg.cholesky(own + np.exp(fit.coupled[0][RIG]) * errors @ errors.T)
            a, b = (scipy.linalg.solve_triangular(factor, m, lower=True) for m in (x, y))
            q, r = np.linalg.qr(a)
            logs = np.log(np.diag(factor)).sum() + np.log(np.abs(np.diag(r))).sum()
            return np.square(b - q @ (q.T @ b)).sum(), logs

        # The chains' own variances are alike, and those of the fit together are not: only these may count.
        own = tuple(START + 0.0 for _ in range(3))
        fits = [
            NoiseFit(own, (0.0,) * 3, tuple(t + change * np.eye(7)[3] for t in own))
            for change in (0.0, -1.5)
        ]
        ratios = []
        for fit in fits:
            before, logs = square_and_logs(fit, plain)
            gain = before - square_and_logs(fit, np.concatenate([plain, more], axis=1))[0]
            ratios.append((gain, before + 2.0 * logs))
        # The bank looks at chains whose own variances it has not seen; another walk makes the second fit one.
        fits[1] = NoiseFit(tuple(t + 1e-9 for t in own), (0.0,) * 3, fits[1].coupled)
        (found,) = judge(system, bank(system, fits, []), [term], [], {}, None)
    lowest = min(value for _, value in ratios)
    expected = max(gain - (value - lowest) for gain, value in ratios)
    # Sums of thousands of terms of order one.
    assert found.ratio == pytest.approx(expected, rel=1e-4, abs=1e-2)
