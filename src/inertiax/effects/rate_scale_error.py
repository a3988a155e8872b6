"""Wrong scale of the table's rate, or a wrong clock."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """The rate itself, rad/s."""
    return xp.asarray(signal.input)[:, :, None]


EFFECT = Effect(
    name="rate_scale_error",
    title="rate or clock error (IEEE 1554)",
    equation="eps w",
    units={"gyro": "1"},
    prior={"gyro": by_grade((1e-06, 5e-05), (1e-06, 0.001), (1e-05, 0.02))},
    shape=shape,
    in_numpy=True,
    needs="gyros whose scale factors are known otherwise",
    driver="rate",
    sentence="The table's rate or the clock is wrong by the same part on all axes.",
    separating="compare with a time standard; integer turns",
    common=True,
    seen_in_means=True,
)
