"""A run's devices side by side: every parameter at some temperatures, and the devices unlike the others."""

from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..population.population import Population, TriadPopulation
from ..population.unit_covariance import CHANCE
from ..solve.triad_model import curve_covariance, curves, TriadModel
from ..store import each_part, Manifest, matrix_of
from .populate import full_covariances


ROOM = 25.0  # °C; where parameters are compared, if the model covers it


class TriadView(eqx.Module):
    """One triad of all devices that were not set aside."""

    model: TriadModel = eqx.field(static=True)
    line: TriadPopulation | None = eqx.field(static=True)  # `None`: fewer than five devices
    informed: bool = eqx.field(static=True)  # calibrated with `line` as a prior
    devices: tuple[str, ...] = eqx.field(static=True)
    temperatures: Float[np.ndarray, " grid"]  # °C: lowest, reference, highest; one where constant
    values: Float[np.ndarray, "devices grid parameters"]
    sigmas: Float[np.ndarray, "devices grid parameters"]  # 1 sigma of each device's own
    rms: Float[np.ndarray, " devices"]  # misfit, m/s² or rad/s

    @property
    def reference(self) -> int:
        """Place of the reference temperature in `temperatures`."""
        return len(self.temperatures) // 2

    @property
    def mean(self) -> Float[np.ndarray, "grid parameters"]:
        """The line's mean curves, or these devices' where the line is not known."""
        if self.line is None:
            return self.values.mean(axis=0)
        return self.line.mean_curves(self.temperatures)

    @property
    def spread(self) -> Float[np.ndarray, "grid parameters"]:
        """Standard deviation between devices, free of their own uncertainty where the line is known."""
        if self.line is None:
            return self.values.std(axis=0)
        return self.line.spread(self.temperatures)


class Unlike(NamedTuple):
    """A device unlike the others, and its parameter that is farthest out."""

    device: str
    parameter: str
    temperature: float  # °C
    sigmas: float  # of the fleet, the device's own uncertainty counted


def reference_temperature(model: TriadModel) -> float:
    """Where devices are compared, °C: 25, or the middle of the model's range where that is outside."""
    return ROOM if model.low <= ROOM <= model.high else 0.5 * (model.low + model.high)


def triad_view(
    folder: Path, triad: str, manifest: Manifest, population: Population | None
) -> TriadView | None:
    """The devices of a run; `None` where the triad was not calibrated, or no device was."""
    model: TriadModel | None = getattr(manifest, triad)
    if model is None:
        return None
    reference = reference_temperature(model)
    grid = np.array([model.low, reference, model.high] if model.degree else [reference])
    names, values, sigmas, rms = [], [], [], []
    keys = [f"{triad}_{k}" for k in ("parameters", "covariance", "rms")]
    for table in each_part(folder, ["device", *keys]):
        if table.height:
            names += table.get_column("device").to_list()
            values.append(curves(model, matrix_of(table.get_column(keys[0])), grid))
            own = curve_covariance(model, full_covariances(table.get_column(keys[1])), grid)
            sigmas.append(np.sqrt(np.maximum(own, 0.0)))
            rms.append(table.get_column(keys[2]).to_numpy())
    if not names:
        return None
    return TriadView(
        model,
        None if population is None else getattr(population, triad),
        manifest.prior is not None and getattr(manifest.prior, triad) is not None,
        tuple(names),
        grid,
        np.concatenate(values),
        np.concatenate(sigmas),
        np.concatenate(rms),
    )


def deviations(view: TriadView) -> Float[np.ndarray, "devices grid parameters"]:
    """How far each device is from the line's mean, in standard deviations; zero where the line is unknown.

    The standard deviation is that of the difference where the device is one of the line: spread and own
    uncertainty together; less the own uncertainty where the estimate was drawn to the mean by a prior.
    """
    if view.line is None:
        return np.zeros_like(view.values)
    prior = curve_covariance(view.model, view.line.prior_covariance, view.temperatures)
    own = np.square(view.sigmas)
    variance = np.maximum(prior - own, 1e-3 * prior) if view.informed else prior + own
    return (view.values - view.mean) / np.sqrt(variance)


def unlike_devices(view: TriadView) -> tuple[Unlike, ...]:
    """Devices unlike the others, the farthest first.

    Those that are outliers of the run's population; with a prior those of which a
    parameter is so far out that it would happen to any device of a normal fleet with a chance of 1 %.
    """
    if view.line is None:
        return ()
    away = deviations(view).reshape(len(view.devices), -1)
    if view.informed:
        from scipy.stats import t

        far = np.abs(away).max(axis=1) > t.isf(CHANCE / away.size / 2, view.line.devices - 1)
    else:
        known = {o.device for o in view.line.outliers}
        far = np.array([d in known for d in view.devices])
    found = []
    for k in np.flatnonzero(far):
        worst = int(np.abs(away[k]).argmax())
        at, parameter = divmod(worst, len(view.model.names))
        found.append(
            Unlike(
                view.devices[k],
                view.model.names[parameter],
                float(view.temperatures[at]),
                float(away[k, worst]),
            )
        )
    return tuple(sorted(found, key=lambda u: -abs(u.sigmas)))
