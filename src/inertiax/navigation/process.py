"""Allan noise as a filter's process noise: white, random walk, and flicker as a sum of Gauss-Markov processes.

Noise enters the outputs: a' = … + n + d, with white n of density N and a slow drift d of each channel,

    d = w + Σ_i x_i,     w' = K·white,     x_i' = −x_i/τ_i + √(2 s²/τ_i)·white,     s² = B² ln r / π

The τ_i follow each other by the ratio r. Their spectra 2 s² τ/(1 + (2πfτ)²) then add up to IEEE Std 952's flicker
B²/(2πf) between 1/(2πτ_max) and 1/(2πτ_min): Σ_i ≈ ∫ d(ln τ)/ln r · 2 s² τ/(1 + (2πfτ)²) = s²/(2 f ln r).

**Reference:** IEEE Std 952-2020, annex C (coefficients); Keshner, "1/f noise", Proc. IEEE 70 (1982) 212-218 (sums).
"""

import math
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._typing import AnyArray
from ..allan.model import NoiseModel
from ..data.plausible_units import check_from_zero, GREATEST_NOISE


# States of slow drift are in these units, of the order of what they hold: m/s², rad/s.
_UNITS = np.array([1e-3] * 3 + [1e-5] * 3)
LARGEST_TURN_ON = 10.0  # m/s² or rad/s: an accelerometer's range of 1 g, which no bias exceeds
Density = float | Float[AnyArray, ""] | Float[AnyArray, "3"]


class TriadNoise(eqx.Module):
    """Noise of one triad, for all axes alike or one value an axis.

    `None` leaves a term's states out of the filter; zero keeps them, so that a gradient by it exists.

    Raises `ValueError` for a term below zero or implausible in SI.
    """

    white: Density  # N: m/s²/√Hz or rad/s/√Hz
    flicker: Density | None = None  # B: m/s² or rad/s
    walk: Density | None = None  # K: m/s²/√s or rad/s/√s
    turn_on: Density | None = None  # m/s² or rad/s, of the bias from one power-on to the next

    def __check_init__(self):
        for term in ("white", "flicker", "walk", "turn_on"):
            value = getattr(self, term)
            if isinstance(value, float | int | np.ndarray | np.generic):
                largest = LARGEST_TURN_ON if term == "turn_on" else max(GREATEST_NOISE.values())
                check_from_zero(f"TriadNoise({term}=...)", value, largest, "SI")

    @staticmethod
    def from_models(models: Sequence[NoiseModel]) -> "TriadNoise":
        """The noise that `inertiax noise` identified in logs of the x, y and z channel.

        Raises `ValueError` unless there are three models of one triad.
        """
        if len(models) != 3 or len({m.triad for m in models}) != 1:
            kinds = [m.triad for m in models]
            raise ValueError(
                f"`TriadNoise.from_models(models)` takes the three channels of one triad; got {kinds}."
            )
        term = lambda name: np.array([float(m.terms[name].value or 0.0) for m in models])
        return TriadNoise(white=term("N"), flicker=term("B"), walk=term("K"))


class ImuNoise(eqx.Module):
    """Noise of both triads; `flicker_times` (s) are the correlation times that make up the flicker.

    Raises `ValueError` unless the times increase by one ratio, and for gyros' terms that are implausible in SI.
    """

    accel: TriadNoise
    gyro: TriadNoise
    flicker_times: tuple[float, ...] = eqx.field(static=True, default=(10.0, 100.0, 1000.0))

    def __check_init__(self):
        times = np.asarray(self.flicker_times, float)
        ratios = times[1:] / times[:-1]
        if len(times) < 2 or times[0] <= 0 or ratios[0] <= 1 or np.ptp(ratios) > 1e-6 * ratios[0]:
            raise ValueError(
                f"`ImuNoise(flicker_times=...)` needs 2 or more times in s that increase by one ratio, such as "
                f"(10.0, 100.0, 1000.0); got {self.flicker_times}."
            )

        for term in ("white", "flicker", "walk"):
            value = getattr(self.gyro, term)
            if isinstance(value, float | int | np.ndarray | np.generic):
                check_from_zero(f"ImuNoise(gyro=...): {term}", value, GREATEST_NOISE["gyro"], "SI")

    def _has(self, *terms: str) -> bool:
        return any(getattr(t, k) is not None for t in (self.accel, self.gyro) for k in terms)

    @property
    def correlation_times(self) -> tuple[float, ...]:
        """Of the drift processes, s: infinity for the walk, then those of the flicker; each is six states."""
        walk = (math.inf,) if self._has("walk", "turn_on") else ()
        return walk + (self.flicker_times if self._has("flicker") else ())

    @property
    def count(self) -> int:
        """Number of drift states."""
        return 6 * len(self.correlation_times)


class SlowNoise(eqx.Module):
    """The drift states of a filter over one segment: x ← decay·x + noise, drift = unit·Σ x."""

    decay: Float[Array, " slow"]
    variance: Float[Array, " slow"]  # of the noise of one segment
    start: Float[Array, " slow"]  # variances at power-on
    white: Float[Array, "6"]  # densities of accelerometers and gyros, SI


def _six(terms: Sequence[Density | None], dtype: jnp.dtype) -> Float[Array, "6"]:
    """A term of the accelerometers and of the gyros, one value an axis; zero where it is left out."""
    full = [jnp.broadcast_to(jnp.asarray(0.0 if v is None else v, dtype), (3,)) for v in terms]
    return jnp.concatenate(full)


def slow_noise(noise: ImuNoise, duration: Array) -> SlowNoise:
    """The drift states' discrete model for segments of `duration` s."""
    dtype = duration.dtype
    both = lambda term: _six([getattr(t, term) for t in (noise.accel, noise.gyro)], dtype)
    units = jnp.asarray(_UNITS, dtype)
    decay, variance, start = [], [], []
    ratio = noise.flicker_times[1] / noise.flicker_times[0]
    stationary = (both("flicker") / units) ** 2 * (math.log(ratio) / math.pi)
    for time in noise.correlation_times:
        if math.isinf(time):
            decay.append(jnp.ones(6, dtype))
            variance.append((both("walk") / units) ** 2 * duration)
            start.append((both("turn_on") / units) ** 2)
        else:
            left = jnp.exp(-duration / time)
            decay.append(jnp.full(6, left))
            variance.append(stationary * (1.0 - left**2))
            start.append(stationary)
    join = lambda parts: jnp.concatenate([*parts, jnp.zeros(0, dtype)])
    return SlowNoise(join(decay), join(variance), join(start), both("white"))


def drift(slow: Float[AnyArray, " slow"]) -> Float[Array, "6"]:
    """Drift of the accelerometers' (m/s²) and gyros' (rad/s) outputs from the drift states."""
    slow = jnp.asarray(slow)
    return jnp.asarray(_UNITS, slow.dtype) * jnp.sum(slow.reshape(-1, 6), axis=0)


def drift_columns(responses: Float[Array, "rows 6"], count: int) -> Float[Array, "rows slow"]:
    """Response to the drift states, from the response to each channel's drift."""
    one = responses * jnp.asarray(_UNITS, responses.dtype)[None, :]
    return jnp.tile(one, (1, count // 6))
