"""A line's population: mean curves and their spread between devices, as `population.json`.

It says what a device of this line is like before it is measured, N(μ, Σ): the prior with which devices of
short programmes are calibrated, and the yardstick for devices that are unlike the others.
"""

from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Float

from ...data.json_documents import decode, encode
from ...storage.whole_files import write_atomically
from ..solve.triad_model import curve_covariance, curves, TriadModel
from .unit_covariance import FEWEST


SCHEMA = "inertiax.population/1"


class Outlier(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A device unlike the others; it did not enter the population."""

    device: str  # serial number
    distance: float  # Mahalanobis, its own uncertainty counted
    parameter: str  # of the coefficient that is farthest out
    term: int  # of the basis, from 0
    sigmas: float  # how far, in standard deviations of the fleet


class TriadPopulation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """N(μ, Σ) of one triad's coefficients, row-major (degree + 1, parameters), SI."""

    model: TriadModel  # estimator and basis
    mean: tuple[float, ...]  # μ
    covariance: tuple[float, ...]  # Σ between devices, lower triangle row by row
    mean_covariance: tuple[float, ...]  # of μ itself, lower triangle
    scatter: float  # typical scatter between a device's dwells, m/s² or rad/s
    devices: int  # that entered
    shrinkage: float  # of correlations: 0 none, 1 to zero
    outliers: tuple[Outlier, ...] = ()  # devices unlike the others

    def __post_init__(self) -> None:
        if self.devices < FEWEST:
            raise ValueError(f"'devices' is {self.devices}; a population has {FEWEST} or more.")
        n = self.model.unknowns
        for name, length in (
            ("mean", n),
            ("covariance", n * (n + 1) // 2),
            ("mean_covariance", n * (n + 1) // 2),
        ):
            values = getattr(self, name)
            if len(values) != length or not np.all(np.isfinite(values)):
                raise ValueError(
                    f"'{name}' must hold {length} finite numbers; it has {len(values)}."
                )
        try:
            np.linalg.cholesky(_scaled(self.prior_covariance))
        except np.linalg.LinAlgError:
            raise ValueError("'covariance' is not positive definite.") from None

    @property
    def prior_covariance(self) -> Float[np.ndarray, "unknowns unknowns"]:
        """Σ + cov(μ), of a device that is yet to be measured, times (n − 1)/(n − 3): the variance of Student's
        t, which such a device follows where n devices told Σ."""
        student = (self.devices - 1) / (self.devices - 3)
        return student * (symmetric(self.covariance) + symmetric(self.mean_covariance))

    def mean_curves(
        self, temperatures: Float[np.ndarray, " grid"]
    ) -> Float[np.ndarray, "grid parameters"]:
        """μ of every parameter over temperature, °C."""
        return curves(self.model, np.array(self.mean), temperatures)

    def spread(
        self, temperatures: Float[np.ndarray, " grid"]
    ) -> Float[np.ndarray, "grid parameters"]:
        """Standard deviation between devices of every parameter over temperature, °C."""
        return np.sqrt(curve_covariance(self.model, symmetric(self.covariance), temperatures))


class Population(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A line's population; `None` for a triad that was not calibrated."""

    schema: str = SCHEMA  # inertiax.population/1
    g_sensitivity: bool = False  # whether D was estimated
    accel: TriadPopulation | None = None  # None: not calibrated
    gyro: TriadPopulation | None = None  # None: not calibrated


def as_prior(population: Population) -> Population:
    """The population without its list of outliers, which says nothing of other devices."""
    without = lambda t: None if t is None else msgspec.structs.replace(t, outliers=())
    return msgspec.structs.replace(
        population, accel=without(population.accel), gyro=without(population.gyro)
    )


def _scaled(matrix: np.ndarray) -> np.ndarray:
    size = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    return matrix / (size[:, None] * size[None, :])


def symmetric(lower: tuple[float, ...] | list[float]) -> Float[np.ndarray, "n n"]:
    """The matrix of a lower triangle that is stored row by row."""
    n = int((np.sqrt(8 * len(lower) + 1) - 1) / 2)
    matrix = np.zeros((n, n))
    i, j = np.tril_indices(n)
    matrix[i, j] = matrix[j, i] = lower
    return matrix


def lower_triangle(matrix: Float[np.ndarray, "n n"]) -> tuple[float, ...]:
    """Inverse of `symmetric`."""
    return tuple(matrix[np.tril_indices(len(matrix))].tolist())


def write_population(population: Population, file: Path) -> None:
    """Write `population.json`, whole or not at all."""
    write_atomically(file, encode(population, str(file), indent=1))


def read_population(path: Path | str) -> Population:
    """Read `population.json`, or the one in a run's output folder.

    Raises `ValueError`, one line naming the file, for anything that is not exactly this schema.
    """
    file = Path(path)
    if file.is_dir():
        if not (file / "population.json").exists():
            raise ValueError(
                f"{file}: no population.json in this folder; a fleet run writes one where at least five "
                "devices were calibrated."
            )
        file = file / "population.json"
    try:
        content = file.read_bytes()
    except OSError as error:
        raise ValueError(f"{file}: cannot be read ({error.strerror}).") from None
    return decode(content, Population, str(file), "a population", SCHEMA)
