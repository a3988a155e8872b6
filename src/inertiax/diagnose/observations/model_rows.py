"""The model that the user means to fit, on blocks: its fit, its residuals, its Jacobian.

Rows are observations: |a| − g for the invariant accelerometer estimator, an output less the model for
the others, one chain of rows per channel.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._typing import AnyArray
from ...data.recording import Campaign
from ...physics.error_model import AccelerometerErrors, compensate_accel
from .blocks import Blocks


LOWER = tuple((i, j) for i in range(3) for j in range(i + 1))
FULL = tuple((i, j) for i in range(3) for j in range(3))
MISALIGNED = 0.02  # rad, usual size of a misalignment
CHANGING = 0.1  # part of it that usually changes with temperature


class ModelForm(eqx.Module):
    """Which model of one triad: estimator, degree in temperature, and whether D is in it."""

    triad: str = eqx.field(static=True)
    estimator: str = eqx.field(static=True)  # invariant | reference | static
    degree: int = eqx.field(static=True)
    g_sensitivity: bool = eqx.field(static=True)
    low: float = eqx.field(static=True)  # °C
    high: float = eqx.field(static=True)
    gravity: float = eqx.field(static=True)  # m/s²

    @property
    def matrix(self) -> tuple[tuple[int, int], ...]:
        """Free elements of the matrix."""
        return {"invariant": LOWER, "reference": FULL, "static": ()}[self.estimator]

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters at one temperature, in order."""
        names = [f"{self.triad}.bias[{i}]" for i in range(3)]
        names += [f"{self.triad}.matrix[{i},{j}]" for i, j in self.matrix]
        if self.g_sensitivity:
            names += [f"{self.triad}.g_sensitivity[{i},{j}]" for i, j in FULL]
        return tuple(names)

    def basis(
        self, temperature: Float[AnyArray, " time"] | None, num: int
    ) -> Float[np.ndarray, "time size"]:
        """Chebyshev polynomials of temperature, one row per sample."""
        if self.degree == 0 or temperature is None:
            return np.ones((num, 1))
        x = (2.0 * np.asarray(temperature) - (self.low + self.high)) / (self.high - self.low)
        return np.polynomial.chebyshev.chebvander(x, self.degree)


class Baseline(eqx.Module):
    """A fitted model of one triad, on blocks."""

    form: ModelForm
    coefficients: Float[np.ndarray, "parameter size"]
    observed: tuple[Float[np.ndarray, " block"], ...]  # residual rows, one chain each
    columns: tuple[
        Float[np.ndarray, "block column"], ...
    ]  # minus the residual's Jacobian, chain by chain
    index: tuple[np.ndarray, ...]  # which flat coefficients the columns belong to
    loads: tuple[
        Float[np.ndarray, "block channel"], ...
    ]  # how an output's change enters each chain
    input: Float[np.ndarray, "block 3"]  # what the triad feels, m/s² or rad/s

    def rows(self, addition: Float[np.ndarray, "block 3 column"]) -> list[np.ndarray]:
        """What an addition to the outputs does to the rows of each chain, `(block, column)`."""
        if len(self.observed) == 1:
            return [np.einsum("bcq,bc->bq", addition, self.loads[0])]
        return [addition[:, c] for c in range(3)]


def choose(campaign: Campaign, blocks: Blocks, triad: str) -> ModelForm | None:
    """The form that `[model]` asks for, or what the columns allow; `None` where the triad is absent."""
    if getattr(blocks, triad) is None:
        return None
    model = campaign.model
    asked = model.accel_estimator if triad == "accel" else model.gyro_estimator
    rests = np.unique(blocks.position[~blocks.moving])
    if asked is None:
        if getattr(blocks, f"reference_{triad}") is not None:
            asked = "reference"
        elif triad == "accel" and len(rests) >= 9:
            asked = "invariant"
        else:
            asked = "static"
    # Rests only tell the bias: rotation between rests (`gravity`) is no row of theirs.
    estimator = "static" if asked == "gravity" else asked
    if estimator == "reference" and getattr(blocks, f"reference_{triad}") is None:
        raise ValueError(
            f"`diagnose(campaign)`: [model] {triad}_estimator is 'reference' but there are no "
            f"reference_{triad}_x/y/z columns; add them or choose another estimator."
        )
    low, high = 0.0, 1.0
    if blocks.temperature is not None:
        low, high = float(blocks.temperature.min()), float(blocks.temperature.max())
        high = max(high, low + 1e-3)
    degree = model.temperature_degree
    if degree is None:
        degree = 3 if blocks.temperature is not None and high - low > 8.0 else 0
    if degree and blocks.temperature is None:
        raise ValueError(
            f"`diagnose(campaign)`: [model] temperature_degree is {degree} but there is no "
            "'temperature' column; add it or set temperature_degree = 0."
        )
    d = bool(model.g_sensitivity) and triad == "gyro" and blocks.accel is not None
    return ModelForm(triad, estimator, degree, d, low, high, campaign.site.gravity)


def usable(form: ModelForm, blocks: Blocks) -> np.ndarray:
    """Which blocks the form has rows for: all where a reference tells what is felt, otherwise the rests.

    The gyros' only where the device did not move in a rest that was found in the data.
    """
    if form.estimator == "reference":
        return np.ones(blocks.num_blocks, bool)
    return ~blocks.moving & ~(blocks.moved & (form.triad == "gyro"))


@jax.jit
def _specific_force(
    bias: Float[AnyArray, "row 3"],
    matrix: Float[AnyArray, "row 3 3"],
    output: Float[AnyArray, "row 3"],
) -> Float[Array, "row 3"]:
    def one(b, m, a):
        return compensate_accel(AccelerometerErrors(b, m), a)

    return jax.vmap(one)(jnp.asarray(bias), jnp.asarray(matrix), jnp.asarray(output))


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
    return np.asarray(_specific_force(*errors_at(form, coefficients, basis), output))


def _spread(per_parameter: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Columns of parameters at a temperature to columns of their coefficients, parameter-major."""
    return (per_parameter[:, :, None] * basis[:, None, :]).reshape(len(basis), -1)


def _invariant(form: ModelForm, coefficients: np.ndarray, blocks: Blocks, basis: np.ndarray):
    """Residual g − |a|, its Jacobian with turned sign, loads of the three outputs on |a|, and a."""
    bias, matrix = errors_at(form, coefficients, basis)
    force = np.asarray(_specific_force(bias, matrix, blocks.accel))
    size = np.linalg.norm(force, axis=1)
    # Regressors must not carry the residual: the force has the size g, and a rest has one direction.
    mean = _dwell_mean(force / size[:, None], blocks.dwell)
    direction = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    force = form.gravity * direction
    turned = np.swapaxes(np.eye(3) + matrix, 1, 2)
    gain = np.linalg.solve(turned, direction[:, :, None])[:, :, 0]
    per_parameter = [gain[:, i] for i in range(3)] + [
        gain[:, i] * force[:, j] for i, j in form.matrix
    ]
    return size - form.gravity, _spread(np.stack(per_parameter, axis=1), basis), gain, force


def _dwell_mean(values: np.ndarray, dwell: np.ndarray) -> np.ndarray:
    """Each row replaced by the mean over its dwell."""
    _, which, count = np.unique(dwell, return_inverse=True, return_counts=True)
    total = np.zeros((len(count), values.shape[1]))
    np.add.at(total, which, values)
    return (total / count[:, None])[which]


def _fit_invariant(form: ModelForm, blocks: Blocks, weights: np.ndarray) -> Baseline:
    basis = form.basis(blocks.temperature, blocks.num_blocks)
    assert blocks.accel is not None  # an accelerometer's form
    coefficients = _start(form, blocks.accel, basis.shape[1])
    tight = _firmness(form, basis.shape[1])
    for _ in range(12):
        residual, jacobian, gain, force = _invariant(form, coefficients, blocks, basis)
        scatter = max(1.0, float(np.sqrt(np.mean(np.square(residual * weights)))))
        rows = np.concatenate([jacobian * (weights / scatter)[:, None], np.diag(tight)])
        right = np.concatenate([residual * weights / scatter, -tight * coefficients.reshape(-1)])
        step = np.linalg.lstsq(rows, right, rcond=1e-12)[0]
        coefficients = coefficients + step.reshape(coefficients.shape)
        if np.linalg.norm(jacobian @ step) < 1e-10 * form.gravity * np.sqrt(len(residual)):
            break
    residual, jacobian, gain, force = _invariant(form, coefficients, blocks, basis)
    return Baseline(
        form,
        coefficients,
        (residual,),
        (jacobian,),
        (np.arange(jacobian.shape[1]),),
        (gain,),
        force,
    )


def _firmness(form: ModelForm, size: int) -> Float[np.ndarray, " coefficient"]:
    """One over the usual size of misalignments, zero for everything else.

    Positions along the axes tell |a| of a misalignment only in second order: without this, angles of tenths of a radian
    would follow the noise, and their squares would bend the other parameters. Other positions tell far more than this.
    """
    made = np.zeros((len(form.names), size))
    for k, (i, j) in enumerate(form.matrix):
        if i != j:
            made[3 + k] = 1.0 / (CHANGING * MISALIGNED)
            made[3 + k, 0] = 1.0 / MISALIGNED
    return made.reshape(-1)


def _start(form: ModelForm, output: np.ndarray, size: int) -> np.ndarray:
    """Bias and scale from the range of each output: near enough for Gauss-Newton."""
    high, low = output.max(axis=0), output.min(axis=0)
    coefficients = np.zeros((len(form.names), size))
    scale = 0.5 * (high - low) / form.gravity
    if np.all((scale > 0.8) & (scale < 1.25)):
        return coefficients  # SI outputs of a fair triad: zero is nearer than the extremes
    coefficients[:3, 0] = 0.5 * (high + low)
    for k, (i, j) in enumerate(form.matrix):
        if i == j:
            coefficients[3 + k, 0] = scale[i] - 1.0
    return coefficients


def fit(
    form: ModelForm,
    blocks: Blocks,
    force: Float[np.ndarray, "block 3"] | None,
    weights: list[np.ndarray] | None = None,
) -> Baseline:
    """Least squares of the form on the blocks, weighted where `weights` gives 1/σ per chain.

    `force` is the specific force in g, for the gyros' matrix D.
    """
    white = getattr(blocks, f"{form.triad}_white")
    if form.estimator == "invariant":
        if weights is None:
            weights = [1.0 / np.sqrt(white.mean(axis=1))]
        return _fit_invariant(form, blocks, weights[0])
    basis = form.basis(blocks.temperature, blocks.num_blocks)
    output = getattr(blocks, form.triad)
    reference = getattr(blocks, f"reference_{form.triad}")
    given = np.zeros_like(output) if reference is None else reference
    felt = (
        np.zeros_like(output) if force is None else force
    )  # unknown: no g-sensitivity in the form
    names = form.names
    coefficients = np.zeros((len(names), basis.shape[1]))
    observed, columns, index = [], [], []
    for c in range(3):
        mine = [k for k, name in enumerate(names) if name.split("[")[1][0] == str(c)]
        parts = []
        for k in mine:
            kind = names[k].split(".")[1].split("[")[0]
            j = int(names[k][-2])
            parts.append(
                np.ones(len(basis))
                if kind == "bias"
                else given[:, j]
                if kind == "matrix"
                else felt[:, j]
            )
        jacobian = _spread(np.stack(parts, axis=1), basis)
        y = output[:, c] - given[:, c]
        w = 1.0 / np.sqrt(white[:, c]) if weights is None else weights[c]
        norm = np.linalg.norm(jacobian * w[:, None], axis=0) + 1e-300
        solution = np.linalg.lstsq(jacobian * w[:, None] / norm, y * w, rcond=1e-10)[0] / norm
        coefficients[mine] = solution.reshape(len(mine), -1)
        observed.append(y - jacobian @ solution)
        columns.append(jacobian)
        size = basis.shape[1]
        index.append(np.concatenate([np.arange(k * size, (k + 1) * size) for k in mine]))
    ones = tuple(np.ones((blocks.num_blocks, 1)) for _ in range(3))
    return Baseline(form, coefficients, tuple(observed), tuple(columns), tuple(index), ones, given)


def rows_at(base: Baseline, blocks: Blocks, force: Float[np.ndarray, "block 3"] | None) -> Baseline:
    """The rows of other blocks under a fitted baseline's coefficients; `force` as for `fit`."""
    form = base.form
    if form.estimator == "invariant":
        basis = form.basis(blocks.temperature, blocks.num_blocks)
        residual, jacobian, gain, felt = _invariant(form, base.coefficients, blocks, basis)
        index = (np.arange(jacobian.shape[1]),)
        return Baseline(form, base.coefficients, (residual,), (jacobian,), index, (gain,), felt)
    own = fit(form, blocks, force)
    change = (own.coefficients - base.coefficients).reshape(-1)
    observed = tuple(y + x @ change[k] for y, x, k in zip(own.observed, own.columns, own.index))
    return Baseline(form, base.coefficients, observed, own.columns, own.index, own.loads, own.input)
