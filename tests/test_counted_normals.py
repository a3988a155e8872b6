"""A twin's random numbers: the published answers of their generator, JAX's own, and what makes numbers normal."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from inertiax.navigation.counted_normals import normals, threefry


@pytest.mark.parametrize(
    ("key", "counter", "answer"),
    [
        # Known answers of Random123 for Threefry-2x32 with 20 rounds.
        ((0, 0), (0, 0), (0x6B200159, 0x99BA4EFE)),
        ((2**32 - 1,) * 2, (2**32 - 1,) * 2, (0x1CB996FC, 0xBB002BE7)),
        ((0x13198A2E, 0x03707344), (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0)),
    ],
)
def test_hash_is_threefry(key, counter, answer):
    first, second = (jnp.asarray([c], jnp.uint32) for c in counter)
    found = threefry(jnp.asarray(key, jnp.uint32), first, second)
    assert tuple(int(x[0]) for x in found) == answer


def test_hash_is_that_of_jax():
    words = jax.random.key_data(jax.random.PRNGKey(7))
    first, second = threefry(words, jnp.zeros(5, jnp.uint32), jnp.arange(5, dtype=jnp.uint32))
    # Where JAX counts by elements it folds both words of each hash into one.
    with jax.threefry_partitionable(True):
        expected = jax.random.bits(jax.random.PRNGKey(7), (5,), jnp.uint32)
    np.testing.assert_array_equal(first ^ second, expected)


def test_numbers_are_normal_and_independent():
    count = 20_000
    draw = jax.vmap(lambda n: jnp.stack(normals(jax.random.PRNGKey(3), n, 3, 6)))
    drawn = np.asarray(draw(jnp.arange(count, dtype=jnp.int32)), float).reshape(count, 18)
    # Kolmogorov and Smirnov: one in a thousand of right generators is above 1.95/√n.
    for column in drawn.T:
        assert scipy.stats.kstest(column, "norm").statistic < 1.95 / np.sqrt(count) * 1.2
    correlation = np.corrcoef(drawn.T) - np.eye(18)
    lagged = [np.corrcoef(c[1:], c[:-1])[0, 1] for c in drawn.T]
    # 171 of standard deviation 1/√n: the largest of them is below 4.5 of these but once in a thousand.
    assert np.abs(correlation).max() < 4.5 / np.sqrt(count)
    assert np.abs(lagged).max() < 4.5 / np.sqrt(count)


def test_samples_and_devices_have_numbers_of_their_own():
    one = normals(jax.random.PRNGKey(0), jnp.asarray(5, jnp.int32), 2, 6)
    again = normals(jax.random.key(0), jnp.asarray(5, jnp.int32), 2, 6)
    np.testing.assert_array_equal(one, again)
    other = normals(jax.random.PRNGKey(1), jnp.asarray(5, jnp.int32), 2, 6)
    later = normals(jax.random.PRNGKey(0), jnp.asarray(6, jnp.int32), 2, 6)
    every = np.concatenate([*one, *other, *later])
    assert len(np.unique(every)) == every.size
