"""A sensor's low-pass filter below half the sampling rate: neighbouring samples of the noise are alike.

The spectrum of what is left of each rest around its mean is compared at two frequencies, as shares x of half the
sampling rate. White noise has a ratio of 1; a filter of one pole, y[k] = q y[k−1] + (1 − q) u[k], has

    r(q) = (1 − 2 q cos(π x₂) + q²) / (1 − 2 q cos(π x₁) + q²),   x₁ < x₂

and its corner where 1 − 2 q cos(π x) + q² = 2 (1 − q)². A deep one pole's ratio hardly depends on q, and steeper
filters have larger ones: then it is said that there is a filter, and no corner. Both frequencies lie above a hand's
tremor at the usual 100 Hz, and below them the noise may rise as it likes.
"""

from typing import cast

import numpy as np
from jaxtyping import Float

from .dead_channels import triads
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .rest_windows import parts_of_rests
from .thresholds import Thresholds


WINDOW = 64  # samples of one spectrum
FEWEST = 100  # spectra; their ratio is then known to 6 %
LOW, HIGH = (0.35, 0.5), (0.85, 0.97)  # shares of half the sampling rate
REPEATS = 0.05  # share of repeated samples beyond which holding shapes the spectrum
DEEPEST = 0.7  # q up to which the ratio, known to 3 %, tells one pole's corner to a quarter


def check_band_limit(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """A note for each triad whose noise at rest falls towards half the sampling rate on two axes or more."""
    found = []
    for log in device.logs:
        for name, values in triads(log):
            ratio = fall(log, values)
            if ratio is None or np.sort(ratio)[1] < limits.spectrum_falls:
                continue
            found.append(_told(log, name, float(np.median(ratio))))
    return found


def fall(log: Log, values: Float[np.ndarray, "time 3"]) -> Float[np.ndarray, "3"] | None:
    """The spectrum's ratio of the lower to the upper frequencies, by axis; `None` where the rests are too short."""
    parts = parts_of_rests(log, values, WINDOW, FEWEST)
    if parts is None:
        return None
    if np.any(np.mean(parts[:, 1:] == parts[:, :-1], axis=(0, 1)) > REPEATS):
        return None
    window = np.hanning(WINDOW)[:, None]
    power = np.abs(np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2
    # Knocks and other bursts fill few spectra; the median of them is not moved.
    share = np.linspace(0.0, 1.0, power.shape[1])
    low, high = (
        np.median(power[:, (share >= a) & (share <= b)].mean(axis=1), axis=0)
        for a, b in (LOW, HIGH)
    )
    return low / np.maximum(high, 1e-300) if np.all(low > 0.0) else None


def corner(ratio: float) -> float | None:
    """One pole's corner as a share of half the sampling rate, `None` where the ratio does not tell it."""
    first, second = np.mean(LOW), np.mean(HIGH)

    def of_one_pole(q: float) -> float:
        part = lambda x: 1.0 - 2.0 * q * np.cos(np.pi * x) + q**2
        return float(part(second) / part(first))

    if ratio > of_one_pole(DEEPEST):
        return None
    from scipy.optimize import brentq  # slow to import, and seldom needed

    q = cast(float, brentq(lambda q: of_one_pole(q) - ratio, 0.0, DEEPEST))
    cosine = 1.0 - (1.0 - q) ** 2 / (2.0 * q)
    return float(np.arccos(max(cosine, -1.0)) / np.pi)


def _told(log: Log, name: str, ratio: float) -> Finding:
    half = 0.5 / log.step
    place = corner(ratio)
    where = "" if place is None else f" with its corner near {place * half:.2g} Hz"
    evidence: dict[str, float] = {"ratio": ratio}
    if place is not None:
        evidence["corner"] = place * half
    return finding(
        "band_limit",
        "note",
        name,
        f"{log.name}: the noise of {name} at rest falls by {10.0 * np.log10(ratio):.0f} dB from "
        f"{np.mean(LOW) * half:.3g} to {np.mean(HIGH) * half:.3g} Hz: a low-pass filter{where}. "
        "Neighbouring samples are not independent; means of rests and `inertiax noise` allow for it.",
        remedy=None,
        **evidence,
    )
