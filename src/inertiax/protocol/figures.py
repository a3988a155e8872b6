"""Figures of a protocol: values against limits, and the curves over temperature."""

from pathlib import Path
from typing import NamedTuple

from ..calibration.calibrated_triads import calibrated_triads
from ..physics.temperature import Constant
from ..plots import calibration as plots
from ..plots.protocol import against_limits, AgainstLimit
from ..plots.style import drawing
from ..report.judge import TRIAD_NAMES
from ..report.page import Picture, picture
from .guard_band import allowance
from .protocol import Protocol


_NAMES = ("limits", "curves-accel", "curves-gyro", "curves-mag")
FIGURES = tuple(f"figures/protocol-{name}.{suffix}" for name in _NAMES for suffix in ("png", "svg"))


class Drawn(NamedTuple):
    """A figure in the page and as a file."""

    picture: Picture
    png: Path


def draw(protocol: Protocol, folder: Path) -> list[Drawn]:
    """Draw all figures, and write them to `folder`/figures."""
    made = []
    if protocol.requirements:
        rows = [
            AgainstLimit(
                r.name, r.worst.value / r.limit, allowance(r.worst.measured) / r.limit, r.decision
            )
            for r in protocol.requirements
        ]
        caption = "Of each requirement the value nearest to its limit, with its guard band."
        with drawing():
            made.append(_drawn(against_limits(rows), folder, "limits", caption))
    known = protocol.calibration.temperature_range
    for name, triad in calibrated_triads(protocol.calibration).items():
        if known is None or isinstance(triad.curve.basis, Constant):
            continue
        caption = (
            f"{TRIAD_NAMES[name]}: parameters over temperature, with the 95 % band of the fit and the probe (often "
            "thinner than the line). Shaded: outside the calibrated range."
        )
        with drawing():
            figure = plots.parameter_curves(triad, (float(known[0]), float(known[1])))
            made.append(_drawn(figure, folder, f"curves-{name}", caption))
    return made


def _drawn(figure, folder: Path, name: str, caption: str) -> Drawn:
    shown = picture(figure, folder, f"protocol-{name}", caption, caption)
    return Drawn(shown, folder / "figures" / f"protocol-{name}.png")
