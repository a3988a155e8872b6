"""The digital twin against the catalogue's own formulas along time, its noise against IEEE Std 952."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov, toeplitz
from scipy.signal import freqz, lfilter

from inertiax.allan import identify
from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.calibration.fitted_effects import FittedEffect, known_effect
from inertiax.effects import CATALOGUE, Signal
from inertiax.navigation.sensor_noise import RATIO, SensorNoise, TriadNoise
from inertiax.navigation.twin import Twin
from inertiax.physics.temperature import Curve, Polynomial


RATE = 20.0
COUNT = 400
TIME = np.arange(COUNT) / RATE
# Up and down again, so that lag and play have something to remember.
TEMPERATURE = 40.0 - 40.0 * np.abs(1.0 - TIME / TIME[200])
MOVING = (TIME >= 7.0) & (TIME < 8.0)
OMEGA = np.where(MOVING, 1.0, 0.0)[:, None] * np.array([0.0, 0.5, 0.0])
FORCE = np.where(TIME[:, None] < 7.5, np.array([1.0, 2.0, 9.5]), np.array([2.0, 9.5, 1.0]))
GRAVITY = 9.81

EFFECTS = {
    # name: (triad, channel, settings, coefficient)
    "thermal_lag": ("accel", 0, {"time_constant": 3.0}, 1.0),
    "settling": ("accel", 1, {"time_constant": 2.0, "size": "signed"}, 2e-3),
    "thermal_hysteresis": ("accel", 2, {"radius": 0.1, "loop": "spread", "on": "bias"}, 1e-3),
    "temperature_rate": ("gyro", 0, {"time_constant": 0.0, "on": "bias"}, 1e-5),
    "warm_up": ("gyro", 1, {"time_constant": 5.0, "start": "each"}, 1e-3),
    "drift": ("gyro", 2, {"on": "bias"}, 1e-6),
}


def _calibration():
    names = tuple(f"accel.bias[{i}]" for i in range(3)) + ("accel.matrix[1,0]",)
    curve = Curve(Polynomial(2, -40.0, 70.0), 1e-2 * np.arange(12.0).reshape(3, 4))
    triad = TriadCalibration(curve, np.zeros((12, 12)), names, "invariant")
    effects = tuple(
        FittedEffect(
            name, triad_name, (channel,), tuple(settings.items()), np.array([c]), np.zeros((1, 1)),
            known_effect(name, "").unit(triad_name, settings), clock=(0.0, TIME[-1]), temperature=(0.0, 40.0),
        )
        for name, (triad_name, channel, settings, c) in EFFECTS.items()
    )  # fmt: skip
    return Calibration(gravity=GRAVITY, accel=triad, effects=effects)


def _signal(calibration, triad):
    """The same run as the diagnosis sees one."""
    rested = np.where(TIME < 8.0, TIME, TIME - 8.0)
    moved = np.where(TIME < 8.0, 0.0, 1.0)[:, None] * (FORCE[-1] - FORCE[0]) / GRAVITY

    def at(temperature):
        one = lambda f, w, t: calibration.distort_by_parameters(f, w, t)[triad != "accel"]
        return jax.vmap(one)(jnp.asarray(FORCE), jnp.asarray(OMEGA), temperature)

    return Signal(
        triad=triad, time=TIME, input=FORCE / GRAVITY if triad == "accel" else OMEGA, output=OMEGA,
        since_power=TIME, since_start=TIME, since_move=rested, move=moved, at_rest=~MOVING,
        temperature=TEMPERATURE, temperature_rate=np.gradient(TEMPERATURE, TIME), force=FORCE / GRAVITY,
        rate=OMEGA, at_temperature=at,
    )  # fmt: skip


@pytest.fixture(scope="module")
def run():
    """Outputs of the twin, and those of the parameters alone."""
    calibration = _calibration()

    @jax.jit
    def both(twin):
        start = twin.init(jax.random.PRNGKey(0), TEMPERATURE[0])
        samples = jnp.asarray(FORCE), jnp.asarray(OMEGA), jnp.asarray(TEMPERATURE)
        outputs = jax.lax.scan(lambda s, x: twin.step(s, *x), start, samples)[1]
        plain = jax.vmap(twin.calibration.distort_by_parameters)(*samples)
        return outputs, plain

    outputs, plain = both(Twin(calibration, sample_rate=RATE))
    return calibration, [np.asarray(a) - np.asarray(b) for a, b in zip(outputs, plain)]


@pytest.mark.slow
@pytest.mark.parametrize("name", EFFECTS)
def test_effects_are_those_of_the_diagnosis(run, name):
    calibration, added = run
    triad, channel, settings, coefficient = EFFECTS[name]
    effect = next(e for e in CATALOGUE if e.name == name)
    shape = np.asarray(effect.shape(_signal(calibration, triad), **settings))
    want = coefficient * np.broadcast_to(shape, (COUNT, 3, 1))[:, channel, 0]
    got = added[triad == "gyro"][:, channel]
    same = np.ones(COUNT, bool)
    if name == "temperature_rate":
        # The twin's slope is to the sample before, the diagnosis' to both sides: another at the turn and the start.
        same[[0, 199, 200, 201]] = False
    if name == "settling":
        same = TIME < 7.0
        same |= TIME >= 8.0
    assert np.ptp(want[same]) > 0.0
    np.testing.assert_allclose(got[same], want[same], rtol=0.0, atol=1e-10)


def test_flicker_is_flat_as_ieee_952_has_it():
    # Allan variance of a Gauss-Markov process, variance s², time constant T (IEEE Std 952, C.1.7), in closed form.
    noise = SensorNoise(TriadNoise(B=1.0), TriadNoise(), 100.0)
    tau = np.geomspace(1.0, 1e3, 60)
    total = np.zeros_like(tau)
    for T in noise.time_constants:
        x = tau / T
        total += 2.0 / x**2 * (x - 1.5 + 2.0 * np.exp(-x) - 0.5 * np.exp(-2.0 * x)) / 1.0
    variance = np.log(RATIO) / np.pi
    np.testing.assert_allclose(variance * total, 2.0 * np.log(2.0) / np.pi, rtol=0.02)


@pytest.mark.parametrize("rate", [1.0, 100.0, 4000.0])
def test_one_innovation_makes_the_sum_of_independent_processes(rate):
    noise = SensorNoise(TriadNoise(B=1.0), TriadNoise(), rate)
    keep = np.exp(-1.0 / (rate * noise.time_constants))
    decay, drive, start = noise._flicker
    np.testing.assert_allclose(1.0 - decay, keep, rtol=1e-15)
    # Scaled by √(1 − a²), since SciPy's residuals are of the greatest variance.
    size = np.sqrt(-np.expm1(2.0 * np.log1p(-decay)))
    assert np.all(drive > 0.0)
    states = solve_discrete_lyapunov(np.diag(keep), np.outer(drive, drive))
    np.testing.assert_allclose(start @ start.T, states, rtol=2e-9 * rate)
    for lag in (0, 1, 10, 1000, 10**6, 10**8):
        assert np.sum(keep**lag @ states) == pytest.approx(np.sum(keep**lag), rel=2e-9 * rate)
    # And at any frequency, against SciPy's responses of the filter and of each process by itself.
    turns = np.geomspace(1e-6, np.pi, 50)
    one = sum(freqz([r], [1.0, -a], turns)[1] for r, a in zip(drive, keep))
    each = sum(np.abs(freqz([s], [1.0, -a], turns)[1]) ** 2 for s, a in zip(size, keep))
    np.testing.assert_allclose(np.abs(one) ** 2, each, rtol=1e-8)


@pytest.mark.slow
def test_flicker_begins_in_equilibrium_and_needs_no_64_bits():
    noise = SensorNoise(TriadNoise(B=1.0), TriadNoise(B=1.0), 100.0)

    def run(key, samples):
        step = lambda s, k: noise.follow(s, k)
        return jax.lax.scan(step, noise.begin(key), jnp.arange(samples, dtype=jnp.int32))[1]

    keys = jax.random.split(jax.random.PRNGKey(5), 5000)
    drawn = np.asarray(jax.jit(jax.vmap(lambda k: run(k, 40)))(keys)).transpose(0, 2, 1)
    drawn = drawn.reshape(-1, 40)
    keep = np.exp(-0.01 / noise.time_constants)
    want = toeplitz(np.log(RATIO) / np.pi * np.sum(keep ** np.arange(40)[:, None], axis=1))
    found = drawn.T @ drawn / len(drawn)
    # One sigma of a product's mean over n is √((C_ii C_jj + C_ij²)/n); the largest of 820 is below 4.5 of them.
    spread = np.sqrt((want[0, 0] ** 2 + want**2) / len(drawn))
    assert np.max(np.abs(found - want) / spread) < 4.5

    both = []
    for double in (True, False):
        with jax.enable_x64(double):
            both.append(np.asarray(jax.jit(run, static_argnums=1)(keys[0], 300_000), float))
    # The numbers are the same in both precisions; what rounding adds is as nothing beside the steps.
    assert np.max(np.abs(both[0] - both[1])) < 1e-3 * np.diff(both[0], axis=0).std()


def test_white_walk_ramp_and_angle_noise_have_their_densities(getkey):
    accel = TriadNoise(
        N=np.array([2e-3, 0.0, 0.0]), K=np.array([0.0, 3e-3, 0.0]), Q=np.array([0.0, 0.0, 1e-4])
    )
    noise = SensorNoise(accel, TriadNoise(R=1e-3), 50.0)

    @jax.jit
    def run(key):
        return jax.lax.scan(
            lambda s, k: noise.follow(s, k), noise.begin(key), jnp.arange(20_000, dtype=jnp.int32)
        )[1]

    drawn = np.asarray(run(getkey()))
    assert drawn[:, 0].std() == pytest.approx(2e-3 * np.sqrt(50.0), rel=0.03)
    assert np.diff(drawn[:, 1]).std() == pytest.approx(3e-3 / np.sqrt(50.0), rel=0.03)
    # Each sample is the difference of two angles over the step: √2 Q f.
    assert drawn[:, 2].std() == pytest.approx(np.sqrt(2.0) * 1e-4 * 50.0, rel=0.03)
    np.testing.assert_allclose(drawn[-1, 3:], 1e-3 * 19_999 / 50.0, rtol=1e-12)


def _rest(noise, rate=100.0, samples=500):
    """Accelerometers at rest, less the specific force."""
    twin = Twin(Calibration(gravity=GRAVITY), noise, sample_rate=rate)
    still = jnp.zeros(3)
    start = twin.init(jax.random.PRNGKey(3), 20.0)
    step = lambda state, _: twin.step(state, still, still, 20.0)
    return np.asarray(jax.jit(lambda: jax.lax.scan(step, start, None, length=samples)[1][0])())


def test_white_noise_goes_through_the_sensors_filter_as_scipys():
    a = np.array([[-0.5, 0.1], [0.2, 0.0], [0.0, 0.0]])
    plain = _rest({"accel": {"N": 1e-3}})
    filtered = _rest({"accel": {"N": 1e-3, "filter": a}, "gyro": {"N": 1e-3}})
    want = [lfilter([1.0 + r.sum()], [1.0, *r], x) for r, x in zip(a, plain.T)]
    # The two programs draw in 32 bits, and round the inverse error function each its own way, by up to 1e-5 of σ.
    np.testing.assert_allclose(filtered, np.transpose(want), rtol=0.0, atol=5e-5 * 1e-3)
    slow = {"N": 0.0, "K": 1e-3, "B": 1e-3}
    unfiltered = _rest({"accel": slow})
    np.testing.assert_array_equal(_rest({"accel": slow | {"filter": a}}), unfiltered)


def test_a_twin_of_a_logs_models_has_its_noise_and_filter():
    log = lfilter([0.5], [1.0, -0.5], 0.01 * np.random.default_rng(1).normal(size=20_000))
    model = identify(log, rate=100.0, triad="accel")
    assert len(model.recursion) and not model.terms["K"].shown
    own = _rest({"accel": [model] * 3}, samples=20_000)
    again = identify(own[:, 0], rate=100.0, triad="accel")
    assert again.terms["N"].lower < model.terms["N"].value < again.terms["N"].upper
    assert own.std() == pytest.approx(log.std(), rel=0.02)
    # At another rate the coefficients say nothing.
    twin = Twin(Calibration(gravity=GRAVITY), {"accel": [model] * 3}, sample_rate=200.0)
    assert twin.noise.accel.filter is None


def test_read_out_clips_rounds_and_delays():
    noise = {"accel": {"full_scale": 20.0, "resolution": 0.5}}
    twin = Twin(Calibration(gravity=GRAVITY), noise, sample_rate=10.0, delay=0.25)
    state, outputs = twin.init(jax.random.PRNGKey(0), 20.0), []
    for k in range(5):
        state, (accel, gyro) = twin.step(
            state, np.array([4.0 * k, 100.0, 0.3]), np.array([k, 0.0, 0.0]), 20.0
        )
        outputs.append((accel, gyro))
    accel, gyro = outputs[-1]
    # Two and a half samples late on a ramp of one a sample; 1.5 · 4 = 6 on the grid of 0.5.
    assert float(gyro[0]) == pytest.approx(1.5)
    np.testing.assert_allclose(accel, [6.0, 20.0, 0.5])
