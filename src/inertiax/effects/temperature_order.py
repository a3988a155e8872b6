"""Temperature polynomial of too low a degree: terms above the model's degree."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, chebyshev, DEG_PER_HOUR, Effect, inputs, MICRO_G, Variant
from .form_units import by_what_it_acts_on
from .signal import Signal


def of_orders(signal: Signal, orders: range, on: str) -> Float[AnyArray, "time channels columns"]:
    """Chebyshev terms of these degrees, on the bias, or times the input along or across the axis."""
    curve = xp.stack(
        [chebyshev(xp.asarray(signal.temperature), k, signal.low, signal.high) for k in orders],
        axis=-1,
    )
    if on == "bias":
        return curve[:, None, :]
    scaled = inputs(signal)[:, :, None] * curve[:, None, :]
    if on == "scale":
        return scaled
    return xp.concatenate([xp.roll(scaled, -1, axis=1), xp.roll(scaled, -2, axis=1)], axis=2)


def shape(signal: Signal, *, terms: int, on: str) -> Float[AnyArray, "time channels columns"]:
    """Terms of degree d + 1 … d + terms."""
    return of_orders(signal, range(signal.degree + 1, signal.degree + 1 + terms), on)


def variants(signal: Signal) -> tuple[Variant, ...]:
    """None where the model has no temperature dependence at all: that is another effect."""
    if signal.degree == 0:
        return ()
    forms = [("bias", 1), ("bias", 2), ("bias", 3), ("scale", 1), ("scale", 2), ("misalignment", 1)]
    return tuple(Variant(f"{on}, {n} more", {"terms": n, "on": on}) for on, n in forms)


EFFECT = Effect(
    name="temperature_order",
    title="temperature sensitivity of higher order (IEEE 1293, 952)",
    equation="c_k T_k(x), k > degree; x temperature scaled to [-1, 1]",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": by_grade((5, 50), (50, 500), (200, 3000), unit=MICRO_G),
        "gyro": by_grade((0.002, 0.02), (1, 20), (5, 100), unit=DEG_PER_HOUR),
    },
    shape=shape,
    unit_of_form=by_what_it_acts_on,
    in_numpy=True,
    variants=variants,
    needs="temperatures spread over more levels than the degree",
    driver="temperature",
    sentence="The temperature dependence of {channels} is of a higher degree than the model.",
    separating="more soak temperatures, each reached from both sides; hold out whole temperatures",
    requires=("temperature",),
    instant=True,
    seen_in_means=True,
)
