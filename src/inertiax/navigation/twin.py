"""A digital twin of a device: what it would put out, sample by sample, with memory and noise.

Every step is pure, so that a twin goes through `jit`, `vmap` over devices and `scan` along time; its state holds what
the named effects remember (lag, play, settling, time since power-on), the noise and the delay line.
"""

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .._typing import Scalar, Vec3
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.effect_additions import moment_of, on_channels, online_form
from ..data.plausible_units import check_temperature
from ..physics.leaves import is_traced
from ..physics.shapes import check_key
from ..physics.temperature import Constant, Curve, Polynomial
from .sensor_noise import NoiseState, SensorNoise, triad_noise


STANDARD_GRAVITY = 9.80665  # m/s²
# A device that turns slower is at rest: a hand or a table turns it faster, the Earth a hundred times slower.
REST_RATE = 0.01  # rad/s


SLOWEST = 0.1  # Hz: the means of a log in a chamber, not samples; below it is the step
LONGEST_DELAY = 1.0  # s: filter, bus and stamp of an IMU are a hundred times quicker


class TwinState(eqx.Module):
    """What a twin remembers from sample to sample."""

    count: Int[Array, ""]  # samples so far
    effects: tuple[Any, ...]  # states of effects that remember
    noise: NoiseState  # states of the noise
    line: Float[Array, "samples 6"]  # outputs that are still on their way, the newest first


@runtime_checkable
class PopulationLike(Protocol):
    """What of a `fleet.population.population.Population` is needed: N(μ, Σ) of each triad's coefficients."""

    accel: Any
    gyro: Any


class Twin(eqx.Module):
    """A device that follows a calibration exactly, its named effects included.

    **Arguments:** `noise` is a mapping such as `{"accel": {"N": 1e-3, "B": 2e-4}, "gyro": {"N": 1e-4}}` in SI with the
    coefficients N, B, K, R, Q of IEEE Std 952, `resolution` and `full_scale` (a number or one per axis), and `filter`,
    the low-pass that white noise goes through (see `sensor_noise`), or the three axes' `allan.model.NoiseModel`
    of a triad; `sample_rate` in Hz; `delay` of the outputs in s.

    Raises `ValueError` for an effect that force, rate and temperature do not tell, and for implausible numbers.
    """

    calibration: Calibration  # whose errors it has
    noise: SensorNoise  # of both triads
    sample_rate: float = eqx.field(static=True)  # Hz
    delay: float = eqx.field(static=True)  # s, of the outputs

    def __init__(
        self,
        calibration: Calibration,
        noise: Mapping[str, Any] | SensorNoise | None = None,
        sample_rate: float = 100.0,
        *,
        delay: float = 0.0,
    ):
        if not (np.isfinite(sample_rate) and sample_rate >= SLOWEST):
            raise ValueError(
                f"`Twin(sample_rate=...)`: must be {SLOWEST:g} Hz or more; got {sample_rate} (the step in s?)."
            )
        if not 0.0 <= delay <= LONGEST_DELAY:
            raise ValueError(
                f"`Twin(delay=...)`: must be from 0 to {LONGEST_DELAY:g} s; got {delay} (ms?)."
            )
        for fitted in calibration.effects:
            online_form(fitted, "Twin(calibration)")
        if not isinstance(noise, SensorNoise):
            given = noise or {}
            unknown = sorted(set(given) - {"accel", "gyro"})
            if unknown:
                raise ValueError(
                    f"`Twin(noise=...)`: {unknown[0]!r} is neither 'accel' nor 'gyro'."
                )
            accel, gyro = (triad_noise(t, given.get(t), sample_rate) for t in ("accel", "gyro"))
            noise = SensorNoise(accel, gyro, float(sample_rate))
        self.calibration = calibration
        self.noise = noise
        self.sample_rate = float(sample_rate)
        self.delay = float(delay)

    def __repr__(self) -> str:
        terms = {
            t: [k for k, v in vars(getattr(self.noise, t)).items() if v is not None]
            for t in ("accel", "gyro")
        }
        noise = ", ".join(f"{t} {' '.join(k)}" for t, k in terms.items() if k) or "none"
        return f"Twin({self.calibration!r}, noise: {noise}; {self.sample_rate:g} Hz, delay {self.delay:g} s)"

    @classmethod
    def draw(
        cls,
        key: PRNGKeyArray,
        population: PopulationLike,
        *,
        gravity: float = STANDARD_GRAVITY,
        **options: Any,
    ) -> "Twin":
        """A unit of a fleet: coefficients drawn from its population (`fleet`'s `population.json`).

        `options` are those of `Twin`. `vmap` it over keys for many units. Raises `ValueError` for what is no key.
        """
        check_key("Twin.draw(key, population)", key)
        keys = jax.random.split(key, 2)
        triads = {
            name: _drawn(k, getattr(population, name))
            for k, name in zip(keys, ("accel", "gyro"))
            if getattr(population, name) is not None
        }
        return cls(Calibration(gravity, triads.get("accel"), triads.get("gyro")), **options)

    def init(self, key: PRNGKeyArray, temperature: Scalar | float) -> TwinState:
        """The state at power-on, in equilibrium at a temperature (°C).

        Raises `ValueError` for what is no key, and for several temperatures or one that is no °C.
        """
        check_key("twin.init(key, temperature)", key)
        if jnp.shape(temperature) != ():
            raise ValueError(
                f"`twin.init(key, temperature)`: temperature has shape {jnp.shape(temperature)}; it is one number."
            )
        if not is_traced(temperature):
            check_temperature("twin.init", np.atleast_1d(temperature), np.ones(1, bool))
        start = jnp.asarray(temperature, jnp.result_type(float))
        forms = [online_form(f, "Twin") for f in self.calibration.effects]
        states = tuple(
            () if form is None else form.begin(dict(fitted.settings), start)
            for form, fitted in zip(forms, self.calibration.effects)
        )
        line = jnp.zeros((self._whole_samples + 2 if self.delay else 0, 6))
        return TwinState(jnp.zeros((), jnp.int32), states, self.noise.begin(key), line)

    def step(
        self,
        state: TwinState,
        force: Vec3,
        rate: Vec3,
        temperature: Scalar | float,
        *,
        at_rest: Bool[Array, ""] | bool | None = None,
    ) -> tuple[TwinState, tuple[Float[Array, "3"], Float[Array, "3"]]]:
        """The next state and the outputs (m/s², rad/s) of one sample.

        **Arguments:** specific force (m/s²), absolute rate (rad/s) and the probe's temperature (°C); `at_rest` where
        settling after a move matters (by default the device turns slower than 0.01 rad/s).

        Raises `ValueError` for other shapes.
        """
        for name, vector in (("force", force), ("rate", rate)):
            if jnp.shape(vector) != (3,):
                raise ValueError(
                    f"`twin.step(...)`: {name} has shape {jnp.shape(vector)}, but one sample has (3,); `jax.vmap` it "
                    f"over devices, `jax.lax.scan` over samples."
                )
        kind = jnp.result_type(float)
        force, rate = jnp.asarray(force, kind), jnp.asarray(rate, kind)
        outputs = self.calibration.distort_by_parameters(
            force, rate, jnp.asarray(temperature, kind)
        )
        added = {"accel": jnp.zeros_like(force), "gyro": jnp.zeros_like(rate)}
        resting = jnp.linalg.norm(rate) < REST_RATE if at_rest is None else jnp.asarray(at_rest)
        states = []
        for fitted, memory in zip(self.calibration.effects, state.effects):
            form = online_form(fitted, "Twin")
            if form is None:
                states.append(memory)
                continue
            moment = moment_of(
                self.calibration,
                fitted,
                force,
                rate,
                temperature,
                at_rest=resting,
                **self._clock(state),
            )
            memory, shape = form.follow(memory, moment, dict(fitted.settings))
            states.append(memory)
            added[fitted.triad] = added[fitted.triad] + on_channels(fitted, shape)
        noise, drawn = self.noise.follow(state.noise, state.count)
        whole = jnp.concatenate([outputs[0] + added["accel"], outputs[1] + added["gyro"]]) + drawn
        line, whole = self._delayed(state, whole)
        read = self.noise.read_out(whole)
        return TwinState(state.count + 1, tuple(states), noise, line), (read[:3], read[3:])

    def _clock(self, state: TwinState) -> dict[str, Array]:
        kind = jnp.result_type(float)
        step = jnp.asarray(1.0 / self.sample_rate, kind)
        return {
            "time": state.count.astype(kind) / self.sample_rate,
            "step": step,
            "first": state.count == 0,
        }

    @property
    def _whole_samples(self) -> int:
        return int(np.floor(self.delay * self.sample_rate))

    def _delayed(
        self, state: TwinState, outputs: Float[Array, "6"]
    ) -> tuple[Float[Array, "samples 6"], Float[Array, "6"]]:
        """Outputs of a moment between two samples, by a straight line; the first output until there is one."""
        if not self.delay:
            return state.line, outputs
        line = jnp.concatenate([outputs[None], state.line[:-1]])
        line = jnp.where(state.count == 0, jnp.broadcast_to(outputs, line.shape), line)
        whole = self._whole_samples
        part = self.delay * self.sample_rate - whole
        return line, (1.0 - part) * line[whole] + part * line[whole + 1]


def _drawn(key: PRNGKeyArray, population: Any) -> TriadCalibration:
    """A triad with the coefficients of a unit, which are known, so that their covariance is zero."""
    model = population.model
    basis = Constant() if model.degree == 0 else Polynomial(model.degree, model.low, model.high)
    mean, spread = np.asarray(population.mean), np.asarray(population.prior_covariance)
    scale = np.sqrt(np.diagonal(spread))
    root = np.linalg.cholesky(spread / np.outer(scale, scale)) * scale[:, None]
    normal = jax.random.normal(key, mean.shape)
    drawn = jnp.asarray(mean, normal.dtype) + jnp.asarray(root, normal.dtype) @ normal
    covariance = np.zeros((len(mean), len(mean)))
    names = tuple(model.names)
    return TriadCalibration(
        Curve(basis, drawn.reshape(basis.size, -1)), covariance, names, model.estimator
    )
