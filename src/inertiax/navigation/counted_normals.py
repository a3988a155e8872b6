"""Normal numbers by counting: those of sample n are a hash of the key and n, without a chain from sample to sample.

The generator is Threefry-2x32 with 20 rounds, JAX's own, written out in plain operations so that a compiler joins it
with what uses its numbers; JAX's form is a loop of its own on a processor, and spends a whole hash on each number. A
hash here gives two. Numbers are made in 32 bits, the same whatever JAX's precision: 2²³ of them, up to 5.3 standard
deviations.

**Reference:** Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC'11.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray, UInt32


_ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))
_PARITY = np.uint32(0x1BD11BDA)


def normals(key: PRNGKeyArray, count: Int[Array, ""], number: int) -> Float[Array, " number"]:
    """`number` standard normal numbers of sample `count` (from 0), in 32 bits."""
    pairs = (number + 1) // 2
    lanes = jnp.arange(pairs, dtype=jnp.uint32)
    words = jax.random.key_data(key).reshape(-1)[-2:]
    first, second = threefry(words, jnp.broadcast_to(count.astype(jnp.uint32), (pairs,)), lanes)
    bits = jnp.concatenate([first, second])[:number]
    # Odd multiples of 2⁻²³ in (−1, 1), which are exact and never an end.
    halves = (bits >> np.uint32(9)).astype(jnp.int32).astype(jnp.float32) + np.float32(0.5)
    uniform = halves * np.float32(2.0**-22) - np.float32(1.0)
    return np.float32(np.sqrt(2.0)) * jax.lax.erf_inv(uniform)


def threefry(
    key: UInt32[Array, "2"], first: UInt32[Array, " n"], second: UInt32[Array, " n"]
) -> tuple[UInt32[Array, " n"], UInt32[Array, " n"]]:
    """Threefry-2x32-20 of pairs of words."""
    schedule = (key[0], key[1], key[0] ^ key[1] ^ _PARITY)
    x, y = first + schedule[0], second + schedule[1]
    for group in range(5):
        for turn in _ROTATIONS[group % 2]:
            x = x + y
            y = x ^ ((y << np.uint32(turn)) | (y >> np.uint32(32 - turn)))
        x = x + schedule[(group + 1) % 3]
        y = y + schedule[(group + 2) % 3] + np.uint32(group + 1)
    return x, y
