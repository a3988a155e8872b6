"""Size effect: the accelerometers sit apart from the point that the reference is for."""

from collections.abc import Mapping
from typing import Any

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect, gradient
from .moment import Moment, Online
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """ω × (ω × r) + dω/dt × r along each element's axis for the three components of the lever arm r, m/s² per m."""
    w = xp.asarray(signal.rate)
    known = signal.rate_change
    change = gradient(w, signal.time) if known is None else xp.asarray(known)
    return _rows(w, change, signal.axes)


def _rows(
    w: Float[AnyArray, "time 3"],
    change: Float[AnyArray, "time 3"],
    axes: Float[AnyArray, "3 3"] | None,
) -> Float[AnyArray, "time channels columns"]:
    inner = w[:, :, None] * w[:, None, :] - xp.sum(w**2, axis=1)[:, None, None] * xp.eye(3)[None]
    x, y, z = change[:, 0], change[:, 1], change[:, 2]
    o = xp.zeros_like(x)
    cross = xp.stack(
        [xp.stack([o, -z, y], -1), xp.stack([z, o, -x], -1), xp.stack([-y, x, o], -1)], axis=1
    )
    pull = inner + cross
    return pull if axes is None else xp.asarray(axes) @ pull


def _begin(settings: Mapping[str, Any], temperature: AnyArray) -> AnyArray:
    del settings
    return xp.zeros(3, temperature.dtype)


def _follow(
    state: AnyArray, moment: Moment, settings: Mapping[str, Any]
) -> tuple[AnyArray, Float[AnyArray, "channels columns"]]:
    """With the difference to the sample before for dω/dt."""
    del settings
    w = xp.asarray(moment.rate)
    change = xp.where(moment.first, xp.zeros_like(w), (w - state) / moment.step)
    return w, _rows(w[None], change[None], moment.axes)[0]


EFFECT = Effect(
    name="size_effect",
    title="size effect, inner lever arms",
    equation="(E + Gamma) (w x (w x r) + dw/dt x r)",
    units={"accel": "m"},
    prior={"accel": by_grade((0.001, 0.1), (0.001, 0.05), (0.0005, 0.02))},
    shape=shape,
    in_numpy=True,
    needs="accelerometer rows while the table turns",
    driver="rate",
    sentence="The sensing element of {channels} sits a lever arm away from the centre of rotation.",
    separating="several rates of both signs about three axes",
    requires=("rate",),
    online=Online(_begin, _follow),
)
