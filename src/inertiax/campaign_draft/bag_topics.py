"""Topics of a bag that a campaign has to name."""

from pathlib import Path

from ..data.formats import ros
from .toml_text import Line


def topic_lines(bag: Path) -> tuple[Line, ...]:
    """The topics of a bag that must be named: the IMU's among several, and the probe's."""
    imus, probes = ros.topics(bag)
    made = []
    if len(imus) > 1:
        made.append(Line("topic", imus[0], f"one of {', '.join(imus)}", certain=False))
    if probes:
        several = f"one of {', '.join(probes)}"
        why = "the bag's only topic of temperatures" if len(probes) == 1 else several
        made.append(Line("temperature_topic", probes[0], why, certain=len(probes) == 1))
    return tuple(made)
