"""Earth rate left out of the reference."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import any_grade, Effect
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """The room's axes seen by the device, in units of Earth's rate: coefficients are Earth's unit vector."""
    return xp.asarray(signal.room) * 7.292115e-5


EFFECT = Effect(
    name="earth_rate",
    title="Earth rate",
    equation="C^T w_E",
    units={"gyro": "1"},
    prior={"gyro": any_grade(0.3, 1.1)},
    shape=shape,
    in_numpy=True,
    needs="rests in positions that turn the Earth rate in the device",
    driver="attitude",
    sentence="Earth's rate is missing from the reference rates.",
    separating="several headings at the same specific force",
    requires=("room",),
    common=True,
)
