"""Temperature dependence where the model has none."""

from jaxtyping import Float

from .._typing import AnyArray
from .effect import by_grade, DEG_PER_HOUR, Effect, MICRO_G, Variant
from .form_units import by_what_it_acts_on
from .signal import Signal
from .temperature_order import of_orders


def shape(signal: Signal, *, terms: int, on: str) -> Float[AnyArray, "time channels columns"]:
    """Terms of degree 1 … terms."""
    return of_orders(signal, range(1, terms + 1), on)


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
        "accel": by_grade((5, 3000), (100, 10000), (500, 100000), unit=MICRO_G),
        "gyro": by_grade((0.005, 1), (5, 200), (20, 4000), unit=DEG_PER_HOUR),
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
