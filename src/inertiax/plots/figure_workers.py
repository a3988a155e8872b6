"""Figures as they are asked for, and who draws them."""

from collections.abc import Callable
from typing import Any, TypeVar

from .style import Figure


Made = TypeVar("Made")


class Drawing:
    """A figure to be drawn: a function of this folder and what it is given."""

    def __init__(self, draw: Callable[..., Figure], *given: Any):
        self._draw, self._given = draw, given

    def figure(self) -> Figure:
        """The figure, in the style of all."""
        from .style import drawing

        with drawing():
            return self._draw(*self._given)


def drawn(make: Callable[..., Made], drawing: Drawing, *given: Any) -> Callable[[], Made]:
    """`make(drawing, *given)`, begun where figures are drawn; what is returned gives its result."""
    made = make(drawing, *given)
    return lambda: made
