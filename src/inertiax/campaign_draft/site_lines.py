"""`[site]`: gravity, by where the place is or by what a table wrote."""

import math

import numpy as np

from ..physics.earth import gravity as normal_gravity
from .raw_triads import RawTriads
from .references import force_unit
from .toml_text import Line, Table


_STANDARD = 9.80665  # m/s²


def site_table(latitude: float | None, height: float) -> Table:
    """Normal gravity at a latitude (deg) and height (m), and how far a place may be from it; else standard gravity."""
    if latitude is None:
        why = "standard gravity; give --latitude and --height, or a survey's value: 0.1 % off is 0.1 % of each scale"
        return Table("site", (Line("gravity", _STANDARD, why, certain=False),))
    value = round(float(normal_gravity(math.radians(latitude), height)), 5)
    why = (
        f"normal gravity of WGS 84 at {height:g} m; a place differs from it by up to some 1e-3 m/s^2, or 100 ppm of "
        "all scale factors, which their ± leaves out"
    )
    return Table("site", (Line("gravity", value, why), Line("latitude", float(latitude))))


def site_of_reference(found: RawTriads) -> Table | None:
    """Gravity as a table's reference has it."""
    names = found.roles.reference_accel
    if names is None:
        return None
    told = force_unit(np.stack([found.log.numbers[n] for n in names], axis=1))
    if told.gravity is None:
        return None
    why = "the norm of reference_accel, in all of its rests"
    return Table("site", (Line("gravity", told.gravity, why),))
