r"""Lever arms of a table as those of the device alone.

On a table accelerometer i sits at $R_i$ from the point about which the table turns. Where the device was mounted there
is in all three arms alike, and is no property of the device; what they differ by is. The device's own place is the
point P from which no accelerometer is away along its own axis, $P_i = R_{ii}$. About it the arms are $R_{ij} - R_{jj}$
wherever the device was mounted, and a force that is compensated for these alone is the one at P.

A difference is taken for zero where a plan did not show both of its arms (an unseen one is held at exactly zero), or
where it is less than two of its standard deviations: the chips of most devices are a few millimetres apart, and a plan
about two axes shows no less than that.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .fitted_effects import FittedEffect
from .pytree import Calibration


EFFECT = "size_effect"
_SHOWN = 2.0  # standard deviations (convention)


class _Arms(NamedTuple):
    """By accelerometer and axis, m; of arms that several effects share, their sums."""

    arm: Float[np.ndarray, "3 3"]
    variance: Float[np.ndarray, "3 3"]
    seen: Bool[np.ndarray, "3 3"]


def place_on_table(calibration: Calibration) -> Float[np.ndarray, "3"] | None:
    """The device's own place P from the point about which the table turned, m, NaN along axes that were not shown.

    `None` without lever arms.
    """
    if not _are_there(calibration):
        return None
    arms = _arms(calibration)
    return np.where(np.diagonal(arms.seen), np.diagonal(arms.arm), np.nan)


def arms_not_shown(calibration: Calibration) -> str:
    """What the plan did not show of the arms themselves, as the end of a sentence; empty where it showed all."""
    arms = _arms(calibration)
    if arms.seen.all():
        return ""
    unseen = ", ".join(f"{'xyz'[k]} along {'xyz'[j]}" for k, j in np.argwhere(~arms.seen))
    sigma = 1e3 * math.sqrt(arms.variance[~arms.seen].max())
    return f", but for arms that no plateau showed, taken for 0 ± {sigma:.0f} mm: {unseen}"


def about_device(calibration: Calibration) -> Calibration:
    """The calibration with lever arms about the device's own place, see the module; without any where none differ.

    ```python
    import numpy as np
    import inertiax as ix
    from inertiax.calibration.device_place import about_device
    from inertiax.calibration.fitted_effects import FittedEffect

    arm = np.array([0.03, 0.02, 0.05])  # m: a chip on a table, all three accelerometers in one place
    effects = [FittedEffect("size_effect", "accel", (k,), (), arm, 1e-8 * np.eye(3), "m") for k in range(3)]
    print(about_device(ix.Calibration(gravity=9.81, effects=effects)).effects)    # ()
    ```
    """
    if not _are_there(calibration):
        return calibration
    arms = _arms(calibration)
    own, variance = np.diagonal(arms.arm), np.diagonal(arms.variance)
    away = arms.arm - own
    spread = arms.variance + variance
    told = arms.seen & np.diagonal(arms.seen) & (np.square(away) > _SHOWN**2 * spread)
    away = np.where(told & ~np.eye(3, dtype=bool), away, 0.0)
    models = {c: e for e in calibration.effects if e.name == EFFECT for c in e.channels}
    made = [
        replace(
            models[k],
            channels=(k,),
            coefficients=away[k],
            covariance=np.diag(np.where(away[k] != 0.0, spread[k], 0.0)),
        )
        for k in sorted(models)
        if np.any(away[k])
    ]
    others = [e for e in calibration.effects if e.name != EFFECT]
    return calibration.changed(effects=(*made, *others))


def _are_there(calibration: Calibration) -> bool:
    return any(e.name == EFFECT for e in calibration.effects)


def _arms(calibration: Calibration) -> _Arms:
    arms = _Arms(np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3), bool))
    for effect in calibration.effects:
        if effect.name == EFFECT:
            _add(arms, effect)
    return arms


def _add(arms: _Arms, effect: FittedEffect) -> None:
    values = np.asarray(effect.coefficients, float)
    for k in effect.channels:
        arms.arm[k] += values
        arms.variance[k] += np.diagonal(np.asarray(effect.covariance, float))
        arms.seen[k] |= values != 0.0
