"""The filter of `state_space` under many variances at once, the variances along the last axis of every array.

Under other variances the same rows go through the same steps. With the variances innermost, a step is a few passes over
short contiguous lines that the compiler turns into vector instructions and that stay in the processor's nearest cache;
with them outermost, as `jax.vmap` has it, it is many products of small matrices, and takes twice as long.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..._jax import Array, jax, jnp
from ..._typing import AnyArray
from .processes import processes
from .state_space import Chain, NUM_VARIANCES


TOGETHER = 16  # variances that one call takes: so many columns' states fit into the nearest cache


class Steps(NamedTuple):
    """What a filter needs of every row, for a unit of each variance; rows of padding are seen with no state."""

    white: Float[np.ndarray, " row"]  # 0 where a row is padding
    decay: Float[np.ndarray, "row state"]
    added: Float[np.ndarray, "variance row state"]
    seen: Float[np.ndarray, "row state"]

    @classmethod
    def of(cls, chain: Chain) -> "Steps":
        """The steps of a chain."""
        white = np.asarray(chain.white, float)
        num = int(np.count_nonzero(white > 0.0))
        parts = [
            (decay, added, seen[:, k])
            for decay, added, seen in processes(chain, num)
            for k in range(seen.shape[1])
        ]
        made = cls(
            white,
            np.zeros((len(white), len(parts))),
            np.zeros((NUM_VARIANCES, len(white), len(parts))),
            np.zeros((len(white), len(parts))),
        )
        for state, (decay, added, seen) in enumerate(parts):
            made.decay[:num, state], made.seen[:num, state] = decay, seen
            for variance, unit in added.items():
                made.added[variance, :num, state] = unit
        return made


def grams_under_each(
    variances: Float[AnyArray, "lane 7"], steps: Steps, columns: Float[AnyArray, "row column"]
) -> tuple[Float[np.ndarray, "lane column column"], Float[np.ndarray, " lane"]]:
    """Products of the whitened columns with each other, and log determinants, as of `state_space.whiten`, under each
    of some variances.

    **Arguments:** variances and columns in the observation's unit.
    """
    white, logs = _whitened(variances, steps, columns)
    # One product of matrices for each: summed row by row the products would leave the nearest cache.
    by_lane = np.ascontiguousarray(np.asarray(white).transpose(2, 0, 1))
    return by_lane.transpose(0, 2, 1) @ by_lane, np.asarray(logs)


@jax.jit
def _whitened(
    variances: Float[AnyArray, "lane 7"], steps: Steps, columns: Float[AnyArray, "row column"]
) -> tuple[Float[Array, "row column lane"], Float[Array, " lane"]]:
    variances, columns = jnp.asarray(variances), jnp.asarray(columns)
    a, h = jnp.asarray(steps.decay), jnp.asarray(steps.seen)
    q = jnp.einsum("lv,vrs->rsl", variances, jnp.asarray(steps.added))
    white = jnp.asarray(steps.white)[:, None]
    r = jnp.where(white > 0.0, white * variances[None, :, 0], 1.0)

    def step(carried, row):
        x, p, logs = carried
        a, q, h, r, c = row
        p = p * (a[:, None] * a[None, :])[:, :, None] + jnp.eye(len(a))[:, :, None] * q[:, None, :]
        ph = jnp.sum(p * h[:, None, None], axis=0)
        s = jnp.sum(ph * h[:, None], axis=0) + r
        gain = ph / s[None, :]
        p = p - gain[:, None, :] * ph[None, :, :]
        x = x * a[:, None, None]
        innovation = c[:, None] - jnp.sum(x * h[:, None, None], axis=0)
        x = x + gain[:, None, :] * innovation[None, :, :]
        return (x, p, logs + jnp.log(s)), innovation / jnp.sqrt(s)[None, :]

    size, lanes, width = a.shape[1], len(variances), columns.shape[1]
    start = (
        jnp.zeros((size, width, lanes)),
        jnp.zeros((size, size, lanes)),
        jnp.zeros(lanes),
    )
    (_, _, logs), white = jax.lax.scan(step, start, (a, q, h, r, columns))
    return white, logs
