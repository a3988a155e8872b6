"""Noise of logs as a document, as text, and as a figure on disk."""

import math
from collections.abc import Sequence
from pathlib import Path

from rich import box
from rich.table import Table

from ..allan import ChannelNoise, LogNoise, NoiseTerm, TERMS
from ..allan.model import NAMES, SI_UNITS, USUAL_UNITS
from ..plots.noise import allan
from ..plots.style import drawing, save_png
from .terminal import Terminal


def noise_document(logs: Sequence[LogNoise]) -> dict[str, object]:
    """`noise.json`: every value with its unit, densities apart from discrete values."""
    return {"schema": "inertiax.noise/1", "logs": [_log(found) for found in logs]}


def _log(found: LogNoise) -> dict[str, object]:
    return {
        "recording": found.recording,
        "device": found.device,
        "rate": {"value": found.rate, "unit": "Hz"},
        "duration": {"value": found.duration, "unit": "s"},
        "notes": list(found.notes),
        "channels": {c.channel: _channel(c) for c in found.channels},
    }


def _channel(found: ChannelNoise) -> dict[str, object]:
    model, triad = found.model, found.model.triad
    rate_unit = SI_UNITS[triad]["B"]
    return {
        "terms": {name: _term(found, name) for name in TERMS},
        "discrete": {
            "meaning": f"standard deviations from sample to sample at {model.rate:.6g} Hz; not densities",
            "white": {"value": model.discrete_sigma, "unit": rate_unit},
            "random_walk_step": {"value": model.discrete_walk, "unit": rate_unit},
        },
        "rate": {"value": model.rate, "unit": "Hz"},
        "band": {"lower": model.band[0], "upper": model.band[1], "unit": "Hz"},
        "filter_corner": {"value": model.corner, "unit": "Hz"},
        "rounding_step": {"value": model.rounding, "unit": rate_unit},
        "statement": model.statement,
        "chi2_per_dof": float(model.chi2_per_dof),
        "allan_deviation": {
            "kind": found.curve.kind,
            "unit": rate_unit,
            "level": 0.6827,
            "tau_s": found.curve.tau.tolist(),
            "deviation": found.curve.deviation.tolist(),
            "lower": found.lower.tolist(),
            "upper": found.upper.tolist(),
        },
    }


def _term(found: ChannelNoise, name: str) -> dict[str, object]:
    """A term; `value` is null where the log does not determine it, `upper_95` where it does not even limit it."""
    term, triad = found.model.terms[name], found.model.triad
    unit, factor = USUAL_UNITS[triad][name]
    return {
        "name": NAMES[triad][name],
        "shown": term.shown,
        "value": term.value,
        "lower_95": term.lower,
        "upper_95": term.upper if math.isfinite(term.upper) else None,
        "unit": SI_UNITS[triad][name],
        "usual": {"value": None if term.value is None else factor * term.value, "unit": unit},
    }


def write_figures(logs: Sequence[LogNoise], folder: Path) -> list[str]:
    """`noise.png`, or `noise-1.png` … where there are several logs; their names."""
    names = ["noise.png"] if len(logs) == 1 else [f"noise-{k + 1}.png" for k in range(len(logs))]
    for name, found in zip(names, logs, strict=True):
        with drawing():
            figure = allan(found)
        save_png(figure, folder / name)
    return names


def print_noise(logs: Sequence[LogNoise]) -> None:
    """Every term of every channel in data-sheet units, with its 95 % limits."""
    console = Terminal(soft_wrap=True)
    for found in logs:
        console.print(f"{found.recording or 'log'}: {found.duration:.0f} s at {found.rate:.6g} Hz")
        for triad in USUAL_UNITS:
            channels = [c for c in found.channels if c.model.triad == triad]
            if channels:
                console.print(_table(triad, channels))
        for channel in found.channels:
            console.print(f"{channel.channel}: {channel.model.statement}")
        for note in found.notes:
            console.print(f"note: {note}")


def _table(triad: str, channels: Sequence[ChannelNoise]) -> Table:
    """A row for each term and channel: three channels side by side do not fit a terminal of 80."""
    table = Table(box=box.SIMPLE, show_edge=False, pad_edge=False)
    for heading in (triad, "", "", "value", "95 % limits", "unit"):
        table.add_column(heading, no_wrap=True)
    for name in TERMS:
        unit, factor = USUAL_UNITS[triad][name]
        for k, found in enumerate(channels):
            first = (name, NAMES[triad][name]) if k == 0 else ("", "")
            cells = _cells(found.model.terms[name], factor)
            table.add_row(*first, found.channel[-1], *cells, unit)
    return table


def _cells(term: NoiseTerm, factor: float) -> tuple[str, str]:
    """Value and limits; a term that the log does not determine has only an upper limit, or none."""
    if term.value is None:
        return "", f"< {factor * term.upper:.2g}" if math.isfinite(term.upper) else "not told"
    return f"{factor * term.value:.3g}", f"{factor * term.lower:.3g}…{factor * term.upper:.3g}"
