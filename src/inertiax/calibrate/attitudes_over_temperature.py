"""Whether a campaign shows its temperatures in one attitude only, and its attitudes at one temperature."""

import numpy as np

from ..reduction.dwells import Dwells


SAME = np.deg2rad(15.0)  # between the directions of one attitude
FEWEST = 4  # further attitudes, from which a campaign is one of poses
WIDER = 3.0  # times the range of the poses, from which the one attitude tells the temperature alone
ENOUGH = 200  # rests, about which others are counted
LEAST = 5.0  # °C, of which it must be wider
_ONE = "the device stands in one attitude only"


def one_attitude_over_temperature(dwells: Dwells) -> str | None:
    """A remark, where most of the temperatures were recorded in one attitude beside poses at about one temperature."""
    if dwells.accel is None or dwells.temperature is None:
        return None
    rest = np.asarray(dwells.position) >= 0
    force, probe = np.asarray(dwells.accel)[rest], np.asarray(dwells.temperature)[rest]
    if len(force) < FEWEST + 2:
        return None
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    alike = up[:: max(len(up) // ENOUGH, 1)] @ up.T > np.cos(SAME)
    spans = [np.ptp(probe[mine]) for mine in alike]
    mine = alike[int(np.argmax(spans))]
    if (~mine).sum() < FEWEST:
        return None
    low, high = float(probe[~mine].min()), float(probe[~mine].max())
    if max(spans) < max(WIDER * (high - low), high - low + LEAST):
        return None
    return (
        f"from {probe[mine].min():.0f} to {probe[mine].max():.0f} °C {_ONE}, and its "
        f"other attitudes are from {low:.0f} to {high:.0f} °C: what scale factors and misalignments do with "
        "temperature does not show. Calibrate the two as campaigns of their own and join them "
        "(`inertiax export --warm-up`), or record the attitudes at several temperatures."
    )


def is_of_one_attitude(warning: str) -> bool:
    """Whether a warning is the remark of `one_attitude_over_temperature`."""
    return _ONE in warning
