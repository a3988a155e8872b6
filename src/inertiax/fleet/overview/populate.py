"""The population of a run's devices."""

from pathlib import Path

import numpy as np
import polars as pl

from ..population.population import lower_triangle, Outlier, Population, TriadPopulation
from ..population.unit_covariance import Between, between_devices, deviation, FEWEST
from ..solve.triad_model import TriadModel
from ..store import each_part, matrix_of, read_manifest


# As many devices tell the spread to 3 %; the others are judged by it.
ENOUGH = 500
PER_UNKNOWN = 10


def population_of(folder: Path) -> Population | None:
    """Mean and spread of the devices that a run calibrated, and those unlike the others.

    Of many devices an even choice enters the estimate. `None` where fewer than five were calibrated. Raises
    `ValueError` where the folder holds no run.
    """
    manifest = read_manifest(folder)
    if manifest is None:
        raise ValueError(f"{folder}: no manifest.json; it is not the output of a fleet run.")
    accel = _triad_population(folder, "accel", manifest.accel)
    gyro = _triad_population(folder, "gyro", manifest.gyro)
    if accel is None and gyro is None:
        return None
    return Population(g_sensitivity=manifest.g_sensitivity, accel=accel, gyro=gyro)


def _triad_population(folder: Path, triad: str, model: TriadModel | None) -> TriadPopulation | None:
    if model is None:
        return None
    light = pl.concat(each_part(folder, [f"{triad}_parameters", f"{triad}_scatter"]))
    if light.height < FEWEST:
        return None
    entering = max(ENOUGH, PER_UNKNOWN * model.unknowns)
    chosen = np.zeros(light.height, bool)
    chosen[np.linspace(0, light.height - 1, min(entering, light.height)).astype(int)] = True
    covariances = _chosen_covariances(folder, triad, chosen)
    estimates = matrix_of(light.get_column(f"{triad}_parameters"))
    found = between_devices(estimates[chosen], covariances, groups=model.kinds)
    scatter = light.get_column(f"{triad}_scatter").to_numpy()
    return TriadPopulation(
        model=model,
        mean=tuple(found.mean.tolist()),
        covariance=lower_triangle(found.covariance),
        mean_covariance=lower_triangle(found.mean_covariance),
        scatter=float(np.median(scatter)),
        devices=int(found.kept.sum()),
        shrinkage=found.shrinkage,
        outliers=_outliers(folder, triad, model, found, light.height),
    )


def _chosen_covariances(folder: Path, triad: str, chosen: np.ndarray) -> np.ndarray:
    column, first = f"{triad}_covariance", 0
    parts = []
    for table in each_part(folder, [column]):
        mine = chosen[first : first + table.height]
        first += table.height
        if mine.any():
            parts.append(full_covariances(table.get_column(column).filter(pl.Series(mine))))
    return np.concatenate(parts)


def full_covariances(column: pl.Series) -> np.ndarray:
    """Covariance matrices (devices, n, n) from a column of lower triangles."""
    lower = matrix_of(column)
    n = int((np.sqrt(8 * lower.shape[1] + 1) - 1) / 2)
    i, j = np.tril_indices(n)
    matrices = np.empty((len(lower), n, n))
    matrices[:, i, j] = matrices[:, j, i] = lower
    return matrices


def _outliers(
    folder: Path, triad: str, model: TriadModel, found: Between, fleet: int
) -> tuple[Outlier, ...]:
    """All devices unlike the others, the farthest first."""
    outliers: list[Outlier] = []
    columns = ["device", f"{triad}_parameters", f"{triad}_covariance"]
    for table in each_part(folder, columns):
        if not table.height:
            continue
        away = deviation(
            matrix_of(table.get_column(f"{triad}_parameters")),
            full_covariances(table.get_column(f"{triad}_covariance")),
            found.mean,
            found.covariance,
            found.mean_covariance,
            told_by=int(found.kept.sum()),
            fleet=fleet,
            groups=model.kinds,
        )
        for k in np.flatnonzero(away.outlying):
            worst = int(np.abs(away.sigmas[k]).argmax())
            term, parameter = divmod(worst, len(model.names))
            outliers.append(
                Outlier(
                    device=table.item(int(k), "device"),
                    distance=float(away.distance[k]),
                    parameter=model.names[parameter],
                    term=term,
                    sigmas=float(away.sigmas[k, worst]),
                )
            )
    return tuple(sorted(outliers, key=lambda o: -o.distance))
