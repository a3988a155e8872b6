"""How precise a plan is, and how many positions and hours a stated precision takes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._typing import AnyArray
from ..estimators import AbstractEstimator
from ..physics.temperature import AbstractBasis
from ..simulate.programme import Programme, Table
from .information import GRAVITY, host_rows, unit_scales


TWO_SIDED_95 = 1.959964  # standard deviations


class Precision(eqx.Module):
    """1 sigma of every parameter over a range of temperatures, from the plan alone."""

    names: tuple[str, ...] = eqx.field(static=True)
    temperature: Float[np.ndarray, " grid"]  # °C
    deviation: Float[np.ndarray, "grid parameters"]  # 1 sigma, in the parameters' units

    def worst(self, kind: str) -> float:
        """Largest 1 sigma over the range of "bias", "scale" or "misalignment" parameters."""
        columns = [k for k, name in enumerate(self.names) if kind_of(name) == kind]
        return float(self.deviation[:, columns].max())


def kind_of(name: str) -> str:
    """Which of bias, scale (diagonal of the matrix) or misalignment a parameter is."""
    if ".bias" in name:
        return "bias"
    row, column = name.split("[")[1].rstrip("]").split(",")
    return "scale" if row == column else "misalignment"


def precision(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    programme: Programme,
    temperatures: Float[AnyArray, " experiments"],
    *,
    deviation: float,
    table: Table | None = None,
    grid: Float[AnyArray, " grid"] | None = None,
) -> Precision:
    """Standard deviations that a plan will give, with `deviation` (m/s², 1 sigma) of every dwell mean.

    The programme is run at every temperature; the device is taken as nearly ideal, which is right to
    about its relative errors, 1e-2 or less. `grid` (°C) is where curves are judged, by default
    from the lowest to the highest temperature.
    """
    rows = host_rows(estimator, Table() if table is None else table, programme.angles)
    information = np.einsum("nri,nrj->ij", rows, rows)
    per_position = np.linalg.inv(information) * (deviation / GRAVITY) ** 2
    at = np.asarray(temperatures, float)
    phi = np.asarray(jax.vmap(basis)(jnp.asarray(at)))
    over = np.linspace(at.min(), at.max(), 116) if grid is None else np.asarray(grid, float)
    phi_grid = np.asarray(jax.vmap(basis)(jnp.asarray(over)))
    by_temperature = np.einsum("ga,ab,gb->g", phi_grid, np.linalg.inv(phi.T @ phi), phi_grid)
    own = np.sqrt(np.diagonal(per_position)) * unit_scales(estimator)
    return Precision(estimator.names, over, np.sqrt(by_temperature)[:, None] * own[None, :])


class Effort(eqx.Module):
    """What one programme needs to meet a target."""

    programme: Programme
    reachable: bool = eqx.field(static=True)  # False: re-positioning alone is too much
    dwell_time: float = eqx.field(static=True)  # s at each position
    hours: float = eqx.field(static=True)  # all experiments with their waiting times
    half_width: float = eqx.field(static=True)  # 95 %, worst over the range, at that dwell time


def effort_for(
    target: float,
    programmes: list[Programme],
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    temperatures: Float[AnyArray, " experiments"],
    *,
    kind: str = "scale",
    density: float,
    repeatability: float = 0.0,
    wait_hours: float = 0.0,
    slew_time: float = 10.0,
    shortest_dwell: float = 10.0,
    table: Table | None = None,
) -> tuple[Effort, ...]:
    """Dwell time and hours with which each programme has a 95 % half-width of `target`.

    A dwell of t seconds has the variance density²/t + repeatability²; the half-width is 1.96 σ of the worst
    parameter of that `kind` at the worst temperature. **Arguments:** `target` is dimensionless for
    "scale", rad for "misalignment", m/s² for "bias"; `density` (m/s²/√Hz) of white noise;
    `repeatability` (m/s²) of a dwell after re-positioning; `wait_hours` between experiments, each.

    **Returns** one `Effort` per programme, in their order. Raises `ValueError` for a target that is not
    above 0.
    """
    if not target > 0.0:
        raise ValueError(f"`effort_for(target={target})`: the target must be above 0.")
    experiments = len(np.asarray(temperatures))
    made = []
    for programme in programmes:
        plan = precision(estimator, basis, programme, temperatures, deviation=1.0, table=table)
        per_unit = TWO_SIDED_95 * plan.worst(kind)  # half-width for 1 m/s² of noise in a dwell
        left = (target / per_unit) ** 2 - repeatability**2
        reachable = bool(left > 0.0)
        dwell = max(shortest_dwell, float(density**2 / left)) if reachable else float("inf")
        n = programme.num_positions
        hours = experiments * ((n * dwell + (n - 1) * slew_time) / 3600.0 + wait_hours)
        noise = np.sqrt(density**2 / dwell + repeatability**2)
        made.append(Effort(programme, reachable, dwell, hours, per_unit * float(noise)))
    return tuple(made)
