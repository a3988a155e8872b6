"""Steps, kinks and bumps at a level of the input along an axis: on a grid, and between its points.

A converter that changes its range, or a resonance that one rate excites, acts at one level. With no
such form among the unlisted dependences, the catalogued effect that differs at the same positions (a clip at the
outermost, an asymmetry for a kink) would be the only one to fit.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...effects import Signal, Variant
from ..observations.model_rows import Baseline
from .signatures import channel_terms, Term


OVER = "level of input"
FEWEST = 5  # levels of an axis, from which a place between them means something
# Parts of the largest input; scale asymmetry has its kink at 0, a dead band its middle.
CENTRES = np.linspace(-0.9, 0.9, 19)
WIDTHS = (0.08, 0.16)
SHARP = 0.02
PLACES = (-0.06, -0.03, 0.0, 0.03, 0.06)
WIDER = (0.6, 0.8, 1.0, 1.25, 1.6)
FAINT = 0.2  # of a bump's height: no input came nearer


@dataclass(frozen=True, eq=False)
class AtLevel:
    """A dependence on the input of each axis, in words, by numbers and at the blocks."""

    family: str
    formula: str
    settings: Mapping[str, float | int | str]
    values: Float[np.ndarray, "block 3 1"]


def at_levels(signal: Signal) -> Iterator[AtLevel]:
    """The grid; empty where no axis has enough levels."""
    u = _unit(signal)
    if u is None or max(len(np.unique(u[:, c].round(2))) for c in range(3)) < FEWEST:
        return
    for centre in CENTRES:
        yield _form(signal, u, "bump", centre, WIDTHS[0])
        yield _form(signal, u, "bump", centre, WIDTHS[1])
        if centre != 0.0:
            yield _form(signal, u, "kink", centre, 0.0)
        yield _form(signal, u, "step", centre, SHARP)


def near_level(term: Term, signal: Signal, base: Baseline) -> list[Term]:
    """The same form at other levels and widths."""
    settings, u = term.variant.settings, _unit(signal)
    if u is None:
        return []
    kind = str(settings["kind"])
    centre, width = float(settings["centre"]), float(settings["width"])
    made = []
    for place in PLACES:
        for wider in WIDER if kind == "bump" else (1.0,):
            if (place, wider) != (0.0, 1.0):
                form = _form(signal, u, kind, centre + place, width * wider)
                variant = Variant(form.formula, form.settings)
                made.append(channel_terms(term.name, variant, base, form.values)[term.channels[0]])
    return made


def _form(signal: Signal, u: np.ndarray, kind: str, centre: float, width: float) -> AtLevel:
    top = float(np.abs(np.asarray(signal.input)).max())
    letter, unit = ("f", "g") if signal.triad == "accel" else ("w", "rad/s")
    distance, level = u - centre, centre * top
    away = f"({letter} {'-' if level >= 0.0 else '+'} {abs(level):.3g} {unit})"
    if kind == "bump":
        values = np.exp(-0.5 * (distance / width) ** 2)
        values = np.where(values.max(axis=0) > FAINT, values, 0.0)
        formula = f"exp(-({away} / {width * top:.2g} {unit})^2 / 2)"
    elif kind == "kink":
        values, formula = np.abs(distance), f"|{away[1:-1]}|"
    else:
        values, formula = np.tanh(distance / width), f"step{away}"
    settings = {"over": OVER, "kind": kind, "centre": float(centre), "width": float(width)}
    return AtLevel(f"{kind} in input", formula, settings, values[:, :, None])


def _unit(signal: Signal) -> Float[np.ndarray, "block 3"] | None:
    """The input as a part of its largest value; `None` where there is none."""
    u = np.asarray(signal.input)
    top = float(np.abs(u).max())
    return u / top if top > 0.0 else None
