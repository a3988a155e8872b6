"""Noise of six channels, sample by sample: the terms of IEEE Std 952 and the read-out.

    white    N √f                                each sample
    flicker  Σ Gauss-Markov, variance B² ln r/π  time constants a factor r apart
    walk     K / √f                              each step
    ramp     R t
    Q        (θ_k − θ_{k−1}) f                   θ white with standard deviation Q

The white noise goes through the sensor's low-pass filter, if there is one: y_k = (1 + Σ a) u_k − Σ a_j y_{k−j}. Flicker
and walk, which are slow, pass it as they are.

Sums of Gauss-Markov processes have the spectrum s²/(2 f ln r) where their time constants lie, which is flicker noise's
B²/(2π f) for s² = B² ln r/π. One normal number a sample makes their sum (`one_innovation`).

**Reference:** IEEE Std 952-2020, annex C; Keshner, *1/f noise*, Proc. IEEE 70 (1982).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from .._typing import AnyArray
from ..data.plausible_units import farthest_outside, GREATEST_NOISE, PEAK_FORCE, PEAK_RATE
from ..physics.leaves import is_traced
from .counted_normals import normals
from .one_innovation import one_innovation, OneInnovation


RATIO = 6.0  # between time constants: the Allan variance is flat to 2 % (tested)
SAME_RATE = 0.01  # relative: a filter's coefficients hold at one sample rate
LEAST_RANGE = 9.7  # m/s²: an accelerometer that saturates below gravity reads none of its poses
SHORTEST, LONGEST = 1.0, 1e5  # of the time constants, in samples and in s


class TriadNoise(eqx.Module):
    """One triad's noise and read-out in SI, each a number or one per axis but the filter; `None`: none of it."""

    N: Any = None  # m/s²/√Hz or rad/s/√Hz
    B: Any = None  # m/s² or rad/s
    K: Any = None  # m/s²/√s or rad/s/√s
    R: Any = None  # m/s³ or rad/s²
    Q: Any = None  # m/s or rad
    filter: Any = None  # a₁, a₂, … at the sample rate, (order,) or (3, order)
    resolution: Any = None  # least step of the output
    full_scale: Any = None  # greatest output


def triad_noise(triad: str, given: Any, sample_rate: float) -> TriadNoise:
    """`TriadNoise` of a mapping, of three channels' `allan.model.NoiseModel`, or as it is.

    Of models, terms that their logs do not determine are zero, filters count at the rate of their logs alone, and the
    read-out's steps count where all three axes have them.
    Raises `ValueError` for names that are none, sizes that are implausible in SI, or a filter that is not stable.
    """
    if given is None or isinstance(given, TriadNoise):
        made = given or TriadNoise()
    elif isinstance(given, Mapping):
        unknown = sorted(set(given) - set(TriadNoise.__dataclass_fields__))
        if unknown:
            names = ", ".join(TriadNoise.__dataclass_fields__)
            raise ValueError(
                f"`Twin(noise=...)`: {triad} has no {unknown[0]!r}; there are {names}."
            )
        made = TriadNoise(**{k: _axes(triad, k, v) for k, v in given.items()})
    else:
        models = list(given)
        if len(models) != 3 or any(m.triad != triad for m in models):
            raise ValueError(
                f"`Twin(noise=...)`: {triad} needs the noise models of its three axes."
            )
        terms = {k: np.array([m.terms[k].known for m in models]) for k in "NBKRQ"}
        steps = np.array([m.rounding for m in models])
        made = TriadNoise(
            **terms,
            filter=_filters(models, sample_rate),
            resolution=steps if np.all(steps > 0.0) else None,
        )
    if made.filter is not None and not is_traced(made.filter):
        _check_stable(triad, np.asarray(made.filter, float))
    for name in "NBKRQ":
        value = getattr(made, name)
        if value is None or is_traced(value):
            continue
        greatest = GREATEST_NOISE[triad]
        if not (np.all(np.asarray(value) >= 0.0) and np.all(np.asarray(value) <= greatest)):
            raise ValueError(
                f"`Twin(noise=...)`: {triad} {name} is {farthest_outside(value, 0.0, greatest):g}; it is in SI, from 0 "
                f"to {greatest:g} (another unit?)."
            )
    for name in ("resolution", "full_scale"):
        value = getattr(made, name)
        if value is None or is_traced(value):
            continue
        if not np.all(np.asarray(value) > 0.0):
            raise ValueError(
                f"`Twin(noise=...)`: {triad} {name} is {np.min(np.asarray(value)):g}; it must be above 0."
            )
    _check_range(triad, made.full_scale)
    return made


def _check_range(triad: str, full_scale: Any) -> None:
    """Raise `ValueError` for a range that does not hold what the triad reads at rest, or that no such sensor has."""
    if full_scale is None or is_traced(full_scale):
        return
    greatest = float(np.max(np.asarray(full_scale)))
    least, most = (LEAST_RANGE, PEAK_FORCE) if triad == "accel" else (0.0, PEAK_RATE)
    if least <= greatest <= most:
        return
    unit, guess = ("m/s²", "in g?" if greatest < least else "mm/s²?")
    if triad == "gyro":
        unit, guess = "rad/s", "deg/s?"
    raise ValueError(
        f"`Twin(noise=...)`: {triad} full_scale is {greatest:g}; it is in {unit}, from {least:g} to {most:g} ({guess})."
    )


def _filters(models: Sequence[Any], sample_rate: float) -> Float[np.ndarray, "3 order"] | None:
    """The filters of three models; `None` where there are none or the rate is another."""
    order = max(len(m.recursion) for m in models)
    if not order or any(abs(m.rate / sample_rate - 1.0) > SAME_RATE for m in models):
        return None
    return np.array([(*m.recursion, *np.zeros(order - len(m.recursion))) for m in models])


def _check_stable(triad: str, recursion: Float[np.ndarray, "..."]) -> None:
    for row in np.atleast_2d(recursion):
        if not np.all(np.abs(np.roots([1.0, *row])) < 1.0):
            raise ValueError(
                f"`Twin(noise=...)`: {triad} filter {row.tolist()} is not stable: 1 + a1 / z + a2 / z^2 + ... has a "
                f"root outside the unit circle."
            )


def _axes(triad: str, name: str, value: Any) -> AnyArray:
    array = value if isinstance(value, jax.Array) else np.asarray(value, float)
    filter_ = name == "filter" and array.ndim in (1, 2) and array.shape[:-1] in ((), (3,))
    if not filter_ and (name == "filter" or array.shape not in ((), (3,))):
        right = "(order,) or (3, order)" if name == "filter" else "() or (3,)"
        raise ValueError(
            f"`Twin(noise=...)`: {triad} {name} has shape {array.shape}; it is {right}."
        )
    return array


class NoiseState(eqx.Module):
    """What the noise remembers; the six channels are the accelerometers' and the gyros'."""

    key: PRNGKeyArray
    walk: Float[Array, "6"]
    # Of the flicker's processes, variance 1, one after the other: in one row many devices' are computed quicker.
    markov: Float[Array, " rows"]
    last: Float[Array, "6"]  # θ of the sample before
    white: Float[Array, "order 6"]  # behind the sensor's filter, the newest first
    # Normal numbers of the next sample, a vector for each term. Kept from step to step they are made once, where a
    # compiler would make them anew for each of the processes that read them.
    drawn: tuple[Float[Array, "6"], ...]


class SensorNoise(eqx.Module):
    """The noise of both triads at a sample rate."""

    accel: TriadNoise
    gyro: TriadNoise
    sample_rate: float = eqx.field(static=True)

    def term(self, name: str) -> Float[Array, "6"] | None:
        """One coefficient of all channels; `None` where no channel has it."""
        pair = [getattr(t, name) for t in (self.accel, self.gyro)]
        if all(x is None for x in pair):
            return None
        full = lambda x: jnp.broadcast_to(jnp.zeros(()) if x is None else jnp.asarray(x), (3,))
        return jnp.concatenate([full(x) for x in pair])

    @property
    def recursion(self) -> Float[Array, "order 6"]:
        """Coefficients a of the channels' filters; of order 0 where there is none."""
        pair = [np.zeros(0) if t.filter is None else t.filter for t in (self.accel, self.gyro)]
        order = max(jnp.shape(x)[-1] for x in pair)
        padded = [
            jnp.pad(
                jnp.broadcast_to(x, (3, jnp.shape(x)[-1])), ((0, 0), (0, order - jnp.shape(x)[-1]))
            )
            for x in pair
        ]
        return jnp.concatenate(padded).T

    @property
    def time_constants(self) -> np.ndarray:
        """Of the Gauss-Markov processes, s."""
        first = SHORTEST / self.sample_rate
        count = int(np.ceil(np.log(LONGEST / first) / np.log(RATIO))) + 1
        return first * RATIO ** np.arange(count)

    def begin(self, key: PRNGKeyArray) -> NoiseState:
        """Flicker in equilibrium, the walk and the filter at zero."""
        key, first, second = jax.random.split(key, 3)
        zero, kind = jnp.zeros((), jnp.int32), jnp.result_type(float)
        markov = jnp.zeros(0)
        if self.term("B") is not None:
            start = self._flicker.start.astype(kind)
            drawn = normals(first, zero, len(start), 6)
            rows = [sum(c * d.astype(kind) for c, d in zip(row, drawn)) for row in start]
            markov = jnp.concatenate(rows)
        last = normals(second, zero, 1, 6)[0].astype(kind)
        white = jnp.zeros(self.recursion.shape)
        drawn = self._draw(key, zero)
        return NoiseState(key, jnp.zeros(6), markov, last * _or_zero(self.term("Q")), white, drawn)

    def _draw(self, key: PRNGKeyArray, count: Int[Array, ""]) -> tuple[Float[Array, "6"], ...]:
        """Normal numbers of a sample: a vector for each of N, K, Q and B that there is."""
        kind = jnp.result_type(float)
        return tuple(d.astype(kind) for d in normals(key, count, len(self._drawn_terms), 6))

    @property
    def _drawn_terms(self) -> list[str]:
        return [n for n in "NKQB" if self.term(n) is not None]

    @property
    def _flicker(self) -> OneInnovation:
        return one_innovation(1.0 / (self.sample_rate * self.time_constants))

    def follow(
        self, state: NoiseState, count: Int[Array, ""]
    ) -> tuple[NoiseState, Float[Array, "6"]]:
        """The next state and the noise of sample `count` (from 0)."""
        total = jnp.zeros(6)
        ramp = self.term("R")
        if ramp is not None:
            total = total + ramp * (count.astype(total.dtype) / self.sample_rate)
        if not state.drawn:
            return state, total
        own = dict(zip(self._drawn_terms, state.drawn))
        rate, walk, last, markov = self.sample_rate, state.walk, state.last, state.markov
        white = state.white
        if "N" in own:
            fresh = own["N"] * _or_zero(self.term("N")) * np.sqrt(rate)
            if len(white):
                recursion = self.recursion.astype(fresh.dtype)
                fresh = (1.0 + recursion.sum(axis=0)) * fresh - (recursion * white).sum(axis=0)
                white = jnp.concatenate([fresh[None], white[:-1]])
            total = total + fresh
        if "K" in own:
            walk = walk + own["K"] * _or_zero(self.term("K")) / np.sqrt(rate)
            total = total + walk
        if "Q" in own:
            angle = own["Q"] * _or_zero(self.term("Q"))
            total, last = total + (angle - last) * rate, angle
        if "B" in own:
            decay, drive = (np.repeat(v.astype(total.dtype), 6) for v in self._flicker[:2])
            # The change is added last: 32 bits do not hold the 1 − 10⁻⁷ that the slowest process keeps of itself.
            markov = markov + (drive * jnp.tile(own["B"], len(drive) // 6) - decay * markov)
            size = _or_zero(self.term("B")) * np.sqrt(np.log(RATIO) / np.pi)
            # One by one, as a compiler adds along an axis of many devices several times slower.
            total = total + size * sum(markov[k : k + 6] for k in range(0, len(markov), 6))
        drawn = self._draw(state.key, count + 1)
        return NoiseState(state.key, walk, markov, last, white, drawn), total

    def read_out(self, outputs: Float[Array, "6"]) -> Float[Array, "6"]:
        """The outputs within the range and on the grid of the read-out."""
        parts = []
        for own, triad in ((outputs[:3], self.accel), (outputs[3:], self.gyro)):
            if triad.full_scale is not None:
                limit = jnp.asarray(triad.full_scale, own.dtype)
                own = jnp.clip(own, -limit, limit)
            if triad.resolution is not None:
                step = jnp.asarray(triad.resolution, own.dtype)
                own = step * jnp.round(own / step)
            parts.append(own)
        return jnp.concatenate(parts)


def _or_zero(values: Float[Array, "6"] | None) -> Float[Array, "6"]:
    return jnp.zeros(6) if values is None else values
