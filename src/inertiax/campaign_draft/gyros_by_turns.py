"""How gravity turns between the rests of a draft's log, and gyros by it whose name says nothing."""

from ..reduction.gravity_turns import gravity_turns, GravityTurns
from .accel_unit import directions
from .gyro_unit import turn_as_gravity
from .raw_triads import columns, RawTriads
from .resting import Resting


def turns_between(found: RawTriads, rests: Resting) -> GravityTurns | None:
    """How gravity and the gyros turn between neighbouring rests; `None` where that is not told."""
    if found.accel is None or found.gyro is None or rests.accel is None or rests.single_rows:
        return None
    up = directions(found.accel, rests.accel)
    return gravity_turns(found.seconds, found.gyro, up, rests.start, rests.stop)


def with_gyros_by_turns(found: RawTriads, rests: Resting) -> RawTriads:
    """The log with gyros whose name says nothing, where it has none under another name.

    They are the first three columns that belong together and whose integral turns gravity as it turned from rest to
    rest.
    """
    if found.gyro is not None or not found.clock.known:
        return found
    for triad in found.roles.unnamed:
        values = columns(found.log, triad)
        if values is None or len(values) != len(found.seconds):
            continue
        note = f"{', '.join(triad)}: taken for the gyros, because gravity turns as they do"
        roles = found.roles._replace(gyro=triad, notes=(*found.roles.notes, note))
        candidate = found._replace(gyro=values, roles=roles)
        turns = turns_between(candidate, rests)
        if turns is not None and turn_as_gravity(values, turns):
            return candidate
    return found
