"""The live posterior against the batch estimators, numerical integration and least squares of SciPy."""

import jax
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import least_squares, minimize
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from scipy.stats import norm, t as student

from inertiax.data.recording import Campaign, Rig, Site
from inertiax.estimators import Invariant, ReferenceAccel
from inertiax.live.accel_rows import accel_posterior, ByMagnitude, ByReference, RestMeans
from inertiax.live.estimate import estimate
from inertiax.live.gyro_rows import integrated, planned_rows, Turn, turn_rows
from inertiax.live.next_position import best_position, followed, in_words, Part, planned_shares
from inertiax.live.posterior import posterior_of, Rows
from inertiax.live.rest_ledger import mean_covariances, Rest
from inertiax.live.rests_ahead import rests_ahead
from inertiax.live.target import parse_target
from inertiax.live.warming import away_from_mean, followed_slopes
from inertiax.physics.directions import hand_directions, nearest_by_hand, up_in_words
from inertiax.reduction.dwells import Dwells


GRAVITY = 9.81


def rests(rng, count, sigma, vector, reference=False):
    """Means of an accelerometer triad in random poses, by NumPy alone."""
    up = rng.standard_normal((count, 3))
    force = GRAVITY * up / np.linalg.norm(up, axis=1, keepdims=True)
    matrix = np.eye(3)
    matrix[np.tril_indices(3)] += vector[3:]
    accel = force @ matrix.T + vector[:3] + sigma * rng.standard_normal((count, 3))
    covariance = np.broadcast_to(sigma**2 * np.eye(3), (count, 3, 3))
    return RestMeans(accel, covariance, force if reference else None)


VECTOR = np.array([0.1, -0.2, 0.05, 0.01, -0.004, -0.02, 0.006, 0.003, 0.015])


@pytest.mark.slow
@pytest.mark.parametrize("by_reference", [False, True])
def test_rows_are_those_of_the_batch_estimator(by_reference):
    means = rests(np.random.default_rng(1), 5, 0.01, VECTOR, reference=True)
    model = ByReference(GRAVITY) if by_reference else ByMagnitude(GRAVITY)
    estimator = ReferenceAccel() if by_reference else Invariant(gravity=GRAVITY)
    assert model.names == estimator.names
    at = np.random.default_rng(2).normal(0.0, 0.02, len(model.names))
    rows = model.rows(at, means)
    zeros = np.zeros(5)
    dwells = Dwells(
        time=zeros,
        duration=zeros + 1.0,
        count=zeros + 1.0,
        temperature=zeros,
        experiment=zeros.astype(int),
        position=zeros.astype(int),
        valid=zeros == 0.0,
        accel=means.accel,
        accel_covariance=means.covariance,
        reference_accel=means.reference,
    )
    misfit = lambda v: jax.vmap(lambda d: estimator.misfit(v, d)[0])(dwells).reshape(-1)
    sign = -1.0 if by_reference else 1.0  # output less model there, model less output here
    found = sign * np.asarray(misfit(at))
    np.testing.assert_allclose(rows.jacobian @ at - rows.value, found, atol=1e-12)
    np.testing.assert_allclose(rows.jacobian, sign * np.asarray(jax.jacfwd(misfit)(at)), atol=1e-10)
    np.testing.assert_allclose(rows.variance, 1e-4, rtol=1e-9)


def test_many_rests_give_what_least_squares_gives():
    means = rests(np.random.default_rng(3), 60, 0.003, VECTOR)
    found = accel_posterior(ByMagnitude(GRAVITY), means, "consumer")

    def residual(vector):
        matrix = np.eye(3)
        matrix[np.tril_indices(3)] += vector[3:]
        force = np.linalg.solve(matrix, (means.accel - vector[:3]).T)
        return (np.linalg.norm(force, axis=0) - GRAVITY) / 0.003

    solved = least_squares(residual, np.zeros(9), xtol=1e-14, ftol=1e-14)
    std = np.sqrt(np.diag(np.linalg.inv(solved.jac.T @ solved.jac)))
    # The priors' pull is (std / prior)², at most (4e-3 / 2)² of a deviation here.
    np.testing.assert_allclose((found.mean - solved.x) / std, 0.0, atol=0.05)
    # The scatter between rests is zero, but 60 rests leave it open: some hundredths.
    np.testing.assert_allclose(found.std / std, 1.0, atol=0.15)
    assert np.all(found.std >= std)


def test_an_unknown_scatter_widens_as_the_integral_over_it_does():
    """Mean of four numbers of own variance v and unknown scatter: by numerical integration over the scatter."""
    value, v = np.array([0.3, -0.9, 1.4, 0.2]), 0.04
    found = posterior_of(Rows(np.ones((4, 1)), value, np.full(4, v)), np.zeros(1), np.full(1, 1e3))
    mean = value.mean()

    def weight(tau, power):
        total = v + tau**2
        likelihood = total**-1.5 * np.exp(-0.5 * np.sum((value - mean) ** 2) / total)
        return likelihood / (1.0 + tau**2 / (16.0 * v)) * (total / 4.0) ** power

    variance = (
        quad(weight, 0, 200, args=(1,), limit=500)[0]
        / quad(weight, 0, 200, args=(0,), limit=500)[0]
    )
    np.testing.assert_allclose(found.mean, mean, rtol=1e-5)
    np.testing.assert_allclose(found.std, np.sqrt(variance), rtol=0.03)  # a grid of 41 scatters
    assert found.std > 1.5 * np.sqrt((v + value.var(ddof=1)) / 4) / 1.5  # no narrower than known


def test_the_probability_of_being_within_limits_is_that_of_samples():
    rng = np.random.default_rng(4)
    means = rests(rng, 14, 0.01, VECTOR)
    found = accel_posterior(ByMagnitude(GRAVITY), means, "consumer")
    limits = np.where(np.arange(9) < 6, 2.2 * found.std, np.inf)
    drawn = rng.choice(len(found.weight), 20_000, p=found.weight)
    roots = np.linalg.cholesky(found.covariances)
    x = found.means[drawn] + np.einsum("nij,nj->ni", roots[drawn], rng.standard_normal((20_000, 9)))
    share = np.mean(np.all(np.abs(x - found.mean) < limits, axis=1))
    # The product of single probabilities is at most the joint one (Šidák), and near it.
    assert share - 0.05 < found.within(limits) < share + 0.006
    ratio = found.ratio(limits, 0.95)
    np.testing.assert_allclose(found.within(ratio * limits), 0.95, atol=1e-6)


@pytest.mark.slow
def test_intervals_of_unknown_scatter_cover_as_they_say():
    """Twelve rests, a scatter that changes from device to device: 95 % intervals hold the truth in 95 % of them."""
    rng, inside = np.random.default_rng(5), []
    for _ in range(400):
        scatter = 0.003 * abs(rng.standard_cauchy())
        made = rests(rng, 14, np.hypot(0.003, min(scatter, 0.1)), VECTOR)
        covariance = np.broadcast_to(9e-6 * np.eye(3), (14, 3, 3))
        found = accel_posterior(ByMagnitude(GRAVITY), RestMeans(made.accel, covariance), "consumer")
        inside.append(np.abs(found.mean - VECTOR) < 1.96 * found.std)
    # 3600 intervals, correlated within a device: standard deviation below 1 %.
    assert 0.93 < np.mean(inside) < 0.98


@pytest.mark.parametrize(
    ("up", "words"),
    [
        ([0, 0, 1], "with +z up"),
        ([0, 1, 1], "halfway between +y up and +z up"),
        ([-1, 0, 1], "halfway between −x up and +z up"),
        ([1, -1, 1], "midway between +x up, −y up and +z up"),
        (
            [0.5, 3**0.5 / 2, 0],
            "with +y up, tilted by 30° towards +x",
        ),
    ],
)
def test_a_direction_is_said_in_words(up, words):
    up = np.array(up, float)
    assert up_in_words(up / np.linalg.norm(up)) == words
    assert in_words(up / np.linalg.norm(up)) == f"turn the device so that it rests {words}"


def test_a_report_names_the_nearest_direction_that_a_hand_can_hold():
    # 4° off the edge between +x and −z, and 8° off the face +y.
    assert up_in_words(nearest_by_hand(np.array([0.75, 0.0, -0.66]))) == (
        "halfway between +x up and −z up"
    )
    assert up_in_words(nearest_by_hand(np.array([0.0, 0.99, 0.14]))) == "with +y up"


def test_the_next_position_is_the_one_that_tells_what_is_missing():
    """Rests with x, y up and down and between: z is missing, and where it is said, it gains most."""
    faces = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [1, 1, 0], [1, -1, 0]], float)
    force = GRAVITY * faces / np.linalg.norm(faces, axis=1, keepdims=True)
    means = RestMeans(force, np.broadcast_to(1e-6 * np.eye(3), (6, 3, 3)))
    model = ByMagnitude(GRAVITY)
    found = accel_posterior(model, means, "consumer")
    up = hand_directions()
    around = followed(up)
    rows = model.tried(found.mean, around.reshape(-1, 3)).reshape(len(up), -1, 1, 9)
    limits = np.array([0.02] * 3 + [1e-3, np.inf, 1e-3, np.inf, np.inf, 1e-3])
    parts = [Part(found.covariance, limits, rows, 1e-6)]
    chosen = best_position(up, parts, planned_shares(parts))
    assert abs(chosen.up[2]) > 0.85 and 0.0 < chosen.gain <= 1.0
    # The gain by brute force: information with the rows of one direction added, averaged over the circle.
    k = int(np.argmin(np.linalg.norm(up - chosen.up, axis=1)))
    asked = np.isfinite(limits)
    distance = lambda c: np.sum((np.sqrt(np.diag(c))[asked] / limits[asked]) ** 6) ** (1 / 6)
    after = [
        distance(np.linalg.inv(np.linalg.inv(found.covariance) + r.T @ r / 1e-6)) for r in rows[k]
    ]
    np.testing.assert_allclose(
        chosen.gain, 1 - np.mean(after) / distance(found.covariance), rtol=1e-4
    )


def test_degrees_of_freedom_are_those_of_the_rows_that_tell_the_scatter():
    """Rows whose own noise is far below their scatter: as many degrees of freedom as rows less the mean."""
    rng, counts = np.random.default_rng(11), (8, 15, 30)
    for count in counts:
        found = [
            posterior_of(
                Rows(np.ones((count, 1)), rng.standard_normal(count), np.full(count, 1e-4)),
                np.zeros(1),
                np.full(1, 1e3),
            ).freedom(1e-4)
            for _ in range(40)
        ]
        # The half-Cauchy prior of the scatter counts about as one row, as p(τ) ~ τ⁻² against τ⁻¹.
        np.testing.assert_allclose(np.mean(found), count, rtol=0.15)


@pytest.mark.slow
def test_the_forecast_is_what_further_rests_do():
    """Sessions of one device: the gain said beforehand is the mean of what the next rest brought, and the rests that
    are said to be needed are as many as were needed."""
    rng, campaign = np.random.default_rng(12), Campaign((), Site(GRAVITY), Rig())
    target = parse_target("accel.bias=0.5 mg, accel.scale=600 ppm")
    sigma, matrix = 4e-3, np.eye(3)
    matrix[np.tril_indices(3)] += VECTOR[3:]
    said, brought, forecast, needed = [], [], [], []
    for _ in range(12):
        rests, found, up, ratios = [], None, np.array([0.0, 0.0, 1.0]), []
        gains, further = [], []
        while found is None or not found.reached:
            off = followed(up[None])[0, rng.integers(6)]
            mean = GRAVITY * matrix @ off + VECTOR[:3] + sigma * rng.standard_normal(3)
            own = 0.5 * sigma**2 * np.eye(3)
            rests.append(
                Rest(len(rests) + 1, 1, 0, 1, (0.0, 1.0), accel=mean, accel_covariance=own)
            )
            found = estimate(rests, campaign, target, found)
            told = found.next_position()
            up = np.array(told.up) / np.linalg.norm(told.up)
            ratios.append(found.ratio)
            gains.append(told.gain)
            further.append(told.further)
            assert (told.further is None) == (len(rests) < 14)
        last = len(rests)
        brought += [1.0 - b / a for a, b in zip(ratios[13:], ratios[14:])]
        said += gains[13:-1]
        if last > 14:
            forecast.append(further[13])
            needed.append(last - 14)
    # Standard errors of both means are about a tenth of them.
    assert len(said) > 40 and 0.75 < np.mean(said) / np.mean(brought) < 1.3
    assert len(needed) > 6 and 0.6 < np.mean(forecast) / np.mean(needed) < 1.6


def test_the_rests_that_are_said_beforehand_are_those_of_least_squares():
    """By SciPy's quantiles and by normal equations at the plan's directions; a tenth of the noise needs no more than a
    session makes anyhow, and a hundred times it more than a person does."""
    target, model = parse_target("accel.bias=0.5 mg, accel.scale=600 ppm"), ByMagnitude(GRAVITY)
    sigma = 5e-3
    said = rests_ahead(target, model, None, sigma)
    assert rests_ahead(target, model, None, 0.1 * sigma).rests == 14
    assert rests_ahead(target, model, None, 100.0 * sigma).rests is None
    # Shares as the test above has them from an optimiser: faces, and a few of the others; here both by rounding.
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    edges = np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1], [-1, 1, 0], [1, 0, -1], [0, 1, -1]], float)
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    reached = {}
    for rests in (said.rests - 6, said.rests + 8):
        whole = np.concatenate([np.tile(np.concatenate([faces, faces, edges]), (20, 1))])[:rests]
        rows = model.tried(np.zeros(9), followed(whole).reshape(-1, 3)).reshape(rests, -1, 9)
        information = np.einsum("kai,kaj->ij", rows, rows) / rows.shape[1] / sigma**2
        std = np.sqrt(np.diag(np.linalg.inv(information)))
        quantile = student.ppf(0.5 + 0.5 * 0.95 ** (1.0 / 6.0), rests - 9)
        limits = np.array([0.5e-3 * 9.80665] * 3 + [6e-4] * 3)
        reached[rests] = bool(np.all(quantile * std[[0, 1, 2, 3, 5, 8]] <= limits))
    assert list(reached.values()) == [False, True]


def test_the_plan_of_the_rests_that_are_needed_is_the_best_by_a_general_optimiser():
    """Nothing known but a wide prior: shares of the 50 directions, against SciPy's over the same simplex."""
    up = hand_directions()
    around = followed(up)
    model = ByMagnitude(GRAVITY)
    rows = model.tried(np.zeros(9), around.reshape(-1, 3)).reshape(len(up), -1, 1, 9)
    limits = np.array([0.005] * 3 + [6e-4, np.inf, 6e-4, np.inf, np.inf, 6e-4])
    prior, variance = np.diag([2.0**2] * 3 + [0.1**2] * 6), 3e-3**2
    share = planned_shares([Part(prior, limits, rows, variance)])
    np.testing.assert_allclose(share.sum(), 1.0)
    adds = np.einsum("caki,cakj->cij", rows, rows) / rows.shape[1] / variance
    asked = np.isfinite(limits)

    def ratios(weights, rests):
        left = np.linalg.inv(np.linalg.inv(prior) + rests * np.tensordot(weights, adds, 1))
        return np.sqrt(np.diag(left))[asked] / limits[asked]

    # The rests that are needed: the worst of six parameters at the quantile that holds all of them with 95 %.
    aim = 1.0 / norm.ppf(0.5 + 0.5 * 0.95 ** (1.0 / 6.0))
    counts = np.arange(1, 200)
    rests = counts[[ratios(share, n).max() < aim for n in counts]][0]
    distance = lambda weights: np.sum(ratios(weights, rests) ** 6) ** (1.0 / 6.0)
    softmax = lambda x: np.exp(x - x.max()) / np.exp(x - x.max()).sum()
    best = minimize(lambda x: distance(softmax(x)), np.zeros(len(up)), method="L-BFGS-B").fun
    assert distance(share) < 1.01 * best
    assert distance(np.full(len(up), 1.0 / len(up))) > 1.1 * best  # all directions alike are worse
    # Faces tell biases and scale factors best; the rest of the matrix needs a few of the others.
    assert share[:6].sum() > 0.6
    np.testing.assert_allclose(share[:6], share[0], rtol=0.05)


def test_positions_that_are_followed_exactly_reach_a_target_that_does_not_ask_for_misalignments():
    """Faces alone would tell biases and scale factors, but the batch estimate has the whole matrix."""
    rng, sigma = np.random.default_rng(9), 2e-4
    campaign = Campaign((), Site(GRAVITY), Rig(), grade="tactical")
    target = parse_target("accel.bias=40 ug, accel.scale=60 ppm")
    matrix = np.eye(3)
    matrix[np.tril_indices(3)] += 0.1 * VECTOR[3:]
    rests, found, up = [], None, np.array([0.0, 0.0, 1.0])
    while found is None or not found.reached:
        assert len(rests) < 40
        mean = GRAVITY * matrix @ up + 0.1 * VECTOR[:3] + sigma * rng.standard_normal(3)
        covariance = sigma**2 * np.eye(3)
        made = Rest(len(rests) + 1, 1, 0, 1, (0.0, 1.0), accel=mean, accel_covariance=covariance)
        rests.append(made)
        found = estimate(rests, campaign, target, found)
        told = found.next_position()
        up = np.array(told.up) / np.linalg.norm(told.up)
    # 14 leave the batch estimate its five degrees of freedom.
    assert 14 <= len(rests) <= 25


def test_directions_are_followed_ten_degrees_off():
    up = hand_directions()
    assert up.shape == (50, 3)
    np.testing.assert_allclose(np.linalg.norm(up, axis=1), 1.0)
    angle = np.degrees(np.arccos(np.einsum("caj,cj->ca", followed(up), up)))
    np.testing.assert_allclose(angle, 10.0)


def test_the_covariance_of_a_mean_holds_noise_with_a_memory():
    """First-order noise of 50 ms besides white noise: the scatter of many means is what is said of each."""
    rng, step, rows, memory = np.random.default_rng(6), 0.01, 500, 5.0
    decay = np.exp(-1.0 / memory)
    white = rng.standard_normal((200, rows, 3))
    red = lfilter(
        [np.sqrt(1 - decay**2)], [1.0, -decay], rng.standard_normal((200, rows + 200, 3)), axis=1
    )
    samples = white + 2.0 * red[:, 200:]
    said = np.mean([np.diag(c) for c in mean_covariances(list(samples), step)])
    # By theory, of a mean of n samples: 1/n + 4 (1 + a)/(1 - a)/n for n far above the memory.
    expected = 1.0 / rows + 4.0 * (1 + decay) / (1 - decay) / rows
    np.testing.assert_allclose(samples.mean(axis=1).var(), expected, rtol=0.15)
    np.testing.assert_allclose(said, expected, rtol=0.25)  # blocks of 25 rows lose a fifth of it


def test_rows_of_a_turn_are_those_of_finite_differences_and_tell_the_matrix():
    """Turns about changing axes, integrated by SciPy's rotations; the matrix comes back from the tilts."""
    rng, step = np.random.default_rng(8), 0.01
    truth = 0.01 * rng.standard_normal((3, 3))
    turns, ends = [], []
    for _ in range(12):
        ramp = np.sin(np.pi * np.arange(150) / 150)[:, None]
        rate = ramp * (2.0 * rng.standard_normal(3) + np.cos(np.arange(150) / 40.0)[:, None])
        whole = Rotation.identity()
        for omega in rate:
            whole = whole * Rotation.from_rotvec(omega * step)
        start = rng.standard_normal(3)
        start *= GRAVITY / np.linalg.norm(start)
        end = whole.inv().apply(start)
        turns.append(Turn(rate @ (np.eye(3) + truth).T, np.full(150, step), start, end, 1e-10))
        ends.append((start, end))
    before, after = (np.array(x) for x in zip(*ends))
    variance = np.full(12, 1e-8)
    of = lambda m: turn_rows([integrated(t, m) for t in turns], before, after, variance)
    residual = lambda m: of(m).jacobian @ m.reshape(9) - of(m).value
    np.testing.assert_allclose(residual(truth), 0.0, atol=1e-9)
    at = 0.3 * truth
    slope = [
        (residual(at + 1e-6 * e.reshape(3, 3)) - residual(at - 1e-6 * e.reshape(3, 3))) / 2e-6
        for e in np.eye(9)
    ]
    # Across the measured direction only: of second order in the tilt, 1e-2 here.
    np.testing.assert_allclose(of(at).jacobian, np.array(slope).T, atol=2e-2 * np.abs(slope).max())
    matrix = np.zeros((3, 3))
    for _ in range(4):
        matrix = posterior_of(of(matrix), np.zeros(9), np.full(9, 0.1)).mean.reshape(3, 3)
    np.testing.assert_allclose(matrix, truth, atol=1e-5)


def test_rows_of_a_planned_turn_are_those_of_the_turn():
    now, up = np.array([0.0, 0.0, 1.0]), np.array([[0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
    planned = planned_rows(now, up)
    for one, rows in zip(up, planned):
        axis = np.cross(one, now)
        angle = np.arcsin(np.linalg.norm(axis)) if one @ now >= 0 else np.pi
        rate = np.tile(axis / np.linalg.norm(axis) * angle, (400, 1))
        turn = Turn(rate, np.full(400, 1.0 / 400), now, one, 0.0)
        made = turn_rows([integrated(turn, np.zeros((3, 3)))], now[None], one[None], np.ones(1))
        np.testing.assert_allclose(rows, made.jacobian, atol=5e-3)


def warming_rests(slopes):
    """Rests of a device that warms up by 7 °C, by NumPy alone."""
    rng = np.random.default_rng(8)
    up = rng.standard_normal((24, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    temperature = 31.0 - 7.0 * np.exp(-np.arange(24) / 6.0)
    away = temperature - temperature.mean()
    bias, matrix = np.array([0.3, -0.2, 0.1]), np.diag([1.002, 0.997, 1.004])
    accel = GRAVITY * up @ matrix.T + bias + away[:, None] * slopes
    accel += 5e-4 * rng.standard_normal(accel.shape)
    return RestMeans(accel, np.tile(2.5e-7 * np.eye(3), (24, 1, 1))), list(temperature)


def test_slopes_over_temperature_are_those_of_least_squares():
    true = np.array([4e-3, -3e-3, 5e-3])
    means, temperature = warming_rests(true)
    away = away_from_mean(temperature)
    model = ByMagnitude(GRAVITY)
    constant = accel_posterior(model, means, "consumer")
    both = accel_posterior(model, means, "consumer", constant, away)

    def residual(v):
        lower = np.eye(3)
        lower[np.tril_indices(3)] += v[3:9]
        force = (means.accel - v[:3] - away[:, None] * v[9:]) @ np.linalg.inv(lower).T
        return np.linalg.norm(force, axis=1) - GRAVITY

    expected = least_squares(residual, np.zeros(12), xtol=1e-14, ftol=1e-14).x
    assert np.all(
        np.abs(both.mean - expected) < 0.1 * both.std
    )  # priors are 20 to 1000 times as wide
    slopes = followed_slopes(constant, both)
    assert slopes is not None and np.all(np.abs(slopes - true) < 4.0 * both.std[9:])
    assert np.all(both.first(9).std < 0.5 * constant.std)  # what drifts is no scatter any more
    np.testing.assert_allclose(both.first(9).mean, both.mean[:9], rtol=1e-12)


def test_a_device_that_does_not_follow_the_temperature_has_no_slopes():
    means, temperature = warming_rests(np.zeros(3))
    away = away_from_mean(temperature)
    constant = accel_posterior(ByMagnitude(GRAVITY), means, "consumer")
    both = accel_posterior(ByMagnitude(GRAVITY), means, "consumer", constant, away)
    assert followed_slopes(constant, both) is None
    assert away_from_mean([20.0, 20.2, None]) is None and away_from_mean([20.0, 20.3]) is None
