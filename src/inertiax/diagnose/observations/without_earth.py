"""What a calibration takes away of Earth's rate, from the gyros of a log's rests."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...data.recording import Recording, Site
from ...reduction.earth_at_rest import vertical_earth_rate
from ...reduction.segments import Segments


def earth_taken_away(
    recordings: Sequence[Recording], segments: Sequence[Segments], site: Site
) -> Float[np.ndarray, "time 3"] | None:
    """What `without_vertical_earth_rate` takes away from the gyros at rest, rad/s; `None` where that is nothing.

    A reference holds Earth's rate in the rows of all models, of gravity's rotation as well.
    """
    made, first = np.zeros((sum(r.num_samples for r in recordings), 3)), 0
    for recording, part in zip(recordings, segments, strict=True):
        if recording.reference_gyro is None and recording.accel is not None:
            for a, b in zip(part.start[part.resting], part.stop[part.resting], strict=True):
                force = recording.accel[a:b].mean(axis=0)[None]
                made[first + a : first + b] = vertical_earth_rate(force, site)
        first += recording.num_samples
    return made if made.any() else None
