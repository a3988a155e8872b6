"""Correlated noise in state-space form: its likelihood, and the whitening it implies.

One scalar observation per block, in time order, carries the noise

$$e_b = \\sum_c h_{bc}\\,(n_c(t_b) + s_c) + g_b\\,\\Delta T(t_b) + d_{dwell(b)} + w_b,$$

with flicker and random walk $n_c$ of each sensor channel, a level $s_c$ of each power cycle, an error $d$ of each
dwell, of which the rig's part is one for all dwells of a positioning, white noise $w$, and the probe's error
$\\Delta T$, which the outputs' slope $g$ in temperature turns into one of the model; it wanders, and is another after
each power-on. Flicker is a sum of first-order Gauss-Markov processes with equal variances and time constants a factor
of about six apart, whose spectrum is $1/f$ between them. A Kalman filter over these states turns observations and model
columns into white ones in $O(n)$. `grouped_filter` and `restricted_likelihood` are the forms in NumPy that a diagnosis
uses.

**Reference:** Harvey, *Forecasting, Structural Time Series Models and the Kalman Filter*,
Cambridge 1989, ch. 3; for $1/f$ as a sum of relaxations: van der Ziel, Physica 16 (1950) 359.
"""

import numpy as np
from jaxtyping import Float

from ..._jax import Array, eqx, jax, jnp
from ..._typing import AnyArray, Scalar
from ...effects import arrays as xp


TIME_CONSTANTS = (6.0, 36.0, 216.0, 1300.0, 7800.0, 46800.0)  # s, of the Gauss-Markov processes
NUM_VARIANCES = 7
WANDER = 1000.0  # s, over which a probe's error changes
WALK = 1.6  # price of each e-fold of a walk's variance, in twice the log likelihood
FREEDOM = 4.0  # degrees of freedom of what is known of a noise: a unit may be unlike the others
# Degrees of freedom of a rig's statement: its standard deviation is known to 35 %, by GUM (JCGM 100:2008) G.4.2.
# Convention. Positions of two degrees of freedom scatter by a quarter of the stated sigma or less with the chance
# 1 − exp(−1/16) = 6 %; believed, effects of the size of the stated errors were told to a quarter of it.
STATED = 4.0


class Chain(eqx.Module):
    """Blocks of one observed quantity in time order, as the noise model sees them."""

    white: Float[np.ndarray, " block"]  # variance of the block mean by scatter; 0 marks padding
    loads: Float[np.ndarray, "block channel"]  # how each channel's noise enters the observation
    gap: Float[np.ndarray, " block"]  # s since the block before; the first is 0
    new_dwell: Float[np.ndarray, " block"]  # 1 where a new dwell begins, else 0
    new_positioning: Float[np.ndarray, " block"]  # 1 where the rig's error is another one, else 0
    new_cycle: Float[np.ndarray, " block"]  # 1 where the power was cycled, else 0
    rig: Float[np.ndarray, " block"]  # variance of a positioning's error as the rig states it
    rig_of_dwell: Float[np.ndarray, " block"]  # of what the rig states anew for each dwell
    # Change of the observation by one stated standard deviation of the probe's error; no column where none is stated.
    heated: Float[np.ndarray, "block probe"]


class Variances(eqx.Module):
    """Variance components, in the observation's unit squared."""

    white: Float[AnyArray, ""]  # factor on `Chain.white`
    flicker: Float[AnyArray, ""]  # of each Gauss-Markov process
    walk: Float[AnyArray, ""]  # growth per second of a random walk
    dwell: Float[AnyArray, ""]  # of each dwell, beyond what the rig states
    cycle: Float[AnyArray, ""]  # of each power cycle
    probe: Float[AnyArray, ""]  # of either part of the probe's error, in stated variances
    rig: Float[AnyArray, ""]  # of the rig's positioning, in stated variances


class Known(eqx.Module):
    """What is known beforehand of the log variances, relative to a chain's scale: a Student t distribution."""

    center: Float[AnyArray, "7"]
    precision: Float[AnyArray, "7 7"]  # zeros where nothing is known

    @staticmethod
    def nothing() -> "Known":
        """No knowledge beforehand."""
        return Known(np.zeros(NUM_VARIANCES), np.zeros((NUM_VARIANCES, NUM_VARIANCES)))

    def price(self, theta: Float[AnyArray, "7"]) -> Scalar | float:
        """Twice minus the log density of log variances, up to a constant."""
        off = xp.asarray(theta) - xp.asarray(self.center)
        precision = xp.asarray(self.precision)
        told = xp.sum(xp.where(xp.einsum("kk->k", precision) > 0.0, 1.0, 0.0))
        return (FREEDOM + told) * xp.log1p(off @ precision @ off / FREEDOM)


def stated_price(log_variance: Scalar | float) -> Scalar | float:
    r"""Twice minus the log density of a rig's statement, where its variances are $e^\theta$ of the stated ones: up to a
    constant $\nu (\theta + e^{-\theta} - 1)$, of a variance that was estimated with ν = `STATED` degrees of freedom."""
    return STATED * (log_variance + xp.exp(-log_variance) - 1.0)


def transition(
    variances: Variances, chain: Chain
) -> tuple[Float[Array, "block state"], Float[Array, "block state"], Float[Array, "block state"]]:
    """Decay, added variance and observation row of the state at every block."""
    num, channels = chain.loads.shape
    tau = jnp.asarray(TIME_CONSTANTS)
    first = (jnp.arange(num) == 0).astype(float)[:, None]
    decay = jnp.exp(-jnp.asarray(chain.gap)[:, None] / tau[None, :]) * (1.0 - first)
    added = variances.flicker * (1.0 - decay**2)
    gap, cycle, dwell, set_anew = (
        jnp.asarray(x)[:, None]
        for x in (chain.gap, chain.new_cycle, chain.new_dwell, chain.new_positioning)
    )
    per_channel = [(decay, added), (1.0 - first, variances.walk * gap)]
    per_channel.append((1.0 - cycle, variances.cycle * cycle))
    a = jnp.concatenate([jnp.repeat(x, channels, axis=1) for x, _ in per_channel], axis=1)
    q = jnp.concatenate([jnp.repeat(x, channels, axis=1) for _, x in per_channel], axis=1)
    heated = jnp.asarray(chain.heated)
    wander = jnp.exp(-gap / WANDER) * (1.0 - first)
    probes = [(wander, variances.probe * (1.0 - wander**2)), (1.0 - cycle, variances.probe * cycle)]
    if not heated.shape[1]:
        probes = []
    a = jnp.concatenate([a, *(x for x, _ in probes), 1.0 - dwell, 1.0 - set_anew], axis=1)
    rig = set_anew * variances.rig * jnp.asarray(chain.rig)[:, None]
    own = variances.dwell + variances.rig * jnp.asarray(chain.rig_of_dwell)[:, None]
    q = jnp.concatenate([q, *(x for _, x in probes), dwell * own, rig], axis=1)
    loads = jnp.tile(jnp.asarray(chain.loads), (1, len(TIME_CONSTANTS) + 2))
    h = jnp.concatenate([loads, *(heated for _ in probes), jnp.ones((num, 2))], axis=1)
    return a, q, h


def _gains(
    variances: Variances, chain: Chain
) -> tuple[
    Float[Array, " block"],
    Float[Array, "block state"],
    Float[Array, "block state"],
    Float[Array, "block state"],
]:
    """Innovation variance and Kalman gain at every block; they do not depend on the data."""
    a, q, h = transition(variances, chain)
    # Rows of padding are seen with unit variance and no state: they add nothing to the likelihood.
    real = jnp.asarray(chain.white) > 0.0
    white = jnp.where(real, variances.white * jnp.asarray(chain.white), 1.0)
    h = jnp.where(real[:, None], h, 0.0)

    def step(p, x):
        a, q, h, r = x
        p = p * (a[:, None] * a[None, :]) + jnp.diag(q)
        ph = p @ h
        s = h @ ph + r
        gain = ph / s
        return p - gain[:, None] * ph[None, :], (s, gain)

    size = a.shape[1]
    _, (s, gain) = jax.lax.scan(step, jnp.zeros((size, size)), (a, q, h, white))
    return s, gain, a, h


def whiten(
    variances: Variances, chain: Chain, columns: Float[AnyArray, "block column"]
) -> tuple[Float[Array, "block column"], Float[Array, ""]]:
    """Whitened columns, unitless if the columns are in the observation's unit, and log det of the noise covariance.

    The map is linear and lower triangular: $L^{-1} C$ with $L L^T = V$.
    """
    s, gain, a, h = _gains(variances, chain)
    columns = jnp.asarray(columns)

    def step(x, row):
        s, gain, a, h, c = row
        x = x * a[:, None]
        innovation = c - h @ x
        return x + gain[:, None] * innovation[None, :], innovation / jnp.sqrt(s)

    start = jnp.zeros((a.shape[1], columns.shape[1]))
    _, white = jax.lax.scan(step, start, (s, gain, a, h, columns))
    return white, jnp.sum(jnp.log(s))


def unpack(theta: Float[AnyArray, "7"], scale: Float[AnyArray, "7"]) -> Variances:
    """Variances from their logarithms relative to a scale."""
    values = xp.exp(theta) * xp.asarray(scale)
    return Variances(*(values[k, ...] for k in range(NUM_VARIANCES)))


def negative_log_likelihood(
    theta: Float[AnyArray, "7"],
    scale: Float[AnyArray, "7"],
    chain: Chain,
    observed: Float[AnyArray, " block"],
    columns: Float[AnyArray, "block column"],
    extra: Float[AnyArray, "block extra"],
    known: Known,
) -> Float[Array, ""]:
    """Restricted likelihood $\\tfrac12(\\log|V| + \\log|X^TV^{-1}X| + r^TV^{-1}r)$ of log variances.

    `columns` X is the baseline's Jacobian, `extra` holds effects in the mean (zero columns are padding). The
    determinant is taken over X only, so that values compare between different effects. Columns must
    be scaled to the unit of `observed`, so that the Gram matrix is well conditioned.
    """
    variances = unpack(theta, scale)
    parts = [jnp.asarray(observed)[:, None], jnp.asarray(columns), jnp.asarray(extra)]
    white, logdet = whiten(variances, chain, jnp.concatenate(parts, axis=1))
    y, x = white[:, 0], white[:, 1:]
    gram = x.T @ x
    # Normed to a unit diagonal; padding gets a one there and stays out of the fit.
    square = jnp.diag(gram)
    used = square > 0.0
    norm = jnp.sqrt(jnp.where(used, square, 1.0))
    scaled = gram / (norm[:, None] * norm[None, :]) + jnp.diag(jnp.where(used, 1e-11, 1.0))
    factor = jnp.linalg.cholesky(scaled)
    part = jax.scipy.linalg.solve_triangular(factor, (x.T @ y) / norm, lower=True)
    # Scatter inside blocks already tells the white level; and a random walk strong enough to pass for
    # a slow effect is rarer than one that is not.
    prior = 2.0 * jnp.log1p(jnp.square(theta[0] / 0.15)) + WALK * jax.nn.softplus(theta[2] + 3.0)
    prior = prior + known.price(theta)
    stated = jnp.any(jnp.asarray(chain.rig) + jnp.asarray(chain.rig_of_dwell) > 0.0)
    prior = prior + jnp.where(stated, stated_price(theta[6]), 0.0)
    num = columns.shape[1]
    logs = jnp.log(jnp.diag(factor)[:num]) + jnp.log(norm[:num])
    return 0.5 * (logdet + y @ y - part @ part + prior) + jnp.sum(logs)


@jax.jit
def value_and_gradient(*given):
    """`negative_log_likelihood` and its slope by the log variances."""
    return jax.value_and_grad(negative_log_likelihood)(*given)
