"""The result of a calibration in one place: the pytree, its triads, its file."""

from .json_file import (
    read_calibration as read_calibration,
    write_calibration as write_calibration,
)
from .pytree import Calibration as Calibration
from .triad import TriadCalibration as TriadCalibration
