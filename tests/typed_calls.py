"""Types and shapes are checked at the first calls of each function in each test.

A check of two arrays costs 10 µs (22 in jaxtyping's own form, in which checks at each call were a third of the suite's
processor time), and a diagnosis calls functions of the host a hundred thousand times. What a test passes to a function
for the seventh time has the types of the first six. The checker of a function is made when it is first called: a
process calls a third of all.
"""

import contextlib
import dataclasses
import functools
import inspect

import jaxtyping


CALLS = (
    6  # of a function in a test, or in making what several tests share: three axes of two triads
)
_left: list[int] = []
_checked_always = jaxtyping.jaxtyped


def begin_anew() -> None:
    """Check the next calls of every function again."""
    _left[:] = [CALLS] * len(_left)


def _at_first(function, typechecker):
    number = len(_left)
    _left.append(CALLS)
    checked = None

    @functools.wraps(function)
    def call(*args, **kwargs):
        nonlocal checked
        if not _left[number]:
            return function(*args, **kwargs)
        _left[number] -= 1
        if checked is None:
            checked = _checked(function, typechecker)
        return checked(*args, **kwargs)

    return call


def _checked(function, typechecker):
    """By the checker itself, in a scope for the sizes of arrays; jaxtyping's own form checks arguments twice.

    That form is for types written as strings and those that the checker gives up on.
    """
    kinds = function.__annotations__.values()
    if not any(isinstance(x, str) or "ForwardRef" in repr(x) for x in kinds):
        with contextlib.suppress(Exception):  # of types too many for it
            return _in_a_scope(typechecker(function))
    return _checked_always(function, typechecker=typechecker)


def _in_a_scope(checked):
    @functools.wraps(checked)
    def call(*args, **kwargs):
        with _checked_always("context"):
            return checked(*args, **kwargs)

    return call


def jaxtyped(fn=None, *, typechecker=None):
    """What jaxtyping's import hook decorates each function and class of the package with."""
    if fn is None:
        return functools.partial(jaxtyped, typechecker=typechecker)
    if inspect.isfunction(fn) and typechecker is not None:
        return _at_first(fn, typechecker)
    if dataclasses.is_dataclass(fn) and inspect.isfunction(fn.__init__):
        fn.__init__ = _at_first(fn.__init__, typechecker)
        return fn
    return _checked_always(fn, typechecker=typechecker)


def install() -> None:
    """Take the place of jaxtyping's own decorator; call it before the package is imported."""
    jaxtyping.jaxtyped = jaxtyped
