"""Whether gyros show the Earth's rate that the latitude says, in the poses in which they lie still."""

import math

import numpy as np
from jaxtyping import Float

from ..data.recording import Site
from ..physics.wgs84 import EARTH_RATE
from ..reduction.dwell_means import reduce_to_dwells
from ..reduction.earth_at_rest import rounding_hides_earth, shown_by_dwells
from ..reduction.segments import each_without_disturbances
from ..reduction.shown_earth_rate import FAR, FEWEST, shown_earth_rate
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


def check_earth_shown(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """A note where the Earth's rate along the vertical is not in the gyros' means, as where a driver has taken those
    away: then it is not taken from them again. By the dwells of `calibrate`, so that both say the same near the limit.
    See `reduction.shown_earth_rate`."""
    del limits
    logs = [
        log for log in device.logs
        if log.recording.gyro is not None and log.recording.accel is not None
        and log.recording.reference_gyro is None and log.num_rests and not log.turning
    ]  # fmt: skip
    site = device.site
    if site.latitude is None or not logs or "gyro" in device.left_alone:
        return []
    found = [log.found for log in logs if log.found is not None]
    if len(found) < len(logs) or sum(log.num_rests for log in logs) < FEWEST:
        return []
    if _is_clearly_there(logs, site):
        return []
    recordings = [log.recording for log in logs]
    segments = each_without_disturbances(recordings, found, held=True)
    try:
        dwells = reduce_to_dwells(recordings, segments=segments)
    except ValueError:  # nothing is left of the rests, or their columns differ
        return []
    shown, rests = shown_by_dwells(dwells, site), int((dwells.position >= 0).sum())
    if shown is None or not shown.absent or rounding_hides_earth(dwells, recordings, site):
        return []
    return [finding("earth_rate", "note", "gyro", _text(logs[0].name, site, shown.part, shown.std, rests),
                    part=shown.part, std=shown.std, rests=rests)]  # fmt: skip


def _is_clearly_there(logs: list[Log], site: Site) -> bool:
    """Whether means over all rows show the rate already, which saves the dwells: knocks add scatter to them, and no
    rate that goes with the direction of gravity."""
    means = lambda triad: np.concatenate([m.mean for log in logs if (m := log.over_rests(triad))])
    count = np.concatenate([log.stop - log.start for log in logs])
    shown = shown_earth_rate(means("gyro"), means("accel"), count, site, _temperature(logs))
    return shown is not None and 0.0 < shown.part - FAR * shown.std


def _temperature(logs: list[Log]) -> Float[np.ndarray, " rest"] | None:
    """The first probe's means over the rests, °C; `None` where a recording has none."""
    made = []
    for log in logs:
        if log.recording.temperature is None:
            return None
        probe = log.recording.temperature[:, 0]
        made += [probe[a:b].mean() for a, b in zip(log.start, log.stop, strict=True)]
    return np.array(made)


def _text(name: str, site: Site, part: float, std: float, rests: int) -> str:
    assert site.latitude is not None
    expected = 3600.0 * math.degrees(EARTH_RATE * math.sin(site.latitude))
    return (
        f"{name}: the gyros' means in {rests} rests show {part:.2f} ± {std:.2f} of Earth's rate along the vertical, "
        f"{expected:.1f} °/h by [site] latitude: outputs from which a driver took it with the mean at rest, or another "
        "latitude. It is not taken away from them."
    )
