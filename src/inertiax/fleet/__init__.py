"""Many devices: solved in batch, from recordings of any size, resumable, with the bad ones set aside."""

from .batch import fit_fleet as fit_fleet, FleetFit as FleetFit, stack_dwells as stack_dwells
from .invariant import fit_invariant as fit_invariant
from .linear import fit_linear as fit_linear
from .run import (
    fleet_calibration as fleet_calibration,
    FleetSummary as FleetSummary,
    run_fleet as run_fleet,
)
from .store import read_parts as read_parts
from .thermal import fit_thermal_invariant as fit_thermal_invariant
