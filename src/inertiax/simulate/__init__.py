"""A test station and a device with known truth: two-axis table, thermal chamber, sensor triads."""

from .bench import simulate_dwells as simulate_dwells, simulate_recordings as simulate_recordings
from .campaign import write_campaign as write_campaign
from .plan import paper_check as paper_check, paper_set as paper_set, Plan as Plan
from .scenario import load_scenario as load_scenario, Scenario as Scenario, SCENARIOS as SCENARIOS
from .triad import (
    Device as Device,
    draw_accelerometers as draw_accelerometers,
    draw_gyros as draw_gyros,
    Noise as Noise,
)
from .truth import read_truth as read_truth
