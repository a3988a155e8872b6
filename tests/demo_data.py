"""A result of the demo's shape with made-up numbers, so that drawing needs no calibration."""

import numpy as np

from inertiax.analysis.paper_experiment import DemoResult, DemoRow, DemoSet, METHODS
from inertiax.physics.temperature import Polynomial
from inertiax.reduction.dwells import Dwells
from inertiax.simulate.plan import paper_set


ACCEL_NAMES = tuple(f"accel.bias[{i}]" for i in range(3)) + tuple(
    f"accel.matrix[{i},{j}]" for i in range(3) for j in range(i + 1)
)


def made_dwells(rng, *, experiments: int = 3, positions: int = 6) -> Dwells:
    n = experiments * positions
    zeros = np.zeros((n, 3, 3))
    return Dwells(
        time=100.0 * np.arange(n),
        duration=np.full(n, 60.0),
        count=np.full(n, 600.0),
        temperature=np.linspace(-40.0, 60.0, n),
        experiment=np.repeat(np.arange(experiments), positions),
        position=np.tile(np.arange(positions), experiments),
        valid=np.ones(n, bool),
        accel=rng.normal(size=(n, 3)),
        accel_covariance=zeros,
    )


def demo_result() -> DemoResult:
    rng = np.random.default_rng(2)
    basis = Polynomial(6, -62.5, 67.5)
    grid = np.linspace(-55.0, 60.0, 50)
    sets = []
    for number, change in enumerate((15.0, 4.0, 0.5), start=1):
        plan = paper_set(number)
        dwells = made_dwells(rng, experiments=13, positions=18)
        sets.append(
            DemoSet(
                change=change,
                plan=plan,
                dwells=dwells,
                coefficients=1e-3 * rng.normal(size=(4, 7, 9)),
                deviations=1e-6 * np.ones((50, 9)),
                point_temperature=np.linspace(-55.0, 60.0, 13),
                points=1e-2 * rng.normal(size=(13, 9)),
                check_misfit=1e-4 * rng.normal(size=(4, 200)),
                paper_radius=0.5,
                iterations=3,
                warning=None,
            )
        )
    rows = tuple(DemoRow(s.change, m, 1e-4, 1e-5, 1e-4, 1e-5, 1e-4) for s in sets for m in METHODS)
    return DemoResult(
        names=ACCEL_NAMES,
        basis=basis,
        grid=grid,
        truth=np.zeros((50, 9)),
        sets=tuple(sets),
        check_time=np.linspace(0.0, 300.0, 200),
        check_temperature=np.linspace(20.0, 30.0, 200),
        table=rows,
    )
