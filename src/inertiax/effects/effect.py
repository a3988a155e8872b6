"""What a physical effect is: metadata and one function of a signal."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from .._jax import eqx, jax, jnp
from .._typing import AnyArray, Scalar
from ..physics.wgs84 import EARTH_RATE
from . import arrays as xp
from .form_units import UnitOfForm
from .moment import Online, without_memory
from .signal import Signal


MICRO_G = 9.80665e-6  # m/s²
DEG_PER_HOUR = 4.84813681e-6  # rad/s
PPM = 1e-6
# rad/s: a gyro whose rows turn with Earth alone; an effect of rates that shows there has coefficients of percents, and
# what else differs between attitudes would be told as one (factor by convention).
BEYOND_EARTH = 3.0 * EARTH_RATE


@dataclass(frozen=True)
class Variant:
    """One form of an effect: fixed values of what enters non-linearly, and of which columns it has."""

    label: str
    settings: Mapping[str, float | int | str]


def one_form(_: Signal) -> tuple[Variant, ...]:
    """An effect of one form, without settings."""
    return (Variant("", {}),)


Sizes = Mapping[str, tuple[float | int, float | int]]  # smallest and largest by grade


class Effect(eqx.Module):
    """A physical effect on one triad's outputs.

    `shape(signal, **variant.settings)` gives what the effect adds to the outputs for unit coefficients, shape
    `(time, 3, columns)`, or `(time, 1, columns)` where it is the same on every channel. Coefficients are per
    channel, unless the effect is `common` (of the rig or the reference): then one set serves all channels. An
    effect of the `package` may act on all channels with one set and, if `singly`, on one alone.
    The sum over columns of coefficient × shape vanishes at coefficients zero, and its Jacobian there is the
    signature that a diagnosis looks for.
    """

    name: str = eqx.field(static=True)
    title: str = eqx.field(static=True)  # the standards' term
    equation: str = eqx.field(static=True)
    # Of a coefficient by triad, in the form that acts on the bias where there are several: see `unit`.
    units: Mapping[str, str] = eqx.field(static=True)
    # By triad and grade: smallest and largest usual coefficient, SI.
    prior: Mapping[str, Sizes] = eqx.field(static=True)
    shape: Callable[..., Float[AnyArray, "time channels columns"]] = eqx.field(static=True)
    needs: str = eqx.field(static=True)  # the excitation, in words
    driver: str = eqx.field(static=True)  # the quantity that drives it
    sentence: str = eqx.field(static=True)  # template with {channels}
    separating: str = eqx.field(static=True)  # the experiment that tells it from its rivals
    variants: Callable[[Signal], tuple[Variant, ...]] = eqx.field(static=True, default=one_form)
    requires: tuple[str, ...] = eqx.field(static=True, default=())  # fields of the signal
    common: bool = eqx.field(static=True, default=False)
    package: bool = eqx.field(static=True, default=False)  # all channels may have it in one form
    singly: bool = eqx.field(static=True, default=True)  # one channel alone may have it
    slow: bool = eqx.field(static=True, default=False)  # may be evaluated at block means
    nuisance: str = eqx.field(static=True, default="")  # the setting to refine and report, if any
    nuisance_unit: str = eqx.field(static=True, default="s")
    unit_amplitude: bool = eqx.field(static=True, default=False)  # the coefficient is 1 by theory
    # Its shape takes arrays of NumPy as they are (`effects.arrays`): a diagnosis need not compile it.
    in_numpy: bool = eqx.field(static=True, default=False)
    once: bool = eqx.field(static=True, default=False)  # a channel has one of it, of one setting
    opposite: str = eqx.field(
        static=True, default=""
    )  # the effect that a channel has instead of it
    # The output is flat where the channel's own input is near zero: there it tells nothing of that input.
    flat_at_zero: bool = eqx.field(static=True, default=False)
    instant: bool = eqx.field(static=True, default=False)  # force, rate and temperature tell it
    # Whether dwell means show it, as a fleet has them; the others need the samples.
    seen_in_means: bool = eqx.field(static=True, default=False)
    # Depends on the moment, not on what the device goes through.
    clocked: bool = eqx.field(static=True, default=False)
    jump: bool = eqx.field(static=True, default=False)  # of a bias, at a moment; must persist
    branched: bool = eqx.field(
        static=True, default=False
    )  # by the temperature's branch; held at its ends
    wants_rests: bool = eqx.field(static=True, default=False)  # to be computed for a recording
    # Of the outputs of one stream as a whole: measured and taken out before the rest is looked for.
    stream_delay: bool = eqx.field(static=True, default=False)
    # Of a coefficient per second, by triad and grade: usual change of the output over a whole log, SI.
    change: Mapping[str, Sizes] | None = eqx.field(static=True, default=None)
    lost: str = eqx.field(static=True, default="")  # why it cannot be compensated, if so
    # rad/s, of gyros: the greatest in the rows from which they tell it.
    least_rate: float = eqx.field(static=True, default=0.0)
    # Units of forms whose coefficients are in others than `units`.
    unit_of_form: UnitOfForm | None = eqx.field(static=True, default=None)
    online: Online | None = eqx.field(
        static=True, default=None
    )  # where it depends on what went before

    def __repr__(self) -> str:
        return f"Effect({self.name!r})"

    @property
    def triads(self) -> tuple[str, ...]:
        """Triads that can have it."""
        return tuple(self.units)

    @property
    def settings(self) -> Mapping[str, bool]:
        """Names of what `shape` takes beside the signal, and whether each must be given."""
        taken = list(inspect.signature(self.shape).parameters.values())[1:]
        return {p.name: p.default is p.empty for p in taken}

    @property
    def sample_by_sample(self) -> Online | None:
        """The effect in real time; `None` where it depends on what a sensor's inputs do not tell."""
        return without_memory(self.shape) if self.instant else self.online

    def unit(self, triad: str, settings: Mapping[str, float | int | str], column: int = 0) -> str:
        """Unit of a form's coefficient, SI: a change of the scale factor has none, one of the bias the outputs'."""
        unit = self.units[triad]
        made = self.unit_of_form
        return unit if made is None else made(unit, triad, settings, column)

    def usual(
        self, triad: str, grade: str | None, seconds: float = np.inf
    ) -> tuple[float | int, float | int] | None:
        """Usual range of a coefficient's size for a grade; all grades together where none is given.

        In a log of so many `seconds` a coefficient per second is usual up to a usual change over the log.
        """
        usual = _of_grade(self.prior.get(triad), grade)
        change = None if self.change is None else _of_grade(self.change.get(triad), grade)
        if usual is None or change is None or not seconds > 0.0:
            return usual
        return usual[0], max(usual[1], change[1] / seconds)


def _of_grade(sizes: Sizes | None, grade: str | None) -> tuple[float | int, float | int] | None:
    if not sizes:
        return None
    if grade is not None and grade in sizes:
        return sizes[grade]
    return min(v[0] for v in sizes.values()), max(v[1] for v in sizes.values())


def by_grade(
    navigation: tuple[float | int, float | int],
    tactical: tuple[float | int, float | int],
    consumer: tuple[float | int, float | int],
    *,
    unit: float = 1.0,
) -> Mapping[str, tuple[float, float]]:
    """Smallest and largest usual coefficient of each grade, given in a `unit` of SI."""
    sizes = {"navigation": navigation, "tactical": tactical, "consumer": consumer}
    return {grade: (low * unit, high * unit) for grade, (low, high) in sizes.items()}


def any_grade(low: float, high: float | int) -> Mapping[str, tuple[float, float]]:
    """The same usual sizes for every grade, SI."""
    return by_grade((low, high), (low, high), (low, high))


def fixed(
    *variants: tuple[str, Mapping[str, float | int | str]],
) -> Callable[[Signal], tuple[Variant, ...]]:
    """Variants that do not depend on the signal."""
    made = tuple(Variant(label, settings) for label, settings in variants)
    return lambda signal: made


def over(
    setting: str, values: Callable[[Signal], AnyArray], **others: float | int | str
) -> Callable[[Signal], tuple[Variant, ...]]:
    """Variants along a grid of one setting."""

    def variants(signal: Signal) -> tuple[Variant, ...]:
        return tuple(
            Variant(f"{setting}={v:.4g}", {setting: float(v), **others}) for v in values(signal)
        )

    return variants


def addition(
    effect: Effect,
    coefficients: Float[AnyArray, "channels columns"],
    variant: Variant,
    signal: Signal,
) -> Float[AnyArray, "time 3"]:
    """What the effect adds to the outputs, m/s² or rad/s.

    `coefficients` has shape `(3, columns)`, one row per channel, or `(1, columns)` for a common effect.
    """
    shape = xp.asarray(effect.shape(signal, **variant.settings))
    full = xp.broadcast_to(shape, (shape.shape[0], 3, shape.shape[2]))
    each = xp.broadcast_to(xp.asarray(coefficients), (3, shape.shape[2]))
    return xp.einsum("tcq,cq->tc", full, each)


def apply(
    effect: Effect,
    coefficients: Float[AnyArray, "channels columns"],
    variant: Variant,
    signal: Signal,
) -> Signal:
    """The signal with the effect added to its outputs; the same signal at coefficients zero."""
    return eqx.tree_at(
        lambda s: s.output, signal, signal.output + addition(effect, coefficients, variant, signal)
    )


def inputs(signal: Signal) -> Float[AnyArray, "time 3"]:
    """What an ideal triad reads, in the outputs' unit: m/s² or rad/s."""
    return inputs_at(signal.triad, signal.input)


def inputs_at(triad: str, given: Float[AnyArray, "*time 3"]) -> Float[AnyArray, "*time 3"]:
    """`inputs` of a triad from its input in g or rad/s."""
    return xp.asarray(given) * (9.80665 if triad == "accel" else 1.0)


def chebyshev(
    temperature: AnyArray, order: int, low: Scalar | float, high: Scalar | float
) -> Float[AnyArray, " time"]:
    """Chebyshev polynomial $T_{order}(x)$ of temperature scaled to [-1, 1]."""
    x = (2.0 * xp.asarray(temperature) - (low + high)) / (high - low)
    before, value = xp.ones_like(x), x
    if order == 0:
        return before
    for _ in range(order - 1):
        before, value = value, 2.0 * x * value - before
    return value


def change_at(
    outputs: Callable[[AnyArray], AnyArray], element: AnyArray, probe: AnyArray
) -> Float[AnyArray, "time 3"]:
    """A model's outputs at the elements' temperatures less those at the probe's, m/s² or rad/s.

    A model that knows which part of it the temperature has none in gives the `change` itself.
    """
    change = getattr(outputs, "change", None)
    if change is not None:
        return change(element, xp.asarray(probe))
    return outputs(element) - outputs(xp.asarray(probe))


def gradient(
    values: Float[AnyArray, "time 3"], time: Float[AnyArray, " time"]
) -> Float[AnyArray, "time 3"]:
    """Time derivative by central differences, in the values' unit per second."""
    change, step = xp.gradient(values, axis=0), xp.gradient(time)
    # Rows that only pad a series repeat a moment; who padded it cuts them off.
    with np.errstate(divide="ignore", invalid="ignore"):
        return xp.asarray(change) / xp.asarray(step)[:, None]


def lag(
    time: Float[AnyArray, " time"], values: Float[AnyArray, " time"], time_constant: Scalar | float
) -> Float[AnyArray, " time"]:
    """First-order lag $\\tau \\dot y + y = x$, exact for a piecewise linear x, in equilibrium at the start."""
    time, values = xp.asarray(time), xp.asarray(values)
    decay, mean = _weights(xp.diff(time, prepend=time[:1]), time_constant)
    before = xp.concatenate([values[:1], values[:-1]])
    driven = (1.0 - mean) * values + (mean - decay) * before
    driven = xp.concatenate([values[:1], driven[1:]])
    decay = xp.concatenate([xp.zeros_like(decay[:1]), decay[1:]])
    return (_followed if xp.of_jax(decay, driven) else _followed_by_lapack)(decay, driven)


@jax.jit
def _followed(
    decay: Float[AnyArray, " time"], driven: Float[AnyArray, " time"]
) -> Float[AnyArray, " time"]:
    """$y_k = a_k y_{k-1} + b_k$ of decays a and drives b, from zero."""

    def follow(state, now):
        state = now[0] * state + now[1]
        return state, state

    # A plain scan: an associative one compiles ten times longer, and a CPU gains nothing from it.
    return jax.lax.scan(follow, jnp.zeros_like(driven[0]), (decay, driven))[1]


def _followed_by_lapack(
    decay: Float[np.ndarray, " time"], driven: Float[np.ndarray, " time"]
) -> Float[np.ndarray, " time"]:
    """The same: forward substitution in a matrix of ones with -a below its diagonal."""
    # Slow to import, and who reads or exports a calibration evaluates nothing.
    from scipy.linalg import get_blas_funcs

    (substitute,) = get_blas_funcs(("tbsv",), dtype=np.float64)  # in a banded triangle
    band = np.stack([np.ones_like(decay), -np.append(decay[1:], 0.0)])
    return substitute(1, np.asfortranarray(band), driven, lower=1, diag=1)


def _weights(step: Any, time_constant: Scalar | float) -> tuple[Any, Any]:
    """Decay over a step, and its mean over the step."""
    ratio = xp.maximum(step / time_constant, 1e-9)
    return xp.exp(-ratio), -xp.expm1(-ratio) / ratio


def lag_step(
    state: tuple[AnyArray, AnyArray],
    value: AnyArray,
    step: Scalar | float,
    time_constant: Scalar | float,
) -> tuple[AnyArray, AnyArray]:
    """One step of `lag`: the lagged value and the value itself, from those before."""
    decay, mean = _weights(xp.asarray(step), time_constant)
    lagged, before = state
    return decay * lagged + (1.0 - mean) * value + (mean - decay) * before, value


def play(values: Float[AnyArray, " time"], radius: Scalar | float) -> Float[AnyArray, " time"]:
    """Play (backlash) operator of half-width `radius`, starting in the middle of its play."""
    if xp.of_jax(values, radius):
        return _play(values, radius)
    return _play_in_blocks(np.asarray(values), float(radius))


def _play_in_blocks(
    values: Float[np.ndarray, " time"], radius: float
) -> Float[np.ndarray, " time"]:
    """The same, all blocks of about √n/2 moments side by side.

    Each moment clips y to x ± radius, and clips one after the other are one clip: a first pass finds each block's.
    """
    count = len(values)
    length = int(np.ceil(0.5 * np.sqrt(count)))
    blocks = -(-count // length)
    rows = np.concatenate([values, np.full(blocks * length - count, values[-1])])
    rows = np.ascontiguousarray(rows.reshape(blocks, length).T)
    low, high = rows - radius, rows + radius
    first, last = low[0], high[0]
    for lowest, highest in zip(low[1:], high[1:]):
        first, last = (np.minimum(np.maximum(x, lowest), highest) for x in (first, last))
    y, begun = float(values[0]), []
    for lowest, highest in zip(first.tolist(), last.tolist()):
        begun.append(y)
        y = min(max(y, lowest), highest)
    state = np.array(begun)
    for row, lowest, highest in zip(rows, low, high):
        state = np.minimum(np.maximum(state, lowest), highest, out=row)
    return rows.T.reshape(-1)[:count]


@jax.jit
def _play(values: Float[AnyArray, " time"], radius: Scalar | float) -> Float[AnyArray, " time"]:
    values = jnp.asarray(values)

    def step(y, x):
        y = jnp.clip(y, x - radius, x + radius)
        return y, y

    return jax.lax.scan(step, values[0], values)[1]
