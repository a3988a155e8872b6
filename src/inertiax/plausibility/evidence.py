"""What the checks look at: one device's recordings with their rests and the motions between them. NumPy only."""

import dataclasses
from collections.abc import Sequence
from typing import SupportsFloat

import numpy as np
from jaxtyping import Bool, Float, Int

from ..data.formats.columns import ColumnMap
from ..data.moments import moment
from ..data.recording import Campaign, NOT_CALIBRATED, Recording, Site
from ..data.settings import read_table
from ..reduction.rests import usual_step
from ..reduction.segments import segment, segment_each, Segments


_MOST_RESTS = 2000  # of one recording: more are labels that do not mean rests


@dataclasses.dataclass(frozen=True, eq=False)
class Means:
    """Means and standard deviations of a triad over segments, SI. One row a segment."""

    mean: Float[np.ndarray, "segment 3"]
    std: Float[np.ndarray, "segment 3"]  # of single samples


@dataclasses.dataclass(frozen=True, eq=False)
class Log:
    """One recording with its rests (and plateaus of constant rate, where a reference says so)."""

    recording: Recording
    start: Int[np.ndarray, " rest"]  # rows [start, stop) of each rest
    stop: Int[np.ndarray, " rest"]
    labelled: bool  # by the recording itself, not searched in its data
    plateau_start: Int[np.ndarray, " plateau"]
    plateau_stop: Int[np.ndarray, " plateau"]
    step: float  # s, the usual time from sample to sample
    turning: bool = False  # slowly all along: the rests are stretches of that
    ramps: float = 0.0  # s, of plateaus at whose ends the gyros still changed; left out
    found: Segments | None = None  # all of them as recorded, with what disturbs them
    known: dict[tuple[str, str], Means] = dataclasses.field(default_factory=dict)  # asked before

    @property
    def name(self) -> str:
        """What a statement calls the recording."""
        return self.recording.name or "the recording"

    def moment(self, seconds: SupportsFloat) -> str:
        """A moment on the recording's clock, in words."""
        return moment(float(seconds), float(self.recording.time[0]))

    @property
    def num_rests(self) -> int:
        """Length of `start`."""
        return len(self.start)

    @property
    def at_rest(self) -> Bool[np.ndarray, " time"]:
        """Rows of rests."""
        marks = np.zeros(self.recording.num_samples + 1, np.int64)
        np.add.at(marks, self.start, 1)
        np.add.at(marks, self.stop, -1)
        return np.cumsum(marks[:-1]) > 0

    def labels(self, column: str) -> Int[np.ndarray, " rest"] | None:
        """`position` or `experiment` of each rest; `None` where the recording has no such column."""
        values = getattr(self.recording, column)
        return None if values is None else values[self.start]

    def over_rests(self, column: str) -> Means | None:
        """Means of a triad over the rests, `None` where it was not recorded."""
        return self._means(column, "rest", self.start, self.stop)

    def over_plateaus(self, column: str) -> Means | None:
        """The same over plateaus of constant rate."""
        return self._means(column, "plateau", self.plateau_start, self.plateau_stop)

    def _means(
        self,
        column: str,
        over: str,
        start: Int[np.ndarray, " segment"],
        stop: Int[np.ndarray, " segment"],
    ) -> Means | None:
        if (column, over) not in self.known:
            values = getattr(self.recording, column)
            if values is None:
                return None
            self.known[column, over] = means(values, start, stop)
        return self.known[column, over]


@dataclasses.dataclass(frozen=True, eq=False)
class DeviceLogs:
    """One device's recordings, the place, and how the campaign maps columns."""

    logs: tuple[Log, ...]
    site: Site
    columns: ColumnMap
    device: str = ""
    left_alone: frozenset[str] = frozenset()  # triads that [model] does not calibrate
    azimuth: float = 0.0  # deg, of [table]
    delay: float | tuple[float, ...] = 0.0  # s, of [table]; of all files or of each
    drift: float | tuple[float, ...] | None = (
        None  # ppm; `None` where the table has no log of its own
    )

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """As given."""
        return tuple(log.recording for log in self.logs)


def means(
    values: Float[np.ndarray, "time 3"],
    start: Int[np.ndarray, " segment"],
    stop: Int[np.ndarray, " segment"],
) -> Means:
    """Mean and standard deviation over each range of rows."""
    made = np.empty((2, len(start), 3))
    for k, (a, b) in enumerate(zip(start.tolist(), stop.tolist(), strict=True)):
        made[0, k] = values[a:b].mean(axis=0)
        made[1, k] = values[a:b].std(axis=0)
    return Means(*made)


def look_at(
    campaign: Campaign, device: str, *, as_recorded: Sequence[Segments] | None = None
) -> DeviceLogs:
    """One device's recordings with their rests.

    **Arguments:** `device` is a serial number of the campaign; `as_recorded` are the segments of its recordings
    (`segment(..., handling=False)`), where they were found before.
    """
    recordings = campaign.of_device(device).recordings
    if as_recorded is None:
        as_recorded = segment_each(recordings, handling=False)
    # A campaign outlives its file, which only says how to write a remedy.
    file = campaign.path if campaign.path is not None and campaign.path.is_file() else None
    said = None if file is None else read_table(file)
    columns = ColumnMap() if said is None else said.columns
    logs = tuple(look_at_one(r, s) for r, s in zip(recordings, as_recorded, strict=True))
    asked = {"accel": campaign.model.accel_estimator, "gyro": campaign.model.gyro_estimator}
    left_alone = frozenset(triad for triad, name in asked.items() if name == NOT_CALIBRATED)
    azimuth, delay = (0.0, 0.0) if said is None else (said.table.azimuth or 0.0, said.table.delay)
    own = said is not None and said.recordings.table_files is not None
    drift = said.table.drift if said is not None and own else None
    return DeviceLogs(logs, campaign.site, columns, device, left_alone, azimuth, delay, drift)


def look_at_one(recording: Recording, found: Segments | None = None) -> Log:
    """A recording with its rests as recorded, for what disturbs them is looked for; without, where its labels do not
    mean rests."""
    found = segment(recording, handling=False) if found is None else found
    rests, plateaus = found.resting.copy(), ~found.resting
    if rests.sum() > _MOST_RESTS:
        rests &= np.arange(len(rests)) < _MOST_RESTS
    return Log(
        recording,
        found.start[rests],
        found.stop[rests],
        recording.position is not None or recording.reference_gyro is not None,
        found.start[plateaus],
        found.stop[plateaus],
        usual_step(recording),
        found.turning is not None,
        found.ramps,
        found,
    )
