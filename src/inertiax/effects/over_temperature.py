"""An effect whose coefficients change with temperature: its columns times Chebyshev polynomials."""

import inspect
from collections.abc import Callable, Mapping

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import chebyshev, Variant
from .signal import Signal


MOST = 2  # degree of the coefficients; at most that of the model
Shape = Callable[..., Float[AnyArray, "time channels columns"]]


def over_temperature(shape: Shape) -> Shape:
    r"""The shape with a setting `over`, the degree of its coefficients in temperature; 0 is the shape as it is.

    $\sum_{k=0}^{d} c_k T_k(x)\,s$ for the columns $s$, temperature scaled to $x \in [-1, 1]$ over the model's range:
    first all columns times $T_0$, then all times $T_1$ and so on.
    """

    def formed(
        signal: Signal, *, over: int = 0, **settings: float | int | str
    ) -> Float[AnyArray, "time channels columns"]:
        columns = shape(signal, **settings)
        if over == 0:
            return columns
        curve = [
            chebyshev(xp.asarray(signal.temperature), k, signal.low, signal.high)
            for k in range(over + 1)
        ]
        return xp.concatenate([columns * c[:, None, None] for c in curve], axis=2)

    # The settings of a form are read from its signature: those of the shape, and `over`, which may be left out.
    own = inspect.signature(shape)
    degree = inspect.signature(formed).parameters["over"]
    formed.__signature__ = own.replace(parameters=[*own.parameters.values(), degree])  # pyright: ignore[reportFunctionMemberAccess]
    return formed


def forms_over_temperature(
    signal: Signal, label: str, settings: Mapping[str, float | int | str]
) -> tuple[Variant, ...]:
    """One form for each degree up to the model's; none where the model is constant over temperature."""
    if signal.temperature is None:
        return ()
    return tuple(
        Variant(f"{label}, degree {n} in temperature", {**settings, "over": n})
        for n in range(1, min(MOST, signal.degree) + 1)
    )


def said_of_coefficients(settings: Mapping[str, float | int | str]) -> str:
    """A sentence on coefficients that change with temperature; empty for constants."""
    degree = int(settings.get("over", 0))
    if degree == 0:
        return ""
    terms = ", then ".join(f"T_{k}" for k in range(degree + 1))
    return (
        f" Its coefficients change with temperature, by degree {degree}: those of {terms}, Chebyshev polynomials of "
        "the temperature scaled to [-1, 1]."
    )
