"""Flexible dependences on physical variables: what a right explanation must leave nothing for.

Each is a smooth function of one variable, or a set of products, with up to ten free coefficients. None is an
explanation; after the named effects are fitted they are asked together whether something is left.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline

from ...effects import Signal, Variant
from ..observations.model_rows import Baseline
from .empirical import PREFIX
from .signatures import channel_terms, Term


MOST = 10  # columns of one dependence
LEVELS = 7  # of an input, from which a spline of it makes sense


def spline(x: Float[np.ndarray, " block"], size: int) -> Float[np.ndarray, "block column"]:
    """Cubic B-splines on equal knots over the range of x."""
    low, high = float(x.min()), float(x.max())
    step = (high - low) / (size - 3)
    knots = low + step * np.arange(-3, size + 1)
    inside = np.clip(x, low, high - 1e-9 * (high - low))
    return BSpline.design_matrix(inside, knots, 3).toarray()[:, :size]


def flexible(signal: Signal, base: Baseline) -> list[Term]:
    """All flexible dependences of one triad; `signal` at block means."""
    made: list[Term] = []
    for family, formula, addition in _additions(signal):
        wide = np.broadcast_to(addition, (addition.shape[0], 3, addition.shape[2]))
        made.extend(channel_terms(PREFIX + family, Variant(formula, {}), base, wide))
    return made


def on_input(term: Term) -> bool:
    """Whether a flexible dependence is one on the inputs, and not on a course alone."""
    family = term.name.removeprefix(PREFIX)
    return not family.startswith("curve of") or family.endswith("input")


def _additions(signal: Signal) -> Iterator[tuple[str, str, np.ndarray]]:
    u = np.asarray(signal.input)
    letter = "f" if signal.triad == "accel" else "w"
    u = u / max(float(np.abs(u).max()), 1e-300)
    felt = bool(np.any(u))
    courses = list(_courses(signal))
    for name, course in courses:
        yield f"curve of {name}", f"a smooth function of {name}", course[:, None, :]
        if felt:
            yield (
                f"curve of {name} times input",
                f"{letter} times a smooth function of {name}",
                u[:, :, None] * course[:, None, :],
            )
    for name, vector in _vectors(signal):
        yield f"products of {name}", f"squares and products of {name}", _products(vector, 2)
        yield f"products of {name}", f"third powers and products of {name}", _products(vector, 3)
        for course, values in (("time", signal.time), ("temperature", signal.temperature)):
            if values is not None and np.ptp(np.asarray(values)) > 2.0:
                x = np.asarray(values) - np.mean(values)
                x = x / np.abs(x).max()
                for degree, word in ((2, "squares"), (3, "third powers")):
                    times = _products(vector, degree) * x[:, None, None]
                    yield (
                        f"products of {name} and {course}",
                        f"{word} of {name} times {course}",
                        times,
                    )
    if felt:
        if len(np.unique(u.round(3))) > LEVELS:
            own = np.stack([spline(u[:, c], 9) for c in range(3)], axis=1)
            yield "curve of input", f"a smooth function of {letter} along the axis", own
        before = u - np.asarray(signal.move) / max(
            float(np.abs(np.asarray(signal.input)).max()), 1e-300
        )
        yield "memory of the move", f"{letter} of the position before", before[:, None, :]


def _courses(signal: Signal) -> Iterator[tuple[str, np.ndarray]]:
    yield "time", spline(np.asarray(signal.time), MOST)
    if signal.temperature is None or np.ptp(np.asarray(signal.temperature)) <= 2.0:
        return
    curve = spline(np.asarray(signal.temperature), MOST)
    yield "temperature", curve
    rate = np.asarray(signal.temperature_rate)
    if np.ptp(rate) > 0.0:
        side = np.tanh(3.0 * rate / np.abs(rate).max())[:, None]
        wide = spline(np.asarray(signal.temperature), 5)
        yield "temperature by branch", side * wide
        yield "temperature rate", spline(np.tanh(2.0 * rate / np.abs(rate).max()), 6)


def _vectors(signal: Signal) -> Iterator[tuple[str, np.ndarray]]:
    given = {"input": signal.input}
    if signal.triad == "gyro" and signal.force is not None:
        given["specific force"] = signal.force
    for name, vector in given.items():
        v = np.asarray(vector)
        if np.any(np.ptp(v, axis=0) > 0.0):
            yield name, v / np.abs(v).max()


def _products(vector: np.ndarray, degree: int) -> Float[np.ndarray, "block 1 column"]:
    """All monomials of one degree in three components."""
    x, y, z = vector.T
    made = [
        x**i * y**j * z ** (degree - i - j)
        for i in range(degree + 1)
        for j in range(degree + 1 - i)
    ]
    return np.stack(made, axis=-1)[:, None, :]
