"""Results of a fleet as its folder holds them, written without a calibration."""

from pathlib import Path

import numpy as np
import polars as pl

from inertiax.fleet import population_of, write_population
from inertiax.fleet.population.population import lower_triangle
from inertiax.fleet.solve.triad_model import TriadModel
from inertiax.fleet.store import Manifest, SCHEMA, write_manifest, write_part


NAMES = tuple(f"accel.bias[{i}]" for i in range(3)) + tuple(
    f"accel.matrix[{i},{j}]" for i in range(3) for j in range(i + 1)
)
SPREAD = np.r_[np.full(3, 3e-2), np.full(6, 3e-3)]  # m/s² and per unit, between devices
OWN = 0.02  # a device's own sigma, in parts of the spread


def _names(devices: int) -> list[str]:
    return [f"SN{k:05d}" for k in range(devices)]


def _truth(devices: int, degree: int) -> np.ndarray:
    """Coefficients (devices, (degree + 1) · 9) of a line with a mean of half the spread."""
    rng = np.random.default_rng(1)
    size = np.concatenate([SPREAD * 0.3**k for k in range(degree + 1)])
    return size * (0.5 + rng.standard_normal((devices, len(size))))


def _write_results(
    folder: Path, truth: np.ndarray, names: list[str], *, seed: int = 0, aside: int = 0
) -> np.ndarray:
    """A finished run's folder with estimates of those devices, the last `aside` in quarantine."""
    degree = truth.shape[1] // 9 - 1
    sigma = np.concatenate([OWN * SPREAD] * (degree + 1))
    estimates = truth + sigma * np.random.default_rng(100 + seed).standard_normal(truth.shape)
    model = TriadModel("invariant", NAMES, degree, -30.0, 60.0)
    write_manifest(Manifest(SCHEMA, "", 9.81, model, None, False, ("why",), ()), folder)
    lower = list(lower_triangle(np.diag(sigma**2)))
    for number, start in enumerate(range(0, len(truth), 1000)):
        rows = range(start, min(start + 1000, len(truth)))
        table = pl.DataFrame(
            {
                "device": [names[k] for k in rows],
                "reason": [
                    f"accel: no convergence after {k} steps" if k >= len(truth) - aside else ""
                    for k in rows
                ],
                "dwells": [18] * len(rows),
                "temperature_low": [-30.0] * len(rows),
                "temperature_high": [60.0] * len(rows),
                "reservation": pl.Series([None] * len(rows), dtype=pl.String),
                "accel_parameters": [estimates[k].tolist() for k in rows],
                "accel_sigma": [sigma.tolist()] * len(rows),
                "accel_covariance": [lower] * len(rows),
                "accel_rms": [1e-4] * len(rows),
                "accel_scatter": [0.0] * len(rows),
                "accel_chi2_per_dof": [1.0] * len(rows),
            }
        )
        write_part(folder, number, table)
    found = population_of(folder)
    if found is not None:
        write_population(found, folder / "population.json")
    return estimates
