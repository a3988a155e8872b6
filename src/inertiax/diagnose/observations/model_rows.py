"""The model that was calibrated, on blocks: its residuals and their Jacobian, as its own estimator gives them.

Rows are observations: |a| − g for the invariant accelerometer estimator, an output less the model for
the others, one chain of rows per channel. They are linearised at the calibration's own parameters.
"""

import re
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..._jax import eqx
from ..._typing import AnyArray
from ...calibrate.results import DeviceResult, TriadResult
from ...calibration.over_rows import solved
from ...estimators import AbstractEstimator, ESTIMATORS, GravityRotation, StaticGyro
from ...physics.temperature import Polynomial
from ...procedure.single_device import linearise
from ...reduction.dwells import Dwells, is_told
from .blocks import Blocks, Log


_ELEMENT = re.compile(r"(\w+)\.(\w+)\[(\d)(?:,(\d))?\]")


class ModelForm(eqx.Module):
    """Which model of one triad, as it was calibrated."""

    triad: str = eqx.field(static=True)
    estimator: str = eqx.field(static=True)  # a name of `[model]`
    degree: int = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)  # parameters at one temperature, in order
    low: float = eqx.field(static=True)  # °C
    high: float = eqx.field(static=True)
    gravity: float = eqx.field(static=True)  # m/s²

    @property
    def by_reference(self) -> bool:
        """Whether its rows need what an ideal triad reads."""
        return ESTIMATORS[self.triad][self.estimator].by_reference

    @property
    def by_magnitude(self) -> bool:
        """Whether its rows are of |a|, one chain, instead of one a channel."""
        return ESTIMATORS[self.triad][self.estimator].by_magnitude

    @property
    def matrix(self) -> tuple[tuple[int, int], ...]:
        """Free elements of the matrix, in the order of the parameters from the fourth on."""
        found = [_ELEMENT.fullmatch(n) for n in self.names if ".matrix[" in n]
        return tuple((int(m[3]), int(m[4])) for m in found if m is not None)

    def of_channel(self, channel: int) -> list[int]:
        """Numbers of the parameters that act on one channel's output."""
        found = [_ELEMENT.fullmatch(n) for n in self.names]
        return [k for k, m in enumerate(found) if m is not None and int(m[3]) == channel]

    def basis(
        self, temperature: Float[AnyArray, " time"] | None, num: int
    ) -> Float[np.ndarray, "time size"]:
        """Chebyshev polynomials of temperature, one row per sample."""
        if self.degree == 0 or temperature is None:
            return np.ones((num, 1))
        x = (2.0 * np.asarray(temperature) - (self.low + self.high)) / (self.high - self.low)
        return np.polynomial.chebyshev.chebvander(x, self.degree)


class Baseline(eqx.Module):
    """The calibrated model of one triad, on blocks."""

    form: ModelForm
    coefficients: Float[np.ndarray, "parameter size"]
    observed: tuple[Float[np.ndarray, " block"], ...]  # residual rows, one chain each
    # Minus the residual's Jacobian, chain by chain
    columns: tuple[Float[np.ndarray, "block column"], ...]
    index: tuple[np.ndarray, ...]  # which flat coefficients the columns belong to
    # How an output's change enters each chain
    loads: tuple[Float[np.ndarray, "block channel"], ...]
    input: Float[np.ndarray, "block 3"]  # what the triad feels, m/s² or rad/s

    def rows(self, addition: Float[np.ndarray, "block 3 column"]) -> list[np.ndarray]:
        """What an addition to the outputs does to the rows of each chain, `(block, column)`."""
        if len(self.observed) == 1:
            return [np.einsum("bcq,bc->bq", addition, self.loads[0])]
        return [addition[:, c] for c in range(3)]


class CalibratedTriad(eqx.Module):
    """What was calibrated of one triad: its form, its parameters, and the estimator of its rows."""

    form: ModelForm
    estimator: AbstractEstimator
    coefficients: Float[np.ndarray, "parameter size"]


def calibrated(result: DeviceResult, triad: str) -> CalibratedTriad | None:
    """A triad's model from the device's calibration; `None` where it was not calibrated."""
    found: TriadResult | None = getattr(result, triad)
    spec = getattr(result.model, triad)
    if found is None or spec is None:
        return None
    basis = found.solution.curve.basis
    covered = result.calibration.temperature_range or (0.0, 1.0)
    low, high = float(covered[0]), max(float(covered[1]), float(covered[0]) + 1e-3)
    if isinstance(basis, Polynomial):
        low, high = float(basis.low), float(basis.high)
    coefficients = np.asarray(found.solution.curve.coefficients, float).T
    names = spec.parameters
    if triad == "accel" and result.model.lever_arms:
        names = (*names, *(f"accel.lever_arm[{i},{j}]" for i in range(3) for j in range(3)))
        arms = np.zeros((9, coefficients.shape[1]))
        effects = sorted(result.calibration.effects, key=lambda e: e.channels)
        arms[:, 0] = np.concatenate([np.asarray(e.coefficients) for e in effects])
        coefficients = np.concatenate([coefficients, arms])
    gravity = float(result.calibration.gravity)
    form = ModelForm(triad, spec.estimator, basis.size - 1, names, low, high, gravity)
    return CalibratedTriad(form, _of_rests(found.estimator), coefficients)


def spanning(model: CalibratedTriad, blocks: Blocks) -> CalibratedTriad:
    """A constant model whose scale of temperature holds the rows' temperatures, beside those of its dwells' means.

    Effects are polynomials on [-1, 1]: where one rest was all, its mean alone would be the scale of what moved in it.
    """
    if model.form.degree > 0 or blocks.temperature is None:
        return model
    low = min(model.form.low, float(blocks.temperature.min()))
    high = max(model.form.high, float(blocks.temperature.max()))
    return replace(model, form=replace(model.form, low=low, high=high))


def of_means(triad: str, blocks: Blocks, gravity: float) -> Baseline:
    """A model of three constants, for a triad whose own model is not one of a calibration."""
    low, high = 0.0, 1.0
    if blocks.temperature is not None:
        low, high = float(blocks.temperature.min()), float(blocks.temperature.max())
    names = tuple(f"{triad}.bias[{i}]" for i in range(3))
    form = ModelForm(triad, "static", 0, names, low, max(high, low + 1e-3), gravity)
    means = np.mean(getattr(blocks, triad), axis=0)[:, None]
    return Baseline(form, means, (), (), (), (), np.zeros((blocks.num_blocks, 3)))


def _of_rests(estimator: AbstractEstimator) -> AbstractEstimator:
    """The estimator of the rows at rest; gyros that gravity turns show their bias and D there."""
    if isinstance(estimator, GravityRotation):
        estimator = StaticGyro(gravity=estimator.gravity, g_sensitivity=estimator.g_sensitivity)
    return eqx.tree_at(lambda e: e.scatter, estimator, np.zeros(()))


def usable(form: ModelForm, blocks: Blocks) -> np.ndarray:
    """Which blocks the form has rows for: all where a reference tells what is felt, otherwise the rests.

    A hand that holds a device turns it, which gyros see; it pushes it nowhere for long, so |a| stays that of gravity.
    """
    if form.by_magnitude:
        return ~blocks.moving
    if not form.by_reference:
        return ~blocks.moving & ~blocks.held
    if form.triad == "accel" and blocks.reference_accel is not None:
        return np.asarray(is_told(blocks.reference_accel))
    return np.ones(blocks.num_blocks, bool)


def _specific_force(
    bias: Float[np.ndarray, "row 3"],
    matrix: Float[np.ndarray, "row 3 3"],
    output: Float[np.ndarray, "row 3"],
) -> Float[np.ndarray, "row 3"]:
    return np.ascontiguousarray(solved(np.moveaxis(matrix, 0, 2), (output - bias).T).T)


def _outputs(
    bias: Float[np.ndarray, "row 3"],
    matrix: Float[np.ndarray, "row 3 3"],
    force: Float[np.ndarray, "row 3"],
) -> Float[np.ndarray, "row 3"]:
    return force + np.einsum("rij,rj->ri", matrix, force) + bias


def expected_output(
    model: CalibratedTriad, log: Log, blocks: Blocks
) -> Float[np.ndarray, "time 3"] | None:
    """(E + Γ) times the reference at every sample, which is the output but for the bias; `None` without a reference.

    Γ is that of the blocks' mean temperature: its change over temperature moves nothing within a block.
    """
    given = getattr(log, f"reference_{model.form.triad}")
    if not model.form.by_reference or given is None:
        return None
    basis = model.form.basis(blocks.temperature, blocks.num_blocks).mean(axis=0, keepdims=True)
    _, (matrix,) = errors_at(model.form, model.coefficients, basis)
    return given @ (np.eye(3) + matrix).T


def errors_at(
    form: ModelForm, coefficients: np.ndarray, basis: np.ndarray
) -> tuple[Float[np.ndarray, "row 3"], Float[np.ndarray, "row 3 3"]]:
    """Bias and matrix at each row of a basis."""
    values = basis @ coefficients.T
    matrix = np.zeros((len(basis), 3, 3))
    for k, (i, j) in enumerate(form.matrix):
        matrix[:, i, j] = values[:, 3 + k]
    return values[:, :3], matrix


def compensated(
    form: ModelForm, coefficients: np.ndarray, basis: np.ndarray, output: np.ndarray
) -> np.ndarray:
    """Specific force by equation (3) at each row, m/s²."""
    return _specific_force(*errors_at(form, coefficients, basis), output)


def rows(
    model: CalibratedTriad, blocks: Blocks, force: Float[np.ndarray, "block 3"] | None
) -> Baseline:
    """The model's residuals on the blocks and their Jacobian at its own parameters.

    `force` is the specific force in g, for the gyros' matrix D.
    """
    form = model.form
    basis = form.basis(blocks.temperature, blocks.num_blocks)
    dwells = _as_dwells(form, blocks, force)
    if form.by_magnitude:
        return _invariant_rows(model, blocks, basis, dwells)
    misfit, jacobian = _linearised(model, basis, dwells)
    given = getattr(blocks, f"reference_{form.triad}")
    given = np.zeros((blocks.num_blocks, 3)) if given is None else given
    misfit, jacobian = _with_lever_arms(model, blocks, basis, misfit, jacobian)
    observed, columns, index = [], [], []
    size = basis.shape[1]
    for c in range(3):
        seen = [k for k in form.of_channel(c) if np.any(jacobian[:, c, k])]
        observed.append(misfit[:, c])
        columns.append(_spread(-jacobian[:, c, seen], basis, form, seen))
        kept = [(k, size if ".lever_arm" not in form.names[k] else 1) for k in seen]
        index.append(np.concatenate([np.arange(k * size, k * size + n) for k, n in kept]))
    ones = tuple(np.ones((blocks.num_blocks, 1)) for _ in range(3))
    return Baseline(
        form, model.coefficients, tuple(observed), tuple(columns), tuple(index), ones, given
    )


def _invariant_rows(
    model: CalibratedTriad, blocks: Blocks, basis: np.ndarray, dwells: Dwells
) -> Baseline:
    """Residual |a| − g, its Jacobian with turned sign, the outputs' loads on |a|, and a.

    Regressors must not carry the residual: they are taken at outputs that the model itself gives for a force
    of the size g in the mean direction of each rest.
    """
    form = model.form
    bias, matrix = errors_at(form, model.coefficients, basis)
    assert blocks.accel is not None  # whose magnitude it is
    force = _specific_force(bias, matrix, blocks.accel)
    mean = _dwell_mean(force / np.linalg.norm(force, axis=1, keepdims=True), blocks.dwell)
    force = form.gravity * mean / np.linalg.norm(mean, axis=1, keepdims=True)
    clean = eqx.tree_at(lambda d: d.accel, dwells, _outputs(bias, matrix, force))
    misfit, _ = _linearised(model, basis, dwells)
    _, jacobian = _linearised(model, basis, clean)
    columns = -jacobian[:, 0]
    return Baseline(
        form,
        model.coefficients,
        (misfit[:, 0],),
        (_spread(columns, basis, form, range(len(form.names))),),
        (np.arange(len(form.names) * basis.shape[1]),),
        (columns[:, :3],),  # an output acts as minus a bias does
        force,
    )


def _linearised(
    model: CalibratedTriad, basis: np.ndarray, dwells: Dwells
) -> tuple[Float[np.ndarray, "block row"], Float[np.ndarray, "block row parameter"]]:
    """Misfits in SI and their Jacobian by the parameters of the form; zero for those that rests do not show."""
    form, estimator = model.form, model.estimator
    place = [form.names.index(n) for n in estimator.names]
    vectors = basis @ model.coefficients[place].T
    now = linearise(estimator, vectors, dwells)
    full = np.zeros((*now.residual.shape, len(form.names)))
    full[:, :, place] = now.jacobian
    return now.residual, full


def _as_dwells(
    form: ModelForm, blocks: Blocks, force: Float[np.ndarray, "block 3"] | None
) -> Dwells:
    """Blocks as an estimator takes them, each of unit covariance, so that residuals are in SI units."""
    num = blocks.num_blocks
    unit = np.broadcast_to(np.eye(3), (num, 3, 3))
    by_force = None if force is None else force * form.gravity
    accel, gyro = blocks.accel if form.triad == "accel" else by_force, None
    if form.triad == "gyro":
        gyro = blocks.gyro
    return Dwells(
        time=blocks.time,
        duration=np.ones(num),
        count=np.ones(num),
        temperature=np.zeros(num) if blocks.temperature is None else blocks.temperature,
        experiment=blocks.experiment,
        position=blocks.position,
        valid=np.ones(num, bool),
        accel=accel,
        accel_covariance=None if accel is None else unit,
        gyro=gyro,
        gyro_covariance=None if gyro is None else unit,
        reference_accel=blocks.reference_accel if form.triad == "accel" else None,
        reference_gyro=blocks.reference_gyro if form.triad == "gyro" else None,
    )


def _with_lever_arms(
    model: CalibratedTriad,
    blocks: Blocks,
    basis: np.ndarray,
    misfit: np.ndarray,
    jacobian: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """The rows beside lever arms that were fitted, with their columns: the size effect is linear in them."""
    form = model.form
    mine = [k for k, n in enumerate(form.names) if ".lever_arm" in n]
    if not mine or blocks.reference_gyro is None:
        return misfit, jacobian
    # s_i = [(E + Γ) (ω × (ω × R_i))]_i by the lever arms' components
    w = blocks.reference_gyro
    each = w[:, :, None] * w[:, None, :] - np.square(w).sum(axis=1)[:, None, None] * np.eye(3)
    axes = np.eye(3) + errors_at(form, model.coefficients, basis)[1]
    shape = np.einsum("nij,ci->ncij", axes @ each, np.eye(3)).reshape(len(w), 3, 9)
    jacobian = jacobian.copy()
    jacobian[:, :, mine] = -shape
    return misfit - shape @ model.coefficients[mine, 0], jacobian


def _spread(per_parameter: np.ndarray, basis: np.ndarray, form: ModelForm, which) -> np.ndarray:
    """Columns of parameters at a temperature to columns of their coefficients, parameter-major.

    Lever arms are constant over temperature.
    """
    made = [
        per_parameter[:, n, None] * (basis[:, :1] if ".lever_arm" in form.names[k] else basis)
        for n, k in enumerate(which)
    ]
    return np.concatenate(made, axis=1)


def _dwell_mean(values: np.ndarray, dwell: np.ndarray) -> np.ndarray:
    """Each row replaced by the mean over its dwell."""
    _, which, count = np.unique(dwell, return_inverse=True, return_counts=True)
    total = np.zeros((len(count), values.shape[1]))
    np.add.at(total, which, values)
    return (total / count[:, None])[which]
