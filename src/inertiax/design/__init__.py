"""Experiment design for precision: which positions, temperatures and times determine the parameters.

`information` has the rows that a position adds, `criteria` what is asked of them (D, A, I), `positions`
and `temperatures` the optimal plans, `effort` how many positions and hours a stated precision takes.
"""

from .advise import Advice, advise
from .criteria import CRITERIA, score
from .effort import Effort, effort_for, Precision, precision
from .information import ideal_rows
from .positions import optimal_positions, shortest_order, TableLimits
from .temperatures import optimal_temperatures


__all__ = [
    "Advice",
    "CRITERIA",
    "Effort",
    "Precision",
    "TableLimits",
    "advise",
    "effort_for",
    "ideal_rows",
    "optimal_positions",
    "optimal_temperatures",
    "precision",
    "score",
    "shortest_order",
]
