"""Temperature dependence where the model has none."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import chebyshev, DEG_PER_HOUR, Effect, inputs, MICRO_G, Variant
from .form_units import by_what_it_acts_on
from .signal import Signal


def shape(signal: Signal, *, terms: int, on: str) -> Float[AnyArray, "time channels columns"]:
    """Chebyshev terms of degree 1 … terms, on the bias, or times the input along or across the axis."""
    curve = xp.stack(
        [
            chebyshev(xp.asarray(signal.temperature), k, signal.low, signal.high)
            for k in range(1, terms + 1)
        ],
        axis=-1,
    )
    if on == "bias":
        return curve[:, None, :]
    scaled = inputs(signal)[:, :, None] * curve[:, None, :]
    if on == "scale":
        return scaled
    return xp.concatenate([xp.roll(scaled, -1, axis=1), xp.roll(scaled, -2, axis=1)], axis=2)


def variants(signal: Signal) -> tuple[Variant, ...]:
    """None where the model already has a temperature dependence."""
    if signal.degree > 0:
        return ()
    forms = [("bias", 1), ("bias", 2), ("bias", 3), ("scale", 1), ("misalignment", 1)]
    return tuple(Variant(f"{on}, degree {n}", {"terms": n, "on": on}) for on, n in forms)


EFFECT = Effect(
    name="temperature_dependence",
    title="temperature sensitivity (IEEE 1293, 952)",
    equation="c_k T_k(x), k >= 1; x temperature scaled to [-1, 1]",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": {
            "navigation": (5 * MICRO_G, 3000 * MICRO_G),
            "tactical": (100 * MICRO_G, 10000 * MICRO_G),
            "consumer": (500 * MICRO_G, 100000 * MICRO_G),
        },
        "gyro": {
            "navigation": (0.005 * DEG_PER_HOUR, 1 * DEG_PER_HOUR),
            "tactical": (5 * DEG_PER_HOUR, 200 * DEG_PER_HOUR),
            "consumer": (20 * DEG_PER_HOUR, 4000 * DEG_PER_HOUR),
        },
    },
    shape=shape,
    unit_of_form=by_what_it_acts_on,
    in_numpy=True,
    variants=variants,
    needs="the temperature changes while the model is constant",
    driver="temperature",
    sentence="The parameters of {channels} change with temperature; the model is constant.",
    separating="return to the first temperature; the same programme at another constant temperature",
    requires=("temperature",),
    instant=True,
    seen_in_means=True,
)
