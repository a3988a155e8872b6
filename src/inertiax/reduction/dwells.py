"""Dwell means: one row per time at rest (or at constant rate), ready for estimation.

A dwell is reduced to its mean outputs, its mean temperature and the covariance of those means.
For a linear sensor model nothing is lost by that, and a solve costs microseconds instead of
milliseconds.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from .._typing import AnyArray
from .motions import Motions


class Dwells(eqx.Module):
    """Means over dwells. The leading axis counts dwells; absent columns are `None`.

    Under `vmap` one slice is one dwell, which is what an estimator's residual is written for.
    `valid` is False for rows that only pad an array to a common shape; they weigh nothing.
    """

    time: Float[AnyArray, " *dwell"]  # s, middle of the dwell
    duration: Float[AnyArray, " *dwell"]  # s
    count: Float[AnyArray, " *dwell"]  # samples averaged
    temperature: Float[AnyArray, " *dwell"]  # °C, mean; 0 where no probe was recorded
    experiment: Int[AnyArray, " *dwell"]
    position: Int[AnyArray, " *dwell"]  # -1 at constant rate
    valid: Bool[AnyArray, " *dwell"]
    accel: Float[AnyArray, "*dwell 3"] | None = None  # m/s²
    accel_covariance: Float[AnyArray, "*dwell 3 3"] | None = None  # of the mean, (m/s²)²
    gyro: Float[AnyArray, "*dwell 3"] | None = None  # rad/s
    gyro_covariance: Float[AnyArray, "*dwell 3 3"] | None = None  # of the mean, (rad/s)²
    reference_accel: Float[AnyArray, "*dwell 3"] | None = None  # m/s²
    reference_gyro: Float[AnyArray, "*dwell 3"] | None = None  # rad/s
    motion: Motions | None = None  # the motion that led to each dwell, where an estimator needs it

    @property
    def num_dwells(self) -> int:
        """Length of the leading axis."""
        return int(self.time.shape[0])

    def __getitem__(self, rows: slice | int | np.ndarray) -> "Dwells":
        """The same columns, only those dwells."""
        return jax.tree.map(lambda x: x[rows], self)


def experiment_rows(
    dwells: Dwells,
) -> tuple[Int[np.ndarray, "experiments longest"], Bool[np.ndarray, "experiments longest"]]:
    """Rows of each experiment's valid dwells, padded to the longest, and which are no padding.

    Padding repeats the experiment's last dwell, so that every number stays finite. Experiments are
    in the order of their numbers.
    """
    valid = np.asarray(dwells.valid)
    labels = np.asarray(dwells.experiment)
    rows = [np.flatnonzero((labels == n) & valid) for n in np.unique(labels[valid])]
    longest = max(len(r) for r in rows)
    index = np.stack([np.pad(r, (0, longest - len(r)), mode="edge") for r in rows])
    kept = np.stack([np.arange(longest) < len(r) for r in rows])
    return index, kept


def by_experiment(
    dwells: Dwells,
    rows: Int[AnyArray, "experiments longest"],
    kept: Bool[AnyArray, "experiments longest"],
) -> Dwells:
    """Stack the dwells of each experiment along a new leading axis, as `experiment_rows` says."""
    stacked = jax.tree.map(lambda x: jnp.asarray(x)[rows], dwells)
    return eqx.tree_at(lambda d: d.valid, stacked, jnp.asarray(kept))
