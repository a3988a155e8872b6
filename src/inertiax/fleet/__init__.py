"""Many devices: solved in batch, from recordings of any size, resumable, with the bad ones set aside."""

from .batch import fit_fleet as fit_fleet, FleetFit as FleetFit, stack_dwells as stack_dwells
from .between import Between as Between, between_devices as between_devices
from .explain import read_line_file as read_line_file
from .invariant import fit_invariant as fit_invariant
from .line import LineMismatch as LineMismatch, read_line as read_line
from .linear import fit_linear as fit_linear
from .mismatch import FleetScores as FleetScores, score as score
from .populate import population_of as population_of
from .population import (
    Population as Population,
    read_population as read_population,
    TriadPopulation as TriadPopulation,
    write_population as write_population,
)
from .results import fleet_calibration as fleet_calibration, FleetSummary as FleetSummary
from .run import run_fleet as run_fleet
from .sharding import fit_sharded as fit_sharded
from .store import read_parts as read_parts
from .thermal import fit_thermal_invariant as fit_thermal_invariant
