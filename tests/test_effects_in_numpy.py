"""The catalogue's shapes evaluated by NumPy against the same formulas compiled by JAX."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.diagnose.candidates.signatures import block_shapes
from inertiax.diagnose.observations.blocks import block_mean, Blocks
from inertiax.effects import arrays, CATALOGUE, Signal
from inertiax.effects.effect import lag, lag_step, play


CASES = [(e, t) for e in CATALOGUE for t in e.triads]
NUM = 300


class Curved(eqx.Module):
    """A model whose three outputs follow temperature in three ways."""

    def __call__(self, temperature):
        t = temperature
        return arrays.stack([t, 2.0 * t, t * t / 30.0], axis=-1)


def turning_and_warming(triad: str, degree: int) -> Signal:
    """Uneven rows of both triads in rests and turns, over temperature, with everything that an effect may ask for."""
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(0.5, 1.5, NUM))
    force = rng.standard_normal((NUM, 3))
    force /= np.linalg.norm(force, axis=1, keepdims=True)
    rate = 0.5 * rng.standard_normal((NUM, 3))
    temperature = 20.0 + 15.0 * np.sin(time / 40.0)
    return Signal(
        triad=triad, time=time, input=force if triad == "accel" else rate, output=9.0 * force,
        since_power=time, since_start=time + 5.0, since_move=time % 20.0, move=rng.standard_normal((NUM, 3)),
        at_rest=np.arange(NUM) % 3 > 0, temperature=temperature,
        temperature_rate=np.gradient(temperature, time), force=force, rate=rate,
        room=np.linalg.qr(rng.standard_normal((NUM, 3, 3)))[0], upright=True, oriented=True,
        vibration=rng.random(NUM), resolution=np.full(3, 0.1), scatter=np.full(3, 0.01),
        supply=5.0 + 0.1 * rng.standard_normal(NUM), at_temperature=Curved(), degree=degree, low=5.0, high=35.0,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("effect, triad", CASES, ids=lambda x: getattr(x, "name", x))
def test_a_shape_in_numpy_is_the_one_that_jax_compiles(effect, triad):
    assert effect.in_numpy
    # Some effects exist only without a model of temperature.
    signals = (turning_and_warming(triad, degree) for degree in (3, 0))
    signal, variants = next((s, v) for s in signals if (v := effect.variants(s)))
    asked = variants[:: max(1, len(variants) // 3)]
    shapes = lambda s: [effect.shape(s, **v.settings) for v in asked]
    with jax.enable_x64(True):
        compiled = jax.jit(shapes)(signal)
    for mine, other in zip(shapes(signal), map(np.asarray, compiled), strict=True):
        assert isinstance(mine, np.ndarray)
        # Rounding ε; a lock-in's root of a difference of squares makes √ε of it.
        np.testing.assert_allclose(mine, other, rtol=1e-9, atol=3e-8 * np.abs(other).max())


def test_memory_in_numpy_is_that_of_jax():
    signal = turning_and_warming("accel", 0)
    with jax.enable_x64(True):
        time, values = jnp.asarray(signal.time), jnp.asarray(signal.temperature)
        for tau in (1e-3, 3.0, 500.0):
            other = np.asarray(lag(time, values, tau))
            np.testing.assert_allclose(lag(signal.time, signal.temperature, tau), other, rtol=1e-13)
        rough = signal.temperature + np.random.default_rng(1).standard_normal(NUM)
        rough[100:110] = rough[100]  # neither rises nor falls
        for course in (signal.temperature, rough, rough[:1]):
            for radius in (0.0, 0.7, 100.0):
                other = np.asarray(play(jnp.asarray(course), radius))
                np.testing.assert_array_equal(play(course, radius), other)


def test_numbers_of_python_do_not_widen_arrays_of_32_bits():
    with jax.enable_x64(True):
        value = jnp.ones((), jnp.float32)
        lagged, last = lag_step((value, value), value, 0.1, arrays.maximum(30.0, 1e-9))
    assert lagged.dtype == last.dtype == jnp.float32


def test_blocks_take_the_mean_and_a_block_of_zeros_has_none():
    rng = np.random.default_rng(0)
    values = 1e6 + rng.standard_normal((50, 3, 2))
    values[20:30] = 0.0
    start, stop = np.array([0, 7, 20, 31]), np.array([7, 20, 30, 50])
    means = [values[a:b].mean(axis=0) for a, b in zip(start, stop)]
    found = block_mean(values, start, stop)
    np.testing.assert_allclose(found, means, rtol=1e-14)
    assert not found[2].any()
    np.testing.assert_array_equal(block_mean(values[:, 0, 0], start[:3], stop[:3]), found[:3, 0, 0])


def test_an_effect_of_a_user_in_jax_is_compiled_to_the_same_rows():
    signal = turning_and_warming("gyro", 0)
    effect = next(e for e in CATALOGUE if e.name == "dead_band")
    start = np.arange(0, NUM, 10)
    none = np.zeros(len(start), int)
    blocks = Blocks(
        start, start + 10, none, none > 0, none > 0, none > 0, 0.1 * none, none, none, none, none, *7 * [None]
    )  # fmt: skip
    compiled = dataclasses.replace(effect, in_numpy=False)
    variants = effect.variants(signal)
    with jax.enable_x64(True):
        pairs = [block_shapes(e, variants, signal, signal, blocks) for e in (effect, compiled)]
    for mine, other in zip(*pairs, strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-9, atol=3e-8 * np.abs(other).max())
