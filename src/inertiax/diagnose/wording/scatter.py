"""What dwells and recordings still differ by where nothing more is named: said, since a diagnosis takes it as noise."""

import math

from ...calibrate.goodness_of_fit import LIMITS
from ...calibrate.level_by_recording import level_words
from ...calibrate.results import DeviceResult
from ...calibration.quantities import rms_text


TRIADS = {"accel": "accelerometers", "gyro": "gyros"}


def scatter_sentence(result: DeviceResult) -> str:
    """One sentence for each triad whose recordings' biases differ, as `calibrate` says it, or whose dwells differ by
    far more than their noise, by its limit.

    **Arguments:** the calibration that is written, beside named effects if there are any.
    """
    said = []
    levels = level_words(result, float(result.calibration.gravity))
    for triad, name in TRIADS.items():
        estimate = getattr(result, triad)
        if estimate is None:
            continue
        if triad in levels:
            said.append(f"Taken as noise: {levels[triad]}.")
            continue
        ratio = math.sqrt(estimate.chi2_per_dof)
        if ratio >= LIMITS.noise_ratio:  # not where the noise is unknown
            left = rms_text(estimate.misfit_unit, estimate.rms)
            said.append(
                f"The {name}' dwells still differ by {left} rms, {ratio:.1f} times their noise, in a way that nothing "
                "catalogued follows: it counts as scatter, drawn anew for each dwell, and its cause is not known."
            )
    return " ".join(said)
