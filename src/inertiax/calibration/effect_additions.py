"""What fitted effects add to the outputs in one sample."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Float

from .._jax import Array, jnp
from .._typing import AnyArray, Scalar
from ..effects import Moment, Online
from ..physics.temperature import held, Polynomial
from .fitted_effects import FittedEffect, known_effect
from .triad import TriadCalibration


@runtime_checkable
class Calibrated(Protocol):
    """What of a `Calibration` is needed here."""

    @property
    def gravity(self) -> Scalar | float:
        """m/s²."""
        ...

    @property
    def accel(self) -> TriadCalibration | None:
        """The accelerometers."""
        ...

    @property
    def gyro(self) -> TriadCalibration | None:
        """The gyros."""
        ...

    @property
    def effects(self) -> tuple[FittedEffect, ...]:
        """Named effects beside the parameters."""
        ...

    def distort_by_parameters(
        self, force: Array, rate: Array, temperature: Scalar | float
    ) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Equation (1) without the effects."""
        ...


def refuse_memory(effects: Sequence[FittedEffect], call: str) -> None:
    """Raise `ValueError` for an effect that one sample does not determine. Those of the rig do not matter."""
    for fitted in effects:
        effect = known_effect(fitted.name, f"calibration: effect {fitted.name!r}")
        if effect.instant or effect.common:
            continue
        raise ValueError(
            f"`{call}`: the effect '{fitted.name}' on {', '.join(fitted.channel_names)} depends on more than one "
            f"sample; use `ix.Twin`, `diagnose.estimates.applied_effects` for a recording, or leave it out by "
            f"`calibration.without_effects({fitted.name!r})`."
        )


def online_form(fitted: FittedEffect, call: str) -> Online | None:
    """The effect sample by sample; `None` for one of the rig, which is not the device's.

    Raises `ValueError` where it depends on what a sensor's inputs do not tell.
    """
    effect = known_effect(fitted.name, f"calibration: effect {fitted.name!r}")
    if effect.common:
        return None
    if effect.sample_by_sample is None:
        raise ValueError(
            f"`{call}`: the effect '{fitted.name}' on {', '.join(fitted.channel_names)} depends on what force, rate "
            f"and temperature do not tell; leave it out by `calibration.without_effects({fitted.name!r})`."
        )
    return effect.sample_by_sample


def additions(
    calibration: Calibrated, force: Array, rate: Array, temperature: Scalar | float
) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """What the effects without memory add to the accelerometers' (m/s²) and the gyros' outputs (rad/s)."""
    added = {"accel": jnp.zeros_like(force), "gyro": jnp.zeros_like(rate)}
    for fitted in calibration.effects:
        online = online_form(fitted, "calibration")
        if online is None:
            continue
        moment = moment_of(calibration, fitted, force, rate, temperature)
        _, shape = online.follow((), moment, dict(fitted.settings))
        added[fitted.triad] = added[fitted.triad] + on_channels(fitted, shape)
    return added["accel"], added["gyro"]


def moment_of(
    calibration: Calibrated,
    fitted: FittedEffect,
    force: Array,
    rate: Array,
    temperature: Scalar | float,
    **circumstances: Any,
) -> Moment:
    """One sample (m/s², rad/s, °C) as an effect sees it; `circumstances` are fields of `Moment`."""
    real = lambda x: held(x, force.dtype)
    in_g = force / real(calibration.gravity)
    number = 0 if fitted.triad == "accel" else 1
    outputs = lambda t: calibration.distort_by_parameters(force, rate, t)[number]
    default: Mapping[str, Any] = {
        "time": 0.0,
        "step": 1.0,
        "first": jnp.asarray(True),
        "at_rest": jnp.asarray(False),
    }
    degree, low, high = _scale(calibration, fitted)
    coldest, warmest = (low, high) if fitted.temperature is None else fitted.temperature
    start, end = (0.0, 0.0) if fitted.clock is None else fitted.clock
    return Moment(
        triad=fitted.triad,
        input=in_g if fitted.triad == "accel" else rate,
        force=in_g,
        rate=rate,
        temperature=jnp.asarray(temperature, force.dtype),
        at_temperature=outputs,
        axes=_axes(calibration, fitted, temperature),
        degree=degree,
        low=real(low),
        high=real(high),
        coldest=real(coldest),
        warmest=real(warmest),
        greatest_input=real(fitted.greatest_input),
        duration=real(end) - real(start),
        **{**default, **circumstances},
    )


def on_channels(
    fitted: FittedEffect, shape: Float[AnyArray, "channels columns"]
) -> Float[Array, "3"]:
    """Coefficients times shape, on the effect's own channels."""
    columns = jnp.asarray(shape)
    coefficients = jnp.asarray(fitted.coefficients, columns.dtype)
    every = jnp.broadcast_to(columns @ coefficients, (3,))
    mine = jnp.asarray([c in fitted.channels for c in range(3)])
    return jnp.where(mine, every, jnp.zeros_like(every))


def _axes(
    calibration: Calibrated, fitted: FittedEffect, temperature: Scalar | float
) -> Float[Array, "3 3"] | None:
    """E + Γ or E + Θ at that temperature."""
    triad = calibration.accel if fitted.triad == "accel" else calibration.gyro
    if triad is None:
        return None
    matrix = triad.parameters(temperature)[3:12].reshape(3, 3)
    return jnp.eye(3, dtype=matrix.dtype) + matrix


def _scale(
    calibration: Calibrated, fitted: FittedEffect
) -> tuple[int, Scalar | float, Scalar | float]:
    """Degree of the model that the effect was fitted beside, and the temperatures at ±1 of its polynomials."""
    if fitted.degree is not None and fitted.scale is not None:
        return fitted.degree, *fitted.scale
    triad = calibration.accel if fitted.triad == "accel" else calibration.gyro
    if triad is not None and isinstance(triad.curve.basis, Polynomial):
        basis = triad.curve.basis
        return basis.degree, basis.low, basis.high
    return 0, 0.0, 1.0
