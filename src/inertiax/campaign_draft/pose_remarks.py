"""What a draft says of the poses that a log rests in, counted as a calibration will count them."""

import numpy as np
from jaxtyping import Float

from .accel_unit import directions, TriadUnit
from .raw_triads import RawTriads
from .resting import poses, Resting, rests_of_both


_POSES_OF_A_CALIBRATION = 9  # three biases and six elements of a triangular matrix


def poses_of(accel: Float[np.ndarray, "time 3"], rests: Resting) -> int:
    """In how many poses the device rests, by outputs in the log's units."""
    assert rests.accel is not None
    return poses(directions(accel, rests.accel))


def rests_by_both(found: RawTriads, rests: Resting, units: dict[str, TriadUnit]) -> Resting | None:
    """Rests by both triads where the accelerometers alone show several poses and nothing labels them."""
    accel, gyro, roles = found.accel, found.gyro, found.roles
    if accel is None or gyro is None or roles.position or roles.reference_gyro:
        return None
    if rests.single_rows or rests.turned or poses_of(accel, rests) == 1:
        return None
    si = {
        key: (x - (0.0 if units[key].offset is None else np.asarray(units[key].offset)))
        * units[key].factor
        for key, x in (("accel", accel), ("gyro", gyro))
    }
    return rests_of_both(found.seconds, si["accel"], si["gyro"])


def on_poses(
    found: RawTriads,
    rests: Resting,
    both: Resting | None,
    *,
    references: bool,
    about: str | None,
) -> list[str]:
    """What the log can calibrate of the accelerometers; `references` of a table tell more than the norm of gravity, and
    the faces on a table that turns about one axis do, `about` up or down."""
    if references or found.roles.reference_accel is not None or about == "up":
        return []
    if about is not None:
        return [
            "A positive rate of the table is left-handed about up, or else the accelerometers' sign is wrong: at rest "
            "the axis that points up must read +g."
        ]
    assert found.accel is not None
    said = [
        "The sign of the accelerometers does not show: at rest the axis that points up must read +g."
    ]
    if rests.turned:
        return [
            *said,
            "No rest was found: accelerometers need rests of seconds in 9 orientations or more.",
        ]
    count = poses_of(found.accel, rests)
    if both is not None:
        quiet = 0 if both.turned else poses_of(np.asarray(both.accel), both)
        if quiet < min(count, _POSES_OF_A_CALIBRATION):
            return [
                *said,
                f"{quiet} pose{'s' * (quiet != 1)} in {0 if both.turned else both.num_rests} rests; the accelerometers "
                f"alone are quiet {rests.num_rests} times, in {count}, but the gyros turn there. Bias, scale and "
                "misalignments of the accelerometers need 9 or more: lay the device down for 2 s or longer in each.",
            ]
    if rests.slowly:
        said.append(
            f"The device never lies still for long: {rests.num_rests} stretches in which it hardly turns stand for "
            "rests."
        )
    elif count < _POSES_OF_A_CALIBRATION:
        said.append(
            f"{count} pose{'s' * (count > 1)}: bias, scale and misalignments of the accelerometers need 9 or more."
        )
    return said
