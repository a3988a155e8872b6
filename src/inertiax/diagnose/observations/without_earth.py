"""The gyros of a log without what the calibration takes away of Earth's rate at rest."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...data.recording import Campaign, Recording
from ...reduction.earth_at_rest import is_told_beside_gravity, vertical_earth_rate
from ...reduction.segments import Segments


def without_earth(
    gyro: Float[np.ndarray, "time 3"],
    recordings: Sequence[Recording],
    segments: Sequence[Segments],
    campaign: Campaign,
) -> Float[np.ndarray, "time 3"]:
    """Gyros whose rests are without what the calibration takes away of Earth's rate (`without_earth_rate`)."""
    gyro, first = gyro.copy(), 0
    all_of_it = is_told_beside_gravity(campaign)
    for recording, part in zip(recordings, segments, strict=True):
        known = recording.reference_gyro
        rests = zip(part.start[part.resting], part.stop[part.resting], strict=True)
        for a, b in rests:
            if known is not None and all_of_it:
                gyro[first + a : first + b] -= known[a:b].mean(axis=0)
            elif known is None and recording.accel is not None:
                force = recording.accel[a:b].mean(axis=0)[None]
                gyro[first + a : first + b] -= vertical_earth_rate(force, campaign.site)
        first += recording.num_samples
    return gyro
