"""Both triads of a log, or of two, on one clock and still in their own units."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..data.formats import imu_tk
from ..data.pairing import pair
from ..data.recording import Recording
from .clock import ALL_UNITS, Clock, clock_of
from .column_roles import Roles, roles_of
from .devices_in_rows import of_first_device, with_devices
from .raw_log import as_text, RawLog, read_log, read_logs, unnamed
from .settings_rows import without_settings
from .vectornav import vectornav


_LISTED = 4  # lengths in an error


# Of the stamps: a clock that stands still more often is coarse, and rows that are equal may be samples (convention).
_AGAIN = 0.2


# Of the longer of two files that nobody named together, the share of time that both cover: an app begins and ends its
# files within a second or two, and recordings made one after the other have lengths of their own (convention).
_TOGETHER = 0.9


class RawTriads(NamedTuple):
    """Outputs on one clock, in the file's units."""

    log: RawLog
    roles: Roles
    clock: Clock
    gyro_log: RawLog | None  # where the gyros have a file of their own
    gyro_roles: Roles | None
    seconds: Float[np.ndarray, " time"]
    accel: Float[np.ndarray, "time 3"] | None
    gyro: Float[np.ndarray, "time 3"] | None
    gyro_time: str | None = None  # the stamps of the gyros' file, where it calls them otherwise
    beside: str | None = (
        None  # what is said of a gyros' file that lay beside the log and was not asked for
    )

    @property
    def gyro_columns(self) -> tuple[str, str, str] | None:
        """Names of the gyros' columns in the file that holds them."""
        return self.roles.gyro if self.gyro_roles is None else self.gyro_roles.gyro

    @property
    def turning(self) -> Float[np.ndarray, " time"]:
        """How fast the device turns: the size of the gyros' outputs less their medians, in the file's unit.

        Raises `ValueError` without gyros.
        """
        if self.gyro is None:
            raise ValueError(f"{self.log.path}: no gyros, which tell how fast it turns.")
        return np.linalg.norm(self.gyro - np.median(self.gyro, axis=0), axis=1)

    @property
    def gyro_words(self) -> str:
        """What the file says in words of the gyros' columns."""
        log = self.log if self.gyro_log is None else self.gyro_log
        return " ".join(log.hint(n) for n in self.gyro_columns or ())

    @property
    def accel_words(self) -> str:
        """What the file says in words of the accelerometers' columns."""
        return " ".join(self.log.hint(n) for n in self.roles.accel or ())


def read_triads(path: Path, gyro_path: Path | None) -> RawTriads:
    """Both triads. Raises `ValueError` where a file holds none, or triads were not logged at the same time."""
    log = _with_a_triad(path)
    if gyro_path is None:
        return _with_what_lies_beside(path, log)
    return _read(path, log, gyro_path)


def _with_what_lies_beside(path: Path, log: RawLog) -> RawTriads:
    """The log with the gyros' file beside it, where that is of the same recording; else alone, with the reason."""
    other = gyros_beside(path, log)
    if other is None:
        return _read(path, log, None)
    try:
        found = _read(path, log, other, asked=False)
    except ValueError as error:  # what lies beside it is no part of this log
        why = str(error).removesuffix(".")
        remark = f'Not read: "{other.name}" beside it. {why}. `init {path.name} --gyro {other.name}` takes it.'
        return _read(path, log, None)._replace(beside=remark)
    remark = (
        f'The gyros are those of "{other.name}" beside it. If that is another recording, take gyro_files, gyro_names '
        "and [columns] gyro out of campaign.toml."
    )
    return found._replace(beside=remark)


def _with_a_triad(path: Path) -> RawLog:
    """The columns of a file; of several lengths, as of a body sensor's heart beats and accelerations, the first that
    has a triad among them.

    Raises `ValueError` where several lengths have none.
    """
    first, *others = read_logs(path)
    if not others:
        return without_settings(first)
    refused, taken, further = None, None, []
    for log in (first, *others):
        try:
            roles = roles_of(log)
        except ValueError as error:
            refused = refused or error
            continue
        if taken is None:
            taken = log
        elif triad := roles.accel or roles.gyro or roles.mag:
            further.append(f"{triad[0]} ({_rows(log)} rows)")
    if taken is not None:
        return taken._replace(aside=tuple(further))
    shown = "; ".join(f"{_rows(x)} rows: {', '.join(x.names[:3])}" for x in others[:_LISTED])
    raise ValueError(
        f"{str(refused).removesuffix('.')}. Columns of other lengths are no triads either ({shown})."
    )


def _rows(log: RawLog) -> int:
    return len(next(iter(log.numbers.values())))


def _read(path: Path, log: RawLog, gyro_path: Path | None, *, asked: bool = True) -> RawTriads:
    """Both triads; a gyros' file that nobody `asked` for has to show that it is of the same recording."""
    roles = roles_of(log, None if gyro_path is None else "accel")
    # The format's own reader takes one file for accelerometers.
    if log.format == imu_tk.NAME and roles.accel is None:
        log = as_text(log)
        roles = roles_of(log)
    roles = with_devices(log, roles)
    sentence = vectornav(log)
    log = log if sentence is None else log._replace(words=sentence.units)
    log = _samples(of_first_device(log, roles.device), roles)
    accel, gyro = columns(log, roles.accel), columns(log, roles.gyro)
    clock = clock_of(log, roles.time, _rows(log), roles.temperature, accel)
    if gyro_path is None:
        found = RawTriads(log, roles, clock, None, None, clock.seconds, None, None)
        return in_rows(found, clock.seconds, accel, gyro)
    other = read_log(gyro_path)
    other_roles = roles_of(other, "gyro")
    other_clock = clock_of(other, other_roles.time, _rows(other), other_roles.temperature)
    named_otherwise = log.has_header and clock.name not in (None, *other.stamps, *other.names)
    if named_otherwise and (other_clock.name is None or other_clock.unit != clock.unit):
        raise ValueError(
            f"{gyro_path.name}: has no column {clock.name!r}, the stamps of {path.name}, and none in their unit; write "
            "both files with stamps of one clock and one unit."
        )
    gyro = columns(other, other_roles.gyro)
    assert accel is not None and gyro is not None
    first = Recording(time=absolute(log, clock), accel=accel, name=path.name)
    second = Recording(time=absolute(other, other_clock), gyro=gyro, name=gyro_path.name)
    if not asked:
        _require_one_recording(first, second, counted=None in (clock.name, other_clock.name))
    both = pair(first, second, counted=clock.name is None).recording
    own = other_clock.name if named_otherwise else None
    return RawTriads(log, roles, clock, other, other_roles, both.time, both.accel, both.gyro, own)


def _require_one_recording(accel: Recording, gyro: Recording, *, counted: bool) -> None:
    """Raises `ValueError` where two files do not show by their stamps that they were written together."""
    if counted:
        raise ValueError(
            "Without stamps in both files nothing shows that they were logged together."
        )
    ends = [(r.time[0], r.time[-1]) for r in (accel, gyro)]
    both = min(last for _, last in ends) - max(first for first, _ in ends)
    if both < _TOGETHER * max(last - first for first, last in ends):
        said = " and ".join(f"{first:.6g} to {last:.6g} s" for first, last in ends)
        raise ValueError(f"The two files are not of the same time ({said}).")


def _samples(log: RawLog, roles: Roles) -> RawLog:
    """The rows that are samples, as the reader keeps them (`formats.kept_rows`).

    Rows without a number of a triad are another sensor's or a filter's, whose stamps need not be in order with these;
    others are the row before, written again.
    """
    names = (*(roles.accel or ()), *(roles.gyro or ()))
    if not names:
        return log
    rows = np.any([np.isfinite(log.numbers[n]) for n in names], axis=0)
    if not rows.any():
        return log
    log = _only(log, rows)
    stamps = None if roles.time is None else (log.stamps | log.numbers)[roles.time]
    if stamps is None or len(stamps) < 2:
        return log
    again = np.diff(stamps) == 0.0
    if not again.any() or again.mean() > _AGAIN:
        return log
    for name in names:
        again &= np.diff(log.numbers[name]) == 0.0
    return _only(log, np.r_[True, ~again])


def _only(log: RawLog, rows: Bool[np.ndarray, " rows"]) -> RawLog:
    if rows.all():
        return log
    only = lambda columns: {n: v[rows] for n, v in columns.items()}
    return log._replace(numbers=only(log.numbers), stamps=only(log.stamps), labels=only(log.labels))


def in_rows(
    found: RawTriads,
    seconds: Float[np.ndarray, " rows"],
    accel: Float[np.ndarray, "rows 3"] | None,
    gyro: Float[np.ndarray, "rows 3"] | None,
) -> RawTriads:
    """The triads in those rows in which both have numbers."""
    rows = np.ones(len(seconds), bool)
    for x in (accel, gyro):
        rows &= True if x is None else np.isfinite(x).all(axis=1)
    only = lambda x: None if x is None else x[rows]
    return found._replace(seconds=seconds[rows], accel=only(accel), gyro=only(gyro))


def given_names(log: RawLog, roles: Roles) -> tuple[str, ...] | None:
    """Canonical names for the columns of a file without a header line, `None` where it has its own."""
    if log.has_header or log.format == "imu_tk":
        return None
    new = {} if roles.time is None else {roles.time: "time"}
    new |= {} if roles.device is None else {roles.device: "device"}
    for key, triad in (("accel", roles.accel), ("gyro", roles.gyro), ("mag", roles.mag)):
        new |= {} if triad is None else {n: f"{key}_{a}" for n, a in zip(triad, "xyz", strict=True)}
    assert log.layout is not None  # only a text has no names of its own
    return tuple(new.get(n, n) for n in unnamed(log.layout.width))


def absolute(log: RawLog, clock: Clock) -> Float[np.ndarray, " rows"]:
    """Seconds since the file's own zero, so that two files agree."""
    if clock.name is None or clock.name in log.stamps:
        return clock.seconds
    assert clock.unit is not None  # of numbers it is told, or they are no stamps
    # The seconds may be mended: a clock that begins anew goes on behind what was before.
    return ALL_UNITS[clock.unit] * log.numbers[clock.name][0] + clock.seconds - clock.seconds[0]


def columns(log: RawLog, names: tuple[str, str, str] | None) -> Float[np.ndarray, "rows 3"] | None:
    """Three columns side by side, in the file's units."""
    return None if names is None else np.stack([log.numbers[n] for n in names], axis=1)


def gyros_beside(path: Path, log: RawLog) -> Path | None:
    """The gyros' file beside one that holds the accelerometers alone: `gyroscope.txt` beside `accelerometer.txt`.

    Raises `ValueError` where the log holds no triad.
    """
    if "acc" not in path.stem.lower() or roles_of(log).gyro is not None:
        return None
    for word, others in (
        ("totalacceleration", ("gyroscope",)), ("accelerometer", ("gyroscope", "gyro")),
        ("acceleration", ("gyroscope",)), ("accel", ("gyro",)), ("acc", ("gyro", "gyr")),
    ):  # fmt: skip
        for other in others:
            for made in (other, other.capitalize()):
                file = path.with_name(_replaced(path.name, word, made))
                if file != path and file.is_file():
                    return file
    return None


def _replaced(name: str, word: str, other: str) -> str:
    place = name.lower().find(word)
    return name if place < 0 else name[:place] + other + name[place + len(word) :]
