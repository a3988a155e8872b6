"""The filter of `state_space` under many variances at once, the variances along the last axis of every array.

Under other variances the same rows go through the same steps. With the variances innermost, a step is a few passes over
short contiguous lines that the compiler turns into vector instructions and that stay in the processor's nearest cache;
with them outermost, as `jax.vmap` has it, it is many products of small matrices, and takes twice as long.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._typing import AnyArray
from .state_space import Chain, transition, unpack


TOGETHER = 16  # variances that one call takes: so many columns' states fit into the nearest cache


@jax.jit
def whiten_under_each(
    thetas: Float[AnyArray, "lane 7"],
    scale: Float[AnyArray, "7"],
    chain: Chain,
    columns: Float[AnyArray, "block column"],
) -> tuple[Float[Array, "block column lane"], Float[Array, " lane"]]:
    """Whitened columns and log determinants as of `state_space.whiten`, under each of some log variances.

    **Arguments:** `thetas` relative to `scale`, as `state_space.unpack` takes them; columns in the observation's unit.
    """
    columns = jnp.asarray(columns)
    # Decays and observation rows do not depend on the variances.
    made = jax.vmap(lambda t: transition(unpack(t, scale), chain), out_axes=(None, 2, None))
    a, q, h = made(jnp.asarray(thetas))
    level = jnp.exp(jnp.asarray(thetas)[:, 0]) * jnp.asarray(scale)[0]
    # Rows of padding are seen with unit variance and no state: they add nothing to the likelihood.
    white = jnp.asarray(chain.white)[:, None]
    r = jnp.where(white > 0.0, level[None, :] * white, 1.0)
    h = jnp.where(white > 0.0, h, 0.0)

    def step(carried, row):
        x, p = carried
        a, q, h, r, c = row
        p = p * (a[:, None] * a[None, :])[:, :, None] + jnp.eye(len(a))[:, :, None] * q[:, None, :]
        ph = jnp.sum(p * h[:, None, None], axis=0)
        s = jnp.sum(ph * h[:, None], axis=0) + r
        gain = ph / s[None, :]
        p = p - gain[:, None, :] * ph[None, :, :]
        x = x * a[:, None, None]
        innovation = c[:, None] - jnp.sum(x * h[:, None, None], axis=0)
        x = x + gain[:, None, :] * innovation[None, :, :]
        return (x, p), (innovation / jnp.sqrt(s)[None, :], s)

    size, lanes = a.shape[1], len(thetas)
    start = jnp.zeros((size, columns.shape[1], lanes)), jnp.zeros((size, size, lanes))
    _, (made, s) = jax.lax.scan(step, start, (a, q, h, r, columns))
    return made, jnp.sum(jnp.log(s), axis=0)
