"""What a form of an effect takes: how many coefficients, and settings of which kind."""

import functools
import inspect
from collections.abc import Callable, Mapping

import numpy as np

from .._typing import AnyArray
from ..physics.leaves import is_traced
from .effect import Effect, Variant
from .signal import Signal


_ROWS = 6  # of a signal that only tells how many columns a shape has (convention)


def check_settings(effect: Effect, triad: str, settings: Mapping[str, object], where: str) -> None:
    """Raise `ValueError` for a setting of the wrong kind: text where a number is meant, or the other way round; or for
    an `on` that the effect does not act on."""
    wants = {p.name: p.annotation for p in inspect.signature(effect.shape).parameters.values()}
    for name, value in settings.items():
        text = wants.get(name) is str
        if isinstance(value, str) != text or not (text or _is_number(value)):
            kind = "text" if text else "a number"
            raise ValueError(f"{where}: the setting {name!r} is {value}; it must be {kind}.")
    known = _acted_on(effect.variants, triad) if "on" in effect.settings else ()
    if known and settings.get("on", known[0]) not in known:
        raise ValueError(
            f"{where}: the setting 'on' is {settings['on']!r}; it must be {' or '.join(map(repr, known))}."
        )


def num_coefficients(
    effect: Effect, triad: str, settings: Mapping[str, object], degree: int | None
) -> tuple[int, ...]:
    """How many coefficients a channel may have in a form; empty where only a compiled program would tell.

    They are several where it matters what was recorded, as whether the vertical is known. **Arguments:** `degree` of
    the model beside it. Real settings, such as time constants, do not matter.
    """
    if not effect.in_numpy:
        return ()
    real = lambda v: is_traced(v) or not isinstance(v, str | int)
    fixed = tuple(sorted((k, 1.0 if real(v) else v) for k, v in settings.items()))
    return _columns(effect.shape, triad, fixed, degree or 1)


@functools.lru_cache(maxsize=256)
def _columns(
    shape: Callable[..., AnyArray], triad: str, fixed: tuple[tuple[str, object], ...], degree: int
) -> tuple[int, ...]:
    signals = [_signal(triad, degree, known=known) for known in (True, False)]
    try:
        counts = {int(np.shape(shape(s, **dict(fixed)))[-1]) for s in signals}
    except (KeyError, ValueError, IndexError, TypeError):  # a form that it does not know
        return ()
    return tuple(sorted(counts))


@functools.lru_cache(maxsize=256)
def _acted_on(variants: Callable[[Signal], tuple[Variant, ...]], triad: str) -> tuple[str, ...]:
    """What an effect's forms act on, by their setting `on`."""
    made = [v for degree in (0, 1) for v in variants(_signal(triad, degree))]
    return tuple(dict.fromkeys(str(v.settings["on"]) for v in made if "on" in v.settings))


def _is_number(value: object) -> bool:
    """Whether a setting is a number; what is traced is, and so are those of many devices."""
    if is_traced(value):
        return True
    try:
        return bool(np.isfinite(np.asarray(value, float)).all())
    except (TypeError, ValueError):
        return False


def _signal(triad: str, degree: int, *, known: bool = True) -> Signal:
    """A few rows with all that a shape may ask for; `known`: the vertical, and how the device is turned about it."""
    time, three = 10.0 * np.arange(float(_ROWS)), np.ones((_ROWS, 3))
    return Signal(
        triad=triad,
        time=time,
        input=three,
        output=three,
        since_power=time,
        since_start=time,
        since_move=time,
        move=three,
        at_rest=np.ones(_ROWS, bool),
        temperature=20.0 + time / 10.0,
        temperature_rate=np.full(_ROWS, 0.1),
        force=three,
        rate=three,
        rate_change=three,
        room=np.tile(np.eye(3), (_ROWS, 1, 1)),
        upright=known,
        oriented=known,
        vibration=np.ones(_ROWS),
        resolution=np.ones(3),
        scatter=np.ones(3),
        supply=5.0 + time / 100.0,
        expected=three,
        at_temperature=lambda t: np.outer(np.asarray(t), np.ones(3)),
        axes=np.eye(3),
        degree=degree,
        low=19.0,
        high=27.0,
    )
