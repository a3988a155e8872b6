"""How far the gyros' biases differ from recording to recording: another day or switching on has a level of its own.

The rests' means less what the fit says of them have a mean and a standard error in each recording. Where these means
differ by more than rests of one recording do, their standard deviation between recordings (Paule and Mandel) is how
far the bias of one switching on is from the stated one, whose interval is that of the mean over the recordings.
"""

import numpy as np
from jaxtyping import Float

from ..calibration.quantities import DEG_PER_HOUR
from ..numerics.paule_mandel import excess_deviation
from ..physics.error_model import GyroErrors
from .results import TriadResult


_FEWEST = 3  # rests of a recording that tell its level and scatter
_FAR = 4.0  # standard errors between two recordings; chance has it in 6 of 100 000 pairs of an axis


def level_words(gyro: TriadResult | None, gravity: float) -> str | None:
    """In words how far the gyros' biases differ between recordings; `None` where no more than by chance."""
    found = None if gyro is None else levels(gyro, gravity)
    if found is None:
        return None
    level, error = found
    apart = np.abs(level[:, None] - level[None]) / np.hypot(error[:, None], error[None])
    if apart.max() < _FAR:
        return None
    between = [excess_deviation(level[:, k] - level[:, k].mean(), error[:, k], 1) for k in range(3)]
    sizes = ", ".join(f"{DEG_PER_HOUR * s:.3g}" for s in between)
    return (
        f"gyros: the biases of the {len(level)} recordings differ by {sizes} °/h in x, y, z (1 sigma between "
        "recordings), as each day or switching on has a bias of its own; the stated bias and its interval are those of "
        "their mean, and the bias of one switching on is that far from it"
    )


def levels(
    gyro: TriadResult, gravity: float
) -> tuple[Float[np.ndarray, "recording 3"], Float[np.ndarray, "recording 3"]] | None:
    """Each recording's mean of the rests' outputs less the fit, and its standard error, rad/s; `None` for one.

    **Arguments:** `gravity` in m/s², which makes g-sensitivity's force dimensionless.
    """
    dwells = gyro.dwells
    if dwells.rows is None or dwells.gyro is None:
        return None
    rest = np.asarray(dwells.position) >= 0
    number = np.asarray(dwells.rows)[:, 0]
    own = [rest & (number == k) for k in np.unique(number)]
    own = [rows for rows in own if rows.sum() >= _FEWEST]
    if len(own) < 2:
        return None
    curve = gyro.solution.curve
    left = np.empty(np.shape(dwells.gyro))
    for k, temperature in enumerate(np.asarray(dwells.temperature)):
        errors = gyro.estimator.unpack(curve(temperature))
        assert isinstance(errors, GyroErrors)
        known = np.asarray(errors.bias)
        if dwells.accel is not None:
            known = known + np.asarray(errors.g_sensitivity) @ np.asarray(dwells.accel)[k] / gravity
        if dwells.reference_gyro is not None:
            known = known + (np.eye(3) + np.asarray(errors.matrix)) @ dwells.reference_gyro[k]
        left[k] = np.asarray(dwells.gyro)[k] - known
    level = np.stack([left[rows].mean(axis=0) for rows in own])
    inside = np.concatenate([left[rows] - left[rows].mean(axis=0) for rows in own])
    degrees = len(inside) - len(own)
    scatter = np.sqrt(np.sum(inside**2, axis=0) / degrees)
    error = np.stack([scatter / np.sqrt(rows.sum()) for rows in own])
    return level, error
