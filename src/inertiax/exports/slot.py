"""Which of a flight controller's sensors a calibration is for: the slot in the names of its parameters."""

import re

import msgspec

from ..calibration.calibration import Calibration
from ..storage.wrong_value import WrongValue


_OF_LOG = re.compile(r"imu(\d+)")  # devices of a log with several IMUs, counted from zero


class Slot(msgspec.Struct, frozen=True):
    """A slot by the controller's own count, and what is to be said of it."""

    number: int
    notes: tuple[str, ...] = ()


def slot_of(
    calibration: Calibration, given: int | None, *, controller: str, first: int, last: int
) -> Slot:
    """The slot that was given, else that of device `imu0`, `imu1`, … of a log, else the first.

    **Arguments:** the controller counts its sensors from `first` to `last`; logs count theirs from zero.

    Raises `ValueError` for a slot that the controller does not have.
    """
    of_log = _OF_LOG.fullmatch(calibration.device)
    own = None if of_log is None else first + int(of_log.group(1))
    number = given if given is not None else own if own is not None else first
    if not first <= number <= last:
        wrong = ValueError if given is None else WrongValue
        raise wrong(f"{controller}: instance = {number} must be within {first} to {last}.")
    if own is None or number == own:
        return Slot(number)
    return Slot(
        number,
        (
            f"this is {calibration.device} of the log, whose place is instance = {own}: the file with "
            f"instance = {number} is for another sensor",
        ),
    )
