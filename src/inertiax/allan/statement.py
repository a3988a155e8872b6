"""One line on a channel's fit: from which band N came, and where the model fails."""

import numpy as np

from .band import Band, corner_of
from .likelihood import Fit
from .spectrum import Spectrum


def band_statement(spectrum: Spectrum, band: Band, fit: Fit) -> str:
    """What a reader should know of the band."""
    nyquist = 0.5 * spectrum.rate
    lower = "0" if band.lower == 0.0 else f"{band.lower:.3g}"
    parts = [f"N from {lower} to {band.upper:.3g} Hz"]
    corner = corner_of(band, fit, spectrum.rate) if band.seen else None
    if corner is not None:
        parts.append(f"behind a low-pass filter of {corner:.3g} Hz")
    elif band.seen and band.upper < 0.99 * nyquist:
        parts.append("behind a filter whose corner lies beyond")
    if not band.passes:
        parts.append("the terms do not describe this band")
    if band.upper < 0.99 * nyquist:
        parts.append(f"not described above, up to {nyquist:.3g} Hz")
    if band.lower > 0.0:
        parts.append("below, a drift or a transient prevails: B, K and R are not told")
    if band.lines.any():
        parts.append(f"{_lines(spectrum, band)} left out")
    return "; ".join(parts)


def _lines(spectrum: Spectrum, band: Band) -> str:
    """The frequencies left out, neighbours as one."""
    found = np.flatnonzero(band.lines)
    groups = np.split(found, np.flatnonzero(np.diff(found) > 1) + 1)
    peaks = [spectrum.frequency[g[np.argmax(spectrum.power[g])]] for g in groups]
    listed = ", ".join(f"{p:.3g}" for p in peaks[:4]) + (", …" if len(peaks) > 4 else "")
    return f"{'a line at' if len(peaks) == 1 else 'lines at'} {listed} Hz"
