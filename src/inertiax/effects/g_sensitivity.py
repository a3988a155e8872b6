"""Sensitivity of a gyro to specific force: matrix D."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, DEG_PER_HOUR, Effect, Variant
from .over_temperature import forms_over_temperature, over_temperature
from .signal import Signal


@over_temperature
def shape(signal: Signal, *, axes: str) -> Float[AnyArray, "time channels columns"]:
    """Specific force along the device's axes, g."""
    f = xp.asarray(signal.force)
    return xp.stack([f[:, "xyz".index(k)] for k in axes], axis=-1)[:, None, :]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """All three axes, each alone, and all three with coefficients over temperature where the model has them."""
    forms = (("row", "xyz"), ("x", "x"), ("y", "y"), ("z", "z"))
    constant = tuple(Variant(label, {"axes": axes}) for label, axes in forms)
    return (*constant, *forms_over_temperature(signal, "row", {"axes": "xyz"}))


EFFECT = Effect(
    name="g_sensitivity",
    title="g-sensitivity, mass unbalance (IEEE 517, 1431)",
    equation="D f",
    units={"gyro": "rad/s/g"},
    prior={"gyro": by_grade((0.001, 10), (0.5, 30), (10, 1000), unit=DEG_PER_HOUR)},
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="rests in positions that differ in specific force",
    driver="specific_force",
    sentence="The output of {channels} depends on specific force (matrix D).",
    separating="turn the heading in the same position: specific force stays, Earth rate and magnetic field turn",
    requires=("force",),
    instant=True,
    seen_in_means=True,
)
