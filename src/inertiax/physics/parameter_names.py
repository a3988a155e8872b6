"""The name of a triad's error parameter, such as `accel.matrix[1,0]`, taken apart."""

import re
from typing import NamedTuple


_NAME = re.compile(
    r"(?P<triad>accel|gyro|mag)\."
    r"(?:(?P<vector>bias|(?<=mag\.)current)\[(?P<element>[0-2])\]"
    r"|(?P<kind>matrix|(?<=gyro\.)g_sensitivity)\[(?P<row>[0-2]),(?P<column>[0-2])\])"
)


class ParameterName(NamedTuple):
    """What a parameter's name says: its triad, what it belongs to, and its place there."""

    triad: str  # accel, gyro or mag
    kind: str  # bias, matrix, g_sensitivity or current
    row: int  # the output it acts on
    column: int  # the input it is multiplied by; 0 for a bias or a current


def parse(name: str) -> ParameterName | None:
    """The parts of a parameter's name; nothing for another name.

    Gyros alone have a g-sensitivity, magnetometers alone the field of a current.
    """
    match = _NAME.fullmatch(name)
    if match is None:
        return None
    if match["vector"]:
        return ParameterName(match["triad"], match["vector"], int(match["element"]), 0)
    return ParameterName(match["triad"], match["kind"], int(match["row"]), int(match["column"]))
