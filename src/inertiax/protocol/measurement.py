"""A results folder read again: the calibration with the record of what it was made of."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

from ..calibration.calibration import Calibration, read_calibration
from ..storage.wrong_value import WrongValue
from .record import FILE, read_record, Record


@dataclasses.dataclass(frozen=True, eq=False)
class Measurement:
    """One device's results."""

    calibration: Calibration
    record: Record


def load_measurement(folder: Path, device: str | None = None) -> Measurement:
    """The results of `calibrate`, `diagnose` or of one device of a fleet.

    **Arguments:** `device` is the serial number where the folder holds several devices.

    Raises `ValueError`, one line that names folder and file, for a folder without results, for several devices of
    which none is named, and for files that do not belong together.
    """
    if (folder / "manifest.json").is_file():
        # The fleet's modules take a second to import, which other results need not wait for.
        from .fleet_record import fleet_measurement

        return Measurement(*fleet_measurement(folder, device))
    if not (folder / "calibration.json").is_file():
        folder = _of_device(folder, device)
    measured = Measurement(read_calibration(folder / "calibration.json"), read_record(folder))
    own = measured.calibration.device
    if device is not None and device != own:
        raise WrongValue(f"{folder}: the results are of device {own!r}, not {device!r}.")
    return measured


def each_measurement(folder: Path) -> Iterator[tuple[str, Measurement | str]]:
    """All devices of a results folder by serial number; of one that a fleet has set aside the reason, in words.

    Raises `ValueError` as `load_measurement` does.
    """
    if (folder / "manifest.json").is_file():
        from .fleet_record import fleet_measurements

        for device, found in fleet_measurements(folder):
            yield device, found if isinstance(found, str) else Measurement(*found)
        return
    one = (folder / "calibration.json").is_file()
    for home in [folder] if one else _homes(folder):
        measured = load_measurement(home)
        yield measured.calibration.device, measured


def _homes(folder: Path) -> list[Path]:
    """The folders of several devices. Raises `ValueError` where there is none."""
    homes = sorted(p.parent for p in folder.glob(f"*/{FILE}"))
    if not homes:
        raise ValueError(
            f"{folder}: holds no calibration.json and no fleet's manifest.json; RESULT is a folder that `inertiax "
            "calibrate`, `diagnose` or `fleet` wrote."
        )
    return homes


def _of_device(folder: Path, device: str | None) -> Path:
    """The folder of one of several devices."""
    homes = _homes(folder)
    own = {read_calibration(h / "calibration.json").device: h for h in homes}
    if device in own:
        return own[device]
    names = ", ".join(list(own)[:8]) + (", …" if len(own) > 8 else "")
    asked = "name one with --device" if device is None else f"there is no device {device!r}"
    raise WrongValue(f"{folder}: holds the results of {names}; {asked}.")
