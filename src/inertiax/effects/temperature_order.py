"""Temperature polynomial of too low a degree: terms above the model's degree."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import chebyshev, DEG_PER_HOUR, Effect, inputs, MICRO_G, Variant
from .form_units import by_what_it_acts_on
from .signal import Signal


ON = {"bias": 0, "scale": 1, "misalignment": 2}


def shape(signal: Signal, *, terms: int, on: str) -> Float[AnyArray, "time channels columns"]:
    """Chebyshev terms of degree d + 1 … d + terms, on the bias, or times the input along or across the axis."""
    order = range(signal.degree + 1, signal.degree + 1 + terms)
    curve = xp.stack(
        [chebyshev(xp.asarray(signal.temperature), k, signal.low, signal.high) for k in order],
        axis=-1,
    )
    if on == "bias":
        return curve[:, None, :]
    scaled = inputs(signal)[:, :, None] * curve[:, None, :]
    if on == "scale":
        return scaled
    return xp.concatenate([xp.roll(scaled, -1, axis=1), xp.roll(scaled, -2, axis=1)], axis=2)


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
        "accel": {
            "navigation": (5 * MICRO_G, 50 * MICRO_G),
            "tactical": (50 * MICRO_G, 500 * MICRO_G),
            "consumer": (200 * MICRO_G, 3000 * MICRO_G),
        },
        "gyro": {
            "navigation": (0.002 * DEG_PER_HOUR, 0.02 * DEG_PER_HOUR),
            "tactical": (1 * DEG_PER_HOUR, 20 * DEG_PER_HOUR),
            "consumer": (5 * DEG_PER_HOUR, 100 * DEG_PER_HOUR),
        },
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
