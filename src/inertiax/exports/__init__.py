"""Calibrations in other tools' formats: one file each, listed in `registry.FORMATS`.

A format is a module with `NAME`, `TITLE`, `SUFFIX`, `KEEPS`, `LOSES`, a `Settings` and
`write(calibration, settings) -> Export`; `read(content) -> Calibration` where its files say enough; `MAGNETOMETERS`
and `BAROMETER` where it has a place for them.
"""

from .export import Export as Export
from .loss import Loss as Loss, measure_loss as measure_loss
from .registry import by_name as by_name, export as export, FORMATS as FORMATS
