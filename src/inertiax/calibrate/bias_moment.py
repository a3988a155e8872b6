"""Of what moment a bias' interval speaks, in words, where the device wanders during its log."""

import numpy as np

from ..calibration.quantities import rms_text
from .mean_output import told_of_the_sensor
from .results import TriadResult
from .slow_noise import of_one_log, wander


_LIKELY = 0.5  # probability of slow noise from which it is said; more likely than not
_NAMES = {"accel": "accelerometers", "gyro": "gyros"}
_UNITS = {"accel": "m/s^2", "gyro": "rad/s"}
_OF_LOG = (
    "; the intervals of the biases are those of their mean over this log, at whose end a bias is off by {} (1 sigma); "
    "later, and after the next switching on, it may be off by more"
)
_OF_DEVICE = (
    ", by {} (1 sigma); the intervals of the biases are those of the device beside such slow noise, and wider than of "
    "the mean over these experiments"
)
_OF_REST = (
    "{}: the output wanders within the one rest; the intervals of the biases hold what it differs by from one stretch "
    "of this length to the next, {} (1 sigma); after the next switching on it may be off by more"
)


def moment_words(result: TriadResult | None) -> tuple[str, ...]:
    """One sentence where dwells more likely than not err alike, or their only one wanders; none else."""
    result = told_of_the_sensor(result)
    if result is None:
        return ()
    within = result.dwells.wander
    if within is not None:
        triad = result.estimator.triad
        own = np.asarray(within)[0, :3] if triad == "accel" else np.asarray(within)[0, 3:]
        size = float(np.max(own))
        return (_OF_REST.format(_NAMES[triad], rms_text(_UNITS[triad], size)),) if size else ()
    if result.slow_noise.probability < _LIKELY:
        return ()
    triad, rows = result.estimator.triad, result.fitted
    size = wander(result.dwells if rows is None else rows, result.estimator, result.slow_noise)
    moment = _OF_LOG if of_one_log(result.dwells) else _OF_DEVICE
    said = moment.format(rms_text(_UNITS[triad], size))
    return (f"{_NAMES[triad]}: dwells that follow one another err alike{said}",)
