"""The catalogue of physical effects: names, identity at zero, and formulas against outside values."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal
from scipy.spatial.transform import Rotation

from inertiax.effects import addition, apply, CATALOGUE, Signal, Variant
from inertiax.effects.effect import lag, play


# Section "names of physical effects" of the interface: public, so a change here breaks users.
NAMES = """temperature_order thermal_lag temperature_rate thermal_hysteresis temperature_dependence warm_up
drift bias_step settling second_order third_order odd_quadratic scale_asymmetry cross_coupling size_effect
vibration_rectification g_sensitivity g2_sensitivity rate_nonlinearity dead_band cross_axis_rate
table_misalignment table_axis_error pier_tilt gravity_error earth_rate rate_scale_error time_delay
quantization saturation interference magnetic supply probe_lag""".split()

BY_NAME = {e.name: e for e in CATALOGUE}
CASES = [(e, t) for e in CATALOGUE for t in e.triads]


class Slope(eqx.Module):
    """A model whose three outputs are 1, 2 and 3 units per °C."""

    def __call__(self, temperature):
        return jnp.asarray(temperature)[:, None] * jnp.array([[1.0, 2.0, 3.0]])


def make_signal(triad: str, num: int = 240, degree: int = 3) -> Signal:
    rng = np.random.default_rng(0)
    time = np.arange(num) * 1.0
    force = rng.standard_normal((num, 3))
    force /= np.linalg.norm(force, axis=1, keepdims=True)
    rate = 0.5 * rng.standard_normal((num, 3))
    temperature = 20.0 + 15.0 * np.sin(time / 40.0)
    return Signal(
        triad=triad, time=time, input=force if triad == "accel" else rate, output=np.ones((num, 3)),
        since_power=time, since_start=time, since_move=time % 20.0, move=rng.standard_normal((num, 3)),
        at_rest=np.arange(num) % 2 == 0, temperature=temperature,
        temperature_rate=np.gradient(temperature, time), force=force, rate=rate,
        room=np.broadcast_to(np.eye(3), (num, 3, 3)), vibration=rng.random(num),
        resolution=np.full(3, 0.1), scatter=np.full(3, 0.01), supply=5.0 + 0.1 * rng.standard_normal(num),
        at_temperature=Slope(), degree=degree, low=5.0, high=35.0,
    )  # fmt: skip


def forms(effect, triad):
    """A signal and the first few forms of an effect on it (some effects exist only without a model of temperature)."""
    for degree in (3, 0):
        signal = make_signal(triad, degree=degree)
        variants = effect.variants(signal)
        if variants:
            return signal, variants[:: max(1, len(variants) // 5)]
    raise AssertionError(f"{effect.name} has no form on {triad}")


def test_the_catalogue_has_exactly_the_public_names():
    assert sorted(e.name for e in CATALOGUE) == sorted(NAMES)


@pytest.mark.slow
@pytest.mark.parametrize("effect, triad", CASES, ids=lambda x: getattr(x, "name", x))
def test_an_effect_is_identity_at_zero_and_its_shape_is_its_jacobian(effect, triad):
    signal, variants = forms(effect, triad)
    for variant in variants:
        shape = effect.shape(signal, **variant.settings)
        assert shape.shape[0] == len(signal.time) and shape.shape[1] in (1, 3)
        assert bool(jnp.all(jnp.isfinite(shape)))
        zero = jnp.zeros((1 if effect.common else 3, shape.shape[2]))
        assert jnp.array_equal(apply(effect, zero, variant, signal).output, signal.output)
        jacobian = jax.jacfwd(lambda c, v=variant: addition(effect, c, v, signal))(zero)
        summed = jacobian.sum(axis=2)  # over the channels' own coefficients
        expected = jnp.broadcast_to(shape, summed.shape)
        assert jnp.allclose(
            summed, expected, rtol=1e-12, atol=1e-12 * float(jnp.abs(shape).max() + 1e-30)
        )


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.name)
def test_metadata_is_complete(effect):
    for text in (effect.title, effect.equation, effect.needs, effect.separating, effect.driver):
        assert text
    assert effect.sentence.format(channels="accel_x")
    for triad in effect.triads:
        low, high = effect.usual(triad, "tactical")
        assert 0.0 < low < high
        everything = effect.usual(triad, None)
        assert everything[0] <= low and everything[1] >= high


def test_lag_answers_a_ramp_as_the_textbook_says():
    # tau y' + y = r t from rest: y = r (t - tau (1 - exp(-t / tau))).
    time = np.linspace(0.0, 100.0, 400)
    expected = 0.3 * (time - 25.0 * (1.0 - np.exp(-time / 25.0)))
    assert np.allclose(lag(time, 0.3 * time, 25.0), expected, atol=1e-10)


def test_play_follows_behind_by_its_half_width_and_rests_at_a_turn():
    values = np.array([0.0, 1.0, 2.0, 3.0, 2.5, 2.0, 1.0, 0.0])
    assert np.allclose(play(values, 1.0), [0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 2.0, 1.0])


def test_thermal_lag_is_the_models_slope_times_the_lag_of_a_ramp():
    signal = make_signal("accel")
    signal = eqx.tree_at(lambda s: s.temperature, signal, 0.02 * signal.time)
    shape = BY_NAME["thermal_lag"].shape(signal, time_constant=10.0)
    # Long after the start the element is r tau = 0.2 °C behind.
    assert np.allclose(shape[-1, :, 0], [-0.2, -0.4, -0.6], atol=1e-9)


def test_a_probe_that_lags_leaves_the_elements_ahead():
    """The probe's own first-order lag, integrated by SciPy, is undone: the elements are at their own temperature."""
    signal = make_signal("accel")
    tau, time = 12.0, np.asarray(signal.time)
    element = 20.0 + 8.0 * np.sin(time / 40.0)
    model = scipy.signal.StateSpace([[-1.0 / tau]], [[1.0 / tau]], [[1.0]], [[0.0]])
    probe = 20.0 + scipy.signal.lsim(model, element - 20.0, time)[1]
    slope = np.gradient(probe, time)
    signal = eqx.tree_at(lambda s: (s.temperature, s.temperature_rate), signal, (probe, slope))
    shape = BY_NAME["probe_lag"].shape(signal, time_constant=tau)
    # Central differences of 1 s see a period of 251 s to 1e-4 of an amplitude of 2.4 °C; the start is five time
    # constants long, and the last one is one-sided.
    ahead = np.outer(element - probe, [1.0, 2.0, 3.0])
    assert np.abs(np.asarray(shape)[60:-2, :, 0] - ahead[60:-2]).max() < 3e-3


def test_size_effect_gives_the_centripetal_acceleration():
    # 2 rad/s about z, sensor 0.1 m along x: 0.4 m/s² towards the axis.
    signal = make_signal("accel")
    rate = np.tile([0.0, 0.0, 2.0], (len(signal.time), 1))
    signal = eqx.tree_at(lambda s: s.rate, signal, rate)
    added = BY_NAME["size_effect"].shape(signal) @ np.array([0.1, 0.0, 0.0])
    assert np.allclose(added, [-0.4, 0.0, 0.0], atol=1e-12)


def test_lock_in_is_the_hyperbola_above_and_nothing_below():
    signal = make_signal("gyro", num=3)
    signal = eqx.tree_at(lambda s: s.input, signal, np.array([[0.2, 0.05, -0.2]] * 3))
    shape = BY_NAME["dead_band"].shape(signal, width=0.1, form="lock-in")
    total = np.asarray(signal.input) + shape[:, :, 0]
    assert np.allclose(total[0], [0.1 * np.sqrt(3.0), 0.0, -0.1 * np.sqrt(3.0)])


def test_quantization_is_the_mean_rounding_error_of_a_noisy_value():
    rng = np.random.default_rng(1)
    values, scatter, step = np.array([0.03, 0.142, -0.377]), 0.03, 0.1
    noisy = values + scatter * rng.standard_normal((400_000, 3))
    expected = (step * np.round(noisy / step) - noisy).mean(axis=0)
    signal = make_signal("accel", num=2)
    signal = eqx.tree_at(
        lambda s: (s.output, s.scatter), signal, (np.tile(values, (2, 1)), np.full(3, scatter))
    )
    shape = BY_NAME["quantization"].shape(signal)
    # Monte Carlo error of the mean: 0.03 / sqrt(4e5) = 5e-5.
    assert np.allclose(shape[0, :, 0], expected, atol=2.5e-4)


def test_what_rounding_took_is_told_by_the_model_where_the_output_is_rounded_already():
    signal = make_signal("accel", num=3)
    expected = np.array([[0.03, 0.142, -0.377]] * 3)
    rounded = 0.1 * np.round(expected / 0.1)
    signal = eqx.tree_at(lambda s: (s.output, s.scatter), signal, (rounded, np.full(3, 0.025)))
    assert np.allclose(BY_NAME["quantization"].shape(signal), 0.0, atol=1e-12)
    signal = eqx.tree_at(lambda s: s.expected, signal, expected, is_leaf=lambda x: x is None)
    shape = BY_NAME["quantization"].shape(signal)[:, :, 0]
    # By numerical integration over the Gaussian scatter.
    noise = np.linspace(-0.2, 0.2, 200_001)
    weight = np.exp(-0.5 * (noise / 0.025) ** 2)
    noisy = expected[0][:, None] + noise
    taken = ((0.1 * np.round(noisy / 0.1) - noisy) * weight).sum(axis=1) / weight.sum()
    # Mean of the noise is 0; six harmonics leave exp(-2 (7 pi / 4)^2) of the step.
    assert np.allclose(shape, taken, atol=1e-5)


def test_coefficients_over_temperature_are_chebyshev_series_of_the_constant_form():
    """By NumPy: D(T) f with D = D0 + D1 T_1(x) + D2 T_2(x); forms up to the model's degree, at most two."""
    effect, signal = BY_NAME["g_sensitivity"], make_signal("gyro")
    force, heat = np.asarray(signal.force), np.asarray(signal.temperature)
    x = (2.0 * heat - signal.low - signal.high) / (signal.high - signal.low)
    matrices = np.random.default_rng(2).standard_normal((3, 3))  # of D0, D1 and D2 a row each
    found = np.asarray(effect.shape(signal, axes="xyz", over=2))[:, 0] @ matrices.ravel()
    expected = sum(
        np.polynomial.chebyshev.chebval(x, np.eye(3)[k]) * (force @ matrices[k]) for k in range(3)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    forms_of = lambda degree: [
        v.settings.get("over", 0) for v in effect.variants(make_signal("gyro", degree=degree))
    ]
    assert [max(forms_of(d)) for d in (0, 1, 3)] == [0, 1, 2]


def test_second_order_of_one_g_is_its_coefficient():
    signal = make_signal("accel", num=2)
    signal = eqx.tree_at(lambda s: s.input, signal, np.array([[1.0, -1.0, 0.5]] * 2))
    added = addition(BY_NAME["second_order"], jnp.full((3, 1), 4e-4), Variant("", {}), signal)
    assert np.allclose(added[0], [4e-4, 4e-4, 1e-4])


def test_interference_has_the_stated_frequency():
    signal = make_signal("gyro")
    shape = BY_NAME["interference"].shape(signal, frequency=0.05)
    spectrum = np.abs(np.fft.rfft(np.asarray(shape[:, 0, 0])))
    assert np.fft.rfftfreq(len(signal.time), 1.0)[np.argmax(spectrum)] == pytest.approx(0.05)


@pytest.mark.parametrize("pole", [0, 1])
def test_axes_that_are_not_square_turn_the_force_as_the_tables_rotations_do(pole):
    # Case to room is Rx(a) Ry(skew) Rz(b), by SciPy; where the inner axis stands upright b is its zero.
    rng = np.random.default_rng(3)
    outer = np.r_[0.0, np.pi, rng.uniform(0.2, 2.9, 238)]
    inner = np.r_[0.0, 0.0, rng.uniform(-3.0, 3.0, 238)]
    zero = np.pi / 2 * (1 - pole)  # the inner zero lies on device axis x or y

    def force(skew):
        angles = np.stack([outer, np.full(240, skew), inner + zero], axis=1)
        return Rotation.from_euler("XYZ", angles).inv().apply([0.0, 0.0, 1.0])

    signal = make_signal("accel")
    signal = eqx.tree_at(lambda s: (s.force, s.input), signal, (force(0.0), force(0.0)))
    effect = next(e for e in CATALOGUE if e.name == "table_axis_error")
    shape = effect.shape(signal, axis="z", form="skew", pole=pole)
    # Second differences of 1e-4 rad leave 1e-8.
    slope = (force(1e-4) - force(-1e-4)) / 2e-4
    assert np.abs(np.asarray(shape)[:, :, 0] / 9.80665 - slope).max() < 1e-7


def test_axes_that_are_not_square_are_told_by_the_room_at_every_angle():
    # The room's axes are those of a base whose y is the outer axis: up and down, and past either.
    outer, inner = np.random.default_rng(3).uniform(-np.pi, np.pi, (2, 240))
    at = lambda skew: Rotation.from_euler(
        "YXZ", np.stack([outer, 0.0 * outer + skew, inner], axis=1)
    )
    force = lambda skew: at(skew).inv().apply([0.0, 0.0, 1.0])
    rate = at(0.0).inv().apply([0.0, 0.5, 0.0])
    signal = eqx.tree_at(
        lambda s: (s.force, s.input, s.room, s.rate), make_signal("accel"),
        (force(0.0), force(0.0), np.swapaxes(at(0.0).as_matrix(), 1, 2), rate), is_leaf=lambda x: x is None,
    )  # fmt: skip
    effect = BY_NAME["table_axis_error"]
    found = effect.variants(dataclasses.replace(signal, upright=True))
    (mine,) = (v for v in found if v.label == "skew about z")
    assert np.cos(mine.settings["azimuth"]) == pytest.approx(0.0, abs=1e-9)
    shape = np.asarray(effect.shape(signal, **mine.settings))[:, :, 0] / 9.80665
    slope = (force(1e-4) - force(-1e-4)) / 2e-4
    # Second differences of 1e-4 rad leave 1e-8; a turn about x is one about y's normal with z, of either sign.
    assert min(np.abs(shape - sign * slope).max() for sign in (-1, 1)) < 1e-7


def test_a_field_of_unknown_azimuth_is_nearly_among_the_forms():
    rng = np.random.default_rng(3)
    room = Rotation.random(400, rng).as_matrix()  # the room's axes, seen by the device
    signal = eqx.tree_at(lambda s: s.room, make_signal("gyro", 400), room)
    signal = dataclasses.replace(signal, upright=True)
    effect = BY_NAME["magnetic"]
    azimuth, dip = np.radians(104.0), np.radians(58.0)
    field = np.array([np.cos(dip) * np.cos(azimuth), np.cos(dip) * np.sin(azimuth), -np.sin(dip)])
    truth = room @ field @ np.array([0.5, -0.7, 0.4])
    left = {}
    for variant in effect.variants(signal):
        columns = np.asarray(effect.shape(signal, **variant.settings))[:, 0]
        beside = columns @ np.linalg.lstsq(columns, truth, rcond=None)[0]
        left[variant.label] = np.square(truth - beside).sum() / np.square(truth).sum()
    best = min(left, key=left.get)
    # The angle between the field and the nearest form: 14° of azimuth times cos(dip) and 7° of dip, 0.17 rad.
    assert best == "any axis, azimuth 90 deg" and left[best] < 2.0 * 0.17**2
    assert effect.variants(dataclasses.replace(signal, upright=False))[1:] == ()


def test_a_branch_turns_where_the_temperature_does_and_not_where_the_probes_noise_does():
    """Up for 1000 s, a soak, and down: the branch alone is another one from the end of the soak on."""
    effect, noise = BY_NAME["thermal_hysteresis"], 0.02
    course = np.interp(np.arange(2401), [0, 1000, 1400, 2400], [10.0, 50.0, 50.0, 10.0])
    for sigma in (0.0, noise):
        probe = course + sigma * np.random.default_rng(0).standard_normal(2401)
        signal = dataclasses.replace(make_signal("accel", 2401), temperature=probe)
        (variant,) = [
            v for v in effect.variants(signal)
            if v.settings["loop"] == "branch" and v.settings["on"] == "bias"
        ]  # fmt: skip
        branch = np.asarray(effect.shape(signal, **variant.settings))[:, 0, 0]
        np.testing.assert_array_equal(branch[:990], -1.0)
        np.testing.assert_array_equal(branch[1405:], 1.0)
        # In the soak the highest reading is the turn; without noise it is the last of them.
        assert np.count_nonzero(np.diff(branch)) == 1
        assert sigma > 0.0 or branch[1399] == -1.0
        widest = variant.settings["radius"] * np.ptp(probe)
        assert widest < 6.0 * noise if sigma else widest < 0.01  # 4.5 as it stands beside the name


def test_a_probe_that_jumps_from_row_to_row_tells_no_branch():
    probe = np.random.default_rng(0).uniform(0.0, 40.0, 240)
    signal = dataclasses.replace(make_signal("accel"), temperature=probe)
    loops = {v.settings["loop"] for v in BY_NAME["thermal_hysteresis"].variants(signal)}
    assert "play" in loops and "branch" not in loops


def test_the_models_say_where_a_drift_is_zero_and_which_branch_reads_high():
    there_and_back = dataclasses.replace(
        make_signal("accel", 201),
        temperature=20.0 + 30.0 * (1.0 - np.abs(np.arange(201) - 100) / 100),
    )
    for form in ("play", "Rayleigh", "spread"):
        settings = {"radius": 0.05, "loop": form, "on": "bias"}
        shape = np.asarray(BY_NAME["thermal_hysteresis"].shape(there_and_back, **settings))[:, 0, 0]
        assert shape[50] < -0.3 and shape[150] > 0.3  # of the same temperature, 35 °C
    assert "-1 after warming and 1 after cooling" in BY_NAME["thermal_hysteresis"].equation
    drift = np.asarray(BY_NAME["drift"].shape(there_and_back, on="bias"))[:, 0, 0]
    assert drift[100] == 0.0 and drift[-1] == -drift[0] == 100.0
