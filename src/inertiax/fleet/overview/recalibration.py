"""What changed between two calibrations of the same serial numbers."""

from collections.abc import Sequence
from pathlib import Path

import equinox as eqx
import numpy as np
import polars as pl
from jaxtyping import Float

from ..solve.triad_model import curve_covariance, curves, TriadModel
from ..store import each_part, matrix_of, read_manifest
from .populate import full_covariances


FAR = 3.0  # standard deviations of a difference


class Drift(eqx.Module):
    """Later less earlier curves of the devices that both runs calibrated."""

    names: tuple[str, ...] = eqx.field(static=True)
    devices: tuple[str, ...] = eqx.field(static=True)
    temperatures: Float[np.ndarray, " grid"]  # °C
    change: Float[np.ndarray, "devices grid parameters"]
    # Of the change: both uncertainties together
    sigma: Float[np.ndarray, "devices grid parameters"]
    # Devices that now read as another one did before, with that one: serial numbers or files exchanged.
    taken_for: tuple[tuple[str, str], ...] = eqx.field(static=True, default=())
    # °C, lowest and highest that both runs cover; `None` where no parameter follows temperature.
    covered: tuple[float, float] | None = eqx.field(static=True, default=None)

    @property
    def extrapolated(self) -> tuple[float, ...]:
        """The temperatures beyond those that both runs cover."""
        if self.covered is None:
            return ()
        low, high = self.covered
        return tuple(float(t) for t in self.temperatures if not low <= t <= high)

    @property
    def sigmas(self) -> Float[np.ndarray, "devices grid parameters"]:
        """The changes in standard deviations."""
        return self.change / self.sigma


def drift_between(
    folder: Path | str,
    earlier: Path | str,
    triad: str,
    *,
    temperatures: Sequence[float] | None = None,
) -> Drift | None:
    """Changes of one triad's parameters from an earlier run to a later one.

    **Arguments:** `temperatures` in °C; default: the lowest, middle and highest that both runs cover. The error of the
    table's rate is taken as another one in each run and common to all rates of a run, see `common_rate_variance`.

    `None` where one of the runs has no such triad, or no device is in both. Raises `ValueError` where the
    runs estimate different parameters or cover no common temperature.
    """
    models = [_model(Path(f), triad) for f in (earlier, folder)]
    if models[0] is None or models[1] is None:
        return None
    before, after = models[0], models[1]
    if before.names != after.names:
        raise ValueError(
            f"{earlier} and {folder} hold different parameters of {triad} ('{before.estimator}' and "
            f"'{after.estimator}'); drift needs the same estimator in both."
        )
    grid = _temperatures(before, after, temperatures, f"{earlier} and {folder}")
    old = set(_names(Path(earlier)))
    new = [name for name in _names(Path(folder)) if name in old]
    if not new:
        return None
    rates = [_rate(Path(f)) for f in (earlier, folder)]
    common = common_rate_variance(after.names, after.estimator, rates)
    first = _at(Path(earlier), triad, before, grid, new)
    second = _at(Path(folder), triad, after, grid, new)
    return Drift(
        after.names,
        tuple(new),
        grid,
        second[0] - first[0],
        np.sqrt(first[1] + second[1] + common),
        _taken_for(new, first, second, common),
        _covered(before, after),
    )


def _rate(folder: Path) -> float:
    """The stated uncertainty of the table's rate in a run, a part of it, 1 sigma."""
    manifest = read_manifest(folder)
    return 0.0 if manifest is None else manifest.rig[1]


def common_rate_variance(
    names: Sequence[str], estimator: str, rates: Sequence[float]
) -> Float[np.ndarray, " parameter"]:
    """Variance that errors of the rate, common to all rates of a run, give to a change of each parameter.

    An error ρ of all rates is one of all scale factors of gyros that are calibrated by reference, ρ E to first order;
    `rates` are the stated ρ of the runs. Estimates have it as drawn anew for each rate in their covariance.
    """
    scale = [name.startswith("gyro.matrix") and name[-4] == name[-2] for name in names]
    square = float(np.sum(np.square(rates))) if estimator == "reference" else 0.0
    return np.where(scale, square, 0.0)


def _taken_for(
    devices: Sequence[str],
    before: tuple[np.ndarray, np.ndarray],
    after: tuple[np.ndarray, np.ndarray],
    common: Float[np.ndarray, " parameter"],
) -> tuple[tuple[str, str], ...]:
    """Devices whose parameters are within a few sigmas of another's earlier ones and far beyond that of their own."""
    found = []
    for k, device in enumerate(devices):
        square = np.square(after[0][k] - before[0]) / (after[1][k] + before[1] + common)
        # The rms, in standard deviations, to each device's earlier parameters.
        away = np.sqrt(square.mean(axis=(1, 2)))
        nearest = int(away.argmin())
        if away[nearest] < FAR and away[k] > 10.0 * FAR:
            found.append((device, devices[nearest]))
    return tuple(found)


def _model(folder: Path, triad: str) -> TriadModel | None:
    manifest = read_manifest(folder)
    if manifest is None:
        raise ValueError(f"{folder}: no manifest.json; it is not the output of a fleet run.")
    return getattr(manifest, triad)


def _temperatures(
    before: TriadModel, after: TriadModel, wanted: Sequence[float] | None, where: str
) -> Float[np.ndarray, " grid"]:
    if wanted is not None:
        return np.array(wanted, float)
    covered = _covered(before, after)
    if covered is None:
        return np.array([0.5 * (after.low + after.high)])
    low, high = covered
    if low > high:
        raise ValueError(f"{where}: the runs cover no common temperature; say at which to compare.")
    return np.array([low, 0.5 * (low + high), high]) if low < high else np.array([low])


def _covered(before: TriadModel, after: TriadModel) -> tuple[float, float] | None:
    """The temperatures, °C, that both runs cover; the low one above the high one where there are none."""
    ranges = [(m.low, m.high) for m in (before, after) if m.degree]
    return (max(r[0] for r in ranges), min(r[1] for r in ranges)) if ranges else None


def _names(folder: Path) -> list[str]:
    return [d for table in each_part(folder, ["device"]) for d in table.get_column("device")]


def _at(
    folder: Path, triad: str, model: TriadModel, grid: np.ndarray, wanted: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Curves and their variances at the temperatures, in the order of `wanted`."""
    place = {name: k for k, name in enumerate(wanted)}
    shape = (len(wanted), len(grid), len(model.names))
    values, variances = np.empty(shape), np.empty(shape)
    keys = [f"{triad}_parameters", f"{triad}_covariance"]
    for table in each_part(folder, ["device", *keys]):
        mine = table.filter(pl.col("device").is_in(wanted))
        if mine.height:
            rows = [place[d] for d in mine.get_column("device")]
            values[rows] = curves(model, matrix_of(mine.get_column(keys[0])), grid)
            covariances = full_covariances(mine.get_column(keys[1]))
            variances[rows] = curve_covariance(model, covariances, grid)
    return values, variances
