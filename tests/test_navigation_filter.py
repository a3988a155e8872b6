"""Filter and smoother against a plain Kalman filter and batch least squares in NumPy; precision and gradients."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import inertiax.navigation as navigation
from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.physics import rotation
from inertiax.physics.temperature import Curve, Polynomial


LATITUDE, SAMPLES, STEP, SEGMENTS = 0.85, 50, 0.02, 12
FRAME = navigation.LevelFrame(LATITUDE, 300.0)
NOISE = navigation.ImuNoise(
    navigation.TriadNoise(white=6e-4, walk=2e-5), navigation.TriadNoise(white=4e-5, walk=1e-6)
)
ACCEL = tuple(f"accel.bias[{i}]" for i in range(3)) + tuple(
    f"accel.matrix[{i},{j}]" for i in range(3) for j in range(i + 1)
)
GYRO = tuple(f"gyro.bias[{i}]" for i in range(3)) + tuple(
    f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3)
)
RUN = jax.jit(lambda filter_, start, data, fixes: filter_.run(start, data, fixes))
SIGMAS = {"attitude_sigma": 2e-3, "velocity_sigma": 0.05, "position_sigma": 0.5}


def _triad(names, bias, matrix, degree=1):
    sigma = np.tile([bias if "bias" in n else matrix for n in names], degree + 1)
    basis = Polynomial(degree, 0.0, 50.0)
    curve = Curve(basis, jnp.zeros((degree + 1, len(names))))
    # Neighbours correlated by a half, so that the order of coefficients matters.
    near = np.eye(len(sigma)) + 0.5 * (np.eye(len(sigma), k=1) + np.eye(len(sigma), k=-1))
    return TriadCalibration(curve, jnp.asarray(near * np.outer(sigma, sigma)), names, "reference")


@pytest.fixture(scope="module")
def calibration():
    return Calibration(9.81, _triad(ACCEL, 5e-3, 3e-4), _triad(GYRO, 1e-4, 3e-4))


@pytest.fixture(scope="module")
def resting():
    """A device at rest in a tilted attitude: outputs with noise, fixes with noise; everything is linear."""
    rng = np.random.default_rng(5)
    count = SAMPLES * SEGMENTS
    attitude = np.asarray(rotation.exp(jnp.array([0.3, -0.5, 1.0])))
    pull = np.asarray(FRAME.gravity_at(np.zeros(3)))
    earth = 7.292115e-5 * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
    accel = -attitude.T @ pull + 6e-4 / np.sqrt(STEP) * rng.normal(size=(count, 3))
    gyro = attitude.T @ earth + 4e-5 / np.sqrt(STEP) * rng.normal(size=(count, 3))
    data = navigation.ImuData(accel, gyro, np.full(count, 25.0), np.asarray(STEP))
    fixes = 0.1 * rng.normal(size=(SEGMENTS, 3))
    valid = np.arange(SEGMENTS) % 4 != 1
    return attitude, data, np.where(valid[:, None], fixes, np.nan), valid


@pytest.fixture(scope="module")
def biases(calibration):
    """A filter of the biases, and its run at rest."""
    return navigation.Filter(
        calibration, "*.bias", noise=NOISE, frame=FRAME, samples=SAMPLES, thermal=False
    )


@pytest.fixture(scope="module")
def rested(biases, resting):
    attitude, data, fixes, valid = resting
    start = biases.start(attitude, np.zeros(3), np.zeros(3), **SIGMAS)
    return RUN(biases, start, data, [navigation.Position(fixes, 0.1, valid)])


# A plain Kalman filter ----------------------------------------------------------------------------


def _continuous(attitude, data):
    """ζ' = A ζ + …, with walks and constants as further states: 9 + 6 + 6, SI units, from the textbook."""
    cross = lambda v: np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    earth = cross(7.292115e-5 * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)]))
    force = -np.asarray(FRAME.gravity_at(np.zeros(3)))
    a = np.zeros((21, 21))
    a[0:3, 0:3] = -earth
    a[3:6, 0:3], a[3:6, 3:6] = -cross(force), -2 * earth
    a[3:6, 6:9] = np.asarray(FRAME.gravity_gradient(np.zeros(3)))
    a[6:9, 3:6] = np.eye(3)
    for column in (9, 15):  # what adds to outputs is taken off the force and the rate
        a[3:6, column : column + 3] = -attitude
        a[0:3, column + 3 : column + 6] = -attitude
    q = np.zeros((21, 21))
    q[0:3, 0:3], q[3:6, 3:6] = 4e-5**2 * np.eye(3), 6e-4**2 * np.eye(3)
    return a, q


def _prior(calibration):
    p = np.zeros((21, 21))
    p[:9, :9] = np.diag([2e-3**2] * 3 + [0.05**2] * 3 + [0.5**2] * 3)
    for k, triad in enumerate((calibration.accel, calibration.gyro)):
        # Mean over the two nodes of φ C φᵀ; the nodes of degree 1 are at x = ±1/√2.
        size = len(triad.names)
        phi = np.array([[1, x] for x in (0.5**0.5, -(0.5**0.5))])
        blocks = np.asarray(triad.covariance).reshape(2, size, 2, size)[:, :3][:, :, :, :3]
        at = slice(15 + 3 * k, 18 + 3 * k)
        p[at, at] = np.einsum("ta,aibj,tb->ij", phi, blocks, phi) / 2
    return p


def _discrete(resting):
    """F, Q (Van Loan) and H of one segment."""
    a, q = _continuous(*resting[:2])
    time = SAMPLES * STEP
    big = scipy.linalg.expm(np.block([[-a, q], [np.zeros_like(a), a.T]]) * time)
    f = big[21:, 21:].T
    q = f @ big[:21, 21:]
    q[9:12, 9:12] += 2e-5**2 * time * np.eye(3)
    q[12:15, 12:15] += 1e-6**2 * time * np.eye(3)
    h = np.zeros((3, 21))
    h[:, 6:9] = np.eye(3)
    return f, q, h


@pytest.fixture(scope="module")
def free(calibration, resting):
    """Positions of the same outputs integrated without fixes: what the errors' linear filter is told."""
    blind = navigation.Filter(calibration, (), noise=NOISE, frame=FRAME, samples=SAMPLES)
    start = blind.start(resting[0], np.zeros(3), np.zeros(3), **SIGMAS)
    return np.asarray(RUN(blind, start, resting[1], []).estimate.navigation.position)


def _plain(calibration, resting, free):
    """Means and covariances of the errors by the textbook's equations."""
    _, _, fixes, valid = resting
    f, q, h = _discrete(resting)
    x, p, out = np.zeros(21), _prior(calibration), []
    for row in range(SEGMENTS):
        x, p = f @ x, f @ p @ f.T + q
        if valid[row]:
            k = p @ h.T @ np.linalg.inv(h @ p @ h.T + 0.01 * np.eye(3))
            x, p = x + k @ (fixes[row] - free[row] - h @ x), (np.eye(21) - k @ h) @ p
        out.append((x, p))
    return out


@pytest.mark.slow
def test_filter_is_a_plain_kalman_filter_where_all_is_linear(
    calibration, resting, free, biases, rested
):
    plain = _plain(calibration, resting, free)
    units = np.concatenate([np.ones(9), [1e-3] * 3, [1e-5] * 3, biases.model.states.scale])
    found = np.asarray(rested.rows) * units[:15, None] * units
    for row, (_, p) in enumerate(plain):
        sigma = np.sqrt(np.diagonal(p))
        relative = (found[row] - p[:15]) / (sigma[:15, None] * sigma)
        # Sums over 50 samples for integrals (1e-4), tilts of 2e-3 rad squared, and turns of the error's axes by
        # the corrections (up to 2e-3).
        assert np.abs(relative).max() < 5e-3, row
    position = np.asarray(rested.estimate.navigation.position)
    expected = free + np.array([x[6:9] for x, _ in plain])
    sigma = np.asarray(rested.sigma)[:, 6:]
    # Second order: tilts of 2e-3 rad of what velocities of 0.05 m/s have gone.
    assert np.abs((position - expected) / sigma).max() < 5e-3


@pytest.mark.slow
def test_smoother_is_batch_least_squares(calibration, resting, free, rested):
    """All fixes at once, as correlated Gaussian variables: mean and covariance of every time's errors."""
    _, _, fixes, valid = resting
    f, q, h = _discrete(resting)
    # Cov(x_i, x_j) = F^(i−j) P_j without fixes.
    free_p = [_prior(calibration)]
    for _ in range(SEGMENTS):
        free_p.append(f @ free_p[-1] @ f.T + q)
    cov = lambda i, j: np.linalg.matrix_power(f, i - j) @ free_p[j] if i >= j else cov(j, i).T
    rows = [k + 1 for k in range(SEGMENTS) if valid[k]]
    spread = np.block(
        [[h @ cov(i, j) @ h.T + 0.01 * (i == j) * np.eye(3) for j in rows] for i in rows]
    )
    told = np.concatenate([fixes[k - 1] - free[k - 1] for k in rows])
    smoothed = navigation.smooth(rested)
    position = np.asarray(smoothed.estimate.navigation.position)
    for i in range(1, SEGMENTS + 1):
        across = np.hstack([cov(i, j) @ h.T for j in rows])
        mean = across @ np.linalg.solve(spread, told)
        p = cov(i, i) - across @ np.linalg.solve(spread, across.T)
        sigma = np.sqrt(np.diagonal(p))
        found = np.asarray(smoothed.covariance[i - 1])[:9, :9]
        relative = (found - p[:9, :9]) / np.outer(sigma[:9], sigma[:9])
        # As for the filter, going forth and back.
        assert np.abs(relative).max() < 1e-2, i
        off = (position[i - 1] - free[i - 1] - mean[6:9]) / sigma[6:9]
        assert np.abs(off).max() < 1e-2, i
    # The last time's smoothed estimate is the filtered one.
    np.testing.assert_allclose(smoothed.covariance[-1][:9, :9], rested.covariance[-1], rtol=1e-12)


# What goes through it -----------------------------------------------------------------------------


WHITE, APART, MORE = 3e-3, 1e-5, 1e-3


@pytest.fixture(scope="module")
def many(calibration, resting, biases):
    """Last height and likelihood, their slopes by the accelerometers' noise and outputs, and the last position.

    Of runs with the stated noise, with `MORE` m/s² on all outputs as well, and with other noises: one program.
    """
    attitude, data, fixes, valid = resting
    start = biases.start(attitude, np.zeros(3), np.zeros(3), **SIGMAS)

    def told(white, accel):
        noise = navigation.ImuNoise(
            navigation.TriadNoise(white=white, walk=2e-5), navigation.TriadNoise(4e-5, walk=1e-6)
        )
        filter_ = navigation.Filter(
            calibration, "*.bias", noise=noise, frame=FRAME, samples=SAMPLES, thermal=False
        )
        changed = eqx.tree_at(lambda d: d.accel, data, accel)
        track = filter_.run(start, changed, [navigation.Position(fixes, 0.1, valid)])
        position = track.last.estimate.navigation.position
        both = jnp.stack([position[2], track.log_likelihood])
        return both, (both, position)

    def one(white, accel):
        (by_noise, by_outputs), (both, position) = jax.jacrev(told, (0, 1), has_aux=True)(
            white, accel
        )
        return both, by_noise, by_outputs, position

    white = np.array([6e-4, 6e-4, WHITE, WHITE + APART, WHITE - APART])
    accel = np.stack([data.accel, data.accel + MORE, *[data.accel] * 3])
    return [np.asarray(x) for x in jax.jit(jax.vmap(one))(white, accel)]


@pytest.mark.slow
def test_likelihood_is_the_innovations_and_has_a_gradient_by_the_noise(
    calibration, resting, rested, free, many
):
    _, _, fixes, valid = resting
    f, q, h = _discrete(resting)
    x, p, total = np.zeros(21), _prior(calibration), 0.0
    for row in range(SEGMENTS):
        x, p = f @ x, f @ p @ f.T + q
        if valid[row]:
            s = h @ p @ h.T + 0.01 * np.eye(3)
            y = fixes[row] - free[row] - h @ x
            total += -0.5 * (y @ np.linalg.solve(s, y) + np.linalg.slogdet(2 * np.pi * s)[1])
            k = p @ h.T @ np.linalg.inv(s)
            x, p = x + k @ y, (np.eye(21) - k @ h) @ p
    assert float(rested.log_likelihood) == pytest.approx(total, abs=0.02)
    assert many[0][0, 1] == pytest.approx(float(rested.log_likelihood), abs=1e-9)
    (value, up, down), slope = many[0][2:, 1], many[1][2, 1]
    assert np.isfinite(value)
    # Central differences: third derivatives by h², rounding 1e-13 of the value by 1/h.
    assert slope == pytest.approx((up - down) / (2 * APART), rel=1e-4)


@pytest.mark.slow
def test_runs_go_through_vmap_and_gradients_through_the_outputs(rested, many):
    _, _, by_outputs, position = many
    alone = rested.last.estimate.navigation.position
    np.testing.assert_allclose(position[0], alone, atol=1e-12)
    slope = by_outputs[0, 0]
    assert np.all(np.isfinite(slope))
    moved = float(position[1, 2] - position[0, 2])
    # The response to 1 mm/s² on all samples is linear to its 1e-3 relative size.
    assert np.sum(slope) * MORE == pytest.approx(moved, rel=1e-3)


@pytest.mark.slow
def test_single_precision_agrees_to_a_hundredth_of_a_standard_deviation(resting, biases, rested):
    attitude, data, fixes, valid = resting
    low = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (attitude, data, fixes))
    far = jnp.array(
        [5e3, -5e3, 100.0], jnp.float32
    )  # far from the origin, where single precision is 0.5 mm
    zero = jnp.zeros(3, jnp.float32)
    start = biases.start(low[0], zero, far, **SIGMAS)
    track = RUN(biases, start, low[1], [navigation.Position(low[2] + far[None], 0.1, valid)])
    assert track.rows.dtype == jnp.float32
    moved = biases.start(attitude, np.zeros(3), np.asarray(far, float), **SIGMAS)
    exact = RUN(
        biases, moved, data, [navigation.Position(fixes + np.asarray(far, float), 0.1, valid)]
    )
    pair = [t.estimate.navigation for t in (track, exact)]
    off = np.asarray(pair[0].position, float) - np.asarray(pair[1].position)
    assert np.abs(off / np.asarray(exact.sigma)[:, 6:]).max() < 2e-2
    np.testing.assert_allclose(track.sigma, exact.sigma, rtol=1e-3)


@pytest.mark.slow
def test_many_runs_in_one_track_have_a_covariance_each(biases, rested):
    two = lambda tree: jax.tree.map(lambda x: np.stack([x, 4 * np.asarray(x)]), tree)
    many = jax.tree.map(jnp.asarray, two(rested))
    assert many.sigma.shape == (2, SEGMENTS, 9)
    np.testing.assert_array_equal(many.covariance[0], rested.covariance)
    np.testing.assert_array_equal(many.sigma[1], 2.0 * rested.sigma)
    one = navigation.smooth(rested)
    smoothed = jax.tree.map(jnp.asarray, two(one))
    np.testing.assert_array_equal(smoothed.sigma[1], 2.0 * one.sigma)
    with pytest.raises(ValueError, match=r"smooth\(track\)`: the track holds \(2,\) runs"):
        navigation.smooth(many)
    with pytest.raises(ValueError, match=r"observability.*the track holds \(2,\) runs"):
        navigation.observability(biases, many)
    with pytest.raises(ValueError, match=r"observability.*does not work in traced code"):
        jax.jit(lambda track: navigation.observability(biases, track))(rested)
    with pytest.raises(ValueError, match=r"refined.*the state holds \(2,\) runs"):
        navigation.refined(biases, many.last)


@pytest.mark.slow
def test_refined_is_kalmans_update_of_all_coefficients_alone_and_in_traced_code(calibration):
    """Of a measurement of the biases alone; the others follow by their correlation with them."""
    filter_ = navigation.Filter(calibration, "*.bias", noise=NOISE, frame=FRAME, samples=SAMPLES)
    scale, rows = np.asarray(filter_.model.states.scale), list(filter_.model.states.rows)
    prior = np.asarray(calibration.covariance)
    inside, noise = prior[np.ix_(rows, rows)], np.diag(0.25 * scale**2)
    gain = prior[:, rows] @ np.linalg.inv(inside + noise)
    measured = scale * np.array([np.linspace(-1.0, 1.0, len(rows)), np.cos(np.arange(len(rows)))])
    expected, spread = measured @ gain.T, prior - gain @ prior[rows]

    start = filter_.start(np.eye(3), np.zeros(3), np.zeros(3), **SIGMAS)
    after = np.array(start.covariance)
    after[-len(rows) :, -len(rows) :] = spread[np.ix_(rows, rows)] / np.outer(scale, scale)
    leaves = lambda s: (s.estimate.calibration, s.covariance)
    state = lambda moved: eqx.tree_at(leaves, start, (moved / scale, jnp.asarray(after)))
    made = lambda moved: navigation.refined(filter_, state(moved))
    alone, both = made(jnp.asarray(expected[0, rows])), jax.jit(jax.vmap(made))(expected[:, rows])
    # 28 correlated coefficients, 64 bits.
    np.testing.assert_allclose(alone.coefficients, expected[0], rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(both.coefficients, expected, rtol=1e-9, atol=1e-16)
    for found in (alone.covariance, both.covariance[1]):
        np.testing.assert_allclose(found, spread, atol=1e-9 * spread.max())
