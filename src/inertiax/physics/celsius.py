"""Temperatures in °C, and what is none."""

import numpy as np

from .._typing import AnyArray


# What no sensor at a test place shows; outside of it the unit is another one.
COLDEST, HOTTEST = -100.0, 200.0  # °C: cryogenic and down-hole sensors are within
HOTTEST_FAHRENHEIT = 392.0  # °F, the same


def not_celsius(temperatures: AnyArray) -> str | None:
    """Why temperatures are none in °C, in words, or `None` where they may be."""
    values = np.asarray(temperatures)
    low, high = values.min(), values.max()
    if low >= COLDEST and high <= HOTTEST:
        return None
    guess = " (kelvin?)" if 200.0 < np.median(values) < 500.0 else ""
    if COLDEST <= low and np.median(values) <= HOTTEST < high <= HOTTEST_FAHRENHEIT:
        guess = " (Fahrenheit?)"
    said = f"from {low:g} to {high:g}" if values.ndim else f"{low:g}"
    return f"{said}; it is in °C, from {COLDEST:g} to {HOTTEST:g}{guess}"
