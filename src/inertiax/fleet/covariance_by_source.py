"""Each device's covariance by source of uncertainty, taken apart as `calibrate` does it, in the results' table."""

import dataclasses
import math
from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np

from ..calibrate import slow_noise
from ..calibrate.slow_noise import SlowNoise
from ..calibrate.split_covariance import Fit, Part, residual_degrees, split
from ..data.recording import Rig
from ..estimators import AbstractEstimator
from ..physics.temperature import AbstractBasis, Curve
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from .solve.batch import FleetFit


# Relative, of a variance. A batch takes the invariant problem's weights along the force once, alone they follow every
# step: that is some hundredths of a percent.
SAME = 1e-2
SUFFIXES = ("dwells", "turns", "degrees", "sources", "source_degrees", "source_covariances")


def source_columns(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells, fit: FleetFit, rig: Rig
) -> dict[str, list]:
    """A triad's columns by their suffix, of devices that a batch has solved; empty where a device has no solution.

    **Arguments:** `dwells` lead with the device, with the rig's errors in their covariances.
    """
    rows = [_of_device(estimator, basis, dwells, fit, rig, k) for k in range(len(fit.valid))]
    return {suffix: [row[j] for row in rows] for j, suffix in enumerate(SUFFIXES)}


def with_slow_noise(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells, fit: FleetFit, rig: Rig
) -> FleetFit:
    """The fit with the slow noise that each device's dwells show in its covariance, as `calibrate` has it."""
    covariance, slow = fit.covariance.copy(), [SlowNoise()] * len(fit.valid)
    for k in range(len(fit.valid)):
        own = _own(dwells, fit, k)
        if not _solved(own, fit, k):
            continue
        problem = Problem(_weighed(estimator, fit, k), basis, own)
        coefficients = fit.parameters[k].reshape(basis.size, -1)
        covariance[k], slow[k] = slow_noise.with_slow_noise(
            problem, coefficients, covariance[k], rig
        )
    return dataclasses.replace(fit, covariance=covariance, slow=tuple(slow))


def _own(dwells: Dwells, fit: FleetFit, k: int) -> Dwells:
    return jax.tree.map(lambda x: np.asarray(x)[k][fit.valid[k]], dwells)


def _solved(dwells: Dwells, fit: FleetFit, k: int) -> bool:
    return bool(dwells.num_dwells and np.all(np.isfinite(fit.covariance[k])) and fit.converged[k])


def _weighed(estimator: AbstractEstimator, fit: FleetFit, k: int) -> AbstractEstimator:
    return eqx.tree_at(lambda e: e.scatter, estimator, np.asarray(float(fit.scatter[k])))


def _of_device(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    fit: FleetFit,
    rig: Rig,
    k: int,
) -> tuple:
    own = _own(dwells, fit, k)
    if not _solved(own, fit, k):
        return row_of(own, 0, ())
    weighed = _weighed(estimator, fit, k)
    slow = SlowNoise() if fit.slow is None else fit.slow[k]
    curve = Curve(basis, fit.parameters[k].reshape(basis.size, -1))
    found = Fit(weighed, curve, fit.covariance[k], own, own.num_dwells * fit.misfit.shape[2], slow)
    return row_of(own, residual_degrees(found), split(found, rig, same=SAME))


def row_of(dwells: Dwells, degrees: int, parts: Sequence[Part]) -> tuple:
    """One device's entries in the order of `SUFFIXES`; the covariances' lower triangles by rows, one after another.

    Degrees of freedom of what is stated are 0, since a table's number may not be infinite for every reader.
    """
    lower = [p.covariance[np.tril_indices(len(p.covariance))] for p in parts]
    turns = int(np.sum(np.asarray(dwells.position) < 0))
    return (
        dwells.num_dwells,
        turns,
        degrees,
        [p.source for p in parts],
        [p.degrees if math.isfinite(p.degrees) else 0.0 for p in parts],
        np.concatenate(lower).tolist() if lower else [],
    )


def parts_of(row: dict, triad: str) -> tuple[Part, ...]:
    """The parts that a row of the results' table holds; none where it was not taken apart."""
    sources = row.get(f"{triad}_sources") or []
    if not sources:
        return ()
    lower = np.asarray(row[f"{triad}_source_covariances"], float).reshape(len(sources), -1)
    size = int(round(0.5 * (math.sqrt(8 * lower.shape[1] + 1) - 1)))
    i, j = np.tril_indices(size)
    parts = []
    for source, degrees, values in zip(sources, row[f"{triad}_source_degrees"], lower, strict=True):
        full = np.zeros((size, size))
        full[i, j] = full[j, i] = values
        parts.append(Part(source, degrees or math.inf, full))
    return tuple(parts)
