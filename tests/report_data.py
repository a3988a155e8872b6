"""Results and diagnoses as a report takes them, made up."""

import jax.numpy as jnp
import numpy as np
import optimistix as optx

from inertiax.calibrate.observability import Observability
from inertiax.calibrate.pipeline import DeviceResult, TriadResult
from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.diagnose import Diagnosis
from inertiax.diagnose.result import (
    Detectable,
    Evidence,
    Explanation,
    Moved,
    Parameter,
    Quality,
    Where,
)
from inertiax.estimators import Invariant
from inertiax.model_selection.model_spec import ModelSpec, TriadSpec
from inertiax.physics.temperature import Curve, Polynomial
from inertiax.procedure.thermal_iterations import ThermalSolution
from inertiax.reduction.dwells import Dwells


EVIL = '"><script>alert(1)</script>'
NAMES = tuple(f"accel.bias[{i}]" for i in range(3)) + tuple(
    f"accel.matrix[{i},{j}]" for i in range(3) for j in range(i + 1)
)


def device_result(
    *,
    device: str = "",
    scatter: float = 0.0,
    chi2_per_dof: float = 1.0,
    warnings: tuple[str, ...] = (),
    sigmas: np.ndarray | None = None,
) -> DeviceResult:
    """A device with parameters linear in temperature from −40 to 60 °C and made-up misfits."""
    rng = np.random.default_rng(0)
    n, basis = 24, Polynomial(1, -40.0, 60.0)
    sigmas = np.full(9, 1e-4) if sigmas is None else sigmas
    curve = Curve(basis, jnp.asarray(np.stack([np.arange(9) * 1e-3, np.full(9, 1e-4)])))
    covariance = jnp.asarray(np.diag(np.tile(sigmas**2, 2)))
    misfit = 1e-4 * rng.normal(size=(n, 1))
    dwells = Dwells(
        time=60.0 * np.arange(n),
        duration=np.full(n, 50.0),
        count=np.full(n, 500.0),
        temperature=np.linspace(-40.0, 60.0, n),
        experiment=np.repeat(np.arange(4), 6),
        position=np.tile(np.arange(6), 4),
        valid=np.ones(n, bool),
        accel=rng.normal(size=(n, 3)),
        accel_covariance=np.zeros((n, 3, 3)),
    )
    solution = ThermalSolution(
        curve=curve,
        covariance=covariance,
        residuals=misfit,
        result=optx.RESULTS.successful,
        num_iterations=jnp.asarray(3),
        history=np.zeros((2, 2, 9)),
        step_sizes=np.zeros(2),
        method="joint",
    )
    result = TriadResult(
        estimator=Invariant(gravity=9.81),
        solution=solution,
        dwells=dwells,
        misfit=misfit,
        sigma=np.full_like(misfit, 1e-4),
        observability=Observability(2.0, 18, 18, ()),
        scatter=scatter,
        chi2_per_dof=chi2_per_dof,
    )
    calibration = Calibration(
        gravity=9.81,
        accel=TriadCalibration(curve, covariance, NAMES, "invariant"),
        device=device,
        temperature_range=(-40.0, 60.0),
    )
    model = ModelSpec(TriadSpec("invariant", 1, NAMES, False), None)
    return DeviceResult(calibration, result, None, model, ("degree 1 by BIC",), warnings)


def diagnosis(verdict: str) -> Diagnosis:
    """A diagnosis with one of everything; `EVIL` wherever text comes from outside."""
    effect = Explanation(
        name="thermal_lag",
        channels=("accel_y",),
        form="first order",
        alternatives=("temperature_rate",),
        odds=(("thermal_lag", 0.8), ("temperature_rate", 0.2)),
        parameters=(
            ("time_constant", Parameter(310.0, 12.0, "s")),
            ("k", Parameter(1.0, None, "1")),
        ),
        evidence=Evidence(512.0, 0.0, 0.61),
        statement=f"accel_y lags behind the probe {EVIL}",
        separating_experiment="a soak of an hour",
    )
    missing = verdict == "missing-physics"
    return Diagnosis(
        verdict=verdict,
        summary=f"In words {EVIL}",
        where=(
            ()
            if verdict == "consistent"
            else (
                Where("accel_y", 0, 10.0, 200.0, "temperature_rate", 1e-4, 1e-9),
                Where("gyro_x", 0, 250.0, 400.0, EVIL, 1e-4, 1e-9),
            )
        ),
        effects=(effect,) if missing else (),
        baseline=Quality(3e-4, 9.8, 4e-4),
        augmented=Quality(1e-4, 1.02, 1e-4),
        not_testable=("third_order",),
        parameters_moved=(
            Moved("accel.bias[1]", 1.0, 1.5, 0.1),
            Moved("accel.bias[2]", 0.0, 0.0, 0.0),
        ),
        detectable=(Detectable("second_order", ("accel_x",), 1e-5, "m/s²/g²"),),
        empirical="a formula" if verdict == "unexplained" else None,
    )
