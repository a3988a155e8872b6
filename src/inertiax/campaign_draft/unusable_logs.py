"""Logs that no draft can be made of as they are, each with its cure."""

from pathlib import Path

from ..data.formats.detect import is_recording
from .converters import wraps
from .raw_triads import RawTriads
from .sensor_files import tables_in


def refuse_wrapped(log: Path, found: RawTriads) -> None:
    """Raise `ValueError` for signed 16-bit readings that were written as unsigned."""
    for name, values in (("accelerometers", found.accel), ("gyros", found.gyro)):
        if values is not None and wraps(values):
            raise ValueError(
                f"{log}: the {name} are whole numbers up to {values.max():.0f} that jump from one end to the other: "
                "signed 16-bit readings written as unsigned. Take 65536 from every value above 32767, then run "
                "`inertiax init` again."
            )


def refuse_folder(log: Path) -> None:
    """Raise `ValueError` for a folder that is no recording: its logs are to be named, of which it may hold others than
    one campaign's."""
    if not log.is_dir() or is_recording(log):
        return
    logs = tables_in(log)
    cure = f"name its logs, such as inertiax init {logs[0]}" if logs else "name a recording"
    raise ValueError(f"{log}: is a folder, and neither a ROS bag nor of EuRoC's layout; {cure}.")
