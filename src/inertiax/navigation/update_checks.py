"""Plausibility of what is measured beside the IMU, where the numbers are known."""

import numpy as np
from jaxtyping import Bool, Float

from ..physics.leaves import is_traced
from .checks import check_near
from .level_frame import LevelFrame
from .updates import AbstractUpdate, Position


# Of a degree: fixes of a whole run that stay as close as this to the origin's latitude are latitudes. A level frame
# reaches less far, and a device that moves leaves as many metres.
NEAR_LATITUDE = 0.2


def check_update(update: AbstractUpdate, frame: LevelFrame) -> None:
    """Raise `ValueError` for a standard deviation that is not above zero, for a gate that is not, for rows that are no
    numbers, and for positions that are no metres in the level frame, but degrees or Earth-centred."""
    name = type(update).__name__
    valid = None if update.valid is None or is_traced(update.valid) else np.asarray(update.valid)
    if not is_traced(update.sigma):
        sigma = np.asarray(update.sigma)
        if valid is not None and sigma.ndim == 2 and len(sigma) == len(valid):
            sigma = sigma[valid]
        if not np.all(sigma > 0.0):
            raise ValueError(
                f"`{name}(sigma=...)` is {np.min(sigma):g}; it must be above 0: nothing is measured exactly."
            )
    if update.gate is not None and not is_traced(update.gate) and not float(update.gate) > 0.0:
        raise ValueError(
            f"`{name}(gate=...)` is {float(update.gate):g}; it must be above 0, for no innovation's square is below: "
            "16.3 leaves out one of a thousand good ones of three components."
        )
    if valid is not None and np.shape(valid) != np.shape(update.value)[:1]:
        raise ValueError(
            f"`{name}(valid=...)` has shape {np.shape(valid)}; it must be {np.shape(update.value)[:1]}."
        )
    if not is_traced(update.value) and (update.valid is None or valid is not None):
        _check_numbers(name, np.asarray(update.value, float), valid)
    if isinstance(update, Position) and not is_traced(update.value):
        fixes = np.asarray(update.value)
        if valid is not None and len(fixes) == len(valid):
            fixes = fixes[valid]
        check_near("Position(value=...)", fixes)
        if not is_traced(frame.latitude):
            _check_metres(fixes, float(frame.latitude))


def _check_numbers(
    name: str, values: Float[np.ndarray, "..."], valid: Bool[np.ndarray, " segments"] | None
) -> None:
    """Raise `ValueError` for a row that counts and is no number: it would make all that comes after none."""
    wrong = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    if valid is not None and valid.shape == wrong.shape:
        wrong &= valid
    if wrong.any():
        raise ValueError(
            f"`{name}(value=...)`: row {int(np.argmax(wrong))} is not a finite number; give `valid`, false in rows "
            f"without measurement."
        )


def _check_metres(fixes: Float[np.ndarray, "fixes 3"], latitude: float) -> None:
    """Whether a horizontal component is the origin's latitude throughout."""
    if len(fixes) < 2 or fixes.ndim != 2:
        return
    for unit, one in (("degrees", np.rad2deg(1.0)), ("radians", 1.0)):
        away = np.max(np.abs(fixes[:, :2] - one * latitude), axis=0)
        close = away < NEAR_LATITUDE * np.deg2rad(one)
        if close.any() and abs(latitude) > np.deg2rad(1.0):
            at = fixes[0, int(np.argmax(close))]
            raise ValueError(
                f"`Position(value=...)` stays at {at:.6g}, which is the origin's latitude in {unit}; positions are "
                f"metres east, north and up of `LevelFrame`'s origin."
            )
