"""Structured alternatives: dependences on physical variables that no catalogued effect stands for.

They compete with the catalogue under the same rules. Where one of them wins, the honest answer is
"unexplained", with its formula as the best-found dependence.
"""

from collections.abc import Iterator

import numpy as np

from ...effects import Signal, Variant
from ..observations.blocks import Blocks
from ..observations.model_rows import Baseline
from .bumps import bump, Course, Settings, step, wave
from .levels import at_levels
from .signatures import channel_terms, Term


PREFIX = "~"  # names of alternatives; never a name of the catalogue
LEAST_SPAN = 2.0  # °C of a log, from which outputs may follow the temperature (convention)
FEWEST_POSITIONS, MOST_POSITIONS = 4, 40  # that come again, from and up to which each has a level


def _courses(signal: Signal) -> Iterator[Course]:
    """Dependences on time or temperature, `(block,)` or `(block, column)`."""
    time = np.asarray(signal.time)
    x = (time - time[0]) / max(time[-1] - time[0], 1e-9)
    span = time[-1] - time[0]
    for width in (0.015, 0.03, 0.08):
        for centre in np.arange(width, 1.0, 2.0 * width):
            yield bump(signal, "time", float(centre), width)
    for centre in (0.25, 0.5, 0.75):
        at = time[0] + centre * span
        yield Course("kink in time", f"|t - {at:.0f} s|", {}, np.abs(x - centre))
    yield Course("power of time", "t^2", {}, (x - 0.5) ** 2)
    yield Course("power of time", "sqrt(t)", {}, np.sqrt(x))
    if signal.temperature is None:
        return
    t = np.asarray(signal.temperature)
    low, high = t.min(), t.max()
    if high - low < LEAST_SPAN:
        return
    y = (t - low) / (high - low)
    for width in (0.05, 0.1, 0.18):
        for centre in np.arange(0.1, 0.95, max(width, 0.08)):
            yield bump(signal, "temperature", float(centre), width)
    for width in (0.012, 0.04):
        for centre in np.arange(0.05, 0.96, 0.025):
            yield step(signal, float(centre), width)
    for centre in np.arange(0.1, 0.95, 0.1):
        at = low + centre * (high - low)
        yield Course("kink in temperature", f"|T - {at:.1f} °C|", {}, np.abs(y - centre))
    for turns in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0):
        yield wave(signal, turns)
    rate = np.asarray(signal.temperature_rate) * 60.0
    z = 2.0 * y - 1.0
    yield Course("temperature rate", "(dT/dt)^2", {}, rate**2)
    yield Course("temperature rate", "|dT/dt|", {}, np.abs(rate))
    yield Course("temperature rate", "T dT/dt", {}, z * rate)
    yield Course("temperature rate", "T^2 dT/dt", {}, z**2 * rate)
    yield Course("temperature and time", "T t", {}, z * (x - 0.5))


def input_dependences(signal: Signal) -> Iterator[tuple[str, str, np.ndarray]]:
    """Family, formula and dependence on the input alone, `(row, 3, column)` for a signal of so many rows."""
    u = np.asarray(signal.input)
    if not np.any(u):
        return
    letter = "f" if signal.triad == "accel" else "w"
    unit = u / max(float(np.abs(u).max()), 1e-300)
    for power in (4, 5, 6):
        yield "power of input", f"{letter}^{power}", unit[:, :, None] ** power
    for k in (2.0, 3.0, 4.0):
        both = np.stack([np.sin(np.pi * k * unit), np.cos(np.pi * k * unit)], axis=2)
        yield "wave in input", f"sin({k:g} pi {letter} / {letter}max + phase)", both
    for width in (0.15, 0.3):
        yield (
            "bump in input",
            f"exp(-({letter} / {width:g} {letter}max)^2 / 2)",
            np.exp(-0.5 * (unit / width) ** 2)[:, :, None],
        )
    before = unit - np.asarray(signal.move) / max(float(np.abs(u).max()), 1e-300)
    yield "memory of the move", f"{letter} of the position before", before[:, :, None]
    yield (
        "memory of the move",
        f"sign of the change of {letter}",
        np.sign(np.asarray(signal.move))[:, :, None],
    )
    yield (
        "product of inputs",
        f"{letter}_x {letter}_y {letter}_z",
        np.repeat(np.prod(unit, axis=1)[:, None, None], 3, axis=1),
    )
    if signal.triad == "gyro":
        yield "power of input", "w^2", unit[:, :, None] ** 2


def alternatives(signal: Signal, blocks: Blocks, base: Baseline) -> list[Term]:
    """All structured alternatives of one triad; `signal` at block means."""
    u = np.asarray(signal.input)
    scale = max(float(np.abs(u).max()), 1e-300)
    letter = "f" if signal.triad == "accel" else "w"
    made: list[Term] = []

    def add(family: str, formula: str, addition: np.ndarray, settings: Settings) -> None:
        size = float(np.abs(addition).max())
        if size > 0.0:
            variant = Variant(formula, settings)
            made.extend(channel_terms(PREFIX + family, variant, base, addition))

    for course in _courses(signal):
        column = course.values.reshape(len(u), 1, -1)
        family, formula, settings = course.family, course.formula, course.settings
        add(family, formula, np.broadcast_to(column, (len(u), 3, column.shape[2])), settings)
        if np.any(u) and not family.endswith("in time"):
            for power, word, sign in ((1, "input", letter), (2, "input squared", f"{letter}^2")):
                shape = (u / scale)[:, :, None] ** power * column
                own = {**settings, "power": power} if settings else {}
                add(f"{family} times {word}", f"{sign} {formula}", shape, own)
    if np.any(u):
        x = np.linspace(-0.5, 0.5, len(u))[:, None, None]
        courses = [("time", "t", x)]
        if signal.temperature is not None and np.ptp(signal.temperature) > LEAST_SPAN:
            t = np.asarray(signal.temperature)
            courses.append(("temperature", "T", ((t - t.mean()) / np.ptp(t))[:, None, None]))
        for power, word in ((2, "squared"), (3, "cubed")):
            shape = (u / scale)[:, :, None] ** power
            for name, symbol, course in courses:
                add(f"input {word} and {name}", f"{letter}^{power} {symbol}", shape * course, {})
    for family, formula, addition in input_dependences(signal):
        add(family, formula, addition, {})
    for form in at_levels(signal):
        add(form.family, form.formula, form.values, form.settings)
    add_positions(made, signal, blocks, base)
    return made


def add_positions(made: list[Term], signal: Signal, blocks: Blocks, base: Baseline) -> None:
    """One free level for each position that comes again; the least specific alternative.

    The level of a position that comes once is that of its dwell, which is noise.
    """
    rest = ~blocks.moving
    visits = np.unique(np.stack([blocks.position[rest], blocks.dwell[rest]]), axis=1)
    numbers, counts = np.unique(visits[0], return_counts=True)
    again = numbers[counts > 1]
    if not FEWEST_POSITIONS <= len(again) <= MOST_POSITIONS:
        return
    dummy = ((blocks.position[:, None] == again) & rest[:, None]).astype(float)
    addition = np.broadcast_to(dummy[:, None, :], (len(dummy), 3, len(again)))
    made.extend(
        channel_terms(PREFIX + "position", Variant("a level of each position", {}), base, addition)
    )
