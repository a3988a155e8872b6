"""What is said of a g-sensitivity that is as large as the Earth's rate that was taken from the rests."""

import math
from collections.abc import Sequence

from ...calibration.quantities import DEG_PER_HOUR
from ...physics.wgs84 import EARTH_RATE
from ...reduction.shown_earth_rate import NEAR
from ..candidates.signatures import Term
from ..observations.blocks import Log
from ..result import Parameter


NAME = "earth_rate"  # of the catalogue
PARTED_BY = (
    "what the driver does with the mean at rest says whether its outputs hold Earth's rate; "
)
Values = Sequence[tuple[str, Parameter]]


def earth_beside(log: Log | None, found: Sequence[tuple[Term, Values]]) -> str:
    """The sentence that the gyros may hold no Earth's rate, where the coefficients are those that taking it away would
    make: −Ω sin φ on each axis' own, and nothing on others. "" elsewhere, and where none was taken.

    Rests that are too few, or too noisy, to tell whether it is there are taken to hold it
    (`reduction.shown_earth_rate`).

    **Arguments:** each term with its coefficients, rad/s/g.
    """
    if log is None or log.earth is None or log.latitude is None:
        return ""
    vertical = EARTH_RATE * math.sin(log.latitude)
    if not found or not all(_as_taken(term, values, vertical) for term, values in found):
        return ""
    return (
        f" That is Earth's rate along the vertical, {DEG_PER_HOUR * vertical:.1f} °/h by [site] latitude, which was "
        "taken from the rests: outputs that hold none of it, as where a driver took it with the mean at rest, look "
        f"alike, and {NAME} stands beside it."
    )


def _as_taken(term: Term, values: Values, vertical: float) -> bool:
    """Whether the coefficients of one channel are those of the rate taken away."""
    settings = dict(term.variant.settings)
    if term.name != "g_sensitivity" or set(settings) != {"axes"} or len(term.channels) != 1:
        return False
    axes = str(settings["axes"])
    sizes = [value for name, value in values if name.startswith("coefficient")]
    if len(sizes) != len(axes):
        return False
    own = "xyz"[term.channels[0]]
    expected = [-vertical if axis == own else 0.0 for axis in axes]
    near = [
        v.std is not None and abs(v.value - e) < NEAR * v.std
        for v, e in zip(sizes, expected, strict=True)
    ]
    return own in axes and all(near)
