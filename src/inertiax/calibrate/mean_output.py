"""Accelerometers in one pose without a reference: numbers that count from the outputs' own mean."""

from ..estimators import StaticAccel
from ..physics.directions import FEWEST_DIRECTIONS
from .results import TriadResult


def about_the_mean(result: TriadResult | None) -> bool:
    """Whether an estimate counts from the outputs' own mean, which says nothing of the sensor."""
    if result is None or not isinstance(result.estimator, StaticAccel):
        return False
    return result.dwells.reference_accel is None


def words_of_the_mean(result: TriadResult) -> tuple[str, ...]:
    """What is to be said of numbers that count from the mean output."""
    if not about_the_mean(result):
        return ()
    if result.solution.curve.basis.size > 1:
        return (
            "accelerometers: without a reference one pose tells only how the bias changes with temperature, and its "
            "constant is counted from the mean output; a log turned by hand gives it, or reference_accel_x/y/z",
        )
    return (
        "accelerometers: without a reference 'static' tells only changes from the mean output; record "
        f"{FEWEST_DIRECTIONS} directions of gravity or more, or give reference_accel_x/y/z",
    )


def told_of_the_sensor(result: TriadResult | None) -> TriadResult | None:
    """The estimate where its numbers mean something.

    Constants that are counted from the outputs' own mean say nothing of the sensor: no calibration, and no other
    tool's file, may hold them. The diagnosis looks for changes about them.
    """
    if result is None or not about_the_mean(result) or result.solution.curve.basis.size > 1:
        return result
    return None
