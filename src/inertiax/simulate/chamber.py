"""The thermal chamber: the device's temperature as a function of time in each experiment.

The founding paper ran 13 experiments from −55 to +60 °C "in steps of 10 °C" and let the temperature
change by up to 15, 4 or 0.5 °C within an experiment (its sets 1, 2 and 3); it prints no paths.
`PAPER_TEMPERATURES` is the reading in which all three figures hold: −55, −45, …, +55 and +60 °C
(thirteen equal steps would be 115/12 = 9.58 °C). The paths' shapes, `DRIFTS`, are assumed.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._typing import AnyArray, Scalar


PAPER_TEMPERATURES = (*(float(t) for t in range(-55, 56, 10)), 60.0)  # °C
PAPER_CHANGES = (15.0, 4.0, 0.5)  # °C within an experiment, sets 1, 2, 3

_SETTLING = 4.0  # time constants of the settling path in one experiment: 98 % done at its end


def _centred(u: Array, sign: Array) -> Array:
    del sign
    return u - 0.5


def _one_sided(u: Array, sign: Array) -> Array:
    del sign
    return u


def _alternating(u: Array, sign: Array) -> Array:
    return sign * u


def _alternating_centred(u: Array, sign: Array) -> Array:
    return sign * (u - 0.5)


def _settling(u: Array, sign: Array) -> Array:
    del sign
    end = jnp.exp(jnp.asarray(-_SETTLING, u.dtype))
    return -(jnp.exp(-_SETTLING * u) - end) / (1.0 - end)


def _sinusoid(u: Array, sign: Array) -> Array:
    del sign
    return 0.5 * jnp.sin(2.0 * jnp.pi * u)


# Shape of the path over the experiment, u = 0…1, with a peak-to-peak value of 1. `sign` is +1 in
# experiments 0, 2, … and −1 in 1, 3, ….
DRIFTS = {
    "centred": _centred,  # ramp through the nominal temperature at mid-experiment
    "one-sided": _one_sided,  # ramp that leaves from the nominal temperature
    "alternating": _alternating,  # one-sided, heating and cooling in turn
    "alternating-centred": _alternating_centred,  # centred, heating and cooling in turn
    "settling": _settling,  # exponential, arrives at the nominal temperature
    "sinusoid": _sinusoid,  # one period about the nominal temperature
}


class Chamber(eqx.Module):
    """Temperature programme: a nominal temperature per experiment and a drift within it."""

    nominal: Float[AnyArray, " experiment"]  # °C
    # °C, peak to peak within an experiment, of all or of each; negative: the path upside down
    change: Scalar | float | Float[AnyArray, " experiment"]
    drift: str = eqx.field(static=True, default="centred")  # a name in DRIFTS

    def __check_init__(self):
        if self.drift not in DRIFTS:
            raise ValueError(
                f"`Chamber(drift={self.drift!r})`: no such path; it is one of {list(DRIFTS)}."
            )

    def temperature(
        self, experiment: int | Int[AnyArray, ""], fraction: Scalar | float
    ) -> Float[Array, ""]:
        """Temperature of the device's probe (°C) in one experiment, `fraction` (0…1) of the way
        through it."""
        index = jnp.asarray(experiment)
        u = jnp.asarray(fraction)
        sign = jnp.where(index % 2 == 0, 1.0, -1.0).astype(u.dtype)
        nominal = jnp.asarray(self.nominal)
        change = jnp.broadcast_to(jnp.asarray(self.change, u.dtype), nominal.shape)[index]
        return nominal[index] + change * DRIFTS[self.drift](u, sign)


def first_order_lag(
    time: Float[AnyArray, " time"],
    temperature: Float[AnyArray, " time"],
    time_constant: Scalar | float,
) -> Float[Array, " time"]:
    """Temperature behind a first-order lag, $\\tau \\dot y + y = T$, in equilibrium at the start.

    Exact for a temperature that is linear between the given times: over a step h with slope s,

    $$y_1 = T_1 - s\\tau + (y_0 - T_0 + s\\tau)\\, e^{-h/\\tau}.$$

    **Arguments:** `time` in s, `temperature` in °C, `time_constant` τ in s (0 means no lag).
    """
    t, x = jnp.asarray(time), jnp.asarray(temperature)
    tau = jnp.asarray(time_constant, x.dtype)
    safe = jnp.where(tau > 0.0, tau, jnp.ones_like(tau))
    step = jnp.diff(t)
    behind = jnp.diff(x) / step * safe  # where y − T settles, with the sign turned
    decay = jnp.exp(-step / safe)

    def advance(lag: Array, item: tuple[Array, Array]) -> tuple[Array, Array]:
        target, factor = item
        lag = target + (lag - target) * factor  # lag = T − y
        return lag, lag

    start = jnp.zeros((), x.dtype)
    _, lags = jax.lax.scan(advance, start, (behind, decay))
    return jnp.where(tau > 0.0, x - jnp.concatenate([start[None], lags]), x)
