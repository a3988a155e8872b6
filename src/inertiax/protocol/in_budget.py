"""Which of the station's statements the uncertainties contain: one that a page prints must not be taken as included."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

from ..calibrate.split_covariance import LEVEL, ORTHOGONALITY, POSITION, RATE
from ..calibration.calibrated_triads import calibrated_triads
from ..calibration.calibration import Calibration
from .record import Record
from .results import Result
from .sources_at import GRAVITY, PROBE


# Of a fit that is not taken apart, by the record's word for it where it may be unused.
_WITHIN = {POSITION: "position", LEVEL: "level", ORTHOGONALITY: "orthogonality"}


class InBudget(NamedTuple):
    """One statement of the station."""

    source: str  # its name in the budgets
    stated: float | None  # 1 sigma, SI; None where it is not stated
    # In the uncertainties; "no" as well where it is not stated
    contained: Literal["yes", "within fit", "no"]


def in_budget(
    calibration: Calibration,
    record: Record,
    gravity_uncertainty: float | None,
    results: Sequence[Result],
) -> tuple[InBudget, ...]:
    """Gravity, positions, level, axes, rate and probe, in this order.

    A source is contained where the budget of any result has it. Positions, level and axes are within `fit` where the
    dwells are compared with a reference and the fit is not taken apart.
    """
    station = record.station
    present = {source for r in results for source, _ in r.budget}
    hidden = any(
        triad.estimator == "reference" and not own.sources
        for name, triad in calibrated_triads(calibration).items()
        if (own := getattr(record, name)) is not None
    )
    stated = {
        GRAVITY: gravity_uncertainty,
        POSITION: station.position_uncertainty,
        LEVEL: station.level_uncertainty,
        ORTHOGONALITY: station.orthogonality_uncertainty,
        RATE: station.rate_uncertainty,
        PROBE: station.temperature_uncertainty,
    }
    made = []
    for source, sigma in stated.items():
        if sigma is not None and source in present:
            made.append(InBudget(source, sigma, "yes"))
        elif (
            sigma is not None
            and hidden
            and source in _WITHIN
            and _WITHIN[source] not in station.unused
        ):
            made.append(InBudget(source, sigma, "within fit"))
        else:
            made.append(InBudget(source, sigma, "no"))
    return tuple(made)


def not_contained(statements: Sequence[InBudget]) -> tuple[str, ...]:
    """One line for each statement that the uncertainties leave out."""
    return tuple(
        f"{s.source}: the station states an uncertainty of it, but no result is compared with it, so none is in the "
        "budget."
        for s in statements
        if s.stated is not None and s.contained == "no"
    )
