"""Noise of logs as a document, as text, and as a figure on disk."""

import math
from collections.abc import Sequence
from pathlib import Path

from rich import box
from rich.table import Table

from ..allan import ChannelNoise, LogNoise, NoiseTerm, TERMS
from ..allan.model import NAMES, SAMPLE_UNITS, SI_UNITS, USUAL_UNITS
from ..plots import noise_panels as panels
from ..plots.figure_workers import Drawing
from ..plots.noise import allan_panels
from ..plots.style import to_png
from ..storage.whole_files import write_atomically
from .terminal import Terminal


_FILTERED = 0.9  # of N √rate: one sample's scatter below it is worth a line (convention)
_WIDTH = 80  # columns; a table squeezed into fewer loses digits, and a terminal wraps it instead


def noise_document(logs: Sequence[LogNoise], topic: str | None = None) -> dict[str, object]:
    """`noise.json`: every value with its unit, densities apart from discrete values; `topic` is that of ROS bags."""
    of_ros = {} if topic is None else {"topic": topic}
    return {"schema": "inertiax.noise/1", "logs": [_log(found) | of_ros for found in logs]}


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
            "meaning": (
                f"standard deviations at {model.rate:.6g} Hz, not densities: white = N sqrt(rate), for programs that "
                "integrate; sample = one sample as recorded, less behind a low-pass filter"
            ),
            "white": {"value": model.discrete_sigma, "unit": rate_unit},
            "sample": {"value": found.sample, "unit": rate_unit},
            "random_walk_step": {"value": model.discrete_walk, "unit": rate_unit},
        },
        "rate": {"value": model.rate, "unit": "Hz"},
        "white_throughout": model.white_throughout,
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
    """A term; `value` is null where the log does not determine it, `upper_95` where it does not even limit it; `least`
    is what describes the log with the fewest terms."""
    term, triad = found.model.terms[name], found.model.triad
    unit, factor = USUAL_UNITS[triad][name]
    return {
        "name": NAMES[triad][name],
        "shown": term.shown,
        "value": term.value,
        "lower_95": term.lower,
        "least": term.known,
        "upper_95": term.upper if math.isfinite(term.upper) else None,
        "unit": SI_UNITS[triad][name],
        "usual": {"value": None if term.value is None else factor * term.value, "unit": unit},
    }


def write_figures(logs: Sequence[LogNoise], folder: Path) -> list[str]:
    """`noise.png`, or `noise-1.png` … where there are several logs; their names."""
    names = ["noise.png"] if len(logs) == 1 else [f"noise-{k + 1}.png" for k in range(len(logs))]
    begun = [Drawing(to_png, panels.allan, allan_panels(found)).begin() for found in logs]
    for name, picture in zip(names, begun, strict=True):
        write_atomically(folder / name, picture())
    return names


def print_noise(logs: Sequence[LogNoise]) -> None:
    """Every term of every channel in data-sheet units, with its 95 % limits."""
    console = Terminal(soft_wrap=True, width=max(Terminal().width, _WIDTH))
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
    table = Table(box=box.SIMPLE, show_edge=False, pad_edge=False, collapse_padding=True)
    table.add_column("", no_wrap=True)
    table.add_column(triad, no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("value", no_wrap=True, justify="right")
    table.add_column("95 % limits", no_wrap=True)
    for name in TERMS:
        unit, factor = USUAL_UNITS[triad][name]
        _add(
            table,
            name,
            f"{NAMES[triad][name]}, {unit}",
            [(c.channel[-1], c.model.terms[name], factor) for c in channels],
        )
        if name == "N":
            rate, (unit, factor) = channels[0].model.rate, SAMPLE_UNITS[triad]
            _add(
                table,
                "",
                f"N as one sample at {rate:.4g} Hz, {unit}",
                [(c.channel[-1], c.model.terms[name], factor * math.sqrt(rate)) for c in channels],
            )
            _add_filtered(table, channels, unit, factor)
    return table


def _add_filtered(table: Table, channels: Sequence[ChannelNoise], unit: str, factor: float) -> None:
    """The scatter of one sample as it was recorded, where a low-pass filter makes it less than N √rate."""
    if not any(c.sample < _FILTERED * (c.model.discrete_sigma or 0.0) for c in channels):
        return
    for k, c in enumerate(channels):
        first = ("", f"one sample as recorded, {unit}") if k == 0 else ("", "")
        table.add_row(*first, c.channel[-1], _plain(factor * c.sample, 3), "")


def _add(
    table: Table, symbol: str, name: str, axes: Sequence[tuple[str, NoiseTerm, float]]
) -> None:
    """The rows of one term, axis by axis, each with the factor to the unit shown."""
    for k, (axis, term, factor) in enumerate(axes):
        first = (symbol, name) if k == 0 else ("", "")
        table.add_row(*first, axis, *_cells(term, factor))


def _cells(term: NoiseTerm, factor: float) -> tuple[str, str]:
    """Value and limits; a term that the log does not determine has only an upper limit, or none."""
    if term.value is None:
        limited = math.isfinite(term.upper)
        return "", f"< {_plain(factor * term.upper, 2)}" if limited else "not told"
    value, lower, upper = (_plain(factor * x, 3) for x in (term.value, term.lower, term.upper))
    return value, f"{lower}…{upper}"


def _plain(value: float, digits: int) -> str:
    """A number of so many significant digits, up to ten millions without an exponent."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e7 else text
