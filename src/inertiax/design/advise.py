"""One answer to "which positions, how many, how long?" for accelerometers on a two-axis table."""

import equinox as eqx
import numpy as np

from ..estimators import Invariant
from ..simulate.programme import Programme, PROGRAMME_18, PROGRAMME_24, Table
from ..temperature import Polynomial
from .criteria import score
from .effort import Effort, effort_for
from .information import GRAVITY, ideal_rows, position_information, sphere_average
from .positions import optimal_positions


class Advice(eqx.Module):
    """A programme, its efficiency, and the effort for a target where one was given."""

    programme: Programme
    efficiency: float = eqx.field(static=True)  # against the bound, by the criterion D
    plain: float = eqx.field(static=True)  # of the plain 18 positions, the same
    target: float | None = eqx.field(static=True)
    efforts: tuple[Effort, ...]

    def as_dict(self) -> dict[str, object]:
        """For JSON: angles in degrees, hours, seconds."""
        return {
            "positions_deg": np.rad2deg(np.asarray(self.programme.angles)).round(4).tolist(),
            "d_efficiency": self.efficiency,
            "d_efficiency_plain_18": self.plain,
            "target": self.target,
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
        made = [
            f"{self.programme.name}: D-efficiency {self.efficiency:.4f} of the bound (the plain 18 "
            f"positions: {self.plain:.4f})",
            "outer and inner angle, degrees, in the order of short slews:",
            *(f"  {outer:8.2f} {inner:8.2f}" for outer, inner in angles),
        ]
        if self.target is not None:
            made.append(
                f"for {1e6 * self.target:g} ppm at 95 % on every scale factor, all temperatures:"
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
    target: float | None = None,
    density: float,
    repeatability: float = 0.0,
    experiments: int = 13,
    degree: int = 6,
    low: float = -55.0,
    high: float = 60.0,
) -> Advice:
    """The best programme found, how efficient it is, and the dwell time and hours for `target`.

    Arguments as of `optimal_positions` and `effort_for` (SI; `target` is a 95 % half-width, relative);
    temperatures in equal steps from `low` to `high` °C. Soaks between experiments are not counted.
    """
    estimator, table = Invariant(gravity=GRAVITY), Table()
    programme = optimal_positions(estimator, positions, criterion=criterion)
    bound = score("D", sphere_average(estimator, table), 1)

    def efficiency(one: Programme) -> float:
        rows = ideal_rows(estimator, table, one.angles)
        return score("D", position_information(rows), one.num_positions) / bound

    efforts = ()
    if target is not None:
        efforts = effort_for(
            target,
            [programme, PROGRAMME_18, PROGRAMME_24],
            estimator,
            Polynomial(degree, low, high),
            np.linspace(low, high, experiments),
            density=density,
            repeatability=repeatability,
        )
    return Advice(programme, efficiency(programme), efficiency(PROGRAMME_18), target, efforts)
