"""The barometer in the report of `inertiax calibrate`."""

from pathlib import Path

from ..calibrate.results import DeviceResult
from ..plots.barometer import offset_over_temperature
from ..plots.style import drawing
from .page import picture, Section


FIGURE = "barometer"


def barometer_sections(result: DeviceResult, folder: Path) -> list[Section]:
    """What it reads beyond the pressure of the place, over temperature; nothing without one."""
    baro = result.baro
    if baro is None:
        return []
    caption = (
        "Barometer: averages less the pressure of the place and the drift (dots), the fitted curve with its 95 % band, "
        "and what is left. A loop between warming and cooling is weather, or a lag of the probe."
    )
    with drawing():
        figure = picture(offset_over_temperature(baro), folder, FIGURE, caption, caption)
    return [Section("Barometer", lines=baro.statements, figures=(figure,))]
