"""What each uncertainty of a station costs: its part in the parameters and in |a| − g, for the paper's set 2.

    python benchmarks/station_budget.py

Sizes are assumed, as the paper states none. `paper_tables.py` prints the table into the docs, with what the noise is
seen to do over many seeds under it.
"""

import jax
import numpy as np

from inertiax.analysis import sources
from inertiax.analysis.error_budget import error_budget, magnitude_gradient
from inertiax.estimators import Invariant
from inertiax.physics.temperature import Polynomial
from inertiax.procedure.single_device import joint_fit_one
from inertiax.simulate.bench import simulate_dwells
from inertiax.simulate.plan import PAPER_GRAVITY, paper_set
from inertiax.simulate.programme import PROGRAMME_8, PROGRAMME_18
from inertiax.simulate.triad import Device, draw_accelerometers


jax.config.update("jax_enable_x64", True)

ESTIMATOR = Invariant(gravity=PAPER_GRAVITY)
BASIS = Polynomial(6, -63.0, 68.0)
AT = 20.0  # °C
ARCSEC = np.deg2rad(1.0 / 3600.0)
BIAS, SCALE, MISALIGNMENT = [0, 1, 2], [3, 5, 8], [4, 6, 7]

HEAD = [
    "| source | 1 sigma | bias, 10⁻⁵ m/s² | scale, ppm | misalignment, ″ | ‖a‖ − g, ″ of g |",
    "|---|---|---|---|---|---|",
]


def row(name: str, size: str, parameters: np.ndarray, magnitude: float | None) -> str:
    """Greatest of each kind; one line of the table."""
    values = [
        1e5 * parameters[BIAS].max(),
        1e6 * parameters[SCALE].max(),
        parameters[MISALIGNMENT].max() / ARCSEC,
    ]
    if magnitude is not None:
        values.append(magnitude / PAPER_GRAVITY / ARCSEC)
    cells = [f"{v:.2g}" if v >= 1e-4 else "< 10⁻⁴" for v in values] + [""] * (magnitude is None)
    return f"| {name} | {size} | {' | '.join(cells)} |"


def station() -> list[tuple[sources.Source, str]]:
    """Every source with its size in words."""
    plan = paper_set(2)
    angles = np.tile(np.asarray(plan.programme.angles), (plan.num_experiments, 1))
    attitudes = jax.vmap(plan.table.attitude)(angles[:, 0], angles[:, 1])
    axes = sources.table_axes(attitudes, plan.table.outer_axis, plan.table.inner_axis)
    return [
        (sources.output_noise(), "10⁻⁵ m/s² on a dwell's mean"),
        (sources.repositioning(2e-5), "2·10⁻⁵ m/s² each positioning"),
        (sources.day_to_day(3e-5), "3·10⁻⁵ m/s² each experiment"),
        (sources.probe_noise(0.05), "0.05 °C each dwell"),
        (sources.probe_offset(0.1), "0.1 °C"),
        (sources.timing(10.0), "10 s"),
        (sources.gravity(1e-5), "10⁻⁵ m/s²"),
        (sources.table_angles(2.0 * ARCSEC, *axes), "2″ each positioning"),
    ]


def table(noise_only: np.ndarray | None = None) -> list[str]:
    """The error budget as lines of Markdown; `noise_only` (seeds, 9): errors at 20 °C over seeds."""
    device = Device(accel=draw_accelerometers(jax.random.PRNGKey(0)))
    dwells, _ = simulate_dwells(jax.random.PRNGKey(1), paper_set(2), device)
    curve = joint_fit_one(ESTIMATOR, BASIS, dwells).curve
    made = station()
    budget = error_budget(ESTIMATOR, curve, dwells, [source for source, _ in made])
    directions = np.concatenate([PROGRAMME_18.directions(), PROGRAMME_8.directions()])
    gradients = [magnitude_gradient(ESTIMATOR, curve, AT, d, PAPER_GRAVITY) for d in directions]
    parameters = budget.at(AT)
    magnitude = budget.through(np.concatenate(gradients)).max(axis=1)
    lines = [row(s.name, size, p, m) for (s, size), p, m in zip(made, parameters, magnitude)]
    total = np.sqrt(np.sum(np.square(parameters), axis=0))
    # The greatest of the sums, not the sum of the greatest.
    together = np.concatenate(gradients) @ np.concatenate(budget.derivatives, axis=1)
    lines.append(row("all", "", total, np.sqrt(np.sum(np.square(together), axis=1)).max()))
    if noise_only is not None:
        observed = np.sqrt(np.mean(np.square(noise_only), axis=0))
        lines.append(row(f"noise alone, seen over {len(noise_only)} seeds", "", observed, None))
    return HEAD + lines


if __name__ == "__main__":
    print("\n".join(table()))
