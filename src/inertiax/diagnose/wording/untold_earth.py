"""What is said of a g-sensitivity no larger than the Earth's rate, where no reference tells that.

The catalogue's `earth_rate` needs the room's axes in the case. Without them nothing stands for the horizontal part of
the Earth's rate, and where a table repeats its poses the force alone takes it in.
"""

from collections.abc import Mapping

from ...calibrate.untold_earth import is_no_more, no_reference_tells
from ..problem import Prepared
from ..result import Parameter


SAID = (
    " It is no larger than the Earth's rate makes (15 °/h), whose heading no reference tells here, so that earth_rate "
    "explains it as well where a table repeats its poses; a table's angles with [site] latitude tell them apart."
)


def earth_explains(prepared: Prepared, name: str, values: Mapping[str, Parameter]) -> bool:
    """Whether the Earth's rate may be what a named effect of a triad, with these numbers, is."""
    if name != "g_sensitivity" or prepared.form.triad != "gyro":
        return False
    sizes = [v.value for v in values.values() if v.unit == "rad/s/g"]
    blocks = prepared.blocks
    rates = blocks.reference_gyro
    at_rest = None if rates is None else rates[~blocks.moving]
    return bool(sizes) and is_no_more(sizes) and no_reference_tells(at_rest)
