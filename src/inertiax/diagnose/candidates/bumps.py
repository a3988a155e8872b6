"""Bumps, waves and steps along time or temperature: on a grid, and between its points.

A bump that misses the true one by its own width leaves most of it behind, which slow noise then takes
up; so the leading ones of the grid are tried again with other places and widths.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...effects import Signal, Variant
from ..observations.model_rows import Baseline
from .levels import near_level, OVER
from .signatures import channel_terms, Term


Settings = Mapping[str, float | int | str]
PLACES = (-1.0, -0.5, 0.0, 0.5, 1.0)  # of a bump, in widths
WIDER = (0.6, 0.8, 1.0, 1.25, 1.6)
NARROWEST, WIDEST = 0.01, 0.2  # of the range
SHARPEST = 0.002  # of the range, of a step
FEWEST_TURNS = 0.75
TURNS = (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75)  # of a wave


@dataclass(frozen=True, eq=False)
class Course:
    """A dependence on time or temperature, in words, by numbers and at the blocks."""

    family: str
    formula: str
    settings: Settings
    values: Float[np.ndarray, "block *column"]


def bump(signal: Signal, over: str, centre: float, width: float) -> Course:
    """A Gaussian bump along `over`, "time" or "temperature"; centre and width as parts of its range."""
    low, span, x = _scaled(signal, over)
    at, wide = low + centre * span, width * span
    letter, unit, digits = ("t", "s", 0) if over == "time" else ("T", "°C", 1)
    text = f"exp(-(({letter} - {at:.{digits}f} {unit}) / {wide:.{digits}f} {unit})^2 / 2)"
    settings = {"over": over, "centre": float(centre), "width": float(width)}
    return Course(f"bump in {over}", text, settings, np.exp(-0.5 * ((x - centre) / width) ** 2))


def wave(signal: Signal, turns: float) -> Course:
    """A sine of free phase with so many turns over the range of temperature."""
    _, span, x = _scaled(signal, "temperature")
    angle = 2.0 * np.pi * turns * x
    return Course(
        "wave in temperature",
        f"sin(2 pi T / {span / turns:.1f} °C + phase)",
        {"over": "temperature", "turns": float(turns)},
        np.stack([np.sin(angle), np.cos(angle)], axis=1),
    )


def step(signal: Signal, centre: float, width: float) -> Course:
    """A rise from 0 to 1 at a temperature, most of it within twice a width; both as parts of the range."""
    low, span, x = _scaled(signal, "temperature")
    settings = {"over": "temperature", "step": float(centre), "width": float(width)}
    text = f"step(T - {low + centre * span:.1f} °C)"
    return Course("step in temperature", text, settings, 0.5 + 0.5 * np.tanh((x - centre) / width))


def between(term: Term, signal: Signal, base: Baseline) -> list[Term]:
    """The same bump, wave or step with other places, widths or turns; empty for other terms."""
    settings = term.variant.settings
    if "over" not in settings:
        return []
    if settings["over"] == OVER:
        return near_level(term, signal, base)
    power = int(settings.get("power", 0))
    letter = "f" if signal.triad == "accel" else "w"
    made = []
    for course in _near(signal, settings):
        columns = course.values.reshape(len(course.values), 1, -1)
        columns = np.broadcast_to(columns, (len(columns), 3, columns.shape[2]))
        words = course.formula
        if power:
            u = np.asarray(signal.input)
            columns = (u / np.abs(u).max())[:, :, None] ** power * columns
            words = f"{letter}^{power} {words}" if power > 1 else f"{letter} {words}"
        variant = Variant(words, {**course.settings, "power": power})
        made.append(channel_terms(term.name, variant, base, columns)[term.channels[0]])
    return made


def _near(signal: Signal, settings: Settings) -> Iterator[Course]:
    if "turns" in settings:
        for change in TURNS:
            turns = float(settings["turns"]) + change
            if turns >= FEWEST_TURNS:
                yield wave(signal, turns)
        return
    kind, sharpest = ("step", SHARPEST) if "step" in settings else ("centre", NARROWEST)
    centre, width = float(settings[kind]), float(settings["width"])
    for place in PLACES:
        for wider in WIDER:
            at, wide = centre + place * width, wider * width
            if (
                (place, wider) == (0.0, 1.0)
                or not 0.0 <= at <= 1.0
                or not sharpest <= wide <= WIDEST
            ):
                continue
            over = str(settings["over"])
            yield step(signal, at, wide) if kind == "step" else bump(signal, over, at, wide)


def _scaled(signal: Signal, over: str) -> tuple[float, float, np.ndarray]:
    """Lowest value, range, and the course from 0 to 1."""
    values = np.asarray(signal.time if over == "time" else signal.temperature)
    if over == "time":
        low, span = float(values[0]), max(float(values[-1] - values[0]), 1e-9)
    else:
        low, span = float(values.min()), float(np.ptp(values))
    return low, span, (values - low) / span
