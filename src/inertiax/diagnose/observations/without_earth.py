"""What a calibration takes away of Earth's rate, from the gyros of a log's rests."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...data.recording import Recording, Site
from ...reduction.dwell_means import reduce_to_dwells
from ...reduction.earth_at_rest import shown_by_dwells, vertical_earth_rate
from ...reduction.segments import Segments


def earth_taken_away(
    recordings: Sequence[Recording], segments: Sequence[Segments], site: Site
) -> Float[np.ndarray, "time 3"] | None:
    """What `without_vertical_earth_rate` takes away from the gyros at rest, rad/s; `None` where that is nothing.

    A reference holds Earth's rate in the rows of all models, of gravity's rotation as well. Where the gyros show none
    of it nothing is taken. That is told by the dwells of `calibrate`: means of other rows would be near its limit on
    the other side in some logs, and what is judged would not be what was calibrated.
    """
    if site.latitude is None:
        return None
    made, first = np.zeros((sum(r.num_samples for r in recordings), 3)), 0
    rows, force = [], []
    for recording, part in zip(recordings, segments, strict=True):
        if recording.reference_gyro is None and recording.accel is not None:
            for a, b in zip(part.start[part.resting], part.stop[part.resting], strict=True):
                rows.append((first + a, first + b))
                force.append(recording.accel[a:b].mean(axis=0))
        first += recording.num_samples
    if not rows:
        return None
    if all(r.gyro is not None for r in recordings):
        shown = shown_by_dwells(reduce_to_dwells(recordings, segments=segments), site)
        if shown is not None and shown.absent:
            return None
    vertical = vertical_earth_rate(np.array(force), site)
    for (a, b), rate in zip(rows, vertical, strict=True):
        made[a:b] = rate
    return made if made.any() else None
