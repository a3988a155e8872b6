"""A bench that shakes the device at all rests: a line in the spectrum of the accelerometers that outweighs their noise.

Fans, pumps and motors shake at one frequency. The mean of a rest averages that, but its scatter is then no noise of the
sensor's, and rectification by curvatures or a clipped range changes the mean itself. Power is summed over the axes,
since a direction of the room is another one in each pose, and the median over many short spectra passes over knocks.
"""

import numpy as np

from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .rest_windows import parts_of_rests
from .thresholds import Thresholds


WINDOW = 128  # samples of one spectrum
FEWEST = 30  # spectra; with three axes each the noise of a bin is known to a seventh, a line has 20 times as much
BESIDE = 3  # bins on either side that a line fills: two by the window, one where it is between two
AROUND = 10  # bins on either side in which the noise is seen
LOWEST = BESIDE + 2  # bins: a line needs noise on its lower side, or it is not told from slow noise
# Hz, of rests that nobody labelled: hands tremble at 6 to 12 Hz, and their rests are no bench's.
TREMOR = 15.0


def check_bench_vibration(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """A note for each recording in most of whose rests the accelerometers shake by more than their noise."""
    found = []
    for log in device.logs:
        line = None if log.turning else _line(log, limits)
        if line is not None:
            found.append(_told(log, *line))
    return found


def _line(log: Log, limits: Thresholds) -> tuple[float, float, float] | None:
    """Frequency (Hz) and rms (m/s², all axes together) of a line, and the rms of the noise beside it; `None`: none."""
    values = log.recording.accel
    if values is None:
        return None
    parts = parts_of_rests(log, values, WINDOW, FEWEST)
    if parts is None:
        return None
    window = np.hanning(WINDOW)[:, None]
    shape = np.abs(np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2
    # Of one side, to the variance that each frequency has.
    power = 2.0 * np.median(shape.sum(axis=2), axis=0) / (WINDOW * np.sum(window**2))
    peak = LOWEST + int(np.argmax(power[LOWEST:]))
    band = power[peak - BESIDE : peak + BESIDE + 1]
    # On the louder side: the noise of a filter or a flicker rises towards low frequencies, and has no line.
    sides = power[max(peak - AROUND, 1) : peak - BESIDE], power[peak + BESIDE + 1 : peak + AROUND]
    floor = max(float(np.median(side)) for side in sides if len(side))
    line, rest = float(np.sum(band - floor)), float(np.sum(power[1:]) - np.sum(band - floor))
    frequency = peak / (WINDOW * log.step)
    low = not log.labelled and frequency < TREMOR
    sharp = power[peak] > limits.line_over_floor * floor > 0.0
    if low or not sharp or line < limits.line_over_noise**2 * rest:
        return None
    return frequency, float(np.sqrt(line)), float(np.sqrt(rest))


def _told(log: Log, frequency: float, rms: float, noise: float) -> Finding:
    return finding(
        "vibration",
        "note",
        "accel",
        f"{log.name}: the bench vibrates: in most rests the accelerometers shake by {rms:.2g} m/s² rms at about "
        f"{frequency:.3g} Hz, or at a frequency above half the sampling rate that looks like it, beside a noise of "
        f"{noise:.2g} m/s². Set the device on something heavy and soft, away from fans and motors; rests average it, "
        "and curvatures of the sensors do not.",
        frequency=frequency,
        rms=rms,
        noise=noise,
    )
