"""The result: one pytree, callable on raw outputs.

A `Calibration` goes anywhere a pytree goes: `jax.jit(calibration)`, `jax.vmap(calibration)` over samples,
`jax.jacfwd` with respect to its coefficients, `scan` in a navigation loop, `jax.export`. Serial number and notes are
labels, so that devices of one model share compiled code and stack (`stacking.stack`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from .._jax import Array, eqx, jax, jnp
from .._typing import AnyArray, Scalar, Vec3
from ..data.plausible_units import check_gravity, check_sample, check_temperature
from ..model_selection.model_spec import ModelSpec
from ..physics.error_model import (
    AccelerometerErrors,
    compensate_accel,
    compensate_gyro,
    distort_accel,
    distort_gyro,
    GyroErrors,
)
from ..physics.leaves import as_array, as_leaf, is_traced
from ..physics.shapes import check_covariance, check_given, check_key, check_one
from ..physics.temperature import held
from . import coefficients, drawn, representation
from .barometer import BarometerCalibration
from .coefficients import Block
from .effect_additions import additions, refuse_memory
from .fitted_effects import FittedEffect
from .labels import pair, register_labelled
from .magnetometers import MagnetometerCalibration
from .stacking import repeated
from .triad import MAPPED, refuse_stacked, TriadCalibration


# Each round leaves the effects' slope of the error: an effect of a tenth of the input, which no usable sensor has,
# is taken away to 1e-12.
ROUNDS = 12


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """A device's calibration; calling it compensates one sample.

    `temperature_range` are the temperatures (°C) that the data covered; see `extrapolates`. `effects` are named
    effects beside the parameters. Those that depend on a sample alone take part in `calibration(...)` and `distort`;
    with one that depends on what went before, both raise `ValueError`, and `Twin` and
    `diagnose.estimates.applied_effects` serve. `cross_covariance` is that of the accelerometers' coefficients
    with the gyros', where both were estimated together. `mag(outputs, temperature, current)` compensates the
    magnetometers; `baro(pressure, temperature)` a barometer; their coefficients are no part of `coefficients` and
    `covariance`, which are of accelerometers and gyros.

    Raises `ValueError` for a gravity that is none in m/s², temperatures that are no °C or not in order, a triad in
    the other's place, or a `cross_covariance` of another shape.
    """

    gravity: Scalar | float  # m/s²
    accel: TriadCalibration | None = None  # None: not calibrated
    gyro: TriadCalibration | None = None  # None: not calibrated
    device: str = ""  # serial number
    temperature_range: tuple[float, float] | None = None  # °C
    notes: tuple[str, ...] = ()  # what a user should know
    effects: tuple[FittedEffect, ...] = ()  # named effects beside the parameters
    # SI; None: estimated apart.
    cross_covariance: Float[AnyArray, "*batch accel_coefficients gyro_coefficients"] | None = None
    model: ModelSpec | None = None  # as it was fitted
    mag: MagnetometerCalibration | None = None  # None: not calibrated
    baro: BarometerCalibration | None = None  # over temperature; None: not calibrated

    def __post_init__(self):
        object.__setattr__(self, "gravity", as_leaf(self.gravity))
        object.__setattr__(self, "temperature_range", pair(self.temperature_range))
        for name in ("accel", "gyro"):
            triad = getattr(self, name)
            wrong = [] if triad is None else [n for n in triad.names if not n.startswith(name)]
            if wrong:
                raise ValueError(f"`Calibration({name}=...)`: {wrong[0]!r} is not one of {name}.")
        check_gravity("Calibration", self.gravity)
        self._check_range()
        self._check_cross_covariance()

    def _check_range(self) -> None:
        ends = self.temperature_range
        if ends is None or any(is_traced(t) for t in ends):
            return
        if not ends[0] <= ends[1]:
            raise ValueError(
                f"`Calibration(temperature_range=...)`: from {ends[0]:g} to {ends[1]:g}; the lower comes first."
            )
        check_temperature("Calibration", np.array(ends), np.ones(2, bool), name="temperature_range")

    def _check_cross_covariance(self) -> None:
        if self.cross_covariance is None:
            return
        sizes = tuple(
            0 if t is None else int(jnp.shape(t.covariance)[-1]) for t in (self.accel, self.gyro)
        )
        if jnp.shape(self.cross_covariance)[-2:] != sizes:
            raise ValueError(
                f"`Calibration(cross_covariance=...)`: shape {jnp.shape(self.cross_covariance)}, but the triads have "
                f"{sizes[0]} and {sizes[1]} coefficients."
            )

    def accel_errors(self, temperature: Scalar | float) -> AccelerometerErrors:
        """Accelerometer parameters at one temperature, °C; an ideal triad where not calibrated."""
        if self.accel is None:
            return AccelerometerErrors.zero()
        p = self.accel.parameters(temperature)
        return AccelerometerErrors(p[:3], p[3:12].reshape(3, 3))

    def gyro_errors(self, temperature: Scalar | float) -> GyroErrors:
        """Gyro parameters at one temperature, °C; an ideal triad where not calibrated."""
        if self.gyro is None:
            return GyroErrors.zero()
        p = self.gyro.parameters(temperature)
        return GyroErrors(p[:3], p[3:12].reshape(3, 3), p[12:].reshape(3, 3))

    def __call__(
        self, accel: Vec3, gyro: Vec3, temperature: Scalar | float | None = None
    ) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Equation (3), exact: specific force (m/s²) and rate (rad/s) of one sample of raw outputs.

        `vmap` it over samples. For a device with one triad pass zeros for the other. The temperature (°C) may be left
        out, or be NaN, where all parameters are constants.

        Raises `ValueError` for other shapes and implausible units, for stacked devices, where a named effect
        depends on more than the sample, and for parameters over temperature without one.
        """
        refuse_stacked(self.triads, "calibration(accel, gyro, temperature)", MAPPED)
        temperature = self._checked("calibration", temperature, accel=accel, gyro=gyro)
        accel, gyro = jnp.asarray(accel), jnp.asarray(gyro)
        refuse_memory(self.effects, "calibration(accel, gyro, temperature)")
        force, rate = self._by_parameters(accel, gyro, temperature)
        if not self.effects:
            return force, rate

        def better(_: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
            added = additions(self, *now, temperature)
            return self._by_parameters(accel - added[0], gyro - added[1], temperature)

        return jax.lax.fori_loop(0, ROUNDS, better, (force, rate))

    def _by_parameters(
        self, accel: Array, gyro: Array, temperature: Scalar | float
    ) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        force = compensate_accel(self.accel_errors(temperature), accel)
        rate = compensate_gyro(self.gyro_errors(temperature), gyro, force, held(self.gravity))
        return force, rate

    def distort(
        self, force: Vec3, rate: Vec3, temperature: Scalar | float | None = None
    ) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Equation (1): outputs (m/s², rad/s) for one sample of specific force and absolute rate.

        The other way of `calibration(...)`, with the same errors raised.
        """
        refuse_stacked(self.triads, "calibration.distort(force, rate, temperature)", MAPPED)
        temperature = self._checked("calibration.distort", temperature, force=force, rate=rate)
        force, rate = jnp.asarray(force), jnp.asarray(rate)
        refuse_memory(self.effects, "calibration.distort(force, rate, temperature)")
        accel, gyro = self.distort_by_parameters(force, rate, temperature)
        if not self.effects:
            return accel, gyro
        added = additions(self, force, rate, temperature)
        return accel + added[0], gyro + added[1]

    def distort_by_parameters(
        self, force: Vec3, rate: Vec3, temperature: Scalar | float
    ) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Equation (1) without the named effects."""
        accel = distort_accel(self.accel_errors(temperature), force)
        gravity = held(self.gravity)
        return accel, distort_gyro(self.gyro_errors(temperature), rate, force, gravity)

    def _checked(
        self, call: str, temperature: Scalar | float | None, **vectors: Vec3
    ) -> Scalar | float:
        """The temperature, NaN where constant parameters do without; raises `ValueError` for what is no sample."""
        call = f"{call}({', '.join(vectors)}, temperature)"
        looks = bool(self.effects) or any(t.curve.basis.size > 1 for t in self.triads)
        if temperature is None and not looks:
            temperature = np.nan
        check_given(call, **vectors, temperature=temperature)
        check_one(call, **vectors)
        assert temperature is not None  # or `check_given` would have said so
        force, rate = vectors.items()
        check_sample(call, temperature if looks else np.nan, force=force, rate=rate)
        return temperature

    def extrapolates(self, temperature: Scalar | float) -> Bool[Array, ""]:
        """Whether a temperature (°C) is outside what the calibration data covered, or no number."""
        if self.temperature_range is None:
            return jnp.asarray(False)
        low, high = self.temperature_range
        t = jnp.asarray(temperature)
        return ~((t >= jnp.asarray(low, t.dtype)) & (t <= jnp.asarray(high, t.dtype)))

    # The coefficients --------------------------------------------------------------------------------

    @property
    def triads(self) -> tuple[TriadCalibration, ...]:
        """Those that are calibrated, the accelerometers first."""
        return tuple(t for t in (self.accel, self.gyro) if t is not None)

    @property
    def coefficients(self) -> Float[AnyArray, "*batch coefficients"]:
        """All curves' coefficients in one vector, in the order of `coefficient_names`."""
        return coefficients.values(self.triads)

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Such as `accel.bias[0]`, or `accel.bias[0].c2` of the third basis function over temperature."""
        return coefficients.names(self.triads)

    @property
    def coefficient_units(self) -> tuple[str, ...]:
        """SI unit of each coefficient."""
        return coefficients.units(self.triads)

    @property
    def covariance(self) -> Float[AnyArray, "*batch coefficients coefficients"]:
        """Of all coefficients, SI; zero between the triads where they were estimated apart."""
        return coefficients.covariance(self.triads, self.cross_covariance)

    def block(self, pattern: str | Sequence[str]) -> Block:
        """The coefficients that a pattern names: `"accel.bias"`, `"*.bias"`, `"gyro.matrix[1,0]"`, `"accel.scale"`,
        `"*.misalignment"`, `"*.bias.c0"`, or several of them.

        Raises `ValueError`, with the families that there are, where it names none.
        """
        rows = coefficients.matching(self.triads, pattern)
        names, units = self.coefficient_names, self.coefficient_units
        return Block(
            rows,
            tuple(names[k] for k in rows),
            tuple(units[k] for k in rows),
            self.coefficients[..., list(rows)],
            self.covariance[..., list(rows), :][..., :, list(rows)],
        )

    def with_values(
        self, block: Block | str | Sequence[str], values: Float[AnyArray, "*batch coefficients"]
    ) -> "Calibration":
        """The calibration with a block's coefficients replaced (SI); the covariance stays.

        Leading axes of `values` become leading axes of every leaf, to `vmap` over. Raises `ValueError` for
        another number of values than the block has.
        """
        rows = block.rows if isinstance(block, Block) else coefficients.matching(self.triads, block)
        lead = jnp.shape(values)[:-1]
        before = jnp.shape(self.coefficients)[:-1]
        whole = self if len(lead) <= len(before) else repeated(self, lead)
        return whole._with(coefficients.replaced(self.triads, rows, values))

    def with_covariance(
        self, covariance: Float[AnyArray, "*batch coefficients coefficients"]
    ) -> "Calibration":
        """The calibration with another joint covariance of all coefficients, as a filter or a refinement finds it.

        Raises `ValueError` for another shape, and for numbers that are no covariance.
        """
        size = len(self.coefficient_names)
        if jnp.shape(covariance)[-2:] != (size, size):
            raise ValueError(
                f"`calibration.with_covariance(covariance)`: shape {jnp.shape(covariance)}, but the calibration has "
                f"{size} coefficients."
            )
        check_covariance("calibration.with_covariance(covariance)", covariance)
        if len(self.triads) == 1:
            return self._with(None, (covariance,))
        first = len(coefficients.names(self.triads[:1]))
        own = covariance[..., :first, :first], covariance[..., first:, first:]
        return self._with(None, own).changed(cross_covariance=covariance[..., :first, first:])

    def _with(
        self, values: tuple[AnyArray, ...] | None, spreads: tuple[AnyArray, ...] | None = None
    ) -> "Calibration":
        made = {}
        for k, name in enumerate(n for n in ("accel", "gyro") if getattr(self, n) is not None):
            triad = getattr(self, name)
            if values is not None:
                triad = eqx.tree_at(lambda t: t.curve.coefficients, triad, values[k])
            if spreads is not None:
                triad = eqx.tree_at(lambda t: t.covariance, triad, spreads[k])
            made[name] = triad
        return self.changed(**made)

    def samples(self, key: Array, n: int) -> Float[Array, "n coefficients"]:
        """Draws of all coefficients from their Gaussian; `with_values("*", samples)` are as many calibrations.

        Raises `ValueError` for what is no key, a number of draws below one, and stacked devices.
        """
        call = "calibration.samples(key, n)"
        refuse_stacked(self.triads, call, MAPPED)
        check_key(call, key)
        if not isinstance(n, int | np.integer) or n < 1:
            raise ValueError(f"`{call}`: n is {n!r}; it must be 1 or more.")
        return coefficients.draws(key, self.coefficients, self.covariance, int(n))

    def log_density(self, values: Float[AnyArray, " coefficients"]) -> Float[Array, ""]:
        """Logarithm of that Gaussian's density at a vector of all coefficients; for blackjax or numpyro.

        Where coefficients are held, as after `conditioned`, it is that of the others, and −∞ off the held values.
        Raises `ValueError` for another number of values and for stacked devices.
        """
        refuse_stacked(self.triads, "calibration.log_density(values)", MAPPED)
        return coefficients.log_density(values, self.coefficients, self.covariance)

    def conditioned(
        self,
        block: Block | str | Sequence[str],
        values: Float[AnyArray, "*batch coefficients"] | float = 0.0,
    ) -> "Calibration":
        """The calibration where a block's coefficients are known to be `values` (SI): the conditional Gaussian,

            c ← c + C_cb C_bb⁻¹ (v − b),    C ← C_cc − C_cb C_bb⁻¹ C_bc

        of the others c given b = v. Where the model is linear in its coefficients that is the fit without the block's;
        elsewhere it is so to first order in their change. `calibration.conditioned("*.matrix.c1")` leaves biases linear
        in temperature and makes scale factors and misalignments constant. What it adds to χ², (v − b)ᵀ C_bb⁻¹ (v − b),
        has as many degrees of freedom as the block has coefficients, where v is right.

        Works on stacked devices. Raises `ValueError` for a block that names nothing, or values of another shape.
        """
        rows = block.rows if isinstance(block, Block) else coefficients.matching(self.triads, block)
        shape = jnp.shape(values)
        if shape and shape[-1] != len(rows):
            raise ValueError(
                f"`calibration.conditioned(block, values)`: values have shape {shape}, but the block has {len(rows)} "
                f"coefficients."
            )
        given = as_array(values) if shape else np.full(len(rows), values)
        mean, spread = coefficients.conditional(self.coefficients, self.covariance, rows, given)
        return self.with_values("*", mean).with_covariance(spread)

    # For people --------------------------------------------------------------------------------------

    def __repr__(self) -> str:
        return representation.line(self)

    def summary(self) -> str:
        """The parameters in customary units at the middle of the temperature range, with 1 sigma, as text."""
        return representation.summary(self)

    def _repr_html_(self) -> str:
        return representation.html(self)

    def to_frame(
        self, temperatures: Sequence[float] | Float[np.ndarray, " n"] | None = None
    ) -> pl.DataFrame:
        """Columns temperature (°C, the middle of the range where none is given), name, value, sigma, unit (SI)."""
        return representation.frame(self, temperatures)

    def plot(self) -> Any:
        """A matplotlib `Figure` with a panel for each triad and family of parameters: values or curves over temperature
        with 95 % intervals, 5 % beyond the range shaded. Raises `ValueError` for stacked devices, in traced code, and
        where no triad is calibrated.
        """
        representation.single(self, "plot")
        return drawn.figure(self)

    # Copies ------------------------------------------------------------------------------------------

    def without_effects(self, *names: str) -> "Calibration":
        """The calibration without the named effects, or without any where no name is given.

        Raises `ValueError` for an effect that it does not have.
        """
        own = [e.name for e in self.effects]
        unknown = [n for n in names if n not in own]
        if unknown:
            raise ValueError(
                f"`calibration.without_effects({unknown[0]!r})`: it has {own or 'no effects'}."
            )
        kept = tuple(e for e in self.effects if names and e.name not in names)
        return self.changed(effects=kept)

    def changed(self, **new: Any) -> "Calibration":
        """A copy with other values, not checked, of some fields. Raises `ValueError` for a name that is no field's."""
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        for name in sorted(new.keys() - own.keys()):
            raise ValueError(f"`calibration.changed({name}=...)`: it has {', '.join(own)}.")
        made = object.__new__(Calibration)
        for name, value in (own | new).items():
            object.__setattr__(made, name, value)
        return made


register_labelled(
    Calibration,
    leaves=("gravity", "accel", "gyro", "temperature_range", "effects", "cross_covariance", "mag", "baro"),
    structure=(),
    labels={"device": "", "notes": (), "model": None},
)  # fmt: skip
