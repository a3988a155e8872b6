"""Turns through a known angle by hand: only the mean rate over the whole turn is known.

A rate table holds its rate; a hand starts, hurries and stops. What is known of such a turn is its angle, so
that its mean rate is angle / duration and the reference rate of the recording says that mean. The motion
within it is no noise of that mean, which has the gyros' own noise and the uncertainty of the angle.
"""

import numpy as np
from jaxtyping import Bool, Float


ANGLE_UNCERTAINTY = np.deg2rad(1.0)  # 1 sigma: a housing turned by hand against a straight edge
_UNSTEADY = 0.2  # of the reference rate; a table's plateau is steadier by far
_ABOVE_NOISE = 10.0  # times the noise at rest, so that a slow plateau of a noisy gyro is none


def turned_by_hand(
    spread: Float[np.ndarray, " dwell"],
    reference: Float[np.ndarray, "dwell 3"],
    resting: Bool[np.ndarray, " dwell"],
) -> Bool[np.ndarray, " dwell"]:
    """Which dwells are turns whose rate (rad/s) varies by a fifth of its constant reference or more,
    and by far more than the noise at rest. None where nothing rests.

    **Arguments:** `spread` is the mean square distance of a dwell's rates from their mean, (rad/s)²; `reference` the
    mean of the reference rate.
    """
    if not resting.any():
        return np.zeros(len(spread), bool)
    size = np.linalg.norm(reference, axis=1)
    least = np.maximum(_UNSTEADY * size, _ABOVE_NOISE * np.sqrt(np.median(spread[resting])))
    return ~resting & (size > 0) & (np.sqrt(spread) > least)


def with_known_angles(
    covariance: Float[np.ndarray, "dwell 3 3"],
    duration: Float[np.ndarray, " dwell"],
    turns: Bool[np.ndarray, " dwell"],
    resting: Bool[np.ndarray, " dwell"],
    angle: float = ANGLE_UNCERTAINTY,
) -> Float[np.ndarray, "dwell 3 3"]:
    """Covariances of mean rates, (rad/s)², those of the turns replaced by N² / T + (σ_angle / T)².

    `angle` is σ_angle, rad. N² is the angle random walk that the rests' covariances imply.
    """
    if not turns.any():
        return covariance
    walk = np.mean(covariance[resting] * duration[resting, None, None], axis=0)
    t = duration[turns, None, None]
    result = covariance.copy()
    result[turns] = walk / t + (angle / t) ** 2 * np.eye(3)
    return result
