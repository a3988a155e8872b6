"""Many devices: solved in batch, from recordings of any size, resumable, with the bad ones set aside.

`run_fleet` does what `inertiax fleet` does; `read_parts`, `fleet_calibration`, `read_population` and
`read_line_file` read what it wrote. `stack_dwells` and `fit_fleet` solve dwell means that are in memory,
`fit_invariant`, `fit_thermal_invariant` and `fit_linear` are the programs behind it, `fit_sharded` spreads
them over accelerators. `population_of` and `between_devices` tell how devices of a line differ, `score` and
`read_line` what their model leaves out.
"""

from .effects.population_effects import LineMismatch, read_line
from .effects.score_statistics import FleetScores, score
from .overview.explain import read_line_file
from .overview.populate import population_of
from .pipeline import run_fleet
from .population.population import Population, read_population, TriadPopulation, write_population
from .population.unit_covariance import Between, between_devices
from .reduce.stacked_dwells import stack_dwells
from .results import fleet_calibration, FleetSummary
from .solve.batch import fit_fleet, FleetFit
from .solve.invariant import BatchFit, fit_invariant
from .solve.linear import fit_linear
from .solve.sharding import fit_sharded
from .solve.thermal import fit_thermal_invariant
from .store import read_parts


__all__ = [
    "BatchFit",
    "Between",
    "FleetFit",
    "FleetScores",
    "FleetSummary",
    "LineMismatch",
    "Population",
    "TriadPopulation",
    "between_devices",
    "fit_fleet",
    "fit_invariant",
    "fit_linear",
    "fit_sharded",
    "fit_thermal_invariant",
    "fleet_calibration",
    "population_of",
    "read_line",
    "read_line_file",
    "read_parts",
    "read_population",
    "run_fleet",
    "score",
    "stack_dwells",
    "write_population",
]
