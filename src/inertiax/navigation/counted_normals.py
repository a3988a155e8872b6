"""Normal numbers by counting: those of sample n are a hash of the key and n, without a chain from sample to sample.

The generator is Threefry-2x32 with 20 rounds, JAX's own, written out in plain operations so that a compiler joins it
with what uses its numbers; JAX's form is a loop of its own on a processor, and spends a whole hash on each number. A
hash here gives two. Numbers are made in 32 bits, the same whatever JAX's precision; the largest are 5.8.

**References:** Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC'11; Box and Muller,
Ann. Math. Stat. 29 (1958) 610-611.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray, UInt32


_ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))
_PARITY = np.uint32(0x1BD11BDA)


def normals(
    key: PRNGKeyArray, count: Int[Array, ""], rows: int, width: int
) -> list[Float[Array, " width"]]:
    """`rows` vectors of `width` standard normal numbers of sample `count` (from 0), in 32 bits.

    By Box and Muller, a hash for each pair; vectors stay apart, as joining them would keep a compiler from computing
    them side by side.
    """
    words, made = jax.random.key_data(key).reshape(-1)[-2:], []
    sample = jnp.broadcast_to(count.astype(jnp.uint32), (width,))
    for pair in range((rows + 1) // 2):
        lanes = jnp.arange(width, dtype=jnp.uint32) + np.uint32(pair * width)
        first, second = threefry(words, sample, lanes)
        radius = jnp.sqrt(np.float32(-2.0) * jnp.log(_uniform(first)))
        cosine, sine = _circle(_uniform(second))
        made += [radius * cosine, radius * sine]
    return made[:rows]


def _series(function: Callable[[np.ndarray], np.ndarray]) -> list[np.float32]:
    """Powers of s, the highest first, of a function on [0, 1/4] by Chebyshev interpolation."""
    fit = np.polynomial.Chebyshev.interpolate(function, 6, domain=[0.0, 0.25])
    return [np.float32(c) for c in fit.convert(kind=np.polynomial.Polynomial).coef[::-1]]


# Both are even in the part of a turn x, so that they are functions of s = x²; the interpolation is off by 2e-8 at most.
_COSINE = _series(lambda s: np.cos(2.0 * np.pi * np.sqrt(s)))
_SINE = _series(lambda s: 2.0 * np.pi * np.sinc(2.0 * np.sqrt(s)))  # of sin(2πx)/x


def _circle(turn: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Cosine and sine of parts of a turn in (0, 1), less half a turn; a processor's own take three times as long."""
    x = turn - np.float32(0.5)
    square = x * x
    cosine, sine = (jnp.full_like(x, c[0]) for c in (_COSINE, _SINE))
    for c, s in zip(_COSINE[1:], _SINE[1:]):
        cosine, sine = cosine * square + c, sine * square + s
    return cosine, x * sine


def _uniform(bits: UInt32[Array, " n"]) -> Float[Array, " n"]:
    """Odd multiples of 2⁻²⁴ in (0, 1), which are exact and never an end."""
    return ((bits >> np.uint32(9)).astype(jnp.float32) + np.float32(0.5)) * np.float32(2.0**-23)


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
