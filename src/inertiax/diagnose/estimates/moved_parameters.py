"""How far the named effects move the parameters of the calibration that is written."""

import numpy as np

from ...calibration.calibration import Calibration
from ...calibration.quantities import middle_temperature
from ..result import Moved


def moved_between(before: Calibration, after: Calibration) -> tuple[Moved, ...]:
    """Parameters at mid temperature that two calibrations of one campaign have by more than a sigma of the second
    apart, the largest shifts first."""
    at = np.array([middle_temperature(after)])
    made: list[Moved] = []
    for first, second in ((before.accel, after.accel), (before.gyro, after.gyro)):
        if first is None or second is None:
            continue
        (old,), _ = first.over(at)
        (new,), (std,) = second.over(at)
        known = dict(zip(first.names, np.asarray(old).tolist(), strict=True))
        made += [
            Moved(name, known[name], float(value), float(sigma))
            for name, value, sigma in zip(second.names, new, std, strict=True)
            if name in known
        ]
    shift = lambda m: abs(m.after - m.before) / max(m.std, 1e-300)
    return tuple(m for m in sorted(made, key=lambda m: -shift(m)) if shift(m) > 1.0)
