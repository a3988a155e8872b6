"""One answer to "which positions and temperatures, how many, how long?" for accelerometers on a two-axis table."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..estimators import Invariant
from ..physics.temperature import Polynomial
from ..simulate.programme import Programme, PROGRAMME_18, PROGRAMME_24, Table
from .criteria import score
from .effort import Effort, effort_for
from .information import GRAVITY, host_rows, sphere_average
from .positions import optimal_positions, TableLimits
from .temperatures import optimal_temperatures


# The table of `simulate.programme.Table` in the words of `campaign.toml`
TABLE = {"axes": ["east", "up"], "case": ["east", "north", "up"]}


class Advice(eqx.Module):
    """A programme and its temperatures, their efficiency, and the effort for a target where one was given."""

    programme: Programme
    efficiency: float = eqx.field(static=True)  # against the bound, by the criterion D
    plain: float = eqx.field(static=True)  # of the plain 18 positions, the same
    temperatures: Float[np.ndarray, " experiments"]  # °C, ascending
    equal_steps: float = eqx.field(static=True)  # efficiency of equal steps against `temperatures`
    steps: Float[np.ndarray, " experiments"]  # °C, equal, of which the efforts are
    target: float | None = eqx.field(static=True)
    efforts: tuple[Effort, ...]

    def as_dict(self) -> dict[str, object]:
        """For JSON: angles in degrees and the table that they are of, temperatures in °C, hours, seconds."""
        return {
            "schema": "inertiax.design/1",
            "positions_deg": np.rad2deg(np.asarray(self.programme.angles)).round(4).tolist(),
            "up_in_case": (self.programme.directions().round(6) + 0.0).tolist(),
            "table": TABLE,
            "d_efficiency": self.efficiency,
            "d_efficiency_plain_18": self.plain,
            "temperatures": self.temperatures.round(3).tolist(),
            "equal_steps_efficiency": self.equal_steps,
            "target": self.target,
            "effort_temperatures": self.steps.round(3).tolist() if self.efforts else None,
            "efforts": [
                {
                    "programme": e.programme.name,
                    "positions": e.programme.num_positions,
                    "reachable": e.reachable,
                    "dwell_s": e.dwell_time if e.reachable else None,
                    "hours": e.hours if e.reachable else None,
                }
                for e in self.efforts
            ],
        }

    def lines(self) -> tuple[str, ...]:
        """The advice as lines of text."""
        angles = np.rad2deg(np.asarray(self.programme.angles))
        up = self.programme.directions().round(3) + 0.0  # no negative zeros
        made = [
            f"{self.programme.name}: D-efficiency {self.efficiency:.4f} of the bound (the plain 18 "
            f"positions: {self.plain:.4f})",
            "outer and inner angle, degrees, and what of the case's x, y, z points up, in the order of short slews:",
            *(
                f"  {outer:8.2f} {inner:8.2f}    {x:6.3f} {y:6.3f} {z:6.3f}"
                for (outer, inner), (x, y, z) in zip(angles, up, strict=True)
            ),
            "at zero the outer axis lies level and points east, along the case's x, and the inner one up, along its z;",
            "the outer axis carries the inner one, and both count right-handed: R = R_east(outer) R_up(inner).",
            "of a log with these angles as columns, into campaign.toml:",
            "    [columns]",
            '    table_angles = { names = ["outer", "inner"] }',
            "    [table]",
            *(f"    {key} = {json.dumps(value)}" for key, value in TABLE.items()),
        ]
        if len(self.temperatures) > 1:
            made += [
                "temperatures, °C, if the degree is beyond doubt (equal steps have an efficiency of "
                f"{self.equal_steps:.2f}):",
                "  " + ", ".join(f"{t:.1f}" for t in self.temperatures),
            ]
        if self.target is not None:
            made.append(
                f"for {1e6 * self.target:g} ppm at 95 % on every scale factor, all temperatures, "
                "in equal steps:"
            )
            made += [
                f"  {e.programme.name}: {e.dwell_time:.0f} s a position, {e.hours:.1f} h of measuring"
                if e.reachable
                else f"  {e.programme.name}: not reachable, re-positioning alone is too much"
                for e in self.efforts
            ]
        return tuple(made)


def advise(
    positions: int,
    *,
    criterion: str = "D",
    limits: TableLimits | None = None,
    target: float | None = None,
    density: float,
    repeatability: float = 0.0,
    experiments: int = 13,
    degree: int = 6,
    low: float = -55.0,
    high: float = 60.0,
) -> Advice:
    """The best programme found, how efficient it is, and the dwell time and hours for `target`.

    Arguments as of `optimal_positions` and `effort_for` (SI; `target` is a 95 % half-width, relative).
    The temperatures found are optimal for curves of `degree` from `low` to `high` °C: by D, or, for A and I
    (with which variances over temperature are averaged), by I. The effort is that of equal steps, the safer choice
    where the degree is in doubt; it is told for the programme found, for the D-optimal one of the fewest positions, and
    for the plain 18 and 24. Soaks between experiments are not counted.
    """
    estimator, table = Invariant(gravity=GRAVITY), Table()
    programme = optimal_positions(estimator, positions, criterion=criterion, limits=limits)
    bound = score("D", sphere_average(estimator, table), 1)

    def efficiency(one: Programme) -> float:
        rows = host_rows(estimator, table, one.angles)
        return score("D", np.einsum("nri,nrj->ij", rows, rows), one.num_positions) / bound

    basis, steps = Polynomial(degree, low, high), np.linspace(low, high, experiments)
    temperatures, equal = _temperatures(basis, steps, "D" if criterion == "D" else "I")
    efforts = ()
    if target is not None:
        fewest = estimator.num_parameters
        few = () if positions == fewest else (optimal_positions(estimator, fewest, limits=limits),)
        efforts = effort_for(
            target,
            [*few, programme, PROGRAMME_18, PROGRAMME_24],
            estimator,
            basis,
            steps,
            density=density,
            repeatability=repeatability,
        )
    return Advice(
        programme,
        efficiency(programme),
        efficiency(PROGRAMME_18),
        temperatures,
        equal,
        steps,
        target,
        efforts,
    )


def _temperatures(
    basis: Polynomial, steps: Float[np.ndarray, " experiments"], criterion: str
) -> tuple[Float[np.ndarray, " experiments"], float]:
    """The optimal temperatures, and the efficiency of equal steps against them."""
    count = len(steps)
    found = optimal_temperatures(
        basis, count, low=float(basis.low), high=float(basis.high), criterion=criterion
    )
    values = lambda at: np.asarray(jax.vmap(basis)(jnp.asarray(at)))
    over = values(np.linspace(basis.low, basis.high, 201))
    weight = over.T @ over / len(over)
    by = [score(criterion, values(t).T @ values(t), count, weight) for t in (steps, found)]
    return found, by[0] / by[1]
